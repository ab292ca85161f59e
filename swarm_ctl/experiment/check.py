"""Check a mission's world the way the mock will, before anything flies."""

from __future__ import annotations

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
    north, east, _ = (world.high_ned_m - world.low_ned_m).tolist()
    return WorldFacts(world.name, f"{east:.0f} m x {north:.0f} m", len(world.victims))
