"""What ArduPilot makes of SET_POSITION_TARGET_LOCAL_NED: group by group."""

from __future__ import annotations

import math
from typing import Any

from mock_vehicle.autopilot.manoeuvres import NAN, NOWHERE, STILL, STOP, Setpoint, Vector, rotated

FRAME_LOCAL_NED, FRAME_LOCAL_OFFSET_NED = 1, 7
BODY_FRAMES = frozenset({8, 9})
FRAMES = BODY_FRAMES | {FRAME_LOCAL_NED, FRAME_LOCAL_OFFSET_NED}
POSITION_BITS, VELOCITY_BITS, ACCELERATION_BITS = 0x007, 0x038, 0x1C0
FORCE_BIT, YAW_BIT, YAW_RATE_BIT = 0x200, 0x400, 0x800
FASTEST_SETPOINT = 1000.0
"""A larger number is no velocity."""
FARTHEST_SETPOINT_M = 1e7
"""A larger number is no place."""


def read(values: Any, here: Vector, yaw_rad: float) -> Setpoint:
    """Understand a setpoint by groups: one ignore bit of a group ignores the whole group."""
    frame, mask = values.coordinate_frame, values.type_mask
    has_position = not mask & POSITION_BITS
    has_velocity = not mask & VELOCITY_BITS
    has_acceleration = not mask & ACCELERATION_BITS
    pairs_ill = has_position and has_acceleration and not has_velocity
    forces = has_acceleration and mask & FORCE_BIT
    if frame not in FRAMES or forces or not (has_position or has_velocity or has_acceleration):
        return STOP
    position: Vector = (values.x, values.y, values.z)
    velocity: Vector = (values.vx, values.vy, values.vz)
    acceleration: Vector = (values.afx, values.afy, values.afz)
    if frame in BODY_FRAMES:
        position, velocity = rotated(position, yaw_rad), rotated(velocity, yaw_rad)
        acceleration = rotated(acceleration, yaw_rad)
    if frame != FRAME_LOCAL_NED:
        position = (here[0] + position[0], here[1] + position[1], here[2] + position[2])
    used = [
        *(velocity if has_velocity else ()),
        *(acceleration if has_acceleration and not has_position else ()),
    ]
    # "pos only (vel and acc ignored)"; pos+acc without vel is refused by the firmware.
    is_far = has_position and not all(abs(value) < FARTHEST_SETPOINT_M for value in position)
    if pairs_ill or is_far or not all(abs(value) < FASTEST_SETPOINT for value in used):
        return STOP
    fallback = STILL if has_position or not has_acceleration else NOWHERE
    return Setpoint(
        position if has_position else NOWHERE,
        velocity if has_velocity else fallback,
        acceleration if has_acceleration and not has_position else NOWHERE,
        NAN if mask & YAW_BIT or not math.isfinite(values.yaw) else values.yaw,
        NAN if mask & YAW_RATE_BIT or not math.isfinite(values.yaw_rate) else values.yaw_rate,
    )
