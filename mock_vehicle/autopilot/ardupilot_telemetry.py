"""Messages that ArduPilot alone sends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot import (
    clock,
    fences,
    gnss,
    imu,
    progress,
    ranging,
    requests,
    status,
    streams,
)
from mock_vehicle.autopilot.clock import boot_ms
from mock_vehicle.autopilot.gnss import e7, place_of
from mock_vehicle.autopilot.link import Encoder
from mock_vehicle.autopilot.manoeuvres import STILL
from mock_vehicle.autopilot.traits import Manoeuvre
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

AHRS = wire.message("AHRS")
AHRS2 = wire.message("AHRS2")
EKF_STATUS_REPORT = wire.message("EKF_STATUS_REPORT")
ESC_TELEMETRY = wire.message("ESC_TELEMETRY_1_TO_4")
MEMINFO = wire.message("MEMINFO")
NAV_CONTROLLER_OUTPUT = wire.message("NAV_CONTROLLER_OUTPUT")
PARAM_VALUE = wire.message("PARAM_VALUE")
POSITION_TARGET_GLOBAL_INT = wire.message("POSITION_TARGET_GLOBAL_INT")
POSITION_TARGET_LOCAL_NED = wire.message("POSITION_TARGET_LOCAL_NED")
POWER_STATUS = wire.message("POWER_STATUS")
RC_CHANNELS = wire.message("RC_CHANNELS")
TERRAIN_REPORT = wire.message("TERRAIN_REPORT")
WIND = wire.message("WIND")

FRAME_LOCAL_NED = 1
VELOCITY_MASK, POSITION_MASK, BOTH_MASK = 0xC07, 0xDF8, 0xC00
STICKS_US = (1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800)
"""What SITL's own pilot holds."""
HOVER_RPM = 4000


def ekf_status_report(autopilot: Autopilot, now: float) -> None:
    """Send EKF_STATUS_REPORT."""
    flags = status.estimator_flags(autopilot, now)
    doubtful = autopilot.navigation.silent_s(now) >= autopilot.traits.doubt_s
    variance = 1.0 if doubtful and autopilot.has_position(now) else 0.005
    autopilot.send(EKF_STATUS_REPORT, flags, variance, variance, 0.0003, 0.006, 0.0, 0.0)


def position_target(autopilot: Autopilot, now: float) -> None:
    """Send POSITION_TARGET_LOCAL_NED, only while GUIDED follows something."""
    if autopilot.manoeuvre is not Manoeuvre.SETPOINT:
        return
    setpoint = autopilot.setpoint
    has_position = all(map(math.isfinite, setpoint.position_m))
    has_velocity = setpoint.velocity_m_s != STILL or not has_position
    mask = BOTH_MASK if has_velocity else POSITION_MASK
    moves = setpoint.position_m + setpoint.velocity_m_s + setpoint.acceleration_m_s2
    autopilot.send(
        POSITION_TARGET_LOCAL_NED,
        boot_ms(autopilot, now),
        FRAME_LOCAL_NED,
        mask if has_position else VELOCITY_MASK,
        *(value if math.isfinite(value) else 0.0 for value in moves),
        0.0,
        0.0,
    )


def nav_controller_output(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send NAV_CONTROLLER_OUTPUT: lean wanted, and the way to where it holds."""
    s = autopilot.state
    north, east, down = autopilot.hold_at or s[:3]
    away = (north - s.north_m, east - s.east_m)
    distance = math.hypot(*away)
    bearing = round(math.degrees(math.atan2(away[1], away[0]))) % 360 if distance > 0.5 else 0
    lean = (math.degrees(s.roll_rad), math.degrees(s.pitch_rad))
    ahead = streams.clamped(distance, 0, 0xFFFF)
    autopilot.send(NAV_CONTROLLER_OUTPUT, *lean, bearing, bearing, ahead, s.down_m - down, 0.0, 0.0)


def ahrs(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Send AHRS: no drift, no error."""
    autopilot.send(AHRS, 0.0, 0.0, 0.0, 0.0, 0.0, 0.001, 0.001)


def ahrs2(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Send AHRS2, the second estimator, which agrees with the first."""
    s, place = autopilot.state, place_of(autopilot)
    known = autopilot.navigation.has_origin
    autopilot.send(
        AHRS2,
        s.roll_rad,
        s.pitch_rad,
        s.yaw_rad,
        place.amsl_m if known else 0.0,
        e7(place.latitude_deg) if known else 0,
        e7(place.longitude_deg) if known else 0,
    )


def power_status(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Send POWER_STATUS."""
    autopilot.send(POWER_STATUS, 5000, 0, 0)


def meminfo(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Send MEMINFO."""
    autopilot.send(MEMINFO, 0, 0xFFFF, 131_072)


def rc_channels(autopilot: Autopilot, now: float) -> None:
    """Send RC_CHANNELS: SITL has a pilot who never moves."""
    unused = (0,) * (18 - len(STICKS_US))
    autopilot.send(RC_CHANNELS, boot_ms(autopilot, now), len(STICKS_US), *STICKS_US, *unused, 255)


def esc_telemetry(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Send ESC_TELEMETRY_1_TO_4."""
    s = autopilot.state
    share = streams.thrust(autopilot) / autopilot.traits.motors.hover_thrust
    volts = streams.clamped(autopilot.battery_v * 100.0, 0, 0xFFFF)
    amperes = streams.clamped(s.battery_current_a * 25.0, 0, 0xFFFF)
    rpm = streams.clamped(HOVER_RPM * math.sqrt(share), 0, 0xFFFF)
    autopilot.send(
        ESC_TELEMETRY, (25,) * 4, (volts,) * 4, (amperes,) * 4, (0,) * 4, (rpm,) * 4, (0,) * 4
    )


def terrain_report(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Send TERRAIN_REPORT: nothing is known of the terrain."""
    place = place_of(autopilot)
    latitude, longitude = e7(place.latitude_deg), e7(place.longitude_deg)
    autopilot.send(TERRAIN_REPORT, latitude, longitude, 0, 0.0, 0.0, 0, 0)


def wind(autopilot: Autopilot, now: float) -> None:
    """Send WIND once there is a position; the mock does not estimate it."""
    if autopilot.has_position(now):
        autopilot.send(WIND, 0.0, 0.0, 0.0)


STREAMS: Mapping[int, Encoder] = {
    **streams.STREAMS,
    **ranging.STREAMS,
    **status.STREAMS,
    **clock.STREAMS,
    **gnss.STREAMS,
    **imu.STREAMS,
    **imu.ARDUPILOT_STREAMS,
    **requests.MESSAGES,
    AHRS.id: ahrs,
    AHRS2.id: ahrs2,
    EKF_STATUS_REPORT.id: ekf_status_report,
    ESC_TELEMETRY.id: esc_telemetry,
    fences.FENCE_STATUS.id: fences.fence_status,
    MEMINFO.id: meminfo,
    progress.MISSION_CURRENT.id: progress.mission_current,
    NAV_CONTROLLER_OUTPUT.id: nav_controller_output,
    PARAM_VALUE.id: requests.nothing,
    POSITION_TARGET_GLOBAL_INT.id: requests.nothing,
    POSITION_TARGET_LOCAL_NED.id: position_target,
    POWER_STATUS.id: power_status,
    RC_CHANNELS.id: rc_channels,
    TERRAIN_REPORT.id: terrain_report,
    WIND.id: wind,
    requests.AVAILABLE_MODES_ID: requests.nothing,
}
"""Messages with an interval, by id; the same that REQUEST_MESSAGE gives."""
