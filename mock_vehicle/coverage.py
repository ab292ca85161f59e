"""How much of the reachable space the fleet has seen, in cells of floor or of space."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mock_vehicle.world import World

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]
INDICES = NDArray[np.intp]

REFERENCE_HEIGHT_M = 1.5
"""Where free floor is judged for a flat footprint, under ceilings of 3 m and more."""


MOST_POINTS = 256
"""Looked from at once when a whole track is gone over, which bounds the memory."""


class Coverage:
    """Which reachable free cells have been seen, and when first; flat or in voxels."""

    def __init__(self, world: World, starts_ned_m: FLOATS) -> None:
        spec = world.spec.coverage
        self._radius_m, self._footprint, self._cell_m = spec.radius_m, spec.footprint, spec.cell_m
        self._line_of_sight = spec.line_of_sight
        top_m = -float(world.low_ned_m[2])
        if spec.footprint == "sphere":
            levels = max(1, math.floor(top_m / spec.cell_m + 1e-6))
            heights = [(level + 0.5) * spec.cell_m for level in range(levels)]
        else:
            heights = [min(REFERENCE_HEIGHT_M, top_m / 2.0)]
        grids = [world.occupancy(spec.cell_m, height) for height in heights]
        self.origin_ne_m = np.asarray(grids[0].origin_ne_m, dtype=np.float64)
        self.cell_m = spec.cell_m
        self.blocked: BOOLS = np.array([grid.blocked for grid in grids])
        """[level, north, east]; one level for a flat footprint."""
        reached = [world.free_cells(spec.cell_m, height, starts_ned_m) for height in heights]
        columns = np.array(reached).any(axis=0)
        self.free: BOOLS = columns & ~self.blocked
        self._lay_out()
        if spec.line_of_sight:
            self._lay_out_rays(world, heights)
        self._last_ned_m = np.full_like(starts_ned_m, np.nan)

    @property
    def fraction(self) -> float:
        """Share of the reachable free cells seen so far."""
        seen = self._free_cells - np.count_nonzero(self._unseen)
        return float(seen / max(self._free_cells, 1))

    @property
    def seen_s(self) -> NDArray[np.float32]:
        """When each cell was first seen, [level, north, east]; NaN is never."""
        return self._unpadded(self._seen_s)

    def volumes(self) -> dict[str, NDArray[Any]]:
        """Give when each cell was first seen, and which ones count, both [level, north, east]."""
        return {"volume_seen_s": self.seen_s.copy(), "volume_free": self.free}

    def cover(self, position_ned_m: FLOATS, airborne: BOOLS, now: float) -> None:
        """Mark what the airborne vehicles have seen on the way since the last call."""
        flying = np.nonzero(airborne)[0]
        came_from = np.where(
            np.isnan(self._last_ned_m[flying]), position_ned_m[flying], self._last_ned_m[flying]
        )
        way = position_ned_m[flying] - came_from
        far = np.sqrt(np.einsum("ij,ij->i", way, way))
        first = np.isnan(self._last_ned_m[flying, 0])
        moved = first | (far > 0.1 * self._cell_m)
        self._last_ned_m[~airborne] = np.nan
        if not moved.any():
            return
        self._last_ned_m[flying[moved]] = position_ned_m[flying[moved]]
        for points in self._between(came_from[moved], way[moved]):
            fresh = self._in_sight(points, self._unseen)
            self._unseen[fresh] = False
            self._seen_s[fresh] = now

    def seers(self, track_ned_m: FLOATS, airborne: BOOLS) -> INDICES:
        """Count by how many vehicles each cell was seen, [level, north, east].

        A track has shape (time, vehicle, 3); of it counts where its vehicle was `airborne`.
        """
        count = np.zeros(self._free_flat.shape, dtype=np.intp)
        for way, flies in zip(track_ned_m.transpose(1, 0, 2), airborne.T, strict=True):
            legs = flies[:-1] & flies[1:]
            points = self._between(way[:-1][legs], np.diff(way, axis=0)[legs]).reshape(-1, 3)
            seen = np.zeros(count.shape, dtype=bool)
            for begin in range(0, len(points), MOST_POINTS):
                some = points[begin : begin + MOST_POINTS]
                seen[self._in_sight(some, self._free_flat)] = True
            count += seen
        return self._unpadded(count)

    def _between(self, start_ned_m: FLOATS, way_ned_m: FLOATS) -> FLOATS:
        """Part ways so that no footprint is left out, [part, way]: some are smaller than a way."""
        stride = max(0.5 * self._cell_m, 0.25 * self._radius_m)
        far = np.sqrt(np.einsum("ij,ij->i", way_ned_m, way_ned_m))
        steps = max(1, math.ceil(float(far.max(initial=0.0)) / stride))
        parts = np.arange(1, steps + 1)[:, None, None] / steps
        return np.asarray(start_ned_m + parts * way_ned_m)

    def _unpadded(self, flat: NDArray[Any]) -> NDArray[Any]:
        """Give the volume that a padded and flattened one holds."""
        inner = tuple(slice(self._reach[axis], -self._reach[axis] or None) for axis in range(3))
        return flat.reshape(self._shape)[inner]

    def _lay_out(self) -> None:
        """Flatten padded volumes, so that looking around is adding offsets to one index."""
        reach = math.ceil(self._radius_m / self._cell_m) + 1
        self._reach = (reach if self._footprint == "sphere" else 0, reach, reach)
        pad = [(r, r) for r in self._reach]
        self._shape = tuple(
            size + 2 * r for size, r in zip(self.free.shape, self._reach, strict=True)
        )
        self._free_flat = np.pad(self.free, pad).ravel()
        self._free_cells = int(np.count_nonzero(self.free))
        self._unseen = self._free_flat.copy()
        """Free, and seen by nobody yet."""
        self._seen_s = np.full(self._free_flat.shape, np.nan, dtype=np.float32)
        self._strides = np.array([self._shape[1] * self._shape[2], self._shape[2], 1])
        cube = itertools.product(*(range(-r, r + 1) for r in self._reach))
        offsets = np.array(sorted(cube, key=lambda o: (max(map(abs, o)), o)))
        self._offsets = offsets[self._may_reach(offsets)]
        self._flat_offsets = self._offsets @ self._strides

    def _may_reach(self, offsets: INDICES) -> BOOLS:
        """Tell which offsets (m, 3) the footprint reaches from anywhere in the cell it is over."""
        nearest = np.maximum(np.abs(offsets) - 0.5, 0.0)
        if self._footprint == "square":
            far = nearest[:, 1:].max(axis=1)
        else:
            far = np.sqrt(np.einsum("ij,ij->i", nearest, nearest))
        return np.asarray(far <= self._radius_m / self._cell_m + 1e-6)

    def _lay_out_rays(self, world: World, heights: list[float]) -> None:
        """For each offset find the cell before it on the way out, and the steps from there.

        Steps go from centre to centre along the axes, so no chain of open steps leads through a
        wall, however thin. A diagonal one may take its axes in either order.
        """
        index = {tuple(offset): number for number, offset in enumerate(self._offsets.tolist())}
        ring = np.abs(self._offsets).max(axis=1)
        inner = np.rint(self._offsets * ((ring - 1) / np.maximum(ring, 1))[:, None]).astype(int)
        inner[0] = 0
        self._parents = np.array([index[tuple(parent)] for parent in inner.tolist()])
        self._rings = [
            slice(int(np.searchsorted(ring, r)), int(np.searchsorted(ring, r, "right")))
            for r in range(1, max(self._reach) + 1)
        ]
        ways = [
            (self._steps(parent, offset), self._steps(parent, offset, last_axis_first=True))
            for parent, offset in zip(inner.tolist(), self._offsets.tolist(), strict=True)
        ]
        longest = max(len(way) for pair in ways for way in pair)
        filled = [[way + way[:1] * (longest - len(way)) for way in pair] for pair in ways[1:]]
        origin = [[[0] * longest] * 2]
        steps = np.array(origin + filled, dtype=np.intp)  # none where only one's own cell is seen
        self._ways = steps.transpose(1, 2, 0)[..., None]
        self._steps_open = self._open_steps(world, heights)

    def _steps(
        self, start: list[int], end: list[int], *, last_axis_first: bool = False
    ) -> list[int]:
        """Name the steps between two cells by their axis and lower cell, as flat indices."""
        at, steps = list(start), []
        for axis in (2, 1, 0) if last_axis_first else (0, 1, 2):
            if at[axis] != end[axis]:
                lower = list(at)
                lower[axis] = min(at[axis], end[axis])
                steps.append(axis * self._unseen.size + int(np.dot(lower, self._strides)))
                at[axis] = end[axis]
        return steps

    def _open_steps(self, world: World, heights: list[float]) -> BOOLS:
        """Look from each cell's centre to the next one up, north and east: [axis, cell], flat."""
        levels, north, east = self.free.shape
        centres = np.empty((*self.free.shape, 3))
        centres[..., 0] = (self.origin_ne_m[0] + (np.arange(north) + 0.5) * self._cell_m)[:, None]
        centres[..., 1] = self.origin_ne_m[1] + (np.arange(east) + 0.5) * self._cell_m
        centres[..., 2] = -np.array(heights)[:, None, None]
        opened = np.zeros((3, *self._shape), dtype=bool)
        inner = tuple(
            slice(r, r + size) for r, size in zip(self._reach, self.free.shape, strict=True)
        )
        for axis, size in enumerate((levels, north, east)):
            here = np.take(centres, range(size - 1), axis).reshape(-1, 3)
            there = np.take(centres, range(1, size), axis).reshape(-1, 3)
            if len(here):
                seen = np.zeros(self.free.shape, dtype=bool)
                lower = tuple(slice(0, -1 if other == axis else None) for other in range(3))
                seen[lower] = world.line_of_sight(here, there).reshape(seen[lower].shape)
                opened[axis][inner] = seen
        return opened.ravel()

    def _in_sight(self, points_ned_m: FLOATS, wanted: BOOLS) -> INDICES:
        """Find the `wanted` cells whose centres lie in the footprints around (n, 3) points."""
        place = np.empty_like(points_ned_m)
        place[:, 0] = -points_ned_m[:, 2] / self._cell_m if self._footprint == "sphere" else 0.5
        place[:, 1:] = (points_ned_m[:, :2] - self.origin_ne_m) / self._cell_m
        cell = np.floor(place).astype(int)
        inside = ((cell >= 0) & (cell < self.free.shape)).all(axis=1)
        if not inside.all():
            place, cell = place[inside], cell[inside]
        base = (cell + self._reach) @ self._strides
        target = self._flat_offsets[:, None] + base
        within = wanted[target]
        within &= self._within(cell + 0.5 - place)
        if self._line_of_sight:
            (looking,) = within.any(axis=0).nonzero()
            if len(looking):
                within[:, looking] &= self._visible(base[looking])
        return np.asarray(target[within])

    def _within(self, rest: FLOATS) -> BOOLS:
        """Tell which offsets (m) lie in the footprint of each vehicle (n), (m, n)."""
        reach = self._radius_m / self._cell_m + 1e-9
        if self._footprint == "square":
            north, east = (
                np.abs(self._offsets[:, axis, None] + rest[:, axis]) <= reach for axis in (1, 2)
            )
            return np.asarray(north & east)
        squared = np.einsum("ij,ij->i", self._offsets, self._offsets)[:, None]
        squared = squared + 2.0 * (self._offsets @ rest.T) + np.einsum("ij,ij->i", rest, rest)
        return np.asarray(squared <= reach**2)

    def _visible(self, base: INDICES) -> BOOLS:
        """Walk outwards ring by ring: a cell is visible if the one before it is, and the step."""
        step: BOOLS = np.asarray(self._steps_open[self._ways + base].all(axis=1).any(axis=0))
        visible = np.ones_like(step)
        for ring in self._rings:
            visible[ring] = visible[self._parents[ring]] & step[ring]
        return visible
