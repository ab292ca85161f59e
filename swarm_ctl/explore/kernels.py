"""The inner loops of the memory: plain Python on arrays, compiled where numba is installed.

Grids are (nx, ny, nz) bytes of the flags below, nz = 1 in 2-D; positions come in cells relative to
the grid's low corner, and what lies outside of the grid is unknown. Compiled or not, one source.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore.chance import Floats

Grid = NDArray[np.uint8]
Cells = Any
"""Bytes, one per cell, or an array of them."""
Point = Sequence[float] | Floats
"""Three numbers; one by one a tuple is quicker made than an array."""
Call = TypeVar("Call", bound=Callable[..., Any])

VISITED = 1
"""Somebody's footprint has swept the cell."""
WALL = 2
"""Something was seen there; TRODDEN overrules it."""
TRODDEN = 4
"""A vehicle itself was in the cell, so that it is free."""
GIVEN_UP = 8
"""Nobody gets there: no longer worth a way."""
NEAR_WALL = 16
"""Too close to a wall for a path; TRODDEN overrules it."""
BLOCKED = 32
"""A vehicle was held up on its way into the cell, whatever the map says."""
OWN = 64
"""The vehicle's own footprint has swept the cell."""
KNOWN = VISITED | WALL | GIVEN_UP
SLIVER = 100
"""Rank of a frontier with little behind it: whatever else there is comes first."""
BORDER = 2
"""Says of an unknown cell that it is at the border of the map."""
TOLERANCE = 1e-9
"""Of a cell's centre on the very edge of a footprint, in cells."""


def _compiler() -> Callable[[Call], Call]:
    try:
        numba = importlib.import_module("numba")
    except ImportError:  # pragma: no cover - the extra `fast` is optional
        return lambda function: function
    compiler: Callable[[Call], Call] = numba.njit(cache=True)
    return compiler


compiled = _compiler()


@compiled
def paint(  # noqa: C901 - calls cost more than branches where this is not compiled
    grid: Grid, start: Point, end: Point, half: float, is_square: bool, seen: int
) -> bool:
    """Mark what a footprint sweeps from `start` to `end` (3,); the grid must hold all of it.

    `half` is the radius of a disc (2-D) or sphere, or half the side of an axis-aligned square.
    Its cells are marked as `seen`; tell whether that is news: some were not, or one near a wall had
    not been flown through.
    """
    is_new = False
    flat = grid.shape[2] == 1
    ax, ay, az = start[0], start[1], start[2]
    dx, dy, dz = end[0] - ax, end[1] - ay, end[2] - az
    if flat:
        az, dz = 0.5, 0.0
    length2 = dx * dx + dy * dy + dz * dz
    reach2 = (half + TOLERANCE) * (half + TOLERANCE)
    k0, k1 = 0, 1
    if not flat:
        k0 = max(0, math.floor(min(az, az + dz) - half))
        k1 = min(grid.shape[2], math.floor(max(az, az + dz) + half) + 1)
    i0 = max(0, math.floor(min(ax, ax + dx) - half))
    i1 = min(grid.shape[0], math.floor(max(ax, ax + dx) + half) + 1)
    j0 = max(0, math.floor(min(ay, ay + dy) - half))
    j1 = min(grid.shape[1], math.floor(max(ay, ay + dy) + half) + 1)
    x0, x1 = math.floor(min(ax, ax + dx) - 1.0), math.floor(max(ax, ax + dx) + 1.0)
    y0, y1 = math.floor(min(ay, ay + dy) - 1.0), math.floor(max(ay, ay + dy) + 1.0)
    for i in range(i0, i1):
        wx = i + 0.5 - ax
        for j in range(j0, j1):
            wy = j + 0.5 - ay
            # nothing is trodden this far off, and most has been swept before
            is_aside = i < x0 or i > x1 or j < y0 or j > y1
            for k in range(k0, k1):
                if is_aside and grid[i, j, k] & seen == seen:
                    continue
                wz = k + 0.5 - az
                along = wx * dx + wy * dy + wz * dz
                t = 0.0
                if length2 > 0.0:
                    t = min(1.0, max(0.0, along / length2))
                ex, ey, ez = wx - t * dx, wy - t * dy, wz - t * dz
                distance2 = ex * ex + ey * ey + ez * ez
                flags, before = 0, grid[i, j, k]
                if distance2 <= 0.25:
                    flags = seen | TRODDEN
                elif is_square:
                    flags = seen * in_swept_square(wx, wy, dx, dy, half + TOLERANCE)
                elif distance2 <= reach2:
                    flags = seen
                if flags & before != flags:
                    grid[i, j, k] |= flags
                    if before & seen != seen or before & NEAR_WALL:
                        is_new = True
    return is_new


