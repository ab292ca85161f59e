"""What may be wrong with a vehicle's rangefinders, as far as it shows on the ground."""

from __future__ import annotations

from collections.abc import Iterator

from swarm_ctl.autopilot.telemetry import RANGE_BY_ORIENTATION
from swarm_ctl.doctor.chart import Ranges
from swarm_ctl.doctor.rows import Case

RANGES = "DISTANCE_SENSOR"
SIDES = ("front", "back", "left", "right", "up", "down")
SIDE_BY_ORIENTATION = {
    orientation: SIDES[index] for orientation, index in RANGE_BY_ORIENTATION.items()
}
GOOD_SHARE = 0.7
"""Of the rate that was asked for."""
STANDING_CM = 50
"""A rangefinder of a vehicle on the ground is no higher."""
FEW = 10
"""Readings that say too little of a rangefinder."""


def missing(case: Case) -> Iterator[str]:
    """Find sides that nothing looks at."""
    there = {side for turn, side in SIDE_BY_ORIENTATION.items() if _reports(case, turn)}
    missing = [side for side in SIDES if side not in there]
    if missing and case.chart.measured_s:
        yield f"nothing from {', '.join(missing)}"


def _reports(case: Case, orientation: int) -> bool:
    ranges = case.chart.ranges.get(orientation)
    return ranges is not None and ranges.invalid < ranges.count


def rare(case: Case) -> Iterator[str]:
    """Find rangefinders that speak too rarely."""
    pilot = case.chart.autopilot
    wanted_hz = pilot.streams_hz[RANGES] if pilot else 0.0
    for side, ranges in _sides(case):
        rate_hz = ranges.count / max(case.chart.measured_s, 0.1)
        if rate_hz < GOOD_SHARE * wanted_hz:
            yield f"{side} {rate_hz:.1f} Hz of {wanted_hz:g} Hz"


def dead(case: Case) -> Iterator[str]:
    """Find rangefinders that read nothing but less than they can measure."""
    for side, ranges in _sides(case):
        farthest = max(ranges.readings_cm, default=0)
        if side != "down" and ranges.count >= FEW and farthest < ranges.nearest_cm:
            yield f"{side} reads {farthest * 0.01:g} m, below its {ranges.nearest_m:g} m at least"


def floating(case: Case) -> Iterator[str]:
    """Find a down rangefinder that sees no ground under a vehicle that stands on it."""
    for side, ranges in _sides(case):
        nearest = min(ranges.readings_cm, default=0)
        if side == "down" and ranges.count >= FEW and nearest > STANDING_CM:
            yield f"down reads {nearest * 0.01:g} m at least"


def blind(case: Case) -> Iterator[str]:
    """Find rangefinders whose range is empty."""
    for side, ranges in _sides(case):
        if ranges.farthest_cm <= ranges.nearest_cm:
            yield f"{side} says it reaches {ranges.farthest_m:g} m"


def _sides(case: Case) -> Iterator[tuple[str, Ranges]]:
    for orientation, ranges in case.chart.ranges.items():
        if orientation in SIDE_BY_ORIENTATION:
            yield SIDE_BY_ORIENTATION[orientation], ranges
