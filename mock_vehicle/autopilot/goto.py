"""Flights to places on the globe: commands, setpoints, guided items; attitudes and circles."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from mock_vehicle.autopilot import places
from mock_vehicle.autopilot.commands import SETPOINT, Command, Result, whole
from mock_vehicle.autopilot.manoeuvres import NAN, ORBIT_M_S, Orbit, Setpoint, Vector, rotated
from mock_vehicle.autopilot.plans import ARDUPILOT_RULES, Item, Kind, Outcome, check
from mock_vehicle.autopilot.traits import Severity
from mock_vehicle.dynamics import GRAVITY_M_S2
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.ardupilot import ArduPilot
    from mock_vehicle.autopilot.base import Autopilot
    from mock_vehicle.autopilot.px4 import Px4

GLOBAL_SETPOINT = wire.message("SET_POSITION_TARGET_GLOBAL_INT")
ATTITUDE_SETPOINT = wire.message("SET_ATTITUDE_TARGET")

DO_ORBIT = 34
DO_REPOSITION = 192
GO_THERE = 2
"""MISSION_ITEM.current of a place to fly to; 3 is an altitude to change to."""
CHANGE_MODE = 1
"""MAV_DO_REPOSITION_FLAGS."""
LOCAL_NED, NO_FRAME = 1, 255
HOVER = 0.5
"""The thrust that holds the height."""
STEEPEST_RAD = math.radians(45.0)
IGNORES_ATTITUDE, IGNORES_THRUST = 0x80, 0x40
RESET_HEIGHT_M = 83_000.0
"""Higher than this is no altitude."""


def is_on_globe(latitude_deg: float, longitude_deg: float) -> bool:
    """Whether there is such a place; NaN is none."""
    return abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0


# Commands.


def reposition_px4(autopilot: Px4, command: Command, now: float) -> int:
    """Fly to a place (params 5 to 7, altitude AMSL) and loiter; NaN is here, param4 the yaw."""
    flags = whole(command.params[1])
    if flags != CHANGE_MODE:
        return Result.UNSUPPORTED
    autopilot.loiter(now)
    if autopilot.flying:
        autopilot.go_to(_given_or_here(autopilot, command), now)
        if command.params[0] > 0.0:
            autopilot.speed_m_s = command.params[0]
        if math.isfinite(command.params[3]):
            autopilot.heading_rad = command.params[3]
    return Result.ACCEPTED


def _given_or_here(autopilot: Autopilot, command: Command) -> Vector:
    latitude, longitude, altitude = command.place
    if command.is_int:
        latitude, longitude = (places.degrees(e7) for e7 in command.params[4:6])
    there = places.to_local(autopilot, places.GLOBAL, latitude, longitude, altitude)
    return places.filled(there, autopilot.state[:3])


def orbit_px4(autopilot: Px4, command: Command, now: float) -> int:
    """Circle a place: param1 radius (negative is to the left), param2 speed."""
    radius, speed = command.params[:2]
    autopilot.loiter(now)
    if autopilot.flying:
        speed_m_s = speed if 0.0 < speed < 100.0 else ORBIT_M_S
        radius_m = radius if 1.0 <= abs(radius) < 1000.0 else 25.0
        centre = _given_or_here(autopilot, command)
        autopilot.circle(Orbit(centre, abs(radius_m), math.copysign(speed_m_s, radius_m)), now)
    return Result.ACCEPTED


def reposition_ardupilot(autopilot: ArduPilot, command: Command, now: float) -> int:
    """Fly to a place in GUIDED, or change to it (param2 1); only as a COMMAND_INT."""
    flags = whole(command.params[1]) or 0
    latitude, longitude, altitude = command.place
    if not command.is_int:
        return Result.UNSUPPORTED
    if not autopilot.is_guided and not flags & CHANGE_MODE:
        return Result.DENIED
    if command.frame not in places.DATUMS:
        text = f"Unknown mavlink coordinate frame {command.frame}"
        autopilot.say(Severity.INFO, text, now)
        return Result.DENIED
    if not is_on_globe(latitude, longitude) or not abs(altitude) < RESET_HEIGHT_M:
        return Result.DENIED
    if not autopilot.navigation.has_origin:
        return Result.FAILED
    there = places.to_local(autopilot, command.frame, latitude, longitude, altitude)
    autopilot.guide_to(there, now)
    return Result.ACCEPTED


# Items.


def take_guided_item(autopilot: ArduPilot, item: Item, current: int, now: float) -> int:
    """Fly to an item (current = 2), or to its altitude (3), in GUIDED; a MAV_MISSION_RESULT."""
    result = check(ARDUPILOT_RULES, Kind.MISSION, item)
    if result != Outcome.ACCEPTED:
        return result
    if not autopilot.is_guided or not autopilot.navigation.has_origin:
        return Outcome.ERROR
    there = places.of_item(autopilot, item)
    if current != GO_THERE:
        here = autopilot.hold_at or autopilot.state[:3]
        there = (here[0], here[1], there[2])
    autopilot.guide_to(there, now)
    return Outcome.ACCEPTED


# Setpoints.


def on_global_setpoint(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Take a SET_POSITION_TARGET_GLOBAL_INT as the local setpoint that means the same."""
    v = frame.values
    is_ours = autopilot.accepts_setpoint(v.target_system, v.target_component)
    if is_ours and autopilot.navigation.has_origin:
        autopilot.receive_setpoint(localised(autopilot, v), now)


