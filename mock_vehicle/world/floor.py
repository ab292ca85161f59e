"""Places on the floor: slices of cells, ways between them, rows of starts."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mock_vehicle.world.spec import GridSpec

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Grid(NamedTuple):
    """A horizontal slice of the world."""

    origin_ne_m: Floats
    """Lower corner of cell (0, 0): north, east, m; (2,)."""
    cell_m: float
    """Edge of a cell, m."""
    blocked: Bools
    """Solid cells, (north, east)."""

    def cells(self, points_ned_m: Floats) -> NDArray[np.int_]:
        """Find the cells of (n, 3) points, (n, 2) north, east; they may lie beyond the slice."""
        return np.floor((points_ned_m[:, :2] - self.origin_ne_m) / self.cell_m).astype(int)

    def holds(self, cells: NDArray[np.int_]) -> Bools:
        """Tell which of (n, 2) cells belong to the slice."""
        return np.asarray(((cells >= 0) & (cells < self.blocked.shape)).all(axis=1))

    def is_free(self, points_ned_m: Floats) -> Bools:
        """Tell which of (n, 3) points lie in cells that are not blocked."""
        cells = self.cells(points_ned_m)
        free = self.holds(cells)
        free[free] = ~self.blocked[tuple(cells[free].T)]
        return free


def on_floor(north_east_m: Floats) -> Floats:
    """Turn (n, 2) north, east into (n, 3) NED points on the floor."""
    return np.column_stack([north_east_m, np.zeros(len(north_east_m))])


def headings(yaw_deg: Floats) -> Floats:
    """Turn degrees counter-clockwise from east into radians clockwise from north, in [-pi, pi)."""
    heading: Floats = (np.pi / 2.0 - np.radians(yaw_deg) + np.pi) % (2.0 * np.pi) - np.pi
    return heading


def rows(grid: GridSpec, n: int) -> tuple[Floats, Floats]:
    """Place n vehicles row by row, west to east and south to north."""
    row, column = np.divmod(np.arange(n), grid.columns)
    x, y = grid.origin_m
    north_east = np.column_stack([y + row * grid.spacing_m, x + column * grid.spacing_m])
    return on_floor(north_east), np.full(n, grid.yaw_deg)


def centres(low_m: Floats, cell_m: float, shape: tuple[int, ...], height_m: float) -> Floats:
    """Lay out the centres of the cells of a slice, (nx, ny, 3) NED, m."""
    middle = np.full((*shape, 3), -height_m)
    middle[..., 0] = (low_m[0] + (np.arange(shape[0]) + 0.5) * cell_m)[:, None]
    middle[..., 1] = low_m[1] + (np.arange(shape[1]) + 0.5) * cell_m
    return middle


def flood(free: Bools, north: Bools, east: Bools, seeds: NDArray[np.int_]) -> Bools:
    """Mark (nx, ny) cells reachable from (k, 2) seeds.

    `north` (nx - 1, ny) and `east` (nx, ny - 1) tell where a cell's next neighbour can be entered.
    """
    by_row = _runs(east & free[:, :-1] & free[:, 1:])
    by_column = _runs((north & free[:-1] & free[1:]).T).T
    reached = np.zeros_like(free)
    reached[seeds[:, 0], seeds[:, 1]] = True
    reached &= free
    before = np.zeros_like(free)
    while (reached != before).any():
        before = reached
        for runs in (by_row, by_column):
            touched = np.zeros(runs.size, dtype=bool)
            touched[runs[reached]] = True
            reached = touched[runs]
    return reached


def _runs(joined: Bools) -> NDArray[np.intp]:
    """Give each cell the number of its run: of those in its row that are joined, (nx, ny - 1)."""
    begins = np.ones((joined.shape[0], joined.shape[1] + 1), dtype=bool)
    begins[:, 1:] = ~joined
    runs: NDArray[np.intp] = begins.cumsum().reshape(begins.shape) - 1
    return runs


def largest_area(free: Bools, north: Bools, east: Bools) -> Bools:
    """Mark the largest set of (nx, ny) cells that can be reached from one another, as `flood`."""
    best, rest = np.zeros_like(free), free.copy()
    while (left := np.argwhere(rest)).size and len(left) > np.count_nonzero(best):
        middle = len(left) // 2  # pockets are rather found at the rim
        area = flood(free, north, east, left[middle : middle + 1])
        rest &= ~area
        best = max(best, area, key=np.count_nonzero)
    return best
