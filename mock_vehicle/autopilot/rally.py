"""Rally points: where a vehicle returns to when one is nearer than home."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mock_vehicle.autopilot import places
from mock_vehicle.autopilot.plans import Kind

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

LIMIT = "RALLY_LIMIT_KM"
"""ArduPilot ignores points further away than this; 0 is no limit."""


def place_to_return(autopilot: Autopilot) -> tuple[float, float]:
    """Give north and east, m, of home or the rally point that is nearest."""
    here = autopilot.state[:2]
    limit_km = autopilot.parameters.finite(LIMIT) if LIMIT in autopilot.parameters else 0.0
    points = [
        places.of_item(autopilot, item)[:2]
        for item in autopilot.plans.stored[Kind.RALLY]
        if autopilot.navigation.has_origin
    ]
    limit_m = limit_km * 1e3 or math.inf
    near = [point for point in points if math.dist(point, here) <= limit_m]
    return min([autopilot.navigation.home_m[:2], *near], key=lambda point: math.dist(point, here))
