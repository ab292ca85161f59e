"""The ground that a vehicle has seen, told bit by bit: nothing twice, nothing left out."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore.memory import VISITED, VisitedMap
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.model import Vec3

Row = list[int]
"""First square to the north, first one to the east, how many to the east."""

TOLD = 128
"""Flag of a cell beside those of `VisitedMap`."""
JUMP_M = 3.0
"""A position farther than this from the last one is a new beginning, not a way flown."""


class SeenGround:
    """Squares of the vehicle's own frame within the footprint of the way that it has flown.

    Walls hide nothing here: a vehicle knows no more of them than what it has met.
    """

    def __init__(self, params: PlannerParams) -> None:
        """Take footprint and cell size from the planner's."""
        self.cell_m = params.cell_m
        self.cells = 0
        """How many have been told."""
        self._footprint_m = params.footprint_m
        is_square = params.footprint_shape == "square"
        self._map = VisitedMap(
            2, params.cell_m, params.footprint_m, is_square=is_square, dilation=0
        )
        self._way: list[Vec3] = []

    def fly_to(self, place: Vec3) -> None:
        """Take where the vehicle is now; cheap, as most of its steps are small."""
        if not self._way or math.dist(self._way[-1][:2], place[:2]) > 0.5 * self.cell_m:
            self._way.append(place)

    def news(self) -> list[Row]:
        """Give the squares that were never given."""
        if len(self._way) < 2:
            return []
        way, self._way = self._way, self._way[-1:]
        for start, end in itertools.pairwise(way):
            if math.dist(start, end) < JUMP_M:
                self._map.sweep(start[:2], end[:2])
        window = self._around(way)
        fresh = (window & (VISITED | TOLD)) == VISITED
        window[fresh] |= TOLD
        self.cells += int(np.count_nonzero(fresh))
        return self._rows(fresh, self._low(way))

    def told(self) -> list[Row]:
        """Give all squares that were given."""
        grid = self._map.grid[:, :, 0]
        return self._rows((grid & TOLD) == TOLD, [0, 0])

    def _low(self, way: list[Vec3]) -> list[int]:
        """Give the low corner of what the footprint can have touched, in cells of the grid."""
        reach_m = self._footprint_m + 2.0 * self.cell_m
        low = self._map.cells([min(place[axis] for place in way) - reach_m for axis in (0, 1)])
        return [max(0, math.floor(part)) for part in low[:2].tolist()]

    def _around(self, way: list[Vec3]) -> NDArray[np.uint8]:
        low_x, low_y = self._low(way)
        reach_m = self._footprint_m + 2.0 * self.cell_m
        high = self._map.cells([max(place[axis] for place in way) + reach_m for axis in (0, 1)])
        high_x, high_y = (max(0, math.ceil(part)) for part in high[:2].tolist())
        return self._map.grid[low_x:high_x, low_y:high_y, 0]

    def _rows(self, mask: NDArray[np.bool_], low: list[int]) -> list[Row]:
        steps = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        first, behind = np.argwhere(steps == 1), np.argwhere(steps == -1)
        corner = self._map.low[:2] + low
        rows = np.column_stack([first + corner, behind[:, 1] - first[:, 1]])
        return [[int(part) for part in row] for row in rows]
