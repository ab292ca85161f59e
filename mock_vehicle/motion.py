"""The step of `Dynamics` as a loop over vehicles that numba compiles: the same, bit for bit.

Import it only where numba is installed. Vectors are (3,) in NED; `Dynamics` says what the rows of
the arrays hold. What numpy does to all when one needs it may turn the sign of a zero: so does this.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

Call = TypeVar("Call", bound=Callable[..., Any])

GRAVITY_M_S2 = 9.80665
TINY = 1e-9
TURN = 2.0 * np.pi
OFF, POSITION = 0, 2
"""Of `dynamics.Control`."""

compiled: Callable[[Call], Call] = importlib.import_module("numba").njit(
    cache=True, error_model="numpy"
)


@compiled
def _least(value: float, limit: float) -> float:
    """Do as np.minimum, where NaN stays NaN."""
    return value if value < limit or math.isnan(value) else limit


@compiled
def _most(value: float, limit: float) -> float:
    """Do as np.maximum, where NaN stays NaN."""
    return value if value > limit or math.isnan(value) else limit


@compiled
def _within(value: float, limit: float) -> float:
    return _most(_least(value, limit), -limit)


@compiled
def _add(vector: Any, other: Any, factor: float) -> None:
    """Add a multiple of another vector: by axis, as numba would make room for it elsewhere."""
    for axis in range(3):
        vector[axis] += other[axis] * factor


@compiled
def _size(vector: Any, axis: int) -> float:
    """Measure what an axis belongs to: the level part of a vector, or the vertical one."""
    if axis == 2:
        return math.sqrt(vector[2] * vector[2])
    return math.sqrt(vector[0] * vector[0] + vector[1] * vector[1])


@compiled
def _limit(vector: Any, limit: Any) -> None:
    """Shorten a vector to limits (3,), direction kept."""
    level, upright = _most(_size(vector, 0), TINY), _most(_size(vector, 2), TINY)
    for axis in range(3):
        vector[axis] *= _least(limit[axis] / (upright if axis == 2 else level), 1.0)


@compiled
def _answer(error: Any, loop: Any, answer: Any) -> None:
    """Write the answer to an error by a loop, (5, 3): the rows of `_SqrtController`."""
    for axis in range(3):
        size = _size(error, axis)
        wanted = loop[0, axis] * size
        if size > loop[2, axis]:
            wanted = math.sqrt(loop[4, axis] * _most(size - loop[3, axis], 0.0))
        answer[axis] = _least(wanted, loop[1, axis]) / _most(size, TINY) * error[axis]


@compiled
def _approach(position: Any, target: Any, loop: Any, sink: float, wanted: Any) -> None:
    """Add to a wanted velocity what leads to a target; an axis that is no number leads nowhere."""
    gap, approach = np.empty(3), np.empty(3)
    for axis in range(3):
        gap[axis] = target[axis] - position[axis]
        if not math.isfinite(gap[axis]):
            gap[axis] = 0.0
    _answer(gap, loop, approach)
    approach[2] = _least(approach[2], sink)
    wanted += approach


@compiled
def _follow(error: Any, vehicle: Any, loop: Any, axes: Any, has: Any) -> None:
    """Move the thrust of a vehicle, (5, 3), towards what its velocity error demands."""
    _, velocity, acceleration, thrust, integral = vehicle
    _, _, step, error_limit, thrust_limit, lag_share, jerk_step, _, known_drag, damping = axes
    for axis in range(3):
        unwinds = error[axis] * integral[axis] < 0.0
        integrates = abs(error[axis]) < error_limit[axis] or unwinds
        integral[axis] += step[axis] * error[axis] * (1.0 if integrates else 0.0)
    change = np.empty(3)
    _answer(error, loop, change)
    for axis in range(3):  # as in `_add`
        change[axis] += integral[axis]
        if has[0]:
            change[axis] -= damping[axis] * acceleration[axis]
        if has[1]:
            change[axis] += known_drag[axis] * velocity[axis]
    _limit(change, thrust_limit)
    for axis in range(3):
        change[axis] = (change[axis] - thrust[axis]) * lag_share[axis]
    if has[2]:
        _limit(change, jerk_step)
    _add(thrust, change, 1.0)


@compiled
def _resist(wind: Any, drag: Any, velocity: Any, acceleration: Any) -> None:
    """Begin an acceleration with what the air does."""
    for axis in range(3):
        acceleration[axis] = drag[axis] * (wind[axis] - velocity[axis])


@compiled
def _turn(dt: float, turning: Any, limits: Any, can_turn: bool) -> None:
    """Turn one vehicle: the rows of `turning`, (4,), by those of `turn_limits`, (5,)."""
    yaw, yaw_rate, target, target_rate = turning
    fastest, accel, gain, step, _ = limits
    error = target - yaw
    error -= TURN * np.rint(error / TURN)
    reach = _least(0.7 * math.sqrt(2.0 * accel * abs(error)), fastest)
    rate = _within(gain * error, reach) if math.isnan(target_rate) else target_rate
    if math.isnan(rate):
        rate = 0.0
    yaw_rate += _within(_within(rate, fastest) - yaw_rate, step)
    yaw_rate *= 1.0 if can_turn else 0.0
    yaw += yaw_rate * dt
    turning[0] = yaw - TURN * np.floor(yaw / TURN + 0.5)
    turning[1] = yaw_rate


@compiled
def advance(
    dt: float,
    head: int,
    wind: Any,
    has: Any,
    control: Any,
    motor_lost: Any,
    on_ground: Any,
    ground: Any,
    motion: Any,
    targets: Any,
    turning: Any,
    axes: Any,
    loops: Any,
    turn_limits: Any,
    past: Any,
    delayed: Any,
) -> None:
    """Advance all vehicles by `dt` s in a wind of (n, 3)."""
    running = (control != OFF) & ~motor_lost
    all_run, any_grounded = running.all(), on_ground.any()
    any_placed = (control == POSITION).any()
    before, error, limit = past.reshape(-1), np.empty(3), np.empty(3)
    for i in range(len(running)):
        vehicle = motion[:, i]
        position, velocity, acceleration, thrust, integral = vehicle
        powered = 1.0 if running[i] else 0.0
        wanted = past[head, i]
        wanted[:] = targets[1, i]
        if any_placed:
            target = targets[0, i] if control[i] == POSITION else position
            _approach(position, target, loops[5:, i], turn_limits[4, i], wanted)
        for axis in range(3):
            limit[axis] = axes[1, i, axis] if wanted[axis] > 0.0 else axes[0, i, axis]
        _limit(wanted, limit)
        if not all_run:
            wanted *= powered
        for axis in range(3):
            error[axis] = before[delayed[head, i, axis]] - velocity[axis]
        _follow(error, vehicle, loops[:5, i], axes[:, i], has)
        _resist(wind[i], axes[7, i], velocity, acceleration)
        if not all_run:
            thrust *= powered
            integral *= powered
            acceleration[2] += GRAVITY_M_S2 * (1.0 - powered)
        _add(acceleration, thrust, 1.0)
        _add(velocity, acceleration, dt)
        if any_grounded:
            velocity *= 0.0 if on_ground[i] and not velocity[2] < 0.0 else 1.0
        _add(position, velocity, dt)
        _turn(dt, turning[:, i], turn_limits[:, i], running[i] and not on_ground[i])
        on_ground[i] = position[2] >= ground[i]
        if on_ground[i]:
            position[2] = ground[i]
            vehicle[1:] = 0.0
        else:
            ground[i] = 0.0
