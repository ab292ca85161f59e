"""What walls and boxes do to those near them, in numpy and as loops for numba (see `hot.py`)."""

from __future__ import annotations

import math

import numpy as np

from swarm_ctl.experiment.case import overlaps
from swarm_ctl.explore.chance import Bools, Floats, Rows

Corner = tuple[float, ...]


def near_all(place_m: Floats, low: Corner, high: Corner, boxes: Floats, reach_m: float) -> Rows:
    """Find who of (n, d) has a wall or a box near enough for a level ray to hit it within reach.

    The boxes (b, 4) are their outlines from above.
    """
    north, east = place_m[:, 0], place_m[:, 1]
    near: Bools = (north < low[0] + reach_m) | (north > high[0] - reach_m)
    near |= (east < low[1] + reach_m) | (east > high[1] - reach_m)
    if len(boxes):
        near |= overlaps(place_m[:, :2], boxes, reach_m).any(axis=1)
    return near.nonzero()[0]


def slide_all(
    last_m: Floats, wanted_m: Floats, low: Corner, high: Corner, boxes: Floats, half_m: float
) -> tuple[Floats, Floats, Bools]:
    """Keep bodies inside and out of boxes; who would end in one slides along the side it hit.

    Gives the places (n, d), the paths to there (n,), and who was stopped (n,).
    """
    place_m: Floats = np.clip(wanted_m, np.add(low, half_m), np.subtract(high, half_m))
    if len(boxes):
        _slide_along(last_m, place_m, boxes, half_m)
    moved = place_m - last_m
    stopped: Bools = (place_m[:, 0] != wanted_m[:, 0]) | (place_m[:, 1] != wanted_m[:, 1])
    if len(low) == 3:
        stopped |= place_m[:, 2] != wanted_m[:, 2]
    return place_m, np.sqrt(np.einsum("nd,nd->n", moved, moved)), stopped


def _slide_along(last_m: Floats, place_m: Floats, boxes: Floats, half_m: float) -> None:
    row, box = overlaps(place_m, boxes, half_m).nonzero()
    d = place_m.shape[1]
    outward = np.repeat([-1.0, 1.0], d)
    sides = boxes[box] + outward * half_m
    was_beyond = outward * (np.tile(last_m[row], 2) - sides) > -1e-9
    deep_m = np.where(was_beyond, outward * (sides - np.tile(place_m[row], 2)), np.inf)
    side = deep_m.argmin(axis=1)
    place_m[row, side % d] = sides[np.arange(len(row)), side]
    # Between two boxes nothing but to stay is sure to be free.
    stuck = row[overlaps(place_m[row], boxes, half_m - 1e-9).any(axis=1)]
    place_m[stuck] = last_m[stuck]


def plumb(place_m: Floats, low: Corner, high: Corner, boxes: Floats) -> tuple[Floats, Floats]:
    """Measure from (n, 3) straight up and straight down to the first surface, (n,) each."""
    down = place_m[:, 2]
    over = overlaps(place_m[:, :2], boxes[:, [0, 1, 3, 4]], 0.0)
    upper, lower = boxes[:, 2], boxes[:, 5]
    above = np.where(over & (lower <= down[:, None]), lower, low[2])
    below = np.where(over & (upper >= down[:, None]), upper, high[2])
    return down - above.max(axis=1, initial=low[2]), below.min(axis=1, initial=high[2]) - down


# From here on: the flat ones of above as loops for numba, which cannot see the rest of the module.


def near(place_m: Floats, low: Corner, high: Corner, boxes: Floats, reach_m: float) -> Rows:
    """Find who is near, as `near_all`."""
    rows = np.empty(len(place_m), dtype=np.intp)
    count = 0
    for i in range(len(place_m)):
        north, east = place_m[i, 0], place_m[i, 1]
        is_near = north < low[0] + reach_m or north > high[0] - reach_m
        is_near |= east < low[1] + reach_m or east > high[1] - reach_m
        for k in range(len(boxes)):
            is_near |= (boxes[k, 0] - reach_m < north < boxes[k, 2] + reach_m) and (
                boxes[k, 1] - reach_m < east < boxes[k, 3] + reach_m
            )
        rows[count] = i
        count += is_near
    return rows[:count]


def slide(
    last_m: Floats, wanted_m: Floats, low: Corner, high: Corner, boxes: Floats, half_m: float
) -> tuple[Floats, Floats, Bools]:
    """Keep bodies inside and out of boxes, as `slide_all`."""
    place_m, moved_m = np.empty_like(wanted_m), np.empty(len(wanted_m))
    stopped = np.empty(len(wanted_m), dtype=np.bool_)
    deep_m, sides = np.empty(4), np.empty(4)
    for i in range(len(wanted_m)):
        north = min(max(wanted_m[i, 0], low[0] + half_m), high[0] - half_m)
        east = min(max(wanted_m[i, 1], low[1] + half_m), high[1] - half_m)
        place_m[i, 0], place_m[i, 1] = north, east
        hit = False
        for k in range(len(boxes)):
            for side in range(4):
                sides[side] = boxes[k, side] + (half_m if side > 1 else -half_m)
            if not (sides[0] < north < sides[2] and sides[1] < east < sides[3]):
                continue
            hit = True
            for side in range(4):
                outward = 1.0 if side > 1 else -1.0
                at, was = (east, last_m[i, 1]) if side % 2 else (north, last_m[i, 0])
                deep_m[side] = np.inf
                if outward * (was - sides[side]) > -1e-9:
                    deep_m[side] = outward * (sides[side] - at)
            side = int(deep_m.argmin())
            place_m[i, side % 2] = sides[side]
        if hit:
            inner_m = half_m - 1e-9
            north, east = place_m[i, 0], place_m[i, 1]
            for k in range(len(boxes)):
                if (boxes[k, 0] - inner_m < north < boxes[k, 2] + inner_m) and (
                    boxes[k, 1] - inner_m < east < boxes[k, 3] + inner_m
                ):
                    place_m[i, 0], place_m[i, 1] = last_m[i, 0], last_m[i, 1]
        stopped[i] = place_m[i, 0] != wanted_m[i, 0] or place_m[i, 1] != wanted_m[i, 1]
        north, east = place_m[i, 0] - last_m[i, 0], place_m[i, 1] - last_m[i, 1]
        moved_m[i] = math.sqrt(north * north + east * east)
    return place_m, moved_m, stopped
