"""What of the field has been explored: squares, discs and spheres marked in cells, and counted.

In numpy, and as loops for numba (see `hot.py`). Cells lie in rows: in 2-D to the east, in 3-D down.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.experiment.case import Case, Counts
from swarm_ctl.experiment.room import Room
from swarm_ctl.explore.chance import Bools, Floats

Jit = Callable[[Callable[..., Any]], Callable[..., Any]]


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
            return _ball_runs(place_m, self._origin_m, self._cell_m, self._half_m, self._size)
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
    """The same cells, a bit each, marked at once by loops that `jit` compiles."""

    def __init__(self, case: Case, room: Room, trials: int, *, jit: Jit) -> None:
        self._jit = jit
        super().__init__(case, room, trials)

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
            self._jit(_mark_balls)(
                place_m, self._origin_m, self._cell_m, self._half_m, self._size, self._bits
            )
            return
        self._jit(_mark)(
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
        counted: Counts = self._jit(_count)(self._bits, self._free_bits)
        return counted / np.count_nonzero(self._free)


def _ball_runs(
    place_m: Floats, origin_m: tuple[float, ...], cell: float, radius: float, size: tuple[int, ...]
) -> tuple[Floats, Floats, Floats]:
    """Give the row (m, k) of each run in spheres around (m, 3) places, its begin and its end.

    Row n * size[1] + e is the column of voxels at n north and e east; empty runs end before they
    begin, or there.
    """
    at = place_m - origin_m
    around = np.arange(math.ceil(2.0 * radius / cell) + 1)
    north, east = (np.ceil((at[:, axis, None] - radius) / cell - 0.5) + around for axis in (0, 1))
    north, east = north[:, :, None], east[:, None, :]
    beside_n = (north + 0.5) * cell - at[:, 0, None, None]
    beside_e = (east + 0.5) * cell - at[:, 1, None, None]
    left = radius * radius - (beside_n * beside_n + beside_e * beside_e)
    inside = (left >= 0.0) & (north >= 0) & (north < size[0]) & (east >= 0) & (east < size[1])
    reach = np.sqrt(np.maximum(left, 0.0))
    down = at[:, 2, None, None]
    begin = np.maximum(np.ceil((down - reach) / cell - 0.5), 0.0)
    end = np.minimum(np.floor((down + reach) / cell - 0.5) + 1.0, size[2])
    row = np.where(inside, north * size[1] + east, 0.0)
    flat = (len(place_m), -1)
    return row.reshape(flat), begin.reshape(flat), np.where(inside, end, 0.0).reshape(flat)


# From here on: the same as loops for numba, which cannot see the rest of the module.


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


def _mark_balls(
    place_m: Floats,
    origin_m: tuple[float, float, float],
    cell: float,
    radius: float,
    size: tuple[int, int, int],
    bits: NDArray[np.uint64],
) -> None:
    """Set the bits (trials, rows, words) of the voxels that `_ball_runs` finds."""
    every = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
    for trial in range(place_m.shape[0]):
        for i in range(place_m.shape[1]):
            at_n = place_m[trial, i, 0] - origin_m[0]
            at_e = place_m[trial, i, 1] - origin_m[1]
            down = place_m[trial, i, 2] - origin_m[2]
            first_n = max(math.ceil((at_n - radius) / cell - 0.5), 0)
            first_e = max(math.ceil((at_e - radius) / cell - 0.5), 0)
            for north in range(first_n, size[0]):
                beside_n = (north + 0.5) * cell - at_n
                if beside_n > radius:
                    break
                for east in range(first_e, size[1]):
                    beside_e = (east + 0.5) * cell - at_e
                    if beside_e > radius:
                        break
                    left = radius * radius - (beside_n * beside_n + beside_e * beside_e)
                    if left < 0.0:
                        continue
                    reach = math.sqrt(left)
                    begin = max(math.ceil((down - reach) / cell - 0.5), 0)
                    end = min(math.floor((down + reach) / cell - 0.5) + 1, size[2])
                    if begin >= end:
                        continue
                    for word in range(begin >> 6, ((end - 1) >> 6) + 1):
                        low, high = max(begin - (word << 6), 0), min(end - (word << 6), 64)
                        run = (every >> np.uint64(64 - high + low)) << np.uint64(low)
                        bits[trial, north * size[1] + east, word] |= run
