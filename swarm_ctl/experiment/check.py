"""Check a mission's world the way the mock will, before anything flies."""

from __future__ import annotations

import math
from typing import NamedTuple

from mock_vehicle.errors import MockVehicleError
from mock_vehicle.world import load_world
from swarm_ctl.errors import MockError
from swarm_ctl.mission import Mission


class WorldFacts(NamedTuple):
    """What a person wants to know about a world."""

    name: str
    size: str
    victims: int


def check_world(mission: Mission) -> WorldFacts:
    """Load the world and place the vehicles; MockError with the world's own sentence if not."""
    try:
        world = load_world(mission.simulated)
        world.starts(mission.vehicles, mission.seed)
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
