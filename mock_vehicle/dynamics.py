"""Point-mass multicopters with the velocity loops of their autopilots, stepped as one fleet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

GRAVITY_M_S2 = 9.80665
UNLIMITED = 1e6
"""Stands for "no limit" where infinity would turn into NaN."""
TINY = 1e-9


class Control(IntEnum):
    """What the vehicle's controller follows."""

    OFF = 0
    """Motors off: falls, or stays on the ground."""
    VELOCITY = 1
    """`target_velocity_ned_m_s`."""
    POSITION = 2
    """`target_position_ned_m` with `target_velocity_ned_m_s` as feed-forward; an axis whose
    target position is NaN follows the velocity alone."""


@dataclass(frozen=True, slots=True)
class Loop:
    """The controller along one axis: horizontal (a plane vector) or vertical."""

    velocity_gain_1_s: float
    """Acceleration demanded per velocity error; larger is stiffer."""
    accel_m_s2: float
    """Largest acceleration demanded of a velocity error."""
    jerk_m_s3: float
    """Steepest change of acceleration, also the curve of the demand for large errors."""
    delay_s: float
    """Pure delay from a velocity target to the first reaction."""
    speed_m_s: float
    """Fastest target; downwards `Limits.sink_m_s` counts."""
    lag_s: float = 0.0
    """First-order lag of thrust behind demand (the attitude loop)."""
    thrust_m_s2: float = GRAVITY_M_S2
    """Largest acceleration of all demands together: the lean limit."""
    integral_1_s2: float = 0.0
    """Larger fights wind sooner."""
    integral_error_m_s: float = UNLIMITED
    """Errors larger than this are not integrated."""
    damping: float = 0.0
    """Demand taken away per acceleration."""
    drag_1_s: float = 0.0
    """Deceleration per airspeed."""
    drag_known: float = 0.0
    """Share of the own drag that the controller feeds forward, 0..1."""
    position_gain_1_s: float = 1.0
    """Speed wanted per position error."""
    position_accel_m_s2: float = UNLIMITED
    """Deceleration planned for when approaching a position; smaller approaches gentler."""


@dataclass(frozen=True, slots=True)
class Limits:
    """How a personality flies."""

    horizontal: Loop
    vertical: Loop
    sink_m_s: float
    """Fastest descent."""
    yaw_rate_rad_s: float
    """Fastest turn."""
    yaw_accel_rad_s2: float
    """Larger turns sooner."""
    yaw_gain_1_s: float
    """Turn rate wanted per heading error."""


