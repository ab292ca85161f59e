"""What PX4 makes of SET_POSITION_TARGET_LOCAL_NED: axis by axis."""

from __future__ import annotations

import math
from typing import Any

from mock_vehicle.autopilot.manoeuvres import NAN, NOWHERE, STOP, Setpoint, rotated

FRAME_LOCAL_NED, FRAME_BODY_NED = 1, 8
FORCE_BIT, YAW_BIT, YAW_RATE_BIT = 0x200, 0x400, 0x800


def _groups(values: Any) -> Setpoint:
    """Take what is not ignored, axis by axis."""
    _, _, _, _, mask, *given, yaw_rad, yaw_rate_rad_s = values
    x, y, z, vx, vy, vz, ax, ay, az = [
        NAN if mask >> bit & 1 else value for bit, value in enumerate(given)
    ]
    return Setpoint(
        (x, y, z),
        (vx, vy, vz),
        (ax, ay, az),
        NAN if mask & YAW_BIT or not math.isfinite(yaw_rad) else yaw_rad,
        NAN if mask & YAW_RATE_BIT or not math.isfinite(yaw_rate_rad_s) else yaw_rate_rad_s,
    )


def complaint(values: Any) -> str | None:
    """Say why this message does not even count as a setpoint."""
    frame = values.coordinate_frame
    if frame not in {FRAME_LOCAL_NED, FRAME_BODY_NED}:
        return f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported\t"
    setpoint = _groups(values)
    accelerates = not all(map(math.isnan, setpoint.acceleration_m_s2))
    if values.type_mask & FORCE_BIT and accelerates:
        return "SET_POSITION_TARGET_LOCAL_NED force not supported\t"
    moves = setpoint.position_m + setpoint.velocity_m_s + setpoint.acceleration_m_s2
    in_body = frame == FRAME_BODY_NED and not all(map(math.isnan, setpoint.position_m))
    if in_body or all(map(math.isnan, moves)):
        return "SET_POSITION_TARGET_LOCAL_NED invalid\t"
    return None


def read(values: Any, yaw_rad: float) -> Setpoint:
    """Understand a setpoint; one with half a plane or without a vertical axis stops."""
    setpoint = _groups(values)
    moves = (setpoint.position_m, setpoint.velocity_m_s, setpoint.acceleration_m_s2)
    given = [tuple(map(math.isnan, group)) for group in moves]
    if any(map(math.isinf, moves[0] + moves[1] + moves[2])):
        return STOP
    if any(north != east for north, east, _ in given):
        return STOP
    if all(north for north, _, _ in given) or all(down for _, _, down in given):
        return STOP
    if values.coordinate_frame == FRAME_BODY_NED:
        # NaN of an ignored axis must not spread over the others by the rotation.
        return setpoint._replace(
            position_m=NOWHERE,
            velocity_m_s=rotated(setpoint.velocity_m_s, yaw_rad),
            acceleration_m_s2=rotated(setpoint.acceleration_m_s2, yaw_rad),
        )
    return setpoint
