"""How the vehicle moves: attitude, local position, mode, and what is wanted of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.clock import boot_ms, boot_us
from mock_vehicle.autopilot.link import Encoder
from mock_vehicle.dynamics import GRAVITY_M_S2
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot
    from mock_vehicle.autopilot.state import State

ATTITUDE = wire.message("ATTITUDE")
ATTITUDE_QUATERNION = wire.message("ATTITUDE_QUATERNION")
ATTITUDE_TARGET = wire.message("ATTITUDE_TARGET")
EXTENDED_SYS_STATE = wire.message("EXTENDED_SYS_STATE")
HEARTBEAT = wire.message("HEARTBEAT")
LOCAL_POSITION_NED = wire.message("LOCAL_POSITION_NED")
SERVO_OUTPUT_RAW = wire.message("SERVO_OUTPUT_RAW")
VFR_HUD = wire.message("VFR_HUD")

QUADROTOR = 2
ARMED = 128
NO_ROTATION = (0.0, 0.0, 0.0, 0.0)


def clamped(value: float, low: int, high: int) -> int:
    """Round into the range of an integer field."""
    return round(min(max(value, low), high)) if math.isfinite(value) else low


def heartbeat(autopilot: Autopilot, now: float) -> None:
    """Send HEARTBEAT."""
    autopilot.send(
        HEARTBEAT,
        QUADROTOR,
        autopilot.traits.autopilot,
        autopilot.base_mode | (ARMED if autopilot.armed else 0),
        autopilot.reported_mode,
        autopilot.system_status(now),
        3,
    )


def attitude(autopilot: Autopilot, now: float) -> None:
    """Send ATTITUDE."""
    s = autopilot.state
    rates = (0.0, 0.0, s.yaw_rate_rad_s)
    autopilot.send(ATTITUDE, boot_ms(autopilot, now), s.roll_rad, s.pitch_rad, s.yaw_rad, *rates)


def quaternion(state: State) -> tuple[float, float, float, float]:
    """Give the attitude as a quaternion w, x, y, z."""
    cr, sr = math.cos(state.roll_rad / 2), math.sin(state.roll_rad / 2)
    cp, sp = math.cos(state.pitch_rad / 2), math.sin(state.pitch_rad / 2)
    cy, sy = math.cos(state.yaw_rad / 2), math.sin(state.yaw_rad / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def attitude_quaternion(autopilot: Autopilot, now: float) -> None:
    """Send ATTITUDE_QUATERNION."""
    s = autopilot.state
    rates = (0.0, 0.0, s.yaw_rate_rad_s)
    autopilot.send(
        ATTITUDE_QUATERNION, boot_ms(autopilot, now), *quaternion(s), *rates, NO_ROTATION
    )


def attitude_target(autopilot: Autopilot, now: float) -> None:
    """Send ATTITUDE_TARGET; the mock's attitude is what is wanted."""
    s = autopilot.state
    autopilot.send(
        ATTITUDE_TARGET,
        boot_ms(autopilot, now),
        0,
        quaternion(s),
        0.0,
        0.0,
        s.yaw_rate_rad_s,
        thrust(autopilot),
    )


def thrust(autopilot: Autopilot) -> float:
    """Give the thrust, 0..1, that makes the vehicle accelerate as it does."""
    if not autopilot.flying:
        return 0.0
    s = autopilot.state
    lift = 1.0 - float(autopilot.truth.acceleration_ned_m_s2[autopilot.index, 2]) / GRAVITY_M_S2
    upright = max(math.cos(s.roll_rad) * math.cos(s.pitch_rad), 0.1)
    return min(max(autopilot.traits.motors.hover_thrust * lift / upright, 0.0), 1.0)


def servo_output(autopilot: Autopilot, now: float) -> None:
    """Send SERVO_OUTPUT_RAW: four motors that turn alike, us."""
    motors = autopilot.traits.motors
    pulse = motors.disarmed_us
    if autopilot.armed:
        span = (motors.hover_us - motors.idle_us) / motors.hover_thrust
        pulse = clamped(motors.idle_us + span * thrust(autopilot), 0, 2000)
    time_us = boot_us(autopilot, now) & 0xFFFFFFFF
    autopilot.send(SERVO_OUTPUT_RAW, time_us, 0, *(pulse,) * 4, *(motors.unused_us,) * 12)


def local_position(autopilot: Autopilot, now: float) -> None:
    """Send LOCAL_POSITION_NED; while there is no estimate yet nothing is sent."""
    if autopilot.has_position(now):
        autopilot.send(LOCAL_POSITION_NED, boot_ms(autopilot, now), *autopilot.state[:6])


def vfr_hud(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send VFR_HUD."""
    s, traits = autopilot.state, autopilot.traits
    speed = math.hypot(s.north_m_s, s.east_m_s)
    autopilot.send(
        VFR_HUD,
        speed if traits.guesses_airspeed else math.nan,
        speed,
        int(math.degrees(s.yaw_rad)) % 360,
        int(traits.motors.hover_thrust * 100.0) if autopilot.flying else 0,
        autopilot.origin.amsl_m - s.down_m,
        -s.down_m_s,
    )


def extended_sys_state(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send EXTENDED_SYS_STATE."""
    autopilot.send(EXTENDED_SYS_STATE, autopilot.traits.vtol_state, autopilot.landed_state)


STREAMS: Mapping[int, Encoder] = {
    HEARTBEAT.id: heartbeat,
    ATTITUDE.id: attitude,
    ATTITUDE_QUATERNION.id: attitude_quaternion,
    LOCAL_POSITION_NED.id: local_position,
    VFR_HUD.id: vfr_hud,
    EXTENDED_SYS_STATE.id: extended_sys_state,
    ATTITUDE_TARGET.id: attitude_target,
    SERVO_OUTPUT_RAW.id: servo_output,
}
"""What both autopilots send, by message id."""
