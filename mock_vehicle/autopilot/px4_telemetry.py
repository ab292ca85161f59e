"""Messages that PX4 alone sends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot import clock, gnss, imu, progress, ranging, requests, status, streams
from mock_vehicle.autopilot.clock import boot_ms, boot_us
from mock_vehicle.autopilot.gnss import e7, home_of, place_of
from mock_vehicle.autopilot.link import EARLY_S, Encoder
from mock_vehicle.autopilot.manoeuvres import NAN, NOWHERE, Setpoint
from mock_vehicle.autopilot.px4_traits import (
    AUTO_LAND,
    AUTO_MISSION,
    AUTO_RTL,
    AUTO_TAKEOFF,
    POSCTL,
)
from mock_vehicle.autopilot.traits import Manoeuvre
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

CURRENT_MODE = wire.message("CURRENT_MODE")
ESTIMATOR_STATUS = wire.message("ESTIMATOR_STATUS")
FLIGHT_INFORMATION = wire.message("FLIGHT_INFORMATION")
ODOMETRY = wire.message("ODOMETRY")
OPEN_DRONE_ID_LOCATION = wire.message("OPEN_DRONE_ID_LOCATION")
OPEN_DRONE_ID_SYSTEM = wire.message("OPEN_DRONE_ID_SYSTEM")
POSITION_TARGET_LOCAL_NED = wire.message("POSITION_TARGET_LOCAL_NED")

STANDARD_MODES = {POSCTL: 1, AUTO_RTL: 5, AUTO_MISSION: 6, AUTO_LAND: 7, AUTO_TAKEOFF: 8}
"""MAV_STANDARD_MODE by custom_mode; the others are PX4's own."""
MODES_EVERY_S = 0.5
"""How often PX4 publishes its state though nothing has changed."""
FRAME_LOCAL_NED = 1
ESTIMATOR_AUTOPILOT = 8
POSE_VARIANCE = {0: 0.04, 6: 0.04, 11: 0.003, 15: 0.0004, 18: 0.0004, 20: 0.03}
VELOCITY_VARIANCE = {0: 0.0085, 6: 0.0085, 11: 0.001}


def _triangle(variances: Mapping[int, float]) -> tuple[float, ...]:
    """Fill an upper triangle of covariance: all but the diagonal is unknown."""
    return tuple(variances.get(index, NAN) for index in range(21))


POSE_COVARIANCE, VELOCITY_COVARIANCE = _triangle(POSE_VARIANCE), _triangle(VELOCITY_VARIANCE)
CLIMBING_NOWHERE = (0.0, 0.0, 100.0)
"""Acceleration that PX4 wants before it flies: 100 m/s2 down."""
EPOCH_2019_S = 1_546_300_800


def odometry(autopilot: Autopilot, now: float) -> None:
    """Send ODOMETRY."""
    if not autopilot.has_position(now):
        return
    s = autopilot.state
    autopilot.send(
        ODOMETRY,
        boot_us(autopilot, now),
        FRAME_LOCAL_NED,
        FRAME_LOCAL_NED,
        *s[:3],
        streams.quaternion(s),
        *s[3:6],
        0.0,
        0.0,
        s.yaw_rate_rad_s,
        POSE_COVARIANCE,
        VELOCITY_COVARIANCE,
        0,
        ESTIMATOR_AUTOPILOT,
        0,
    )


