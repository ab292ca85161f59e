"""The strip of ground that a candidate step would sweep, and what is new in it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore import kernels
from swarm_ctl.explore.chance import Chance, Floats, Rows
from swarm_ctl.explore.levy import levy_length
from swarm_ctl.explore.memory import VisitedMap, three
from swarm_ctl.explore.planner import PlannerParams

_ROW: Rows = np.zeros(1, dtype=np.intp)


class Swath:
    """The strip of ground that a step would sweep, as the kernels look at it."""

    def __init__(self, params: PlannerParams) -> None:
        self._params = params
        half, cell = params.footprint_m, params.cell_m
        self._d = params.dimensions
        self.width_m = 2.0 * half
        across = 3 if 2.0 * half / cell < 4.5 else 5
        if self._d == 3:
            across = 3
        self.pitch = 2.0 * half / cell / across
        """Distance between samples, cells."""
        self._stride = max(1, round(self.pitch))
        reach = range(-(across // 2), across // 2 + 1)
        body = params.clearance_m / cell
        if self._d == 2:
            swath = [(lane * self.pitch, 0.0) for lane in reach]
            edges = [(side * (half / cell + 0.5 * self.pitch), 0.0) for side in (-1.0, 1.0)]
        else:
            swath = [(lane * self.pitch, rise * self.pitch) for lane in reach for rise in reach]
            rim = half / cell + 0.5 * self.pitch
            edges = [(rim, 0.0), (-rim, 0.0), (0.0, rim), (0.0, -rim)]
        swath.sort(key=lambda lane: math.hypot(*lane))
        self._bodies = sum(math.hypot(*lane) <= body for lane in swath)
        self.inner = len(swath)
        self._lanes = np.array(swath + edges)
        self._sides = np.zeros((1, len(self._lanes), 3))
        self._aside, self._above = self._lanes[None, :, :1], self._lanes[None, :, 1:]
        self.overhead = 1.0 if self._d == 2 else 2.0 / (self.pitch * cell)
        """Samples added to every step's length: short steps cost a decision, too."""
        self._strip = np.array([(2.0 * self.width_m if self._d == 2 else 3.0) / cell])
        self._rated = np.zeros((params.candidates, 4))
        self._one = np.zeros((1, 4))
        headings = np.arange(8) * (math.pi / 4.0)
        self._eight = np.stack([np.cos(headings), np.sin(headings), np.zeros(8)], axis=1)

    def candidates(self, chance: Chance) -> tuple[Floats, Floats, Floats]:
        """Draw steps: unit directions (k, 3), their lanes (k, m, 3) and lengths in metres (k,)."""
        params, count = self._params, self._params.candidates
        lengths = levy_length(
            chance.uniform(_ROW, count)[0], params.levy_min_m, params.levy_max_m, params.levy_beta
        )
        directions = self._eight[np.arange(count) % 8]
        if self._d == 3:
            numbers = chance.uniform(_ROW, 2 * count)[0]
            steepest = math.sin(math.radians(params.climb_angle_deg))
            sine = steepest * (2.0 * numbers[:count] - 1.0)
            heading = 2.0 * math.pi * numbers[count:]
            level = np.sqrt(1.0 - sine * sine)
            directions = np.stack([level * np.cos(heading), level * np.sin(heading), sine], axis=1)
        return directions, self.lanes(directions), lengths

    def lanes(self, directions: Floats) -> Floats:
        """Give the offsets (k, m, 3) of the lanes across unit directions (k, 3), in cells."""
        x, y, z = directions.T
        level = np.maximum(np.hypot(x, y), 1e-9)
        side = np.stack([-y / level, x / level, np.zeros_like(x)], axis=1)
        rise = np.stack([-z * x / level, -z * y / level, level], axis=1)
        lanes: Floats = self._aside * side[:, None, :] + self._above * rise[:, None, :]
        return lanes

    def _lanes_across(self, x: float, y: float, z: float) -> Floats:
        """Give what `lanes` gives for one direction, (1, m, 3): sooner, bit for bit.

        The array may be reused.
        """
        level = max(abs(complex(x, y)), 1e-9)  # numpy's hypot; math.hypot rounds otherwise
        if kernels.IS_COMPILED:
            kernels.spread(self._lanes, x, y, z, level, self._sides)
            return self._sides
        side = np.array([-y / level, x / level, 0.0])
        rise = np.array([-z * x / level, -z * y / level, level])
        lanes: Floats = self._aside * side + self._above * rise
        return lanes

    def rate(
        self,
        memory: VisitedMap,
        place: Sequence[float],
        directions: Floats,
        sides: Floats,
        lengths_m: Floats,
    ) -> Floats:
        """Count the new ground of candidate steps, see `kernels.rate`; the array is reused."""
        _rate(
            memory.grid,
            memory.cells(place),
            directions,
            sides,
            self._bodies,
            self.inner,
            lengths_m / memory.cell_m,
            self.pitch,
            self._stride,
            self._rated,
        )
        return self._rated

    def ahead(
        self, memory: VisitedMap, place: list[float], target: list[float]
    ) -> tuple[float, float]:
        """Count the new samples in the strip towards a target; also the free way there, m."""
        away = [t - p for t, p in zip(target, place, strict=True)]
        far = max(math.hypot(*away), 1e-9)
        direction = [part / far for part in three(away)]
        _rate(
            memory.grid,
            memory.cells(place),
            np.array([direction]),
            self._lanes_across(*direction),
            self._bodies,
            self.inner,
            self._strip,
            self.pitch,
            self._stride,
            self._one,
        )
        return float(self._one[0, 0]), float(self._one[0, 3]) * memory.cell_m


def _rate_side_by_side(
    grid: kernels.Grid,
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
    """Do what `kernels.rate` does, samples side by side: faster where it is not compiled."""
    steps = (lengths / pitch).astype(int)
    part = np.arange(int(steps.max(initial=0)) * stride)
    s = part // stride * pitch + (part % stride + 1) * pitch / stride
    centres = place + s[None, :, None] * directions[:, None, :]
    cells = np.floor(centres[:, :, None, :] + sides[:, None, :, :]).astype(int)
    inside: NDArray[np.bool_] = np.all((cells >= 0) & (cells < grid.shape), axis=3)
    x, y, z = np.moveaxis(np.where(inside[..., None], cells, 0), 3, 0)
    flags = np.where(inside, grid[x, y, z], 0)
    body = flags[:, :, :bodies] & (kernels.WALL | kernels.TRODDEN)
    stops = (body == kernels.WALL).any(axis=2) | (flags[:, :, 0] & kernels.BLOCKED != 0)
    is_stopped: NDArray[np.bool_] = np.maximum.accumulate(stops, axis=1)
    is_free = ~is_stopped & (part // stride < steps[:, None])
    free = np.where(is_free, s, 0.0)
    at = slice(stride - 1, None, stride)
    known: NDArray[np.bool_] = np.asarray(flags[:, at] & kernels.KNOWN, dtype=np.bool_)
    fresh = (~known[:, :, :inner]).sum(axis=2) * is_free[:, at]
    rated[:, 0] = fresh.sum(axis=1)
    rated[:, 1] = (fresh * known[:, :, inner:].any(axis=2)).sum(axis=1)
    rated[:, 2] = np.where(fresh > 0, s[at], 0.0).max(axis=1, initial=0.0)
    rated[:, 3] = free.max(axis=1, initial=0.0)


_rate = kernels.rate if kernels.IS_COMPILED else _rate_side_by_side