@compiled
def box(grid: Grid, cell: tuple[int, int, int], reach: tuple[int, int, int], flag: int) -> None:
    """Set a flag within `reach` cells of one along each axis, as far as the grid goes."""
    for i in range(max(0, cell[0] - reach[0]), min(grid.shape[0], cell[0] + reach[0] + 1)):
        for j in range(max(0, cell[1] - reach[1]), min(grid.shape[1], cell[1] + reach[1] + 1)):
            for k in range(max(0, cell[2] - reach[2]), min(grid.shape[2], cell[2] + reach[2] + 1)):
                grid[i, j, k] |= flag


@compiled
def in_swept_square(wx: float, wy: float, dx: float, dy: float, half: float) -> bool:
    """Tell whether a square that moves from the origin by (dx, dy) ever covers (wx, wy)."""
    low, high = 0.0, 1.0
    if dx != 0.0:
        t0, t1 = (wx - half) / dx, (wx + half) / dx
        low, high = max(low, min(t0, t1)), min(high, max(t0, t1))
    elif abs(wx) > half:
        return False
    if dy != 0.0:
        t0, t1 = (wy - half) / dy, (wy + half) / dy
        low, high = max(low, min(t0, t1)), min(high, max(t0, t1))
    elif abs(wy) > half:
        return False
    return low <= high