class Dynamics:
    """The whole fleet in the world's NED frame; row i of every array is vehicle i.

    Vehicles write `control` and `target_*` in place, sensors read the rest.
    """

    def __init__(
        self,
        n: int,
        position_ned_m: ArrayLike,
        yaw_rad: ArrayLike,
        limits: Sequence[Limits],
    ) -> None:
        if len(limits) != n:
            raise ValueError(f"{n} vehicles need {n} limits, not {len(limits)}")
        self.position_ned_m: Floats = np.array(position_ned_m, dtype=np.float64).reshape(n, 3)
        self.velocity_ned_m_s: Floats = np.zeros((n, 3))
        self.acceleration_ned_m_s2: Floats = np.zeros((n, 3))
        self.roll_rad: Floats = np.zeros(n)
        self.pitch_rad: Floats = np.zeros(n)
        self.yaw_rad: Floats = np.array(yaw_rad, dtype=np.float64).reshape(n)
        self.yaw_rate_rad_s: Floats = np.zeros(n)
        self.on_ground: NDArray[np.bool_] = self.position_ned_m[:, 2] >= 0.0
        self.control: NDArray[np.int8] = np.zeros(n, dtype=np.int8)
        self.target_position_ned_m: Floats = np.full((n, 3), np.nan)
        self.target_velocity_ned_m_s: Floats = np.zeros((n, 3))
        self.target_yaw_rad: Floats = np.full(n, np.nan)
        self.target_yaw_rate_rad_s: Floats = np.full(n, np.nan)
        self._thrust: Floats = np.zeros((n, 3))
        self._integral: Floats = np.zeros((n, 3))
        self._take_coefficients(limits)
        self._delay = _Delay(n, self._delay_s)

    def _take_coefficients(self, limits: Sequence[Limits]) -> None:
        def axes(read: Callable[[Loop], float]) -> Floats:
            rows = [
                (read(one.horizontal), read(one.horizontal), read(one.vertical)) for one in limits
            ]
            return np.array(rows, dtype=np.float64).reshape(-1, 3)

        self._gain = axes(lambda loop: loop.velocity_gain_1_s)
        self._accel = axes(lambda loop: loop.accel_m_s2)
        self._jerk = axes(lambda loop: loop.jerk_m_s3)
        self._delay_s = axes(lambda loop: loop.delay_s)
        self._speed = axes(lambda loop: loop.speed_m_s)
        self._lag_s = axes(lambda loop: loop.lag_s)
        self._thrust_limit = axes(lambda loop: loop.thrust_m_s2)
        self._integral_gain = axes(lambda loop: loop.integral_1_s2)
        self._integral_error = axes(lambda loop: loop.integral_error_m_s)
        self._damping = axes(lambda loop: loop.damping)
        self._drag = axes(lambda loop: loop.drag_1_s)
        self._known_drag = self._drag * axes(lambda loop: loop.drag_known)
        self._position_gain = axes(lambda loop: loop.position_gain_1_s)
        self._position_accel = axes(lambda loop: loop.position_accel_m_s2)
        self._sink = np.array([one.sink_m_s for one in limits])
        self._yaw_rate_limit = np.array([one.yaw_rate_rad_s for one in limits])
        self._yaw_accel = np.array([one.yaw_accel_rad_s2 for one in limits])
        self._yaw_gain = np.array([one.yaw_gain_1_s for one in limits])

    def step(self, dt: float, wind_ned_m_s: Floats | tuple[float, float, float]) -> None:
        """Advance all vehicles by `dt` s in a wind of shape (3,) or (n, 3).

        The ground is z = 0 everywhere; whoever touches it stands still.
        """
        powered = (self.control != Control.OFF)[:, None]
        velocity = self.velocity_ned_m_s
        target = self._delay.push(self._wanted_velocity() * powered, dt)
        self._follow(target - velocity, dt)
        self._thrust *= powered
        self._integral *= powered
        acceleration = self._thrust - self._drag * (velocity - np.asarray(wind_ned_m_s))
        acceleration[:, 2] += GRAVITY_M_S2 * ~powered[:, 0]
        velocity += acceleration * dt
        velocity *= ~(self.on_ground & (velocity[:, 2] >= 0.0))[:, None]
        self.position_ned_m += velocity * dt
        self.acceleration_ned_m_s2[:] = acceleration
        self._turn(dt)
        self._touch_ground()
        self._lean()

    def _wanted_velocity(self) -> Floats:
        """Velocity target of shape (n, 3) after the position loop, within the speed limits."""
        wanted = self.target_velocity_ned_m_s
        positioned = self.control == Control.POSITION
        if positioned.any():
            gap = self.target_position_ned_m - self.position_ned_m
            gap = np.where(positioned[:, None] & np.isfinite(gap), gap, 0.0)
            wanted = wanted + _sqrt_controller(
                gap, self._position_gain, self._position_accel, self._speed
            )
        limit = self._speed.copy()
        np.copyto(limit[:, 2], self._sink, where=wanted[:, 2] > 0.0)
        return _limited(wanted, limit)

    def _follow(self, error: Floats, dt: float) -> None:
        """Move thrust (net of gravity) towards what the velocity error demands."""
        integrated = np.abs(error) < self._integral_error
        self._integral += self._integral_gain * dt * error * integrated
        demand = _sqrt_controller(error, self._gain, self._jerk, self._accel)
        demand += self._integral
        demand -= self._damping * self.acceleration_ned_m_s2
        demand += self._known_drag * self.velocity_ned_m_s
        change = _limited(demand, self._thrust_limit) - self._thrust
        change *= np.minimum(1.0, dt / (self._lag_s + TINY))
        self._thrust += _limited(change, self._jerk * dt)

    def _turn(self, dt: float) -> None:
        error = self.target_yaw_rad - self.yaw_rad
        error = (error + np.pi) % (2.0 * np.pi) - np.pi
        reach = np.minimum(
            0.7 * np.sqrt(2.0 * self._yaw_accel * np.abs(error)), self._yaw_rate_limit
        )
        rate = _within(self._yaw_gain * error, reach)
        rate = np.where(np.isnan(rate), 0.0, rate)
        commanded = self.target_yaw_rate_rad_s
        rate = np.where(np.isnan(commanded), rate, _within(commanded, self._yaw_rate_limit))
        self.yaw_rate_rad_s += _within(rate - self.yaw_rate_rad_s, self._yaw_accel * dt)
        self.yaw_rate_rad_s *= (self.control != Control.OFF) & ~self.on_ground
        self.yaw_rad += self.yaw_rate_rad_s * dt
        self.yaw_rad += np.pi
        self.yaw_rad %= 2.0 * np.pi
        self.yaw_rad -= np.pi

    def _touch_ground(self) -> None:
        np.greater_equal(self.position_ned_m[:, 2], 0.0, out=self.on_ground)
        if self.on_ground.any():
            self.position_ned_m[self.on_ground, 2] = 0.0
            for moving in (
                self.velocity_ned_m_s,
                self.acceleration_ned_m_s2,
                self._thrust,
                self._integral,
            ):
                moving[self.on_ground] = 0.0

    def _lean(self) -> None:
        """Tilt so that the thrust points where the acceleration comes from."""
        north, east = self._thrust[:, 0], self._thrust[:, 1]
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        np.arctan2(-(cos * north + sin * east), GRAVITY_M_S2, out=self.pitch_rad)
        np.arctan2(cos * east - sin * north, GRAVITY_M_S2, out=self.roll_rad)


