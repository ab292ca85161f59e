"""Check a mission's world the way the mock will, before anything flies."""

from __future__ import annotations

import math
from typing import NamedTuple

from mock_vehicle.errors import MockVehicleError
from mock_vehicle.shards import choose, divide, parse_addresses
from mock_vehicle.world import load_world
from swarm_ctl.errors import MockError
from swarm_ctl.flight import Shard
from swarm_ctl.mission import Mission


class WorldFacts(NamedTuple):
    """What a person wants to know about a world."""

    name: str
    size: str
    victims: int


def check_world(mission: Mission, shards: int = 1) -> WorldFacts:
    """Load the world and place the vehicles of all shards; MockError with its own sentence if not.

    Each shard has as many vehicles as the mission.
    """
    try:
        world = load_world(mission.simulated)
        world.starts(shards * mission.vehicles, mission.seed)
    except MockVehicleError as error:
        raise MockError(str(error)) from error
    above_m = (world.spec.ceiling_m or math.inf) - mission.flight.height_m
    if above_m < mission.limits.wall_m:
        raise MockError(
            f"{world.path}: ceiling_m: {world.spec.ceiling_m:g} m is too low to fly at flight."
            f"height_m ({mission.flight.height_m:g}) with limits.wall_m "
            f"({mission.limits.wall_m:g}) above it"
        )
    north, east, _ = (world.high_ned_m - world.low_ned_m).tolist()
    return WorldFacts(world.name, f"{east:.0f} m x {north:.0f} m", len(world.victims))


def take_shard(mission: Mission, addresses: str, number: int | None) -> Shard:
    """Give the part of a mission that is flown `number`th, of those at these addresses."""
    try:
        places = parse_addresses(addresses)
        part = choose(len(places) * mission.vehicles, places, number)
    except ValueError as error:
        raise MockError(str(error)) from None
    first = 1 + part.own.start - part.members.start
    sysids = range(first, first + len(part.own))
    is_grouped = len(part.members) < part.vehicles
    return Shard(part.shard, addresses, part.vehicles, part.group, sysids, is_grouped)


def check_shards(mission: Mission, shards: int) -> None:
    """Refuse a number of shards that are no MAVLink networks; MockError says how many are."""
    try:
        divide(shards * mission.vehicles, shards)
    except ValueError as error:
        raise MockError(str(error)) from None
