"""Where bodies fit, how far they get from their starts, and what of the field that shows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise, product
from typing import Literal

import numpy as np

from swarm_ctl.experiment.case import Case
from swarm_ctl.explore.chance import Bools, Floats, Rows

_STARTS = 1_000_000
"""In the place of a robot's index: the generator of a trial's starts. Not 0, which numpy's
SeedSequence cannot tell from nothing."""
_TOUCH_M = 1e-9
"""An overlap of less is none: bodies slide along walls."""
_SAME_M = 1e-6
"""Sides nearer to one another than this are one."""


class Room:
    """The places that the middle of a body can get to from where all start.

    The sides of the boxes, half a body farther out, cut the field into pieces that are free or not
    as a whole: the sides themselves, and what lies between two neighbours. Piece 2 k along an axis
    is its side k, piece 2 k + 1 the gap to the next: exact, whatever the size of a cell.
    """

    def __init__(self, case: Case) -> None:
        self._case, self._d, self._boxes = case, case.dimensions, case.boxes
        half_m = case.body_m / 2.0
        self._low_m: Floats = np.add(case.field.low_m, half_m)
        self._high_m: Floats = np.subtract(case.field.high_m, half_m)
        self._sides_m = [self._cut(axis, half_m) for axis in range(self._d)]
        middles: list[Floats] = [
            _pieces(sides, (sides[:-1] + sides[1:]) / 2.0) for sides in self._sides_m
        ]
        self._free: Bools = ~_solid(middles, self._boxes, half_m - _TOUCH_M)
        self._open = self._reached()

    @property
    def misfit(self) -> Literal["", "world", "start_height_m", "start_m"]:
        """Name what leaves no room for a robot, nothing if there is room for all."""
        case = self._case
        if (self._low_m > self._high_m).any() or not self._free.any():
            return "world"
        if case.start_height_m is not None and not self._at_height(self._free).any():
            return "start_height_m"
        if case.start_m is None:
            return "" if self._at_height(self._open).any() else "start_height_m"
        return "" if self._is_row_free() else "start_m"

    def starts(self, seed: int, trial: int) -> tuple[Floats, Floats]:
        """Draw places (robots, d) free for a body, and headings (robots,) anywhere."""
        case = self._case
        chance = np.random.default_rng([seed, trial, _STARTS])
        heading_rad = chance.uniform(-math.pi, math.pi, case.robots)
        places = np.empty((0, self._d))
        while len(places) < case.robots:
            drawn = self._draw(chance)
            places = np.concatenate([places, drawn[self._holds(drawn)]])
        return places[: case.robots], heading_rad

    def coverable(self, size: Sequence[int]) -> Bools:
        """Mark the cells, `size` of them along each axis, that can be explored from the room.

        Free cells within the square or cube around a footprint; walls do not hide anything.
        """
        field, cell, reach_m = self._case.field, self._case.field.cell_m, self._case.reach_m
        spans = []
        for sides, low, count in zip(self._sides_m, field.low_m, size, strict=True):
            first = (_pieces(sides, sides[:-1]) - reach_m - low) / cell - 0.5
            last = (_pieces(sides, sides[1:]) + reach_m - low) / cell - 0.5
            begin = np.clip(np.ceil(first - 1e-9), 0, count).astype(int)
            spans.append((begin, np.clip(np.floor(last + 1e-9) + 1.0, 0, count).astype(int)))
        cells: Bools = np.zeros(size, dtype=np.bool_)
        *across, (begin, end) = spans
        for index, piece, last_piece in _runs(self._open):
            lead = (slice(b[i], e[i]) for i, (b, e) in zip(index, across, strict=True))
            cells[(*lead, slice(begin[piece], end[last_piece]))] = True
        centres: list[Floats] = [
            np.add(low, (np.arange(count) + 0.5) * cell)
            for low, count in zip(field.low_m, size, strict=True)
        ]
        return cells & ~_solid(centres, self._boxes, 0.0)

    def _cut(self, axis: int, half_m: float) -> Floats:
        """Collect the sides across an axis, ascending."""
        low_m, high_m = self._low_m[axis], self._high_m[axis]
        boxes = self._boxes[:, [axis, axis + self._d]] + np.array([-half_m, half_m])
        inside = boxes[(boxes > low_m + _SAME_M) & (boxes < high_m - _SAME_M)]
        sides = np.unique([low_m, *inside, high_m])
        kept: Floats = sides[np.append(True, np.diff(sides) > _SAME_M)]
        return kept

    def _reached(self) -> Bools:
        """Mark the free pieces around `start_m`, or the largest room where anybody may start."""
        if self._case.start_m is not None:
            return _flood(self._free, self._seeds())
        volume: Floats = np.ones(1)
        for sides in self._sides_m:
            volume = volume[..., None] * _pieces(np.zeros(len(sides)), np.diff(sides))
        volume = volume[0]
        best, rest = np.zeros_like(self._free), self._free.copy()
        while rest.any():
            seeds = np.zeros_like(rest)
            seeds.flat[rest.argmax()] = True
            room = _flood(rest, seeds)
            rest &= ~room
            best = max(best, room, key=lambda part: (volume[part].sum(), part.sum()))
        return best

    def _seeds(self) -> Bools:
        """Mark the pieces over the places where the robots start, at any height if none is said."""
        seeds = np.zeros_like(self._free)
        north, east = (self._piece(axis, along) for axis, along in enumerate(self._row().T))
        seeds[north, east] = True
        return seeds & self._at_height(np.ones_like(seeds))

    def _at_height(self, pieces: Bools) -> Bools:
        """Leave of some pieces those at the height of the start, if one is said."""
        if self._case.start_height_m is None:
            return pieces
        down_m = self._down_m(self._case.start_height_m)
        if not self._low_m[2] <= down_m <= self._high_m[2]:
            return np.zeros_like(pieces)
        level = np.zeros(pieces.shape[2], dtype=np.bool_)
        level[self._piece(2, np.array([down_m]))] = True
        return pieces & level

    def _is_row_free(self) -> bool:
        """Tell whether every robot fits in its place, with a margin for the jitter."""
        case, row = self._case, self._row()
        inside = (row >= case.field.low_m[:2]) & (row <= case.field.high_m[:2])
        if not inside.all():
            return False
        free = self._at_height(self._free)
        for around in product((-3.0, 0.0, 3.0), repeat=2):
            spread = row + np.multiply(around, case.jitter_m)
            place = np.clip(spread, self._low_m[:2], self._high_m[:2])
            at = tuple(self._piece(axis, along) for axis, along in enumerate(place.T))
            if not free[at].reshape(len(row), -1).any(axis=1).all():
                return False
        return True

    def _row(self) -> Floats:
        """Lay the robots out in their row, (robots, 2) north, east."""
        case = self._case
        row = np.tile(np.array(case.start_m, dtype=np.float64), (case.robots, 1))
        row[:, 1] += case.start_spacing_m * (np.arange(case.robots) - (case.robots - 1) / 2.0)
        return row

    def _draw(self, chance: np.random.Generator) -> Floats:
        case = self._case
        if case.start_m is None:
            drawn = chance.uniform(self._low_m, self._high_m, (case.robots, self._d))
        else:
            around = self._row() + chance.normal(0.0, case.jitter_m, (case.robots, 2))
            drawn = np.clip(around, self._low_m[:2], self._high_m[:2])
            if self._d == 3:
                down_m = chance.uniform(self._low_m[2], self._high_m[2], case.robots)
                drawn = np.column_stack([drawn, down_m])
        if case.start_height_m is not None:
            drawn[:, 2] = self._down_m(case.start_height_m)
        return drawn

    def _down_m(self, height_m: float) -> float:
        return self._case.field.high_m[2] - height_m

    def _holds(self, place_m: Floats) -> Bools:
        """Tell which of (n, d) places are in the room."""
        held: Bools = self._open[tuple(self._piece(i, along) for i, along in enumerate(place_m.T))]
        return held

    def _piece(self, axis: int, along_m: Floats) -> Rows:
        """Find the pieces of coordinates (n,); those beyond the field belong to its last side."""
        sides = self._sides_m[axis]
        next_side = sides.searchsorted(along_m, side="right")
        is_gap = along_m > sides[np.maximum(next_side - 1, 0)]
        return np.clip(2 * next_side - 2 + is_gap, 0, 2 * len(sides) - 2)


def _pieces(sides: Floats, gaps: Floats) -> Floats:
    """Put sides (k,) and the gaps between them (k - 1,) in turns."""
    pieces = np.empty(2 * len(sides) - 1)
    pieces[::2], pieces[1::2] = sides, gaps
    return pieces


def _solid(axes: Sequence[Floats], boxes: Floats, half_m: float) -> Bools:
    """Tell for a lattice of places whether a body there would overlap a box."""
    solid: Bools = np.zeros([len(axis) for axis in axes], dtype=np.bool_)
    for low, high in boxes.reshape(-1, 2, len(axes)):
        inside = (
            (axis > a - half_m) & (axis < b + half_m)
            for axis, a, b in zip(axes, low, high, strict=True)
        )
        solid[np.ix_(*inside)] = True
    return solid


def _flood(free: Bools, seeds: Bools) -> Bools:
    """Mark the free pieces that share a side, over any number of steps, with free seeds."""
    padded = np.pad(free, 1)
    strides = np.array(padded.strides)
    steps, unseen = np.concatenate([strides, -strides]), padded.reshape(-1)
    reached = np.zeros_like(unseen)
    front = np.pad(seeds, 1).reshape(-1).nonzero()[0]
    while len(front := front[unseen[front]]):
        unseen[front], reached[front] = False, True
        front = np.unique(front + steps[:, None])
    return reached.reshape(padded.shape)[(slice(1, -1),) * free.ndim]


def _runs(pieces: Bools) -> Iterator[tuple[tuple[int, ...], int, int]]:
    """Go through the runs along the last axis: where along the others, first and last piece."""
    for index in np.ndindex(pieces.shape[:-1]):
        edges = np.flatnonzero(np.diff(pieces[index], prepend=False, append=False))
        for first, stop in pairwise(edges.tolist()):
            if pieces[index][first]:
                yield index, first, stop - 1
