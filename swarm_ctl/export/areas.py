"""Areas of a grid as polygons, and the ground that a run has searched."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.record.reader import Run

MASK = NDArray[np.bool_]
Ring = list[tuple[float, float]]
"""North and east of its corners, m; the last one is the first one again."""
Polygon = list[Ring]
"""The outer ring, counter-clockwise seen from above; then its holes, clockwise."""

_CELL_M = 0.25
_MOST_CELLS = 4_000_000
"""Of ground searched by vehicles that no referee saw; a larger one has larger cells."""


@dataclass(frozen=True, slots=True)
class Ground:
    """What was searched of the ground, cell by cell."""

    south_m: float
    west_m: float
    cell_m: float
    searched: MASK
    """(north, east)."""
    missed: MASK
    """(north, east): could have been searched and was not; nothing where nobody knows."""
    source: str
    """Who says so, in words."""

    def polygons(self, cells: MASK) -> list[Polygon]:
        """Outline some of its cells, in the launch frame."""
        return [
            [
                [(self.south_m + r * self.cell_m, self.west_m + c * self.cell_m) for r, c in ring]
                for ring in polygon
            ]
            for polygon in outline(cells)
        ]

    def area_m2(self, cells: MASK) -> float:
        """Give the area of some of its cells."""
        return float(cells.sum()) * self.cell_m**2


def searched_ground(run: Run) -> Ground | None:
    """Give what the referee saw searched, else what lies around the paths; None: no paths."""
    arrays = run.truth.arrays
    if {"seen_s", "seen_fraction", "free", "cell_m", "origin_ne_m"} <= arrays.keys():
        free = arrays["free"].astype(bool)
        seen = free & np.isfinite(arrays["seen_s"]) & (arrays["seen_fraction"] > 0.0)
        south_m, west_m = map(float, arrays["origin_ne_m"])
        source = "the mock's referee"
        return Ground(south_m, west_m, float(arrays["cell_m"]), seen, free & ~seen, source)
    return _around_paths(run)


def _around_paths(run: Run) -> Ground | None:
    """Take what lies within the footprint of a path; walls are not known."""
    paths = [track.ned_m[:, :2] for track in run.tracks if len(track.time_s)]
    reach_m = float(run.mission["planner"].get("footprint_m", 1.0))
    if not paths or not run.starts_ned_m:
        return None
    places = np.concatenate(paths)
    low, high = places.min(axis=0) - reach_m, places.max(axis=0) + reach_m
    cell_m = max(_CELL_M, math.sqrt(float(np.prod(high - low)) / _MOST_CELLS))
    shape = np.ceil((high - low) / cell_m).astype(int) + 1
    mask = np.zeros(shape, dtype=bool)
    reach = math.floor(reach_m / cell_m)
    offsets = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T
    offsets = offsets[np.hypot(*offsets.T) * cell_m <= reach_m]
    for path in paths:
        at = np.unique(np.floor((_dense(path, cell_m) - low) / cell_m).astype(int), axis=0)
        cells = (at[:, None] + offsets).reshape(-1, 2)
        cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
        mask[cells[:, 0], cells[:, 1]] = True
    source = f"paths, {reach_m:g} m to each side, as if there were no walls"
    return Ground(float(low[0]), float(low[1]), cell_m, mask, np.zeros_like(mask), source)


def _dense(path: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """Put points along a path, at most a step apart."""
    lengths = np.hypot(*np.diff(path, axis=0).T)
    along = np.append(0.0, np.cumsum(lengths))
    wanted = np.arange(0.0, along[-1] + step_m, step_m)
    return np.stack([np.interp(wanted, along, path[:, axis]) for axis in (0, 1)], axis=1)


def outline(cells: MASK) -> list[list[list[tuple[int, int]]]]:
    """Outline the cells of a mask as polygons whose corners are (row, column), closed.

    Rows count north, columns east. No ring meets itself; two may meet at a corner, as the
    standards allow.
    """
    rings = _rings(np.pad(cells, 1))
    outer = [ring for ring in rings if _area(ring) > 0]
    polygons = [[ring] for ring in outer]
    for hole in (ring for ring in rings if _area(ring) < 0):
        inside = [index for index, ring in enumerate(outer) if _contains(ring, _within(hole))]
        around = min(inside, key=lambda index: _area(outer[index]))
        polygons[around].append(hole)
    return polygons


def _rings(padded: MASK) -> list[list[tuple[int, int]]]:
    """Walk along all edges with the solid on the left; give the closed rings of corners."""
    ways = _edges(padded)
    rings = []
    while ways:
        start = at = next(iter(ways))
        step = ways[start][0]
        ring = [start]
        while True:
            ways[at].remove(step)
            if not ways[at]:
                del ways[at]
            at = (at[0] + step[0], at[1] + step[1])
            if at == start:
                break
            turned = _turn(step, ways[at])
            if turned != step:
                ring.append(at)
            step = turned
        rings += _simple(_without_straight(ring))
    return rings


def _edges(padded: MASK) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """Give the steps that lead on from each corner, counter-clockwise around solid cells.

    Step (0, 1) goes east along a cell's south side, (1, 0) north along its east side.
    """
    ways: dict[tuple[int, int], list[tuple[int, int]]] = {}
    solid = padded.astype(np.int8)
    up = solid[1:, :] - solid[:-1, :]  # row r of it lies between rows r and r + 1
    across = solid[:, 1:] - solid[:, :-1]
    for edges, shift, step in (
        (up == 1, (0, -1), (0, 1)),
        (up == -1, (0, 0), (0, -1)),
        (across == -1, (-1, 0), (1, 0)),
        (across == 1, (0, 0), (-1, 0)),
    ):
        for row, column in np.argwhere(edges).tolist():
            ways.setdefault((row + shift[0], column + shift[1]), []).append(step)
    return ways


def _turn(step: tuple[int, int], ways: list[tuple[int, int]]) -> tuple[int, int]:
    """Choose the way on: to the left where two cells meet at a corner, to stay with one."""
    left = (step[1], -step[0])
    return left if left in ways else ways[0]


def _without_straight(ring: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Leave out the first corner if it is none: a walk may begin in the middle of a side."""
    (a, b), (c, d), (e, f) = ring[-1], ring[0], ring[1]
    is_straight = (c - a) * (f - d) == (d - b) * (e - c)
    return ring[1:] if is_straight else ring