@compiled
def look(grid: Grid, x: float, y: float, z: float) -> int:
    """Read the flags of the cell at a position; outside of the grid 0."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    if i < 0 or j < 0 or k < 0:
        return 0
    if i >= grid.shape[0] or j >= grid.shape[1] or k >= grid.shape[2]:
        return 0
    return int(grid[i, j, k])


@compiled
def rate(  # noqa: C901 - see paint
    grid: Grid,
    place: Floats,
    directions: Floats,
    sides: Floats,
    bodies: int,
    inner: int,
    lengths: Floats,
    pitch: float,
    stride: int,
    rated: Floats,
) -> None:
    """Walk along candidate steps and count the new ground of each; everything in cells.

    From `place` (3,) along unit `directions` (k, 3) for `lengths` (k,), one cell at a time; every
    `stride` cells the lanes at the offsets `sides` (k, m, 3) are looked at: the first `inner` are
    the swath, of which the first `bodies` also stop at walls; the others are its neighbours.
    `rated` (k, 4): new samples, those of them beside known ground, the path length up to the last
    new sample, and the free path length.
    """
    lanes = sides.shape[1]
    for n in range(directions.shape[0]):
        new, beside, last, free = 0, 0, 0.0, 0.0
        steps = int(lengths[n] / pitch)
        is_blocked = False
        for step in range(1, steps + 1):
            for part in range(1, stride + 1):
                s = (step - 1) * pitch + part * pitch / stride
                x = place[0] + s * directions[n, 0]
                y = place[1] + s * directions[n, 1]
                z = place[2] + s * directions[n, 2]
                for m in range(bodies):
                    flags = look(grid, x + sides[n, m, 0], y + sides[n, m, 1], z + sides[n, m, 2])
                    if flags & (WALL | TRODDEN) == WALL or (m == 0 and flags & BLOCKED):
                        is_blocked = True
                if is_blocked:
                    break
                free = s
            if is_blocked:
                break
            fresh = 0
            for m in range(inner):
                flags = look(grid, x + sides[n, m, 0], y + sides[n, m, 1], z + sides[n, m, 2])
                if flags & KNOWN == 0:
                    fresh += 1
            if fresh > 0:
                new += fresh
                last = s
                for m in range(inner, lanes):
                    flags = look(grid, x + sides[n, m, 0], y + sides[n, m, 1], z + sides[n, m, 2])
                    if flags & KNOWN:
                        beside += fresh
                        break
        rated[n, 0] = new
        rated[n, 1] = beside
        rated[n, 2] = last
        rated[n, 3] = free


@compiled
def spread(lanes: Floats, x: float, y: float, z: float, level: float, sides: Floats) -> None:
    """Put the offsets (1, m, 3) of lanes (m, 2) across a unit direction into `sides`, all in cells.

    `level` is the direction's length along the ground.
    """
    for m in range(lanes.shape[0]):
        aside, above = lanes[m, 0], lanes[m, 1]
        sides[0, m, 0] = aside * (-y / level) + above * (-z * x / level)
        sides[0, m, 1] = aside * (x / level) + above * (-z * y / level)
        sides[0, m, 2] = aside * 0.0 + above * level


@compiled
def is_passable(flags: int) -> bool:
    """Tell whether a path may lead through a cell with these flags."""
    if flags & (TRODDEN | BLOCKED):
        return flags & BLOCKED == 0
    return flags & VISITED != 0 and flags & (WALL | NEAR_WALL) == 0


@compiled
def is_line_free(grid: Grid, start: Floats, end: Floats) -> bool:
    """Tell whether a path may go straight from one position to another (in cells)."""
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    steps = int(2.0 * math.sqrt(dx * dx + dy * dy + dz * dz)) + 1
    for n in range(1, steps + 1):
        t = n / steps
        if not is_passable(look(grid, start[0] + t * dx, start[1] + t * dy, start[2] + t * dz)):
            return False
    return True


@compiled
def unknown_within(grid: Grid, i: int, j: int, k: int, reach: int) -> int:
    """Count unknown cells in the box of half size `reach` around a cell, flat in 2-D."""
    count = 0
    deep = 0 if grid.shape[2] == 1 else reach
    for a in range(i - reach, i + reach + 1):
        for b in range(j - reach, j + reach + 1):
            for c in range(k - deep, k + deep + 1):
                if look(grid, a + 0.5, b + 0.5, c + 0.5) & KNOWN == 0:
                    count += 1
    return count


@compiled
def flood(
    free: Cells,
    leaves: Cells,
    ranks: Cells,
    unknown: Cells,
    offsets: Any,
    start: int,
    near_steps: int,
    came_from: Any,
    queue: Any,
    pocket: Any,
) -> int:
    """Search breadth first from `start` for the nearest free cell of the lowest rank.

    All cells lie in one row, with a border that is neither free nor to be entered, so that
    `offsets` lead to the neighbours. `leaves` are cells that one may cross who is not on free
    ground. `ranks` of cells at a frontier; 0: none. A frontier farther than `near_steps` with no
    more than a pocket of `unknown` cells behind it, see `fill`, has rank SLIVER at least.
    Gives -1 when there is none. `came_from`, all -1 before, gets the way back; `queue` and
    `pocket` are scratch.
    """
    best, best_rank = -1, 256
    came_from[start] = start
    queue[0] = start
    head, tail, steps, level = 0, 1, 0, 1
    while head < tail:
        if head == level:
            steps, level = steps + 1, tail
        cell = queue[head]
        head += 1
        is_free = free[cell]
        rank = int(ranks[cell])
        if is_free and 0 < rank < best_rank:
            if (
                rank < SLIVER
                and steps > near_steps
                and fill(unknown, offsets, cell, pocket) < len(pocket)
            ):
                rank = SLIVER
            if rank < best_rank:
                best, best_rank = cell, rank
            if rank == 1:
                return int(cell)
        for offset in offsets:
            near = cell + offset
            if came_from[near] < 0 and (free[near] or (not is_free and leaves[near])):
                came_from[near] = cell
                queue[tail] = near
                tail += 1
    return int(best)


@compiled
def fill(unknown: Cells, offsets: Any, cell: int, pocket: Any) -> int:
    """Collect the unknown cells that hang together around a cell; tell how many, at most all.

    `pocket` gets them, and its length is the most that is counted. `unknown` is BORDER at the
    border of the map: what reaches it fills any pocket.
    """
    most = len(pocket)
    count, done, at = 0, 0, cell
    while True:
        for offset in offsets:
            near = at + offset
            if not unknown[near]:
                continue
            if unknown[near] == BORDER:
                return most
            is_new = True
            for n in range(count):
                if pocket[n] == near:
                    is_new = False
                    break
            if is_new:
                pocket[count] = near
                count += 1
                if count == most:
                    return most
        if done == count:
            return count
        at = pocket[done]
        done += 1


@compiled
def wall_within(grid: Grid, place: Point, radius: float) -> bool:
    """Tell whether a wall's nearest point is within `radius` cells of a position, at its height."""
    x, y, z = place[0], place[1], place[2]
    for i in range(math.floor(x - radius), math.floor(x + radius) + 1):
        for j in range(math.floor(y - radius), math.floor(y + radius) + 1):
            if look(grid, i + 0.5, j + 0.5, z) & (WALL | TRODDEN) != WALL:
                continue
            ex = max(0.0, i - x, x - i - 1.0)
            ey = max(0.0, j - y, y - j - 1.0)
            if ex * ex + ey * ey <= radius * radius:
                return True
    return False


IS_COMPILED = hasattr(paint, "py_func")
"""Whether the loops above are machine code here."""