class _Delay:
    """A pure delay per vehicle and axis, in whole steps."""

    def __init__(self, n: int, delay_s: Floats) -> None:
        self._delay_s = delay_s
        self._dt = 0.0
        self._steps = np.zeros((n, 3), dtype=np.intp)
        self._past = np.zeros((1, n, 3))
        self._head = 0
        self._rows = np.arange(n)[:, None]
        self._columns = np.arange(3)

    def push(self, now: Floats, dt: float) -> Floats:
        if dt != self._dt:
            self._resize(dt)
        length = len(self._past)
        self._head = (self._head + 1) % length
        self._past[self._head] = now
        delayed: Floats = self._past[(self._head - self._steps) % length, self._rows, self._columns]
        return delayed

    def _resize(self, dt: float) -> None:
        """Start anew for another step, as if the last value had always been there."""
        last = self._past[self._head]
        self._steps = np.rint(self._delay_s / dt).astype(np.intp)
        self._past = np.repeat(last[None], int(self._steps.max(initial=0)) + 1, axis=0)
        self._head = 0
        self._dt = dt


def _within(values: Floats, limit: Floats) -> Floats:
    """Clip to -limit..limit; NaN stays NaN."""
    clipped: Floats = np.maximum(np.minimum(values, limit), -limit)
    return clipped


def _magnitude(vectors: Floats) -> Floats:
    """Horizontal norm (twice) and vertical size, shape (n, 3) as the vectors."""
    squares = vectors * vectors
    squares[:, 0] += squares[:, 1]
    squares[:, 1] = squares[:, 0]
    return np.sqrt(squares, out=squares)


def _limited(vectors: Floats, limit: Floats) -> Floats:
    """Shorten vectors that are longer than the limit, direction kept."""
    scale: Floats = limit / np.maximum(_magnitude(vectors), TINY)
    return vectors * np.minimum(scale, 1.0, out=scale)


def _sqrt_controller(error: Floats, gain: Floats, second_order: Floats, limit: Floats) -> Floats:
    """Answer an error in proportion, and a large one by a square root (AP_Math/control.cpp)."""
    size = _magnitude(error)
    linear = second_order / (gain * gain)
    root = np.sqrt(2.0 * second_order * np.maximum(size - linear * 0.5, 0.0))
    answer = np.where(size > linear, root, gain * size)
    return error * (np.minimum(answer, limit) / np.maximum(size, TINY))
