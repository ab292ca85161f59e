"""The parts of a planner step that visit every row: in numpy, and as loops for numba in 2-D.

Both ways do the same operations in the same order, so they give the same numbers, bit for bit.
Sums over rows, sin, cos, arctan2 and powers stay in numpy: compiled ones round differently.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from swarm_ctl.explore.avoidance import consult
from swarm_ctl.explore.chance import Bools, Floats, Rows, deal, short
from swarm_ctl.explore.levy import put, travel
from swarm_ctl.explore.pso import fly
from swarm_ctl.explore.repulsion import hear


class Kernels(NamedTuple):
    """Who does the work, row by row or side by side; see the functions of the same names."""

    short: Callable[..., Rows]
    deal: Callable[..., Floats]
    travel: Callable[..., tuple[Floats, Floats]]
    put: Callable[..., None]
    consult: Callable[..., tuple[Rows, Rows, Rows]]
    hear: Callable[..., tuple[Rows, Floats, Floats]]
    fly: Callable[..., tuple[Floats, Floats]]


NUMPY = Kernels(short, deal, travel, put, consult, hear, fly)
"""For a vehicle that flies, for 3-D, and for many rows where numba is not installed."""


@cache
def compiled() -> Kernels:
    """Compile the loops; ImportError without numba."""
    import numba  # noqa: PLC0415 - an extra, and slow to import

    jit: Callable[[Any], Any] = numba.njit(cache=True, error_model="numpy")
    return Kernels(*(jit(loop) for loop in (_short, _deal, _travel, _put, _consult, _hear, _fly)))


def _short(cursor: Rows, rows: Rows, most: int) -> Rows:
    spent, count = np.empty_like(rows), 0
    for i in range(len(rows)):
        spent[count] = rows[i]
        count += cursor[rows[i]] > most
    return spent[:count]


def _deal(numbers: Floats, cursor: Rows, rows: Rows, count: int) -> Floats:
    dealt = np.empty((len(rows), count))
    for i in range(len(rows)):
        row = rows[i]
        for k in range(count):
            dealt[i, k] = numbers[row, cursor[row] + k]
        cursor[row] += count
    return dealt


def _travel(last_m: Floats, position_m: Floats, suspended: Bools) -> tuple[Floats, Floats]:
    moved_m, flown_m = np.empty(len(last_m)), np.zeros(len(last_m))
    for i in range(len(last_m)):
        north, east = position_m[i, 0] - last_m[i, 0], position_m[i, 1] - last_m[i, 1]
        moved_m[i] = math.sqrt(north * north + east * east)
        if not suspended[i]:
            flown_m[i] = moved_m[i]
    return moved_m, flown_m


def _put(vector_m: Floats, rows: Rows, length_m: Floats, unit: Floats) -> None:
    for i in range(len(rows)):
        vector_m[rows[i], 0] = length_m[i] * unit[i, 0]
        vector_m[rows[i], 1] = length_m[i] * unit[i, 1]


def _consult(
    ranges_m: Floats,
    distance_m: float,
    _dimensions: int,
    last: Rows,
    turns: Bools,
) -> tuple[Rows, Rows, Rows]:
    row, turning, free = np.empty_like(last), np.empty_like(last), np.empty_like(last)
    turning_count, free_count = 0, 0
    for i in range(len(last)):
        front, left, right = ranges_m[i, 0], ranges_m[i, 2], ranges_m[i, 3]
        row[i] = 16 * (front < distance_m) + 8 * (left < distance_m) + 4 * (right < distance_m)
        turning[turning_count], free[free_count] = i, i
        turning_count += turns[row[i]]
        free_count += turns[last[i]] and not turns[row[i]]
    return row, turning[:turning_count], free[:free_count]


def _hear(
    peers_m: Floats,
    nearest_m: float,
    _vertical: float,
) -> tuple[Rows, Floats, Floats]:
    rows, count = np.empty(len(peers_m), dtype=np.intp), 0
    for i in range(len(peers_m)):
        for k in range(peers_m.shape[1]):
            if not math.isnan(peers_m[i, k, 0]):
                rows[count] = i
                count += 1
                break
    inverse, away = np.zeros((count, peers_m.shape[1])), np.empty((count, 2))
    for i in range(count):
        north, east = 0.0, 0.0
        for k in range(peers_m.shape[1]):
            x, y = peers_m[rows[i], k, 0], peers_m[rows[i], k, 1]
            if not math.isnan(x):
                inverse[i, k] = 1.0 / max(math.sqrt(x * x + y * y), nearest_m)
                north += x
                east += y
        away[i, 0], away[i, 1] = -north, -east
    return rows[:count], inverse, away


def _fly(
    motion_m: Floats,
    local_best_m: Floats,
    global_best_m: Floats,
    chance: Floats,
    weights: tuple[float, float, float],
    level_m: float,
    _climb_m: float,
) -> tuple[Floats, Floats]:
    omega, p_omega, n_omega = weights
    next_m, ground_m = np.empty_like(motion_m), np.empty(len(motion_m))
    for i in range(len(motion_m)):
        for axis in range(2):
            v = omega * motion_m[i, axis]
            v += p_omega * chance[i, axis] * local_best_m[i, axis]
            if n_omega:
                v += n_omega * chance[i, 2 + axis] * global_best_m[i, axis]
            next_m[i, axis] = v
        ground = math.hypot(next_m[i, 0], next_m[i, 1])
        kappa = level_m / max(ground, level_m)
        next_m[i, 0] *= kappa
        next_m[i, 1] *= kappa
        ground_m[i] = ground * kappa
    return next_m, ground_m
