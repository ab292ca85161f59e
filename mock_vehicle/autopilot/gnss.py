"""Places on the globe: the fix, the position, the origin, home, and the requests about them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.clock import boot_ms, boot_us
from mock_vehicle.autopilot.commands import Command, Result, acknowledge
from mock_vehicle.autopilot.link import Encoder
from mock_vehicle.geodesy import Origin
from mock_vehicle.sensors.gnss import (
    DEGRADED_FIX,
    LOST_FIX,
    NO_RECEIVER,
    UNKNOWN,
    Fix,
    Reception,
)
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

ALTITUDE = wire.message("ALTITUDE")
GLOBAL_POSITION_INT = wire.message("GLOBAL_POSITION_INT")
GPS_GLOBAL_ORIGIN = wire.message("GPS_GLOBAL_ORIGIN")
GPS_RAW_INT = wire.message("GPS_RAW_INT")
HOME_POSITION = wire.message("HOME_POSITION")
SET_GPS_GLOBAL_ORIGIN = wire.message("SET_GPS_GLOBAL_ORIGIN")

DO_SET_HOME = 179
GET_HOME_POSITION = 410

NOWHERE_YET = (0, 0, 0)


def e7(degrees: float) -> int:
    """Give degrees as the integers of the wire, which end at 214."""
    return round(degrees * 1e7) if abs(degrees) <= 180.0 else 0


def millimetres(metres: float) -> int:
    """Give an altitude as the integers of the wire."""
    return round(metres * 1e3) if abs(metres) < 2e6 else 0


def place_of(autopilot: Autopilot) -> Origin:
    """Give the estimated place; worth something with an origin alone."""
    return autopilot.origin.to_global(*autopilot.state[:3])


def home_of(autopilot: Autopilot) -> Origin:
    """Give the place of home; worth something with an origin alone."""
    return autopilot.origin.to_global(*autopilot.navigation.home_m)


def quality(autopilot: Autopilot, now: float) -> Fix:
    """Give the quality of the fix at this moment."""
    if autopilot.uptime_s(now) < autopilot.boot.gnss_s:
        return NO_RECEIVER
    if not autopilot.receives_gnss:
        return LOST_FIX
    is_degraded = autopilot.state.reception == Reception.DEGRADED
    return DEGRADED_FIX if is_degraded else autopilot.traits.fix


def gps_raw(autopilot: Autopilot, now: float) -> None:
    """Send GPS_RAW_INT: what the receiver says, whatever the estimator makes of it."""
    s, fix = autopilot.state, quality(autopilot, now)
    has_fix = fix.fix_type > LOST_FIX.fix_type
    place = autopilot.navigation.site.to_global(*autopilot.state.fix_m)
    latitude, longitude, altitude = (
        (e7(place.latitude_deg), e7(place.longitude_deg), millimetres(place.amsl_m))
        if has_fix
        else NOWHERE_YET
    )
    speed = math.hypot(s.north_m_s, s.east_m_s)
    course_deg = math.degrees(math.atan2(s.east_m_s, s.north_m_s)) % 360.0
    autopilot.send(
        GPS_RAW_INT,
        boot_us(autopilot, now),
        fix.fix_type,
        latitude,
        longitude,
        altitude,
        fix.eph,
        fix.epv,
        round(speed * 100.0) if has_fix else UNKNOWN,
        int(course_deg * 100.0) % 36000 if has_fix else UNKNOWN,
        fix.satellites,
        altitude,
        fix.h_acc_mm,
        fix.v_acc_mm,
        fix.vel_acc_mm_s,
        0,
        0,
    )


def global_position(autopilot: Autopilot, now: float) -> None:
    """Send GLOBAL_POSITION_INT."""
    s, place = autopilot.state, place_of(autopilot)
    known = autopilot.navigation.has_origin
    autopilot.send(
        GLOBAL_POSITION_INT,
        boot_ms(autopilot, now),
        e7(place.latitude_deg) if known else 0,
        e7(place.longitude_deg) if known else 0,
        millimetres(place.amsl_m) if known else 0,
        millimetres(autopilot.navigation.home_m[2] - s.down_m),
        round(s.north_m_s * 100.0),
        round(s.east_m_s * 100.0),
        round(s.down_m_s * 100.0),
        int(math.degrees(s.yaw_rad) * 100.0) % 36000,
    )


def known_global_position(autopilot: Autopilot, now: float) -> None:
    """Send GLOBAL_POSITION_INT as PX4 does, who says nothing when it knows nothing."""
    if autopilot.navigation.has_home(autopilot, now) and autopilot.has_position(now):
        global_position(autopilot, now)


def altitude(autopilot: Autopilot, now: float) -> None:
    """Send ALTITUDE; the terrain is the floor of the world."""
    height_m = -autopilot.state.down_m
    amsl_m = autopilot.origin.amsl_m + height_m
    above_home_m = height_m + autopilot.navigation.home_m[2]
    autopilot.send(
        ALTITUDE, boot_us(autopilot, now), amsl_m, amsl_m, height_m, above_home_m, 0.0, height_m
    )


def home_position(autopilot: Autopilot, now: float) -> None:
    """Send HOME_POSITION, if there is a home on the globe."""
    if not autopilot.navigation.has_home(autopilot, now):
        return
    home = home_of(autopilot)
    autopilot.send(
        HOME_POSITION,
        e7(home.latitude_deg),
        e7(home.longitude_deg),
        millimetres(home.amsl_m),
        *autopilot.navigation.home_m,
        autopilot.traits.home_attitude,
        0.0,
        0.0,
        0.0,
        boot_us(autopilot, now),
    )


def global_origin(autopilot: Autopilot, now: float) -> None:
    """Send GPS_GLOBAL_ORIGIN, if there is one."""
    if autopilot.navigation.has_origin:
        origin = autopilot.origin
        autopilot.send(
            GPS_GLOBAL_ORIGIN,
            e7(origin.latitude_deg),
            e7(origin.longitude_deg),
            millimetres(origin.amsl_m),
            boot_us(autopilot, now),
        )


# Requests.


def set_home(autopilot: Autopilot, command: Command, now: float) -> int:
    """Take this place (param1 = 1), or the one given, as home."""
    latitude, longitude, amsl_m = command.place
    if command.params[0] == 1.0:
        home = autopilot.state[:3]
    elif autopilot.navigation.has_origin and abs(latitude) <= 90.0 and abs(longitude) <= 180.0:
        home = autopilot.origin.to_local(latitude, longitude, amsl_m)
    else:
        return autopilot.traits.denial
    if not all(map(math.isfinite, home)):
        return autopilot.traits.denial
    autopilot.navigation.set_home(autopilot, home, now)
    return Result.ACCEPTED


def get_home(autopilot: Autopilot, command: Command, now: float) -> int | None:
    """Send HOME_POSITION (the old way to ask)."""
    if not autopilot.navigation.has_home(autopilot, now):
        return autopilot.traits.denial
    acknowledge(autopilot, command, Result.ACCEPTED)
    home_position(autopilot, now)
    if autopilot.traits.gives_origin_with_home:
        global_origin(autopilot, now)
    return None


def on_set_global_origin(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Believe, before satellites tell otherwise, that the local frame lies there."""
    v = frame.values
    place = Origin(v.latitude * 1e-7, v.longitude * 1e-7, v.altitude * 1e-3)
    sane = abs(place.latitude_deg) <= 85.0 and abs(place.longitude_deg) <= 180.0
    asked = v.target_system in {0, autopilot.sysid}
    if asked and sane and not autopilot.navigation.has_origin:
        autopilot.navigation.set_origin(autopilot, place, now)
        global_origin(autopilot, now)


STREAMS: Mapping[int, Encoder] = {
    GPS_RAW_INT.id: gps_raw,
    GLOBAL_POSITION_INT.id: global_position,
    GPS_GLOBAL_ORIGIN.id: global_origin,
    HOME_POSITION.id: home_position,
}
"""What both autopilots send about places, by message id."""

COMMANDS: Mapping[int, Callable[..., int | None]] = {
    DO_SET_HOME: set_home,
    GET_HOME_POSITION: get_home,
}
"""What both do about home, by MAV_CMD."""

MESSAGES: Mapping[int, Callable[..., None]] = {SET_GPS_GLOBAL_ORIGIN.id: on_set_global_origin}
"""What both hear about places, by message id."""
