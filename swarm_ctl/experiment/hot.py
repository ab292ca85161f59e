"""The hot parts of the batch engine, in numpy and as loops that numba compiles.

Both ways do the same operations in the same order, so they give the same numbers, bit for bit.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from swarm_ctl.experiment import walls
from swarm_ctl.experiment.case import TINY, Case, Counts
from swarm_ctl.experiment.ground import CompiledGround, Ground
from swarm_ctl.experiment.room import Room
from swarm_ctl.explore import rows
from swarm_ctl.explore.chance import Bools, Floats, Rows


def has_numba() -> bool:
    """Tell whether the compiled parts can be used."""
    return importlib.util.find_spec("numba") is not None


class Tools(NamedTuple):
    """The hot parts, in numpy or compiled."""

    cast: Callable[..., Floats]
    meet: Callable[..., None]
    near: Callable[..., Rows]
    slide: Callable[..., tuple[Floats, Floats, Bools]]
    ground: Callable[[Case, Room, int], Ground]
    planner: rows.Kernels
    """What `explore.Planner` does for every row."""


def interpreted() -> Tools:
    """Give the parts in numpy."""
    return Tools(_cast_all, _meet_all, walls.near_all, walls.slide_all, Ground, rows.NUMPY)


def compiled() -> Tools:
    """Give the parts compiled; ImportError without numba."""
    near, slide, ground = _jit(walls.near), _jit(walls.slide), partial(CompiledGround, jit=_jit)
    return Tools(_jit(_cast), _jit(_meet), near, slide, ground, rows.compiled())


@cache
def _jit(kernel: Callable[..., Any]) -> Callable[..., Any]:
    import numba  # noqa: PLC0415 - an extra, and slow to import

    compiled: Callable[..., Any] = numba.njit(kernel, cache=True, error_model="numpy")
    return compiled


def _cast_all(
    place_m: Floats,
    cos: Floats,
    sin: Floats,
    low: tuple[float, ...],
    high: tuple[float, ...],
    boxes: Floats,
) -> Floats:
    """Measure level from places (n, d) ahead, to the left and to the right, (n, 3), m."""
    d = place_m.shape[1]
    north, east = np.stack([cos, sin, -sin], axis=1), np.stack([sin, -cos, cos], axis=1)
    north = np.where(np.abs(north) < TINY, TINY, north)
    east = np.where(np.abs(east) < TINY, TINY, east)
    x, y, z = place_m[:, :1], place_m[:, 1:2], place_m[:, 2:]
    ranges_m: Floats = np.minimum(
        (np.where(north > 0.0, high[0], low[0]) - x) / north,
        (np.where(east > 0.0, high[1], low[1]) - y) / east,
    )
    for box in boxes:
        a, b = (box[0] - x) / north, (box[d] - x) / north
        e, f = (box[1] - y) / east, (box[d + 1] - y) / east
        enters = np.maximum(np.minimum(a, b), np.minimum(e, f))
        leaves = np.minimum(np.maximum(a, b), np.maximum(e, f))
        hit = (enters <= leaves) & (leaves >= 0.0)
        if d == 3:
            hit &= (box[2] < z) & (z < box[5])
        ranges_m = np.where(hit, np.minimum(ranges_m, np.maximum(enters, 0.0)), ranges_m)
    return ranges_m


def _meet_all(
    place_m: Floats, radio_m2: float, body_m2: float, peers_m: Floats, touching: Bools,
    collisions: Counts, is_chained: bool = True,
) -> None:  # fmt: skip
    """Fill in the offsets to all others in radio range, or linked by a chain; count contacts.

    Who has no place (NaN) meets nobody.
    """
    robots, d = place_m.shape[1:]
    offsets = [place_m[:, None, :, axis] - place_m[:, :, None, axis] for axis in range(d)]
    apart_m2 = offsets[0] * offsets[0] + offsets[1] * offsets[1]
    if d == 3:
        apart_m2 += offsets[2] * offsets[2]
    apart_m2[:, range(robots), range(robots)] = np.inf
    over = apart_m2 < body_m2
    collisions += (over & ~touching).sum(axis=(1, 2)) // 2
    touching[:] = over
    if peers_m.shape[2]:
        linked = apart_m2 <= radio_m2
        for via in range(robots if is_chained else 0):
            linked |= linked[:, :, via, None] & linked[:, None, via, :]
        linked[:, range(robots), range(robots)] = False
        for axis, offset_m in enumerate(offsets):
            peers_m[..., axis] = np.where(linked, offset_m, np.nan)


# From here on: those of above as loops for numba, which cannot see the rest of the module.


def _cast(
    place_m: Floats,
    cos: Floats,
    sin: Floats,
    low: tuple[float, ...],
    high: tuple[float, ...],
    boxes: Floats,
) -> Floats:
    tiny, d = 1e-12, len(low)
    ranges_m = np.empty((len(place_m), 3))
    for i in range(len(place_m)):
        x, y = place_m[i, 0], place_m[i, 1]
        for beam in range(3):
            north, east = cos[i], sin[i]
            if beam == 1:
                north, east = sin[i], -cos[i]
            elif beam == 2:
                north, east = -sin[i], cos[i]
            north = tiny if abs(north) < tiny else north
            east = tiny if abs(east) < tiny else east
            nearest = min(
                ((high[0] if north > 0.0 else low[0]) - x) / north,
                ((high[1] if east > 0.0 else low[1]) - y) / east,
            )
            for k in range(len(boxes)):
                if d == 3 and not boxes[k, 2] < place_m[i, 2] < boxes[k, 5]:
                    continue
                a, b = (boxes[k, 0] - x) / north, (boxes[k, d] - x) / north
                e, f = (boxes[k, 1] - y) / east, (boxes[k, d + 1] - y) / east
                enters, leaves = max(min(a, b), min(e, f)), min(max(a, b), max(e, f))
                if enters <= leaves and leaves >= 0.0:
                    nearest = min(nearest, max(enters, 0.0))
            ranges_m[i, beam] = nearest
    return ranges_m


def _meet(  # noqa: C901, PLR0912 - a kernel: calls would cost more than they tell
    place_m: Floats, radio_m2: float, body_m2: float, peers_m: Floats, touching: Bools,
    collisions: Counts, is_chained: bool = True,
) -> None:  # fmt: skip
    trials, robots, d = place_m.shape
    cluster = np.empty(robots, dtype=np.int64)
    for trial in range(trials):
        for i in range(robots):
            cluster[i] = i
        alone = True
        for i in range(robots):
            for j in range(i + 1, robots):
                north = place_m[trial, j, 0] - place_m[trial, i, 0]
                east = place_m[trial, j, 1] - place_m[trial, i, 1]
                apart_m2 = north * north + east * east
                if d == 3:
                    down = place_m[trial, j, 2] - place_m[trial, i, 2]
                    apart_m2 += down * down
                over = apart_m2 < body_m2
                if over and not touching[trial, i, j]:
                    collisions[trial] += 1
                touching[trial, i, j] = over
                if apart_m2 <= radio_m2:
                    alone = False
                    if cluster[i] != cluster[j]:
                        into, gone = cluster[i], cluster[j]
                        for k in range(robots):
                            if cluster[k] == gone:
                                cluster[k] = into
        if peers_m.shape[2] == 0:
            continue
        if alone:
            peers_m[trial] = np.nan
            continue
        for i in range(robots):
            for j in range(robots):
                hears = i != j and cluster[i] == cluster[j]
                if hears and not is_chained:
                    apart_m2 = 0.0
                    for axis in range(d):
                        offset_m = place_m[trial, j, axis] - place_m[trial, i, axis]
                        apart_m2 += offset_m * offset_m
                    hears = apart_m2 <= radio_m2
                for axis in range(d):
                    peers_m[trial, i, j, axis] = np.nan
                    if hears:
                        peers_m[trial, i, j, axis] = (
                            place_m[trial, j, axis] - place_m[trial, i, axis]
                        )
