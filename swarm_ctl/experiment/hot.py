"""The hot parts of the batch engine, in numpy and as loops that numba compiles.

Both ways do the same operations in the same order, so they give the same numbers, bit for bit.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.experiment import balls, walls
from swarm_ctl.experiment.case import TINY, Bools, Case, Counts
from swarm_ctl.experiment.room import Room
from swarm_ctl.explore import rows
from swarm_ctl.explore.chance import Floats, Rows


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


class Ground:
    """Which cells have been under a body, trial by trial: a cell counts if its centre was."""

    def __init__(self, case: Case, room: Room, trials: int) -> None:
        field, cell = case.field, case.field.cell_m
        self._origin_m = field.low_m
        self._size = tuple(
            math.ceil((high - low) / cell - 1e-9)
            for low, high in zip(field.low_m, field.high_m, strict=True)
        )
        self._shape = (math.prod(self._size[:-1]), self._size[-1])
        self._cell_m, self._half_m = cell, case.reach_m
        self._is_disc = case.footprint == "disc"
        self._free = room.coverable(self._size).reshape(self._shape)
        self._trials = trials
        self._clear()

    def _clear(self) -> None:
        """Begin with untouched ground; the places of each step wait for the next count."""
        rows, columns = self._shape
        self._waiting: list[Floats] = []
        self._covered = np.zeros((self._trials, rows, columns), dtype=np.bool_)

    def mark(self, position_m: Floats) -> None:
        """Put a body at (trials * robots, d)."""
        self._waiting.append(position_m)

    def share(self) -> Floats:
        """Count the covered share of the free cells, (trials,)."""
        places = np.stack(self._waiting).reshape(
            len(self._waiting), self._trials, -1, len(self._size)
        )
        self._waiting = []
        for trial in range(self._trials):
            self._covered[trial] |= self._under(places[:, trial].reshape(-1, places.shape[3]))
        counted: Counts = np.count_nonzero(self._covered & self._free, axis=(1, 2))
        return counted / np.count_nonzero(self._free)

    def _under(self, place_m: Floats) -> Bools:
        """Tell which cells are under bodies at (m, d): +1 where a run begins, -1 behind its end."""
        rows, columns = self._shape
        row, begin, end = self._runs(place_m)
        first = row * (columns + 1)
        edges, size = np.zeros(rows * (columns + 1), dtype=np.intp), rows * (columns + 1)
        edges += np.bincount((first + begin).astype(np.intp).ravel(), minlength=size)
        edges -= np.bincount(
            (first + np.maximum(begin, end)).astype(np.intp).ravel(), minlength=size
        )
        return edges.reshape(rows, columns + 1).cumsum(axis=1)[:, :-1] > 0

    def _runs(self, place_m: Floats) -> tuple[Floats, Floats, Floats]:
        """Give the row of each run of cells under bodies, where it begins and where it ends."""
        if len(self._size) == 3:
            return balls.runs(place_m, self._origin_m, self._cell_m, self._half_m, self._size)
        rows, columns = self._shape
        cell, half = self._cell_m, self._half_m
        north, east = (place_m - self._origin_m).T[:, :, None]
        last = np.floor((north + half) / cell - 0.5)
        row = np.ceil((north - half) / cell - 0.5) + np.arange(math.ceil(2.0 * half / cell) + 1)
        row = np.clip(np.minimum(row, last), 0, rows - 1)
        if self._is_disc:
            half = np.sqrt(np.maximum(half * half - ((row + 0.5) * cell - north) ** 2, 0.0))
        begin = np.maximum(np.ceil((east - half) / cell - 0.5), 0.0)
        end = np.minimum(np.floor((east + half) / cell - 0.5) + 1.0, columns)
        return row, begin, end


class CompiledGround(Ground):
    """The same cells, a bit each, marked at once."""

    def _clear(self) -> None:
        rows, columns = self._shape
        words = -(-columns // 64)
        bits = np.zeros((rows, 64 * words), dtype=np.bool_)
        bits[:, :columns] = self._free
        packed = np.packbits(bits, axis=1, bitorder="little").view("<u8")
        self._free_bits = packed.astype(np.uint64)
        self._bits = np.zeros((self._trials, rows, words), dtype=np.uint64)

    def mark(self, position_m: Floats) -> None:
        """Put a body at (trials * robots, d)."""
        if len(self._size) == 3:
            place_m = position_m.reshape(self._trials, -1, 3)
            _jit(balls.mark)(
                place_m, self._origin_m, self._cell_m, self._half_m, self._size, self._bits
            )
            return
        _jit(_mark)(
            position_m.reshape(self._trials, -1, 2),
            self._origin_m,
            self._cell_m,
            self._half_m,
            self._is_disc,
            self._shape[1],
            self._bits,
        )

    def share(self) -> Floats:
        """Count the covered share of the free cells, (trials,)."""
        counted: Counts = _jit(_count)(self._bits, self._free_bits)
        return counted / np.count_nonzero(self._free)


def interpreted() -> Tools:
    """Give the parts in numpy."""
    return Tools(_cast_all, _meet_all, walls.near_all, walls.slide_all, Ground, rows.NUMPY)


def compiled() -> Tools:
    """Give the parts compiled; ImportError without numba."""
    near, slide = _jit(walls.near), _jit(walls.slide)
    return Tools(_jit(_cast), _jit(_meet), near, slide, CompiledGround, rows.compiled())


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


def _mark(
    place_m: Floats,
    origin_m: tuple[float, float],
    cell: float,
    half: float,
    is_disc: bool,
    columns: int,
    bits: NDArray[np.uint64],
) -> None:
    trials, robots = place_m.shape[:2]
    every = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
    for trial in range(trials):
        for i in range(robots):
            north = place_m[trial, i, 0] - origin_m[0]
            east = place_m[trial, i, 1] - origin_m[1]
            first = max(math.ceil((north - half) / cell - 0.5), 0)
            last = min(math.floor((north + half) / cell - 0.5), bits.shape[1] - 1)
            band = 1 if is_disc else max(last + 1 - first, 1)
            for at in range(first, last + 1, band):
                reach = half
                if is_disc:
                    beside = (at + 0.5) * cell - north
                    reach = math.sqrt(max(half * half - beside * beside, 0.0))
                begin = max(math.ceil((east - reach) / cell - 0.5), 0)
                end = min(math.floor((east + reach) / cell - 0.5) + 1, columns)
                for word in range(begin >> 6, ((end - 1) >> 6) + 1):
                    low, high = max(begin - (word << 6), 0), min(end - (word << 6), 64)
                    if low < high:
                        run = (every >> np.uint64(64 - high + low)) << np.uint64(low)
                        for row in range(at, at + band):
                            bits[trial, row, word] |= run


def _count(bits: NDArray[np.uint64], free: NDArray[np.uint64]) -> Counts:
    counted = np.zeros(len(bits), dtype=np.int64)
    for trial in range(len(bits)):
        for row in range(free.shape[0]):
            for word in range(free.shape[1]):
                left = bits[trial, row, word] & free[row, word]
                left -= (left >> np.uint64(1)) & np.uint64(0x5555555555555555)
                twos = np.uint64(0x3333333333333333)
                left = (left & twos) + ((left >> np.uint64(2)) & twos)
                left = (left + (left >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
                counted[trial] += np.int64((left * np.uint64(0x0101010101010101)) >> np.uint64(56))
    return counted