def current_mode(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Send CURRENT_MODE: what is flown, and what its user chose."""
    flown, chosen = autopilot.reported_mode, autopilot.mode
    autopilot.send(CURRENT_MODE, STANDARD_MODES.get(flown, 0), flown, chosen)


def changed_mode(autopilot: Autopilot, now: float) -> None:
    """Send CURRENT_MODE when it has changed, or was not told for a while."""
    link, modes = autopilot.to[0], (autopilot.reported_mode, autopilot.mode)
    if link.modes_told != modes or now - link.modes_told_at > MODES_EVERY_S - EARLY_S:
        link.modes_told, link.modes_told_at = modes, now
        current_mode(autopilot, now)


def estimator_status(autopilot: Autopilot, now: float) -> None:
    """Send ESTIMATOR_STATUS."""
    flags = status.estimator_flags(autopilot, now)
    ratios = (0.05, 0.03, 0.01, 0.05, 0.002, NAN)
    autopilot.send(ESTIMATOR_STATUS, boot_us(autopilot, now), flags, *ratios, 0.29, 0.06)


def target(autopilot: Autopilot) -> Setpoint:
    """Give what the position controller follows."""
    if autopilot.manoeuvre is Manoeuvre.SETPOINT:
        return autopilot.setpoint
    return Setpoint(autopilot.hold_at or NOWHERE)


def position_target(autopilot: Autopilot, now: float) -> None:
    """Send POSITION_TARGET_LOCAL_NED; NaN is not wanted."""
    wanted = target(autopilot) if autopilot.armed else Setpoint()
    position, velocity = wanted.position_m, wanted.velocity_m_s
    moves = position + velocity
    mask = sum(1 << bit for bit, value in enumerate(moves) if math.isnan(value))
    acceleration = (0.0, 0.0, 0.0) if autopilot.flying else CLIMBING_NOWHERE
    yaw = wanted.yaw_rad if math.isfinite(wanted.yaw_rad) else autopilot.state.yaw_rad
    yaw_rate = wanted.yaw_rate_rad_s if math.isfinite(wanted.yaw_rate_rad_s) else 0.0
    autopilot.send(
        POSITION_TARGET_LOCAL_NED,
        boot_ms(autopilot, now),
        FRAME_LOCAL_NED,
        mask,
        *moves,
        *acceleration,
        yaw,
        yaw_rate,
    )


def flight_information(autopilot: Autopilot, now: float) -> None:
    """Send FLIGHT_INFORMATION."""
    autopilot.send(FLIGHT_INFORMATION, boot_ms(autopilot, now), 0, 0, 0)


def drone_id_location(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Send OPEN_DRONE_ID_LOCATION."""
    if not autopilot.navigation.has_origin:
        return
    s, place = autopilot.state, place_of(autopilot)
    speed = math.hypot(s.north_m_s, s.east_m_s)
    course_deg = int(math.degrees(math.atan2(s.east_m_s, s.north_m_s)) % 360.0)
    autopilot.send(
        OPEN_DRONE_ID_LOCATION,
        0,
        0,
        b"",
        2 if autopilot.flying else 1,
        course_deg * 100,
        round(speed * 100.0),
        round(-s.down_m_s * 100.0),
        e7(place.latitude_deg),
        e7(place.longitude_deg),
        place.amsl_m,
        float(round(place.amsl_m)),
        0,
        autopilot.navigation.home_m[2] - s.down_m,
        12,
        5,
        0,
        3,
        65535.0,
        0,
    )


def drone_id_system(autopilot: Autopilot, now: float) -> None:
    """Send OPEN_DRONE_ID_SYSTEM: the operator stands where home is."""
    if not autopilot.navigation.has_origin:
        return
    home = home_of(autopilot)
    autopilot.send(
        OPEN_DRONE_ID_SYSTEM,
        0,
        0,
        b"",
        0,
        0,
        e7(home.latitude_deg),
        e7(home.longitude_deg),
        1,
        0,
        -1000.0,
        -1000.0,
        0,
        0,
        home.amsl_m,
        max(clock.unix_us(autopilot, now) // 1_000_000 - EPOCH_2019_S, 0),
    )


STREAMS: Mapping[int, Encoder] = {
    **streams.STREAMS,
    **ranging.STREAMS,
    **status.STREAMS,
    **clock.STREAMS,
    **gnss.STREAMS,
    **imu.STREAMS,
    **imu.PX4_STREAMS,
    gnss.GLOBAL_POSITION_INT.id: gnss.known_global_position,
    gnss.ALTITUDE.id: gnss.altitude,
    clock.PING.id: clock.ask_ping,
    CURRENT_MODE.id: changed_mode,
    ESTIMATOR_STATUS.id: estimator_status,
    progress.MISSION_CURRENT.id: progress.mission_current,
    ODOMETRY.id: odometry,
    OPEN_DRONE_ID_LOCATION.id: drone_id_location,
    OPEN_DRONE_ID_SYSTEM.id: drone_id_system,
    POSITION_TARGET_LOCAL_NED.id: position_target,
}
"""Messages with an interval, by id."""

REQUESTS: Mapping[int, Encoder] = {
    **STREAMS,
    **requests.MESSAGES,
    CURRENT_MODE.id: current_mode,
    FLIGHT_INFORMATION.id: flight_information,
    requests.PROTOCOL_VERSION.id: requests.protocol_version,
    requests.COMPONENT_INFORMATION_ID: requests.nothing,
    requests.COMPONENT_METADATA_ID: requests.nothing,
    requests.AVAILABLE_MODES_ID: requests.nothing,
}
"""Messages that REQUEST_MESSAGE gives, by id."""
