"""What PX4 makes of SET_POSITION_TARGET_LOCAL_NED: axis by axis."""

from __future__ import annotations

import math
from typing import Any

from mock_vehicle.autopilot.manoeuvres import NAN, NOWHERE, STOP, Setpoint, Vector, rotated

FRAME_LOCAL_NED, FRAME_BODY_NED = 1, 8
ALL_AXES = 7
FORCE_BIT, YAW_BIT, YAW_RATE_BIT = 0x200, 0x400, 0x800
VELOCITY_AND_YAW = YAW_RATE_BIT | ALL_AXES << 6 | ALL_AXES
"""The mask that takes nothing else."""


def read(values: Any, yaw_rad: float) -> Setpoint | str:
    """Understand a setpoint; say why if it does not even count as one.

    One with half a plane or without a vertical axis stops.
    """
    _, _, _, frame, mask, x, y, z, vx, vy, vz, ax, ay, az, heading_rad, turn_rad_s = values
    is_usual = frame == FRAME_LOCAL_NED and mask == VELOCITY_AND_YAW
    if is_usual and math.isfinite(vx + vy + vz + heading_rad):  # understood at once
        return Setpoint(NOWHERE, (vx, vy, vz), NOWHERE, heading_rad, NAN)
    if frame not in {FRAME_LOCAL_NED, FRAME_BODY_NED}:
        return f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported\t"
    position = _group((x, y, z), mask & ALL_AXES)
    velocity = _group((vx, vy, vz), mask >> 3 & ALL_AXES)
    acceleration = _group((ax, ay, az), mask >> 6 & ALL_AXES)
    if mask & FORCE_BIT and not _is_empty(acceleration):
        return "SET_POSITION_TARGET_LOCAL_NED force not supported\t"
    in_body = frame == FRAME_BODY_NED and not _is_empty(position)
    if in_body or (_is_empty(velocity) and _is_empty(position) and _is_empty(acceleration)):
        return "SET_POSITION_TARGET_LOCAL_NED invalid\t"
    if not _is_whole(position, velocity, acceleration):
        return STOP
    if frame == FRAME_BODY_NED:
        # NaN of an ignored axis must not spread over the others by the rotation.
        position = NOWHERE
        velocity, acceleration = rotated(velocity, yaw_rad), rotated(acceleration, yaw_rad)
    return Setpoint(
        position,
        velocity,
        acceleration,
        NAN if mask & YAW_BIT or not math.isfinite(heading_rad) else heading_rad,
        NAN if mask & YAW_RATE_BIT or not math.isfinite(turn_rad_s) else turn_rad_s,
    )


def _group(axes: Vector, ignored: int) -> Vector:
    """Take what is not ignored, axis by axis."""
    if not ignored:
        return axes
    if ignored == ALL_AXES:
        return NOWHERE
    north, east, down = axes
    return (
        NAN if ignored & 1 else north,
        NAN if ignored & 2 else east,
        NAN if ignored & 4 else down,
    )


def _is_empty(axes: Vector) -> bool:
    return axes is NOWHERE or all(map(math.isnan, axes))


def _is_whole(*groups: Vector) -> bool:
    """Whether whole planes are given, something level and something upright, all of it finite."""
    level = upright = False
    for axes in groups:
        if axes is not NOWHERE:
            north, east, down = map(math.isnan, axes)
            if north != east or any(map(math.isinf, axes)):
                return False
            level, upright = level or not north, upright or not down
    return level and upright
