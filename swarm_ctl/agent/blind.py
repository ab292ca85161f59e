"""What is known of walls that a silent rangefinder saw last: they stand where they stood."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from swarm_ctl.autopilot.telemetry import Telemetry
from swarm_ctl.model import Vec3

LATE_S = 0.15
"""A rangefinder tells ten times a second; who has said nothing for longer has missed its turn."""
FORGOTTEN_M = 1.5
"""Beyond this from where it was seen, a wall says nothing of what stands beside the vehicle."""
BEAM_BEARINGS_RAD = (0.0, math.pi, -math.pi / 2.0, math.pi / 2.0)
"""Front, back, left and right, clockwise from the heading; then come up and down."""


class Remembered(NamedTuple):
    """A wall that was seen a while ago."""

    direction: Vec3
    """Unit vector of the beam that saw it, NED."""
    distance_m: float
    """Along it, from where the vehicle is now."""


NO_WALLS: Sequence[Remembered] = ()


def sight(
    telemetry: Telemetry, now: float, stale_s: float
) -> tuple[list[float], Sequence[Remembered]]:
    """Give ranges as far as they are known, inf for the others, and what those saw last.

    What was told a moment ago is shortened by what was flown since; what is older than `stale_s`
    is no range any more: nobody knows what else came near meanwhile.
    """
    ranges_m = list(telemetry.ranges_m)
    walls: list[Remembered] = []
    for index, heard_s in enumerate(telemetry.ranges_s):
        if now - heard_s <= LATE_S or ranges_m[index] == math.inf:
            continue
        wall = _remembered(telemetry, index)
        if now - heard_s > stale_s:
            ranges_m[index] = math.inf
            walls += [] if wall is None else [wall]
        elif wall is not None:  # else the estimate jumped: nobody flew so far
            ranges_m[index] = wall.distance_m
    return ranges_m, walls


def _remembered(telemetry: Telemetry, index: int) -> Remembered | None:
    (n0, e0, d0), yaw_rad = telemetry.ranges_from[index]
    n, e, d = telemetry.position_ned_m
    if math.dist((n, e, d), (n0, e0, d0)) > FORGOTTEN_M:
        return None
    if index < len(BEAM_BEARINGS_RAD):
        bearing_rad = yaw_rad + BEAM_BEARINGS_RAD[index]
        x, y, z = math.cos(bearing_rad), math.sin(bearing_rad), 0.0
    else:
        x, y, z = 0.0, 0.0, -1.0 if index == len(BEAM_BEARINGS_RAD) else 1.0
    flown_m = (n - n0) * x + (e - e0) * y + (d - d0) * z
    return Remembered(Vec3(x, y, z), telemetry.ranges_m[index] - flown_m)
