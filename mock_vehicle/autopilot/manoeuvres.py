"""What a mode makes a flying vehicle do: each manoeuvre steers by the latest state."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from mock_vehicle.autopilot import rally
from mock_vehicle.autopilot.traits import Manoeuvre
from mock_vehicle.dynamics import Control

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

POSITION, VELOCITY = Control.POSITION, Control.VELOCITY
NAN = math.nan
Vector = tuple[float, float, float]
STILL: Vector = (0.0, 0.0, 0.0)
NOWHERE: Vector = (NAN, NAN, NAN)
BRAKED_M_S = 0.3
"""Slower than this a vehicle that was told to hold takes its position."""
HOME_REACHED_M = 0.5
CLIMBED_M = 0.3
"""So near below its height a climb is over."""
NEAR_M = 1.0
"""Nearer than this to a place the position is held; further off a speed is planned."""
COURSE_M = 2.0
"""Nearer than this to a place the nose stays where it is."""
CIRCLE_GAIN_1_S = 2.0
"""Speed towards a circle per distance from it."""
ORBIT_M_S = 3.0
"""How fast circles are flown that say nothing of it."""
REACTION_S = 0.3
"""A climb is planned this far ahead: ticks, delays and jerk limits eat as much."""


class Setpoint(NamedTuple):
    """An understood SET_POSITION_TARGET_LOCAL_NED in local NED; NaN is not given."""

    position_m: Vector = NOWHERE
    velocity_m_s: Vector = NOWHERE
    acceleration_m_s2: Vector = NOWHERE
    yaw_rad: float = NAN
    yaw_rate_rad_s: float = NAN

    @property
    def is_position_only(self) -> bool:
        """Whether it may be flown for ever."""
        return self.velocity_m_s == STILL or not any(
            map(math.isfinite, self.velocity_m_s + self.acceleration_m_s2)
        )

    def climbs_from(self, down_m: float) -> bool:
        """Whether it asks to leave the ground."""
        climbs_to = self.position_m[2] < down_m - 0.1
        return climbs_to or self.velocity_m_s[2] < -0.05 or self.acceleration_m_s2[2] < 0.0


@dataclass
class Orbit:
    """A circle that is flown, and how much of it."""

    centre_m: Vector = NOWHERE
    radius_m: float = 1.0
    speed_m_s: float = 0.0
    """Positive is clockwise, seen from above."""
    turned_rad: float = 0.0
    bearing_rad: float = NAN
    """Of the vehicle, seen from the centre, when it was last steered."""


STOP = Setpoint(velocity_m_s=STILL)


def rotated(vector: Vector, yaw_rad: float) -> Vector:
    """Turn a level body vector (forward, right, down) into NED."""
    forward, right, down = vector
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return (cos * forward - sin * right, sin * forward + cos * right, down)


def fall(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - manoeuvres have one signature
    """Leave the motors off."""
    autopilot.truth.control[autopilot.index] = Control.OFF


def sink(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Descend level, wherever the wind blows."""
    autopilot.command(Control.VELOCITY, (0.0, 0.0, autopilot.traits.sink_m_s))


