"""What a vehicle knows of the world: a map of visited cells and walls in its own frame."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore import kernels
from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.kernels import (
    BLOCKED,
    GIVEN_UP,
    KNOWN,
    NEAR_WALL,
    OWN,
    TRODDEN,
    VISITED,
    WALL,
    Grid,
)

MARGIN_CELLS, MARGIN_PARTS = 2, 32
"""How far beyond what is needed the map grows: so many cells, or that part of a large map, which
would else be copied again and again."""
MOST_CELLS = 1 << 25
"""A map larger than this is somebody's mistake; what lies outside is not remembered."""

FAR, DEEP = 1 << 22, 1 << 18
"""Twice as many cells as there can be along a level axis, and upwards: others are 16 wide."""
_PATCHES = (0, 1, 1), (1, 0, 1), (1, 1, 0)
"""How far a patch of wall reaches in cells, by the axis that it lies across."""


class VisitedMap:
    """Cells of `cell_m`, squares in 2-D and cubes in 3-D, that only ever gain flags.

    Every change is an OR, so that the same segments and walls give the same map in any order.
    Positions are metres in the vehicle's own frame, sequences of `dimensions` numbers.
    """

    def __init__(
        self, dimensions: int, cell_m: float, footprint_m: float, *, is_square: bool, dilation: int
    ) -> None:
        self.cell_m = cell_m
        self.dimensions = dimensions
        self._half = footprint_m / cell_m
        self._is_square = is_square
        self._dilation = dilation
        deep = 1 if dimensions == 2 else MARGIN_CELLS
        self.low = np.array([-MARGIN_CELLS, -MARGIN_CELLS, -deep // 2 if deep > 1 else 0])
        """Index of the grid's low corner among all cells; cell 0 begins at the frame's origin."""
        self._corner: list[int] = self.low.tolist()
        self._walls = array("q")
        """Cells and axes of what is marked already, sorted; most walls are seen many times."""
        self.grid: Grid = np.zeros((2 * MARGIN_CELLS, 2 * MARGIN_CELLS, deep), dtype=np.uint8)

    def cells(self, position_m: Sequence[float] | Floats) -> Floats:
        """Give a position in cells from the grid's low corner, (3,)."""
        return np.array(self._place(position_m))

    def _place(self, position_m: Sequence[float] | Floats) -> tuple[float, float, float]:
        """Give the same as three numbers: a point is quicker without an array."""
        (x, y, z), cell_m = self._corner, self.cell_m
        if self.dimensions == 2:
            return position_m[0] / cell_m - x, position_m[1] / cell_m - y, 0.5
        return position_m[0] / cell_m - x, position_m[1] / cell_m - y, position_m[2] / cell_m - z

    def metres(self, cells: Sequence[float] | Floats) -> list[float]:
        """Turn a position in cells (3,) into metres (dimensions,)."""
        return [
            (float(cells[axis]) + float(self.low[axis])) * self.cell_m
            for axis in range(self.dimensions)
        ]

    def flags(self, position_m: Sequence[float] | Floats) -> int:
        """Read the flags of the cell at a position; 0 where nothing is known."""
        return int(kernels.look(self.grid, *self.cells(position_m)))

    def sweep(
        self,
        start_m: Sequence[float] | Floats,
        end_m: Sequence[float] | Floats,
        *,
        is_own: bool = False,
    ) -> bool:
        """Mark what a footprint sweeps along a straight segment; tell whether it is news.

        News are cells not seen before, by the vehicle itself if the footprint `is_own`, and those
        near a wall that nobody had flown through.
        """
        seen = VISITED | OWN if is_own else VISITED
        start, end = self._place(start_m), self._place(end_m)
        if self._reserve(start, end, self._half + 1.0):
            start, end = self._place(start_m), self._place(end_m)
        if kernels.IS_COMPILED:
            is_new: bool = kernels.paint(self.grid, start, end, self._half, self._is_square, seen)
            return is_new
        a, b = np.array(start), np.array(end)
        return _paint(self.grid, a, b, self._half, seen, is_square=self._is_square)

    @contextmanager
    def supposed(
        self, segments_m: Sequence[tuple[Sequence[float], Sequence[float]]]
    ) -> Iterator[None]:
        """Take straight segments for swept, but only for a while."""
        for segment in segments_m:
            for place_m in segment:
                place = self._place(place_m)
                self._reserve(place, place, self._half + 1.0)
        grid = self.grid
        if segments_m:
            self.grid = grid.copy()
        for start_m, end_m in segments_m:
            self.sweep(start_m, end_m)
        try:
            yield
        finally:
            self.grid = grid

    def wall(self, point_m: Sequence[float] | Floats, axis: int = 0) -> bool:
        """Mark a wall at a point; tell whether that was new.

        In 3-D a wall is a patch of 3 x 3 cells across the `axis` (0 to 2) along which it was seen:
        few beams would leave gaps in it otherwise.
        """
        place = x, y, z = self._place(point_m)
        i, j, k = math.floor(x), math.floor(y), math.floor(z)
        walls, wall = self._walls, self._number(i, j, k, axis)
        at = bisect_left(walls, wall)
        if _is_at(walls, at, wall):
            return False  # as for most, and when it was marked, there was room around its cell
        if self._reserve(place, place, self._dilation + 2.0):
            i, j, k = map(math.floor, self._place(point_m))
            wall = self._number(i, j, k, axis)
            at = bisect_left(walls, wall)
        if not self._holds(i, j, k) or _is_at(walls, at, wall):
            return False
        walls.insert(at, wall)
        is_new = not int(self.grid[i, j, k]) & WALL
        a, b, c = _PATCHES[axis] if self.dimensions == 3 else (0, 0, 0)
        near = self._dilation
        self._box((i, j, k), (a, b, c), WALL)
        self._box((i, j, k), (a + near, b + near, c + near), NEAR_WALL)
        return is_new

    def _number(self, i: int, j: int, k: int, axis: int) -> int:
        """Tell a cell and an axis by one number, which stays theirs when the grid grows."""
        x, y, z = self._corner
        return (((i + x) * FAR + j + y) * DEEP + k + z) * 3 + axis

    def give_up(self, position_m: Sequence[float] | Floats, radius_m: float) -> None:
        """Write off the unknown cells around a position, in a box of half size `radius_m`."""
        place, reach = self._place(position_m), math.ceil(radius_m / self.cell_m)
        if self._reserve(place, place, reach + 1.0):
            place = self._place(position_m)
        i, j, k = map(math.floor, place)
        self._box((i, j, k), (reach, reach, reach), GIVEN_UP)

    def block(self, position_m: Sequence[float] | Floats) -> None:
        """Keep ways out of the cell at a position."""
        x, y, z = self._place(position_m)
        i, j, k = math.floor(x), math.floor(y), math.floor(z)
        self._box((i, j, k), (0, 0, 0), BLOCKED)

    def _box(self, cell: tuple[int, int, int], reach: tuple[int, int, int], flag: int) -> None:
        if not self._holds(*cell):
            return
        if kernels.IS_COMPILED:
            kernels.box(self.grid, cell, reach, flag)
            return
        part = [slice(max(0, at - far), at + far + 1) for at, far in zip(cell, reach, strict=True)]
        self.grid[part[0], part[1], part[2]] |= flag

    def _holds(self, i: int, j: int, k: int) -> bool:
        nx, ny, nz = self.grid.shape
        return bool(0 <= i < nx and 0 <= j < ny and 0 <= k < nz)

    def _reserve(self, start: Sequence[float], end: Sequence[float], around: float) -> bool:
        """Grow until the grid holds a segment and what is `around` it; tell whether it grew."""
        nx, ny, nz = self.grid.shape
        (ax, ay, az), (bx, by, bz) = start, end
        deep, far_x, far_y, far_z = self.dimensions == 3, nx - around, ny - around, nz - around
        if (
            (around <= ax < far_x and around <= bx < far_x)
            and (around <= ay < far_y and around <= by < far_y)
            and (not deep or (around <= az < far_z and around <= bz < far_z))
        ):
            return False
        before, wanted = [0, 0, 0], [nx, ny, nz]
        for axis in range(self.dimensions):
            size, (low, high) = wanted[axis], sorted((start[axis], end[axis]))
            margin = max(size // MARGIN_PARTS, MARGIN_CELLS)
            lowest, highest = math.floor(low - around), math.floor(high + around) + 1
            before[axis] = margin - lowest if lowest < 0 else 0
            wanted[axis] += before[axis] + (highest - size + margin if highest > size else 0)
        if wanted == [nx, ny, nz] or math.prod(wanted) > MOST_CELLS:
            return False
        x, y, z = before
        grid = np.zeros(wanted, dtype=np.uint8)
        grid[x : x + nx, y : y + ny, z : z + nz] = self.grid
        self.grid, self.low = grid, self.low - before
        self._corner = self.low.tolist()
        return True


def _is_at(numbers: array[int], at: int, number: int) -> bool:
    """Tell whether a number stands where it would among sorted ones."""
    return at < len(numbers) and numbers[at] == number


def _paint(
    grid: Grid, start: Floats, end: Floats, half: float, seen: int, *, is_square: bool
) -> bool:
    """Do what `kernels.paint` does, cells side by side: faster where loops are not compiled."""
    deep = grid.shape[2] > 1
    move = end - start
    lowest = np.floor(np.minimum(start, end) - half).astype(int)
    highest = np.floor(np.maximum(start, end) + half).astype(int) + 1
    part = [
        slice(max(0, low), max(0, min(size, high)))
        for low, high, size in zip(lowest, highest, grid.shape, strict=True)
    ]
    if not deep:
        part[2], move[2] = slice(0, 1), 0.0
    axes = [
        np.arange(cells.start, cells.stop) + 0.5 - a for cells, a in zip(part, start, strict=True)
    ]
    if not deep:
        axes[2] = np.zeros(1)
    wx, wy, wz = axes[0][:, None, None], axes[1][None, :, None], axes[2][None, None, :]
    dx, dy, dz = move.tolist()
    length2 = dx * dx + dy * dy + dz * dz
    t = np.clip((wx * dx + wy * dy + wz * dz) / length2, 0.0, 1.0) if length2 > 0.0 else 0.0
    ex, ey, ez = wx - t * dx, wy - t * dy, wz - t * dz
    distance2 = ex * ex + ey * ey + ez * ez
    reach = half + kernels.TOLERANCE
    swept = _in_swept_square(wx, wy, dx, dy, reach) if is_square else distance2 <= reach * reach
    trodden = distance2 <= 0.25
    flags = (swept | trodden).astype(np.uint8) * np.uint8(seen)
    flags |= trodden.astype(np.uint8) * np.uint8(TRODDEN)
    view = grid[part[0], part[1], part[2]]
    news = ((view & seen != seen) | (view & NEAR_WALL != 0)) & (flags & ~view != 0)
    view |= flags
    return bool(news.any())


def _in_swept_square(
    wx: Floats, wy: Floats, dx: float, dy: float, half: float
) -> NDArray[np.bool_]:
    low, high = np.zeros_like(wx + wy), np.ones_like(wx + wy)
    inside = np.ones_like(low, dtype=np.bool_)
    for w, d in ((wx, dx), (wy, dy)):
        if d != 0.0:
            t0, t1 = (w - half) / d, (w + half) / d
            low, high = np.maximum(low, np.minimum(t0, t1)), np.minimum(high, np.maximum(t0, t1))
        else:
            inside &= np.abs(w) <= half
    result: NDArray[np.bool_] = inside & (low <= high)
    return result


__all__ = ["BLOCKED", "GIVEN_UP", "KNOWN", "NEAR_WALL", "TRODDEN", "VISITED", "WALL", "VisitedMap"]


def three(position: Sequence[float]) -> list[float]:
    """Give a position or direction three components, the last one 0 in two dimensions."""
    return [position[0], position[1], position[2] if len(position) > 2 else 0.0]
