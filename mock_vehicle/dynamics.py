"""Point-mass multicopters with the velocity loops of their autopilots, stepped as one fleet."""

from __future__ import annotations

import importlib.util
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
TURN = 2.0 * np.pi
SINK_M_S = 0.2
"""Who comes down on something faster than this means to stand there."""


class Control(IntEnum):
    """What the vehicle's controller follows."""

    OFF = 0
    """Motors off: falls, or stays on the ground."""
    VELOCITY = 1
    """`target_velocity_ned_m_s`."""
    POSITION = 2
    """`target_position_ned_m` with `target_velocity_ned_m_s` as feed-forward; an axis whose
    target position is NaN follows the velocity alone."""


OFF, POSITION = int(Control.OFF), int(Control.POSITION)
"""For numpy, to which a member of an enumeration is no plain number."""


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
    """Errors larger than this are not integrated, unless they unwind what was."""
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
    position_speed_m_s: float = UNLIMITED
    """Fastest approach to a position; downwards `Limits.position_sink_m_s` counts, too."""


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
    position_sink_m_s: float = UNLIMITED
    """Fastest descent towards a position."""


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
        self._motion: Floats = np.zeros((5, n, 3))
        self.position_ned_m: Floats = self._motion[0]
        self.velocity_ned_m_s: Floats = self._motion[1]
        self.acceleration_ned_m_s2: Floats = self._motion[2]
        self._thrust, self._integral = self._motion[3:]
        self.position_ned_m[:] = np.asarray(position_ned_m, dtype=np.float64).reshape(n, 3)
        self._turning: Floats = np.zeros((4, n))
        self.yaw_rad, self.yaw_rate_rad_s = self._turning[:2]
        self.target_yaw_rad, self.target_yaw_rate_rad_s = self._turning[2:]
        self.yaw_rad[:], self._turning[2:] = yaw_rad, np.nan
        self.ground_m: Floats = np.zeros(n)
        """How far down each finds the ground: 0 is the floor, less what it stands on."""
        self.on_ground: NDArray[np.bool_] = self.position_ned_m[:, 2] >= 0.0
        self.control: NDArray[np.int8] = np.zeros(n, dtype=np.int8)
        self.motor_lost: NDArray[np.bool_] = np.zeros(n, dtype=bool)
        """Who cannot hold its attitude, whatever its controller follows, and drops."""
        self._targets: Floats = np.zeros((2, n, 3))
        self.target_position_ned_m, self.target_velocity_ned_m_s = self._targets
        self.target_position_ned_m[:] = np.nan
        self._wind: Floats = np.zeros((n, 3))
        self._advance: Callable[..., None] | None = None
        self._limits = list(limits)
        self._take_coefficients(self._limits)
        self._delay = _Delay(n, self._delay_s)
        self._dt = 0.0

    def compile(self) -> None:
        """Step by loops that numba compiles, where it is installed; the same bit for bit."""
        if importlib.util.find_spec("numba") is not None:
            self._advance = importlib.import_module("mock_vehicle.motion").advance

    def lean_rad(self) -> tuple[Floats, Floats]:
        """Give roll and pitch, (n,) each: the thrust points where the acceleration comes from."""
        north, east = self._thrust[:, 0], self._thrust[:, 1]
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        roll: Floats = np.arctan2(cos * east - sin * north, GRAVITY_M_S2)
        pitch: Floats = np.arctan2(-(cos * north + sin * east), GRAVITY_M_S2)
        return roll, pitch

    def _take_coefficients(self, limits: Sequence[Limits]) -> None:
        def axes(read: Callable[[Loop], float]) -> Floats:
            rows = [
                (read(one.horizontal), read(one.horizontal), read(one.vertical)) for one in limits
            ]
            return np.array(rows, dtype=np.float64).reshape(-1, 3)

        self._answer = _SqrtController(
            gain=axes(lambda loop: loop.velocity_gain_1_s),
            second_order=axes(lambda loop: loop.jerk_m_s3),
            limit=axes(lambda loop: loop.accel_m_s2),
        )
        self._approach = _SqrtController(
            gain=axes(lambda loop: loop.position_gain_1_s),
            second_order=axes(lambda loop: loop.position_accel_m_s2),
            limit=axes(lambda loop: min(loop.speed_m_s, loop.position_speed_m_s)),
        )
        self._position_sink = np.array([one.position_sink_m_s for one in limits])
        self._jerk = axes(lambda loop: loop.jerk_m_s3)
        self._delay_s = axes(lambda loop: loop.delay_s)
        self._lag_s = axes(lambda loop: loop.lag_s)
        self._thrust_limit = axes(lambda loop: loop.thrust_m_s2)
        self._integral_gain = axes(lambda loop: loop.integral_1_s2)
        self._integral_error = axes(lambda loop: loop.integral_error_m_s)
        self._drag = axes(lambda loop: loop.drag_1_s)
        self._known_drag = self._drag * axes(lambda loop: loop.drag_known)
        self._damping = axes(lambda loop: loop.damping)
        self._has_damping, self._knows_drag = (
            bool(self._damping.any()),
            bool(self._known_drag.any()),
        )
        self._limits_jerk = bool((self._jerk < UNLIMITED).any())
        self._climb = axes(lambda loop: loop.speed_m_s)
        self._sink = self._climb.copy()
        self._sink[:, 2] = [one.sink_m_s for one in limits]
        self._yaw_rate_limit = np.array([one.yaw_rate_rad_s for one in limits])
        self._yaw_accel = np.array([one.yaw_accel_rad_s2 for one in limits])
        self._yaw_gain = np.array([one.yaw_gain_1_s for one in limits])

    def relimit(self, index: int, limits: Limits) -> None:
        """Let a vehicle fly within other limits from now on; delays stay as they are."""
        self._limits[index] = limits
        self._take_coefficients(self._limits)
        self._scale(self._dt)
        self._gather()

    def _take_step(self, dt: float) -> None:
        """Work out what depends on the size of the steps alone."""
        self._dt = dt
        self._scale(dt)
        self._delay.resize(dt)
        self._gather()

    def _scale(self, dt: float) -> None:
        self._integral_step = self._integral_gain * dt
        self._lag_share = np.minimum(1.0, dt / (self._lag_s + TINY))
        self._jerk_step = self._jerk * dt
        self._yaw_step = self._yaw_accel * dt
        self._axes = np.stack(
            (
                self._climb,
                self._sink,
                self._integral_step,
                self._integral_error,
                self._thrust_limit,
                self._lag_share,
                self._jerk_step,
                self._drag,
                self._known_drag,
                self._damping,
            )
        )
        self._loops = np.concatenate((self._answer.rows(), self._approach.rows()))
        self._turn_limits = np.stack(
            (
                self._yaw_rate_limit,
                self._yaw_accel,
                self._yaw_gain,
                self._yaw_step,
                self._position_sink,
            )
        )

    def step(self, dt: float, wind_ned_m_s: Floats | tuple[float, float, float]) -> None:
        """Advance all vehicles by `dt` s in a wind of shape (3,) or (n, 3).

        The ground is z = 0 but for who stands on something (`stand`); whoever touches it stands
        still.
        """
        if dt != self._dt:
            self._take_step(dt)
        if self._advance is not None:
            self._wind[:] = wind_ned_m_s
            self._advance(dt, self._delay.turn(), self._wind, *self._arrays)
            return
        running = (self.control != OFF) & ~self.motor_lost
        powered = running[:, None]
        velocity = self.velocity_ned_m_s
        all_running = bool(running.all())
        wanted = self._wanted_velocity()
        target = self._delay.push(wanted if all_running else wanted * powered)
        self._follow(target - velocity)
        acceleration = self.acceleration_ned_m_s2
        np.multiply(self._drag, wind_ned_m_s - velocity, out=acceleration)
        if not all_running:
            self._thrust *= powered
            self._integral *= powered
            acceleration[:, 2] += GRAVITY_M_S2 * ~running
        acceleration += self._thrust
        velocity += acceleration * dt
        if self.on_ground.any():
            velocity *= (~self.on_ground | (velocity[:, 2] < 0.0))[:, None]
        self.position_ned_m += velocity * dt
        self._turn(dt, running)
        self._touch_ground()

    def _gather(self) -> None:
        """Name what `motion.advance` takes and changes: naming it at each step costs more."""
        self._arrays = (
            (self._has_damping, self._knows_drag, self._limits_jerk),
            self.control,
            self.motor_lost,
            self.on_ground,
            self.ground_m,
            self._motion,
            self._targets,
            self._turning,
            self._axes,
            self._loops,
            self._turn_limits,
            self._delay.past,
            self._delay.delayed,
        )

    def sinks(self, indices: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Tell which of vehicles (k,) drop, or mean to descend."""
        wanted, actual = self.target_velocity_ned_m_s[indices], self.velocity_ned_m_s[indices]
        sinking: NDArray[np.bool_] = np.maximum(wanted[:, 2], actual[:, 2]) > SINK_M_S
        return sinking

    def stand(self, indices: NDArray[np.intp]) -> None:
        """Let vehicles (k,) find ground where they are, until they leave it."""
        self.ground_m[indices] = self.position_ned_m[indices, 2]

    def stop_along(self, indices: NDArray[np.intp], normal: Floats) -> None:
        """Take from vehicles (k,) what goes against a normal, (k, 3): velocity, thrust, wind-up."""
        for motion in (self.velocity_ned_m_s, self._thrust, self._integral):
            moving = motion[indices]
            inward = np.minimum(np.einsum("ij,ij->i", moving, normal), 0.0)
            motion[indices] = moving - inward[:, None] * normal

    def _wanted_velocity(self) -> Floats:
        """Velocity target of shape (n, 3) after the position loop, within the speed limits."""
        wanted = self.target_velocity_ned_m_s
        positioned = self.control == POSITION
        if positioned.any():
            gap = self.target_position_ned_m - self.position_ned_m
            gap = np.where(positioned[:, None] & np.isfinite(gap), gap, 0.0)
            approach = self._approach(gap)
            np.minimum(approach[:, 2], self._position_sink, out=approach[:, 2])
            wanted = wanted + approach
        return _limited(wanted, np.where(wanted > 0.0, self._sink, self._climb))

    def _follow(self, error: Floats) -> None:
        """Move thrust (net of gravity) towards what the velocity error demands."""
        unwinds = error * self._integral < 0.0
        integrated = (np.abs(error) < self._integral_error) | unwinds
        self._integral += self._integral_step * error * integrated
        demand = self._answer(error)
        demand += self._integral
        if self._has_damping:
            demand -= self._damping * self.acceleration_ned_m_s2
        if self._knows_drag:
            demand += self._known_drag * self.velocity_ned_m_s
        change = _limited(demand, self._thrust_limit)
        change -= self._thrust
        change *= self._lag_share
        self._thrust += _limited(change, self._jerk_step) if self._limits_jerk else change

    def _turn(self, dt: float, running: NDArray[np.bool_]) -> None:
        error = self.target_yaw_rad - self.yaw_rad
        error -= TURN * np.rint(error / TURN)
        reach = 0.7 * np.sqrt(2.0 * self._yaw_accel * np.abs(error))
        np.minimum(reach, self._yaw_rate_limit, out=reach)
        towards = _within(self._yaw_gain * error, reach)
        # a commanded rate goes before a heading, and neither is no turn
        rate = np.where(np.isnan(self.target_yaw_rate_rad_s), towards, self.target_yaw_rate_rad_s)
        np.copyto(rate, 0.0, where=np.isnan(rate))
        rate = _within(rate, self._yaw_rate_limit)
        self.yaw_rate_rad_s += _within(rate - self.yaw_rate_rad_s, self._yaw_step)
        self.yaw_rate_rad_s *= running & ~self.on_ground
        self.yaw_rad += self.yaw_rate_rad_s * dt
        self.yaw_rad -= TURN * np.floor(self.yaw_rad / TURN + 0.5)

    def _touch_ground(self) -> None:
        np.greater_equal(self.position_ned_m[:, 2], self.ground_m, out=self.on_ground)
        self.ground_m *= self.on_ground
        if self.on_ground.any():
            self.position_ned_m[self.on_ground, 2] = self.ground_m[self.on_ground]
            for moving in (
                self.velocity_ned_m_s,
                self.acceleration_ned_m_s2,
                self._thrust,
                self._integral,
            ):
                moving[self.on_ground] = 0.0


class _Delay:
    """A pure delay per vehicle and axis, in whole steps."""

    def __init__(self, n: int, delay_s: Floats) -> None:
        self._delay_s = delay_s
        self.past: Floats = np.zeros((1, n, 3))
        """The last values, the newest in row `turn` gave."""
        self.delayed: NDArray[np.intp] = np.zeros((1, n, 3), dtype=np.intp)
        """By that row: where in `past`, counted through, stands what is due."""
        self._head = 0

    def turn(self) -> int:
        """Go on by a step; give the row of the newest values."""
        self._head = (self._head + 1) % len(self.past)
        return self._head

    def push(self, now: Floats) -> Floats:
        """Take the newest values and give those that are due."""
        head = self.turn()
        self.past[head] = now
        due: Floats = self.past.take(self.delayed[head])
        return due

    def resize(self, dt: float) -> None:
        """Start anew for another step, as if the last value had always been there."""
        last = self.past[self._head]
        steps = np.rint(self._delay_s / dt).astype(np.intp)
        length = int(steps.max(initial=0)) + 1
        self.past = np.repeat(last[None], length, axis=0)
        heads = np.arange(length)[:, None, None]
        cells = np.arange(last.size).reshape(last.shape)
        self.delayed = (heads - steps) % length * last.size + cells
        self._head = 0


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
    size = _magnitude(vectors)
    scale: Floats = np.divide(limit, np.maximum(size, TINY, out=size), out=size)
    np.minimum(scale, 1.0, out=scale)
    scale *= vectors
    return scale


class _SqrtController:
    """Answers errors in proportion, and large ones by a square root (AP_Math/control.cpp)."""

    def __init__(self, *, gain: Floats, second_order: Floats, limit: Floats) -> None:
        self._gain, self._limit = gain, limit
        self._linear = second_order / (gain * gain)
        self._half_linear = 0.5 * self._linear
        self._twice_second_order = 2.0 * second_order

    def rows(self) -> Floats:
        """Give gain, limit, end of the proportion, half of it, and twice the second order."""
        return np.stack(
            (
                self._gain,
                self._limit,
                self._linear,
                self._half_linear,
                self._twice_second_order,
            )
        )

    def __call__(self, error: Floats) -> Floats:
        """Give the answer to errors, (n, 3) as the coefficients."""
        size = _magnitude(error)
        answer = self._gain * size
        is_large = size > self._linear
        if is_large.any():
            beyond = np.maximum(size - self._half_linear, 0.0)
            np.sqrt(self._twice_second_order * beyond, out=answer, where=is_large)
        np.minimum(answer, self._limit, out=answer)
        answer /= np.maximum(size, TINY, out=size)
        answer *= error
        return answer
