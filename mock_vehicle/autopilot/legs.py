"""How each NAV_ item of a mission is flown, and the DO_ items that are commands as well."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mock_vehicle.autopilot import places
from mock_vehicle.autopilot.auto_rules import REPORTED
from mock_vehicle.autopilot.manoeuvres import ORBIT_M_S, Orbit
from mock_vehicle.autopilot.plans import Cmd
from mock_vehicle.autopilot.progress import MISSION_ITEM_REACHED, Leg
from mock_vehicle.autopilot.traits import Manoeuvre, Severity

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

STOPPED_M = 0.5
"""Nearer than this to a place to stop at a vehicle is there."""


def say(autopilot: Autopilot, text: str, now: float) -> None:
    """Say what there is to say."""
    if text:
        autopilot.say(Severity.INFO, text, now)


def reach(autopilot: Autopilot, leg: Leg, now: float) -> None:
    """Tell once that an item is reached."""
    if leg.is_reached:
        return
    leg.is_reached = True
    progress = autopilot.progress
    progress.reached, progress.reached_at = leg.sequence, now
    autopilot.send(MISSION_ITEM_REACHED, leg.sequence)
    if autopilot.auto_rules.announces and leg.item.command in REPORTED:
        autopilot.say(Severity.INFO, f"Reached command #{leg.sequence}", now)


def take_off_to(autopilot: Autopilot, height_m: float, now: float) -> None:
    """Climb straight up to a height above home."""
    autopilot.takeoff_height_m = max(height_m, -autopilot.state.down_m)
    autopilot.begin(Manoeuvre.TAKEOFF, now)
    say(autopilot, autopilot.auto_rules.takeoff_text.format(height_m), now)


def change_speed(autopilot: Autopilot, params: tuple[float, ...]) -> bool:
    """Obey DO_CHANGE_SPEED, param2 m/s of kind param1, and tell whether it makes sense."""
    kind, speed_m_s = params[:2]
    if kind not in {0.0, 1.0, 2.0, 3.0} or not math.isfinite(speed_m_s):
        return False
    if kind <= 1.0 and speed_m_s > 0.0:
        autopilot.speed_m_s = speed_m_s
    return True


def turn(autopilot: Autopilot, params: tuple[float, ...]) -> bool:
    """Obey CONDITION_YAW: param1 degrees, param3 -1 or 1 the sense, param4 1 for relative."""
    angle_deg, _, sense, is_relative = params[:4]
    if not 0.0 <= angle_deg <= 360.0:
        return False
    start = autopilot.state.yaw_rad if is_relative == 1.0 else 0.0
    signed = -angle_deg if is_relative == 1.0 and sense < 0.0 else angle_deg
    autopilot.heading_rad = start + math.radians(signed)
    return True


@dataclass(frozen=True, slots=True)
class Navigation:
    """How a NAV_ item is flown."""

    begin: Callable[[Autopilot, Leg, float], None]
    fly: Callable[[Autopilot, Leg, float], bool]
    """Go on with it, and tell whether it is done."""


def _begin_takeoff(autopilot: Autopilot, leg: Leg, now: float) -> None:
    height_m = autopilot.takeoff_height_m
    if math.isfinite(leg.item.z):
        height_m = -places.of_item(autopilot, leg.item)[2]
    take_off_to(autopilot, height_m, now)


def _fly_takeoff(autopilot: Autopilot, leg: Leg, now: float) -> bool:  # noqa: ARG001
    return autopilot.flying and autopilot.manoeuvre is Manoeuvre.HOLD


def _begin_place(autopilot: Autopilot, leg: Leg, now: float) -> None:
    autopilot.go_to(places.of_item(autopilot, leg.item), now)
    yaw_deg = leg.item.params[3]
    if autopilot.auto_rules.takes_off_by_itself and math.isfinite(yaw_deg):
        autopilot.heading_rad = math.radians(yaw_deg)


def _fly_waypoint(autopilot: Autopilot, leg: Leg, now: float) -> bool:
    """Stay for param1 s."""
    return _has_arrived(autopilot, leg, now) and _has_waited(leg, now)


def _fly_for_ever(autopilot: Autopilot, leg: Leg, now: float) -> bool:
    _has_arrived(autopilot, leg, now)
    return False


def _begin_landing(autopilot: Autopilot, leg: Leg, now: float) -> None:
    north, east, _ = places.of_item(autopilot, leg.item)
    autopilot.go_to((north, east, autopilot.state.down_m), now)


def _fly_landing(autopilot: Autopilot, leg: Leg, now: float) -> bool:
    """Fly above the place, then land."""
    if autopilot.manoeuvre is Manoeuvre.GO and _has_arrived(autopilot, leg, now):
        if autopilot.auto_rules.reaches_before_landing:
            reach(autopilot, leg, now)
        autopilot.begin(Manoeuvre.LAND, now)
    return not autopilot.flying


def _begin_return(autopilot: Autopilot, leg: Leg, now: float) -> None:
    """Return within the mission, or by a mode that ends it."""
    autopilot.return_in_mission(now)
    if autopilot.mode != autopilot.mission_mode:
        reach(autopilot, leg, now)
        autopilot.progress.is_complete = leg.is_last


def _fly_return(autopilot: Autopilot, leg: Leg, now: float) -> bool:  # noqa: ARG001
    return not autopilot.flying


def _begin_wait(autopilot: Autopilot, leg: Leg, now: float) -> None:
    leg.arrived_at = now
    autopilot.begin(Manoeuvre.HOLD, now)


def _fly_wait(autopilot: Autopilot, leg: Leg, now: float) -> bool:  # noqa: ARG001
    return _has_waited(leg, now)


def _begin_circle(autopilot: Autopilot, leg: Leg, now: float) -> None:
    radius_m = abs(leg.item.params[2]) or 1.0
    centre = places.of_item(autopilot, leg.item)
    autopilot.circle(Orbit(centre, radius_m, math.copysign(ORBIT_M_S, leg.item.params[2])), now)


def _fly_circle(autopilot: Autopilot, leg: Leg, now: float) -> bool:  # noqa: ARG001
    return autopilot.orbit.turned_rad >= math.tau * leg.item.params[0]


def _has_arrived(autopilot: Autopilot, leg: Leg, now: float) -> bool:
    if leg.arrived_at is None and autopilot.hold_at is not None:
        gap_m = math.dist(autopilot.state[:3], autopilot.hold_at)
        name, unit_m = autopilot.auto_rules.radius
        radius_m = autopilot.parameters.finite(name, 0.1 / unit_m, 100.0 / unit_m) * unit_m
        is_stop = autopilot.auto_rules.stops_exactly and (leg.is_last or leg.item.params[0] > 0.0)
        if gap_m < (min(STOPPED_M, radius_m) if is_stop else radius_m):
            leg.arrived_at = now
    return leg.arrived_at is not None


def _has_waited(leg: Leg, now: float) -> bool:
    return leg.arrived_at is not None and not now - leg.arrived_at < leg.item.params[0]


_WAYPOINT = Navigation(_begin_place, _fly_waypoint)
NAVIGATION: Mapping[int, Navigation] = {
    Cmd.NAV_WAYPOINT: _WAYPOINT,
    Cmd.NAV_SPLINE_WAYPOINT: _WAYPOINT,
    Cmd.NAV_LOITER_TIME: _WAYPOINT,
    Cmd.NAV_LOITER_TO_ALT: _WAYPOINT,
    Cmd.NAV_LOITER_UNLIM: Navigation(_begin_place, _fly_for_ever),
    Cmd.NAV_LOITER_TURNS: Navigation(_begin_circle, _fly_circle),
    Cmd.NAV_TAKEOFF: Navigation(_begin_takeoff, _fly_takeoff),
    Cmd.NAV_LAND: Navigation(_begin_landing, _fly_landing),
    Cmd.NAV_RETURN_TO_LAUNCH: Navigation(_begin_return, _fly_return),
    Cmd.NAV_DELAY: Navigation(_begin_wait, _fly_wait),
}
"""How NAV_ items are flown, by MAV_CMD; all other items are done on the way."""
GROUND_COMMANDS = frozenset({Cmd.NAV_TAKEOFF, Cmd.NAV_LAND, Cmd.NAV_RETURN_TO_LAUNCH})
"""What can be begun on the ground."""
