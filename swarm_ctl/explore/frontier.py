"""Ways over known free cells to the nearest ground that nobody has seen."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore import kernels
from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.memory import BLOCKED, KNOWN, NEAR_WALL, TRODDEN, VISITED, WALL, VisitedMap

LEAST_UNKNOWN = 2
"""Unknown neighbours that make a cell a frontier (ALGORITHM 2.6: K = 2)."""
CORNERS_AHEAD = 60
"""Cells along a way over which a straight line is tried."""


def find_way(
    memory: VisitedMap,
    position_m: Sequence[float],
    taken_m: Sequence[Sequence[float]],
    exclusion_m: float,
) -> list[list[float]]:
    """Give the corners of the shortest way to the nearest frontier; empty when there is none.

    The last corner lies among the unknown cells beyond the frontier. A frontier closer than
    `exclusion_m` to one of `taken_m` is left to others as long as there is another one.
    """
    padded = np.pad(memory.grid, 1)
    frontier = _frontier(padded, memory.dimensions)
    taken = [memory.cells(point) + 1.0 for point in taken_m]
    if taken:
        near = _near(padded.shape, taken, exclusion_m / memory.cell_m, memory.dimensions)
        frontier[near] *= 2
    corners = _corners(memory, position_m, padded, frontier)
    if corners:
        corners.append(_beyond(memory, corners[-1]))
    return [memory.metres(corner) for corner in corners]


def find_way_to(
    memory: VisitedMap, position_m: Sequence[float], goal_m: Sequence[float]
) -> list[list[float]]:
    """Give the corners of the shortest way to a place; empty when none is known."""
    padded = np.pad(memory.grid, 1)
    goal = np.zeros(padded.shape, dtype=np.uint8)
    index = np.floor(memory.cells(goal_m)).astype(int) + 1
    if (index < 1).any() or (index >= np.array(padded.shape) - 1).any():
        return []
    goal[tuple(index)] = 1
    corners = [memory.metres(corner) for corner in _corners(memory, position_m, padded, goal)]
    return [*corners[:-1], [float(value) for value in goal_m]] if corners else []


def _corners(
    memory: VisitedMap,
    position_m: Sequence[float],
    padded: NDArray[np.uint8],
    wanted: NDArray[np.uint8],
) -> list[Floats]:
    """Give the corners, in cells, of the shortest way to the nearest cell that is wanted."""
    place = memory.cells(position_m)
    index = np.floor(place).astype(int)
    if (index < 0).any() or (index >= memory.grid.shape).any():
        return []
    trodden = padded & TRODDEN != 0
    free = trodden | ((padded & VISITED != 0) & (padded & (WALL | NEAR_WALL) == 0))
    free &= padded & BLOCKED == 0
    leaves = (padded & VISITED != 0) & (padded & (WALL | BLOCKED) == 0)
    start = int(np.ravel_multi_index(tuple(index + 1), padded.shape))
    came_from, goal = _flood(free, leaves, wanted, _offsets(padded.shape), start)
    if goal < 0:
        return []
    cells = [goal]
    while (before := int(came_from[cells[-1]])) != cells[-1]:
        cells.append(before)
    places = np.unravel_index(np.array(cells[::-1]), padded.shape)
    points = np.stack(places, axis=1).astype(np.float64) - 0.5
    return _pull_tight(memory, place, points) or [points[-1]]


def _flood(
    free: NDArray[np.bool_],
    leaves: NDArray[np.bool_],
    frontier: NDArray[np.uint8],
    offsets: list[int],
    start: int,
) -> tuple[Sequence[int] | NDArray[np.int32], int]:
    """Call the kernel with what it is quick on: arrays when it is compiled, else bytes."""
    size = free.size
    if kernels.IS_COMPILED:
        came_from = np.full(size, -1, dtype=np.int32)
        arrays = (free.reshape(-1), leaves.reshape(-1), frontier.reshape(-1))
        scratch = np.empty(size, dtype=np.int32)
        return came_from, kernels.flood(*arrays, np.array(offsets), start, came_from, scratch)
    places = [-1] * size
    goal = kernels.flood(
        free.tobytes(), leaves.tobytes(), frontier.tobytes(), offsets, start, places, [0] * size
    )
    return places, goal


def _frontier(padded: NDArray[np.uint8], dimensions: int) -> NDArray[np.uint8]:
    """Mark cells with enough unknown neighbours (what lies outside of the map is unknown)."""
    unknown = (padded & KNOWN == 0).astype(np.uint8)
    for axis in range(dimensions):
        total = unknown.copy()
        ahead = [slice(None)] * 3
        behind = [slice(None)] * 3
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        total[tuple(ahead)] += unknown[tuple(behind)]
        total[tuple(behind)] += unknown[tuple(ahead)]
        unknown = total
    frontier: NDArray[np.uint8] = (unknown >= LEAST_UNKNOWN).astype(np.uint8)
    return frontier


def _near(
    shape: tuple[int, ...], taken: Sequence[Floats], exclusion: float, dimensions: int
) -> NDArray[np.bool_]:
    near = np.zeros(shape, dtype=np.bool_)
    axes = [np.arange(size) + 0.5 for size in shape]
    for x, y, z in taken:
        far2 = ((axes[0] - x) ** 2)[:, None, None] + ((axes[1] - y) ** 2)[None, :, None]
        if dimensions == 3:
            far2 = far2 + ((axes[2] - z) ** 2)[None, None, :]
        near |= far2 < exclusion * exclusion
    return near


def _offsets(shape: tuple[int, ...]) -> list[int]:
    """Lead to the neighbours in a row of all cells; straight ones first keep ways straight."""
    deep = (0,) if shape[2] == 3 else (-1, 0, 1)
    steps = list(itertools.product((-1, 0, 1), (-1, 0, 1), deep))
    steps.sort(key=lambda step: sum(map(abs, step)))
    return [(a * shape[1] + b) * shape[2] + c for a, b, c in steps[1:]]


def _pull_tight(memory: VisitedMap, place: Floats, points: Floats) -> list[Floats]:
    """Keep only the cells of a way where it has to turn."""
    corners, anchor, at, end = [], place, 0, len(points) - 1
    while at < end:
        reach, ahead = at + 1, min(end, at + CORNERS_AHEAD)
        while ahead > reach and not kernels.is_line_free(memory.grid, anchor, points[ahead]):
            ahead = (ahead + reach) // 2
        at = max(reach, ahead)
        anchor = points[at]
        corners.append(anchor)
    return corners


def _beyond(memory: VisitedMap, point: Floats) -> Floats:
    """Give the middle of the unknown cells around a frontier cell."""
    deep = (-1.0, 0.0, 1.0) if memory.dimensions == 3 else (0.0,)
    around = [point + step for step in itertools.product((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0), deep)]
    unknown = [cell for cell in around if not kernels.look(memory.grid, *cell) & KNOWN]
    middle: Floats = np.mean(unknown or [point], axis=0)
    return middle
