"""Places as messages give them, degrees and an altitude in some frame, in local NED."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.plans import INT_MAX, Item

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

Vector = tuple[float, float, float]

AMSL, ABOVE_HOME = "amsl", "above home"
DATUMS: Mapping[int, str] = {
    0: AMSL,
    5: AMSL,
    3: ABOVE_HOME,
    6: ABOVE_HOME,
    # the world is flat, so terrain is where home is
    10: ABOVE_HOME,
    11: ABOVE_HOME,
}
"""What the altitude of a MAV_FRAME counts from."""
GLOBAL = 0


def degrees(degrees_e7: float) -> float:
    """Give the degrees of an integer field; "not given" is NaN."""
    return math.nan if degrees_e7 == INT_MAX else degrees_e7 * 1e-7


def to_local(
    autopilot: Autopilot, frame: int, latitude_deg: float, longitude_deg: float, altitude_m: float
) -> Vector:
    """Give north, east and down, m; what is not given, or of no known frame, is NaN."""
    datum = DATUMS.get(frame)
    home_amsl_m = autopilot.origin.amsl_m - autopilot.navigation.home_m[2]
    amsl_m = altitude_m + (home_amsl_m if datum == ABOVE_HOME else 0.0)
    north_m, east_m, down_m = autopilot.origin.to_local(latitude_deg, longitude_deg, amsl_m)
    return north_m, east_m, down_m if datum else math.nan


def of_item(autopilot: Autopilot, item: Item) -> Vector:
    """Give the place of an item: where it says nothing, or zeros for a place, it is here."""
    here = autopilot.state[:3]
    latitude_deg, longitude_deg = degrees(item.x), degrees(item.y)
    if item.x == item.y == 0:
        latitude_deg = longitude_deg = math.nan
    altitude_m = math.nan if item.z == 0.0 and autopilot.auto_rules.zero_is_here else item.z
    there = to_local(autopilot, item.frame, latitude_deg, longitude_deg, altitude_m)
    return filled(there, here)


def filled(there: Vector, here: Vector) -> Vector:
    """Complete a place by this one, where it says nothing."""
    north, east, down = (
        value if math.isfinite(value) else own for value, own in zip(there, here, strict=True)
    )
    return north, east, down