def _simple(ring: list[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    """Cut a ring in two wherever it meets itself, and close the parts."""
    parts = []
    walked: dict[tuple[int, int], None] = {}
    for corner in ring:
        if corner in walked:
            loop = [walked.popitem()[0]]
            while loop[-1] != corner:
                loop.append(walked.popitem()[0])
            parts.append([corner, *loop[::-1][1:], corner])
        walked[corner] = None
    return [*parts, [*walked, ring[0]]]


def _area(ring: list[tuple[int, int]]) -> float:
    """Give the area, positive if it goes counter-clockwise (north up, east right)."""
    north, east = np.array(ring, dtype=float).T
    return 0.5 * float(np.sum(east[:-1] * north[1:] - east[1:] * north[:-1]))


def _within(hole: list[tuple[int, int]]) -> tuple[float, float]:
    """Give a place just outside a hole's ring, where the solid is: left of its first side."""
    (a, b), (c, d) = hole[:2]
    length = abs(c - a) + abs(d - b)
    north, east = (c - a) / length, (d - b) / length
    return a + north * 0.5 + east * 0.25, b + east * 0.5 - north * 0.25


def _contains(ring: list[tuple[int, int]], place: tuple[float, float]) -> bool:
    """Tell whether a place lies inside a ring: a ray to the east crosses it an odd number."""
    corners = np.array(ring, dtype=float)
    north, east = place
    low, high = (
        np.minimum(corners[:-1, 0], corners[1:, 0]),
        np.maximum(corners[:-1, 0], corners[1:, 0]),
    )
    crossed = (low <= north) & (north < high) & (corners[:-1, 1] > east)
    return bool(crossed.sum() % 2)