def hold(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Brake, then hold the place where the vehicle has come to rest."""
    state = autopilot.state
    if autopilot.hold_at is None and abs(state.down_m_s) < BRAKED_M_S:
        _stay_when_braked(autopilot)
    if autopilot.hold_at is None:
        autopilot.command(Control.VELOCITY)
    else:
        autopilot.command(Control.POSITION, position_m=autopilot.hold_at)


def take_off(autopilot: Autopilot, now: float) -> None:
    """Climb straight up to the height of the take-off, slower near its end."""
    state, traits = autopilot.state, autopilot.traits
    if autopilot.hold_at is None:
        autopilot.hold_at = (state.north_m, state.east_m, -autopilot.takeoff_height_m)
    missing = state.down_m + autopilot.takeoff_height_m
    if missing <= traits.takeoff_slack_m:
        autopilot.takeoff_done(now)
        return
    soon = max(missing + REACTION_S * state.down_m_s, 0.0)
    braking = math.sqrt(2.0 * traits.limits.vertical.position_accel_m_s2 * soon)
    climb = min(traits.takeoff_gain_1_s * soon, traits.takeoff_speed_m_s, braking)
    north, east, _ = autopilot.hold_at
    autopilot.command(Control.POSITION, (0.0, 0.0, -climb), (north, east, NAN))


def follow_setpoint(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Fly the last setpoint; an acceleration alone is a velocity that grows."""
    setpoint = autopilot.setpoint
    velocity = setpoint.velocity_m_s
    position = setpoint.position_m
    is_slowed = autopilot.speed_m_s is not None and autopilot.auto_rules.slows_setpoints
    if is_slowed and setpoint.is_position_only and all(map(math.isfinite, position)):
        _fly_to(autopilot, position, setpoint.yaw_rad)
        return
    if not all(map(math.isfinite, velocity)):
        velocity = _velocity(autopilot)
    has_position = position is not NOWHERE and any(map(math.isfinite, position))
    autopilot.command(
        POSITION if has_position else VELOCITY,
        velocity,
        position,
        setpoint.yaw_rad,
        setpoint.yaw_rate_rad_s,
    )


def go_home(autopilot: Autopilot, now: float) -> None:
    """Brake, climb to the height of the return, fly back above home, wait there, and land."""
    state = autopilot.state
    if autopilot.return_m is None:
        autopilot.return_m = rally.place_to_return(autopilot)
    distance_m = math.dist(autopilot.return_m, state[:2])
    if autopilot.hold_at is None:
        autopilot.command(Control.VELOCITY)
        if math.hypot(state.north_m_s, state.east_m_s) < BRAKED_M_S:
            home_down_m = autopilot.navigation.home_m[2]
            height_m = autopilot.traits.going_home.height(home_down_m - state.down_m, distance_m)
            autopilot.hold_at = (state.north_m, state.east_m, home_down_m - height_m)
        return
    if state.down_m < autopilot.hold_at[2] + CLIMBED_M:
        autopilot.hold_at = (*autopilot.return_m, autopilot.hold_at[2])
    autopilot.command(Control.POSITION, position_m=autopilot.hold_at)
    if autopilot.hold_at[:2] == autopilot.return_m and distance_m < HOME_REACHED_M:
        if autopilot.home_at is None:
            autopilot.home_at = now
        if now - autopilot.home_at >= autopilot.traits.going_home.wait_s:
            autopilot.begin(Manoeuvre.LAND, now)


def go(autopilot: Autopilot, now: float) -> None:
    """Fly straight to a place, nose ahead, braking in time, and stay there."""
    if autopilot.hold_at is None:
        hold(autopilot, now)
    else:
        _fly_to(autopilot, autopilot.hold_at)


def _fly_to(autopilot: Autopilot, place_m: Vector, yaw_rad: float = NAN) -> None:
    distance_m = math.dist(place_m, autopilot.state[:3])
    if distance_m < NEAR_M:
        autopilot.command(Control.POSITION, position_m=place_m, yaw_rad=yaw_rad)
        return
    north, east, down = (
        (there - here) / distance_m
        for there, here in zip(place_m, autopilot.state[:3], strict=True)
    )
    speed = _speed_along(autopilot, (north, east, down), distance_m)
    is_far = math.hypot(north, east) * distance_m > COURSE_M
    if is_far and math.isnan(yaw_rad) and math.isnan(autopilot.heading_rad):
        yaw_rad = math.atan2(east, north)
    velocity = (speed * north, speed * east, speed * down)
    autopilot.command(Control.VELOCITY, velocity, yaw_rad=yaw_rad)


def _speed_along(autopilot: Autopilot, direction: Vector, distance_m: float) -> float:
    """Plan a speed that is gained slowly, and lost again before the end of the way."""
    rules, loop = autopilot.auto_rules, autopilot.traits.limits.horizontal
    along = sum(v * d for v, d in zip(autopilot.state[3:6], direction, strict=True))
    gained = max(along, 0.0) + rules.accel_m_s2 / loop.velocity_gain_1_s
    braking = math.sqrt(2.0 * rules.brake_m_s2 * distance_m)
    steepest = rules.sink_m_s if direction[2] > 0.0 else rules.climb_m_s
    vertical = steepest / max(abs(direction[2]), 1e-6)
    return min(autopilot.cruise_m_s, gained, braking, vertical)


def circle(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Fly round a place, nose to it, onto the circle and along it."""
    state, orbit = autopilot.state, autopilot.orbit
    north, east = state.north_m - orbit.centre_m[0], state.east_m - orbit.centre_m[1]
    bearing = math.atan2(east, north)
    if math.isfinite(orbit.bearing_rad):
        orbit.turned_rad += abs(math.remainder(bearing - orbit.bearing_rad, math.tau))
    orbit.bearing_rad = bearing
    limit = abs(orbit.speed_m_s)
    outwards = CIRCLE_GAIN_1_S * (orbit.radius_m - math.hypot(north, east))
    outwards = max(min(outwards, limit), -limit)
    velocity = rotated((outwards, orbit.speed_m_s, 0.0), bearing)
    height = (NAN, NAN, orbit.centre_m[2])
    autopilot.command(Control.POSITION, velocity, height, bearing + math.pi)


def land(autopilot: Autopilot, now: float) -> None:
    """Brake, and descend where the vehicle is, perhaps after a pause."""
    height = -autopilot.state.down_m
    speed = next(speed for above, speed in autopilot.traits.land_speeds_m_s if height > above)
    if now < autopilot.descends_at:
        speed = 0.0
    if autopilot.hold_at is None:
        _stay_when_braked(autopilot)
    if autopilot.hold_at is None:
        autopilot.command(Control.VELOCITY, (0.0, 0.0, speed))
    else:
        north, east, _ = autopilot.hold_at
        autopilot.command(Control.POSITION, (0.0, 0.0, speed), (north, east, NAN))


def _stay_when_braked(autopilot: Autopilot) -> None:
    """Take this place to hold, once the vehicle is slow."""
    state = autopilot.state
    if math.hypot(state.north_m_s, state.east_m_s) < BRAKED_M_S:
        autopilot.hold_at = state[:3]


def _velocity(autopilot: Autopilot) -> Vector:
    """Complete the velocity of a setpoint that does not give all its axes."""
    setpoint = autopilot.setpoint
    gain = autopilot.traits.limits.horizontal.velocity_gain_1_s
    axes = zip(setpoint.velocity_m_s, setpoint.acceleration_m_s2, autopilot.state[3:6], strict=True)
    north, east, down = (
        wanted
        if math.isfinite(wanted)
        else current + acceleration / gain
        if math.isfinite(acceleration)
        else 0.0
        for wanted, acceleration, current in axes
    )
    return (north, east, down)


FLY: Mapping[Manoeuvre, Callable[[Autopilot, float], None]] = {
    Manoeuvre.HOLD: hold,
    Manoeuvre.TAKEOFF: take_off,
    Manoeuvre.SETPOINT: follow_setpoint,
    Manoeuvre.GO: go,
    Manoeuvre.CIRCLE: circle,
    Manoeuvre.RETURN: go_home,
    Manoeuvre.LAND: land,
    Manoeuvre.SINK: sink,
    Manoeuvre.FALL: fall,
}
