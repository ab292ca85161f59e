"""Ways over known free cells to the nearest ground that nobody has seen."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore import kernels
from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.memory import BLOCKED, KNOWN, NEAR_WALL, TRODDEN, VISITED, WALL, VisitedMap

Cells = NDArray[np.uint8]

LEAST_UNKNOWN = 2
"""Unknown neighbours that make a cell a frontier (ALGORITHM 2.6: K = 2)."""
SLIVER_CELLS = 6
"""Fewer unknown cells that hang together are a sliver: not worth a way while there is more."""
NEAR_STEPS = 5
"""Steps of the search within which a sliver is as good as any: it is on the way."""
POCKET_CELLS = 80
"""Fewer unknown cells that hang together are work for one: who is there first has them."""
BESIDE_CELLS = 3
"""A way to a place that is not free itself may end this far beside it."""
CORNERS_AHEAD = 60
"""Cells along a way over which a straight line is tried."""


class Others(NamedTuple):
    """What is known of the peers, in metres in the vehicle's own frame."""

    places_m: Sequence[Sequence[float]]
    """Where peers were a short while ago."""
    targets_m: Sequence[Sequence[float]]
    """Where peers are going."""
    exclusion_m: float
    """A frontier closer than this to a target is left to that peer while there is another one."""


NOBODY = Others((), (), 0.0)


def find_way(
    memory: VisitedMap, position_m: Sequence[float], others: Others, gap_cells: int
) -> list[list[float]]:
    """Give the corners of the shortest way to the best frontier; empty when there is none.

    The last corner lies among the unknown cells beyond the frontier. The best frontier is the one
    to which the fewest peers are closer, then the nearest; slivers come after all others, and
    pockets that a peer is after last. Gaps in walls of up to `gap_cells` are no frontiers.
    """
    padded = np.pad(memory.grid, 1)
    unknown = _unknown(padded, memory.dimensions, gap_cells)
    ranks = _frontier(unknown, memory.dimensions)
    ranks &= padded & VISITED  # both 0 or 1: no way leads elsewhere, and most of a map is unknown
    _rank(ranks, unknown, memory, position_m, others)
    corners = _corners(memory, position_m, padded, ranks, unknown)
    if corners:
        corners.append(_beyond(memory, corners[-1]))
    return [memory.metres(corner) for corner in corners]


def find_way_to(
    memory: VisitedMap, position_m: Sequence[float], goal_m: Sequence[float]
) -> list[list[float]]:
    """Give the corners of the shortest way to a place; empty when none is known.

    To a place that counts as wall, or near one, seen since, it leads by the nearest free cell.
    """
    padded = np.pad(memory.grid, 1)
    ranks = np.zeros(padded.shape, dtype=np.uint8)
    index = np.floor(memory.cells(goal_m)).astype(int) + 1
    if (index < 1).any() or (index >= np.array(padded.shape) - 1).any():
        return []
    low = np.maximum(index - BESIDE_CELLS, 0)
    around = tuple(slice(a, b) for a, b in zip(low, index + BESIDE_CELLS + 1, strict=True))
    near = np.argwhere(_free(padded[around])) + low
    ranks[tuple(near.T)] = kernels.SLIVER + 1 + ((near - index) ** 2).sum(axis=1)
    corners = [
        memory.metres(corner) for corner in _corners(memory, position_m, padded, ranks, ranks)
    ]
    return [*corners[:-1], [float(value) for value in goal_m]] if corners else []


def _corners(
    memory: VisitedMap,
    position_m: Sequence[float],
    padded: Cells,
    ranks: Cells,
    unknown: Cells,
) -> list[Floats]:
    """Give the corners, in cells, of the shortest way to the cell of the best rank."""
    place = memory.cells(position_m)
    index = np.floor(place).astype(int)
    if (index < 0).any() or (index >= memory.grid.shape).any():
        return []
    free = _free(padded)
    leaves = (padded & VISITED != 0) & (padded & (WALL | BLOCKED) == 0)
    start = int(np.ravel_multi_index(tuple(index + 1), padded.shape))
    came_from, goal = _flood(free, leaves, ranks, unknown, _offsets(padded.shape), start)
    if goal < 0:
        return []
    cells = [goal]
    while (before := int(came_from[cells[-1]])) != cells[-1]:
        cells.append(before)
    places = np.unravel_index(np.array(cells[::-1]), padded.shape)
    points = np.stack(places, axis=1).astype(np.float64) - 0.5
    return _pull_tight(memory, place, points) or [points[-1]]


def _free(grid: Cells) -> NDArray[np.bool_]:
    """Tell of every cell whether ways may lead through it."""
    is_clear = (grid & VISITED != 0) & (grid & (WALL | NEAR_WALL) == 0)
    free: NDArray[np.bool_] = ((grid & TRODDEN != 0) | is_clear) & (grid & BLOCKED == 0)
    return free