def on_global_setpoint_px4(autopilot: Px4, frame: wire.Frame, now: float) -> None:
    """Refuse unknown frames, with words."""
    number = frame.values.coordinate_frame
    if number in places.DATUMS:
        on_global_setpoint(autopilot, frame, now)
    else:
        text = f"{GLOBAL_SETPOINT.name} coordinate frame {number} unsupported\t"
        autopilot.say(Severity.CRITICAL, text, now)


def localised(autopilot: Autopilot, values: Any) -> Any:
    """Turn a global setpoint into the values of SET_POSITION_TARGET_LOCAL_NED."""
    latitude, longitude = values.lat_int * 1e-7, values.lon_int * 1e-7
    place = places.to_local(autopilot, values.coordinate_frame, latitude, longitude, values.alt)
    is_known = values.coordinate_frame in places.DATUMS and is_on_globe(latitude, longitude)
    return SETPOINT.values(
        values.time_boot_ms,
        values.target_system,
        values.target_component,
        LOCAL_NED if is_known else NO_FRAME,
        values.type_mask,
        *place,
        *(values.vx, values.vy, values.vz),
        *(values.afx, values.afy, values.afz),
        *(values.yaw, values.yaw_rate),
    )


def on_attitude_setpoint(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Lean as SET_ATTITUDE_TARGET says; the thrust above hovering climbs."""
    v = frame.values
    if autopilot.accepts_setpoint(v.target_system, v.target_component):
        setpoint = _leaning(autopilot, v)
        if setpoint is not None:
            autopilot.receive_attitude(setpoint, now)


def _leaning(autopilot: Autopilot, values: Any) -> Setpoint | None:
    """Accelerate where the thrust points; None for what says nothing."""
    quaternion = [0.0] if values.type_mask & IGNORES_ATTITUDE else values.q
    thrust = HOVER if values.type_mask & IGNORES_THRUST else values.thrust
    size = math.hypot(*quaternion)
    if not (math.isfinite(size) and size > 0.0 and 0.0 <= thrust <= 1.0):
        return None
    w, x, y, z = (value / size for value in quaternion)
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - x * z))))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    forward = GRAVITY_M_S2 * math.tan(_clipped(-pitch))
    right = GRAVITY_M_S2 * math.tan(_clipped(roll))
    north, east, _ = rotated((forward, right, 0.0), yaw)
    climb = (thrust - HOVER) / HOVER * autopilot.auto_rules.climb_m_s
    return Setpoint(
        velocity_m_s=(NAN, NAN, -climb), acceleration_m_s2=(north, east, NAN), yaw_rad=yaw
    )


def _clipped(angle_rad: float) -> float:
    return max(-STEEPEST_RAD, min(STEEPEST_RAD, angle_rad))