def _flood(
    free: NDArray[np.bool_],
    leaves: NDArray[np.bool_],
    ranks: Cells,
    unknown: Cells,
    offsets: list[int],
    start: int,
) -> tuple[Sequence[int] | NDArray[np.int32], int]:
    """Call the kernel with what it is quick on: arrays when it is compiled, else bytes."""
    size = free.size
    if kernels.IS_COMPILED:
        came_from = np.full(size, -1, dtype=np.int32)
        a, b, c, d = (cells.reshape(-1) for cells in (free, leaves, ranks, unknown))
        queue, pocket = np.empty(size, dtype=np.int32), np.empty(SLIVER_CELLS, dtype=np.int64)
        ways = np.array(offsets)
        goal = kernels.flood(a, b, c, d, ways, start, NEAR_STEPS, came_from, queue, pocket)
        return came_from, goal
    places, queue_, pocket_ = [-1] * size, [0] * size, [0] * SLIVER_CELLS
    e, f, g, h = (cells.tobytes() for cells in (free, leaves, ranks, unknown))
    goal = kernels.flood(e, f, g, h, offsets, start, NEAR_STEPS, places, queue_, pocket_)
    return places, goal


def _unknown(padded: Cells, dimensions: int, gap_cells: int) -> Cells:
    """Mark unknown cells, BORDER at the edge; a gap in a wall that is too narrow is none."""
    unknown: Cells = (padded & KNOWN == 0).astype(np.uint8)
    wall = padded & WALL != 0
    for axis in range(dimensions):
        along, cells = np.moveaxis(wall, axis, 0), np.moveaxis(unknown, axis, 0)
        for gap in range(1, gap_cells + 1):
            posts = along[: -gap - 1] & along[gap + 1 :]
            for part in range(1, gap + 1):
                cells[part : part + len(posts)] &= ~posts
    for axis in range(dimensions):
        edges = np.moveaxis(unknown, axis, 0)
        edges[0] = edges[-1] = kernels.BORDER
    return unknown


def _frontier(unknown: Cells, dimensions: int) -> Cells:
    """Mark cells with enough unknown neighbours (what lies outside of the map is unknown)."""
    count = (unknown > 0).astype(np.uint8)
    for axis in range(dimensions):
        total = count.copy()
        ahead = [slice(None)] * 3
        behind = [slice(None)] * 3
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        total[tuple(ahead)] += count[tuple(behind)]
        total[tuple(behind)] += count[tuple(ahead)]
        count = total
    frontier: Cells = (count >= LEAST_UNKNOWN).astype(np.uint8)
    return frontier


def _rank(
    ranks: Cells,
    unknown: Cells,
    memory: VisitedMap,
    position_m: Sequence[float],
    others: Others,
) -> None:
    """Rank frontiers, 1 is best: one behind another by how many peers are closer to it."""
    row = ranks.reshape(-1)
    frontier = np.flatnonzero(row.view(np.bool_))  # bytes of 0 and 1, and quicker found as such
    at = np.unravel_index(frontier, ranks.shape)
    if others.places_m:
        own = _far2(at, memory.cells(position_m))
        closer = sum(_far2(at, memory.cells(place)) < own for place in others.places_m)
        row[frontier] += np.minimum(closer, kernels.SLIVER - 3).astype(np.uint8)
    offsets = np.array(_offsets(ranks.shape))
    open_, claimed = [], []
    for target in others.targets_m:
        cells = memory.cells(target) + 1.0
        pocket = _pocket(unknown, cells, offsets)
        if pocket is None:
            open_.append(cells)
        else:
            claimed.append(pocket)
    if open_:
        near = _near(at, open_, others.exclusion_m / memory.cell_m, memory.dimensions)
        row[frontier[near]] += 1
    for pocket in claimed:
        rim = (pocket[:, None] + offsets).ravel()
        row[rim[row[rim] > 0]] = kernels.SLIVER + 1


def _far2(at: Sequence[NDArray[np.intp]], place: Floats) -> Floats:
    """Squared distances of padded cells, an array for each axis, from a place in cells (3,)."""
    dx, dy, dz = (cells - part for cells, part in zip(at, place + 0.5, strict=True))
    far2: Floats = dx * dx + dy * dy + dz * dz
    return far2


def _pocket(unknown: Cells, place: Floats, offsets: NDArray[np.int_]) -> NDArray[np.int64] | None:
    """Give the pocket of unknown cells around a place; None where it is open ground."""
    (i, j, k), (nx, ny, nz) = map(math.floor, place.tolist()), unknown.shape
    if not (0 < i < nx - 1 and 0 < j < ny - 1 and 0 < k < nz - 1):
        return None
    cell = (i * ny + j) * nz + k
    if kernels.IS_COMPILED:
        pocket = np.empty(POCKET_CELLS, dtype=np.int64)
        size = kernels.fill(unknown.reshape(-1), offsets, cell, pocket)
        return pocket[:size] if size < POCKET_CELLS else None
    cells = [0] * POCKET_CELLS
    size = kernels.fill(unknown.tobytes(), offsets.tolist(), cell, cells)
    return np.array(cells[:size], dtype=np.int64) if size < POCKET_CELLS else None


def _near(
    at: Sequence[NDArray[np.intp]], taken: Sequence[Floats], exclusion: float, dimensions: int
) -> NDArray[np.bool_]:
    """Tell of padded cells which are closer than `exclusion` to one of the places."""
    x, y, z = (cells + 0.5 for cells in at)
    near = np.zeros(len(x), dtype=np.bool_)
    for place in taken:
        far2 = (x - place[0]) ** 2 + (y - place[1]) ** 2
        if dimensions == 3:
            far2 = far2 + (z - place[2]) ** 2
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
