"""Solid shapes as arrays: rays against all of them at once, and distances to the nearest."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.world.ring import Ring

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Interval = tuple[Floats, Floats]
Beyond = Callable[["_Columns", Floats], Floats]

_ROOTS_M = 1.0
"""How far shapes on the floor reach below it, so that no ray slips along the floor, m."""
_SEAM_M = 1e-6
"""Nearer to each other, pieces belong to one wall, m."""
_CHUNK = 16_384
"""Rays times shapes looked at together; larger leaves the processor's cache."""


@dataclass(frozen=True)
class Prism:
    """One upright solid: a turned box (`round` false) or a cylinder (`half_m` is its radius)."""

    center_ne_m: tuple[float, float]
    """Centre, north and east, m."""
    half_m: tuple[float, float]
    """Half the edges along its own x and y, m."""
    bottom_m: float
    """Height of the lower face, m."""
    top_m: float
    """Height of the upper face, m."""
    yaw_rad: float = 0.0
    """Its x axis, counter-clockwise from east, rad."""
    round: bool = False
    """Whether it is a cylinder."""

    @property
    def axes_ne(self) -> Floats:
        """Its x and y axes, (2, 2), one a row, each north, east."""
        sin, cos = math.sin(self.yaw_rad), math.cos(self.yaw_rad)
        return np.array([[sin, cos], [cos, -sin]])

    def outline_ne_m(self, corners: int = 16) -> Floats:
        """Draw it from above, (k, 2) north, east, m; a cylinder as a polygon of `corners`."""
        if self.round:
            turn = np.arange(corners) * (2.0 * math.pi / corners)
            unit = np.column_stack([np.cos(turn), np.sin(turn)])
        else:
            unit = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        drawn: Floats = (unit * self.half_m) @ self.axes_ne + self.center_ne_m
        return drawn


class Solids(NamedTuple):
    """What compiled loops take of m boxes and k cylinders, seen from n points."""

    boxes: Floats
    """Offsets from the middle of every box along its own axes, (n, 3, m)."""
    box_sizes: Floats
    """(3, m)."""
    box_axes: Floats
    """North and east of its x axis, then of its y axis, (m, 4)."""
    cylinders: Floats
    """(n, 3, k), as the boxes."""
    cylinders_away: Floats
    """Level distances from the middles, (n, k)."""
    cylinder_sizes: Floats
    """(3, k)."""
    cylinder_middles: Floats
    """North and east, (2, k)."""


class Shapes:
    """Upright solids in arrays; NED, metres."""

    def __init__(self, prisms: list[Prism]) -> None:
        self.prisms = prisms
        self._boxes = _Columns([p for p in prisms if not p.round])
        self._cylinders = _Columns([p for p in prisms if p.round])
        self._box_axes = np.ascontiguousarray(np.concatenate(self._boxes.axes).T)

    def cast(self, origins_m: Floats, directions: Floats) -> Floats:
        """Measure (r,) distances along (r, 3) rays to the nearest shape; 0 inside, inf for none."""
        nearest = np.full(len(origins_m), np.inf)
        for columns, span in ((self._boxes, _box_span), (self._cylinders, _cylinder_span)):
            for rows in columns.chunks(len(origins_m)):
                near = columns.enter(origins_m[rows], directions[rows], span)
                nearest[rows] = np.minimum(nearest[rows], near)
        return nearest

    def crossings(self, origins_m: Floats, directions: Floats, lengths_m: Floats) -> Ints:
        """Count (r,) shapes that (r, 3) rays pass within (r,) lengths; touching ones are one."""
        counts = np.zeros(len(origins_m), dtype=np.intp)
        every = max(1, self._boxes.count + self._cylinders.count)
        step = max(1, _CHUNK // every)
        for rows in (slice(k, k + step) for k in range(0, len(origins_m), step)):
            spans = [
                columns.through(origins_m[rows], directions[rows], lengths_m[rows], span)
                for columns, span in ((self._boxes, _box_span), (self._cylinders, _cylinder_span))
            ]
            near, far = (np.concatenate(ends, axis=1) for ends in zip(*spans, strict=True))
            counts[rows] = _separate(near, far)
        return counts

    def solids(self, points_m: Floats) -> Solids | None:
        """Look at all shapes from (n, 3) points; None where that is too much at once."""
        boxes, cylinders = self._boxes, self._cylinders
        if len(points_m) * max(boxes.count, cylinders.count) > _CHUNK:
            return None
        offsets = cylinders.offsets(points_m)
        away = np.hypot(offsets[:, 0], offsets[:, 1])
        return Solids(
            boxes.offsets(points_m),
            boxes.size,
            self._box_axes,
            offsets,
            away,
            cylinders.size,
            cylinders.center_ne,
        )

    def lines(self, origins_m: Floats, directions: Floats) -> tuple[Floats, ...] | None:
        """Lay (r, 3) rays along all shapes as `loops.cast` takes them; None where that is much."""
        if len(origins_m) * max(self._boxes.count, self._cylinders.count) > _CHUNK:
            return None
        return (
            *self._boxes.lines(origins_m, directions),
            *self._cylinders.lines(origins_m, directions),
        )

    def scan(self, ring: Ring, max_range_m: float) -> None:
        """Stop level rays at the shapes within the range."""
        if self._boxes.count:
            _meet_boxes(self._boxes, ring, max_range_m)
        if self._cylinders.count:
            _meet_cylinders(self._cylinders, ring, max_range_m)

    def plumb(self, points_m: Floats) -> Floats:
        """Measure (n, 2) distances up and down to the nearest face; 0 inside, inf for none."""
        nearest = np.full((len(points_m), 2), np.inf)
        for columns, beyond in ((self._boxes, _beyond_box), (self._cylinders, _beyond_cylinder)):
            for rows in columns.chunks(len(points_m)):
                distance = columns.plumb(points_m[rows], beyond)
                nearest[rows] = np.minimum(nearest[rows], distance)
        return nearest

    def clearance(self, points_m: Floats) -> Floats:
        """Measure (n,) signed distances from (n, 3) points to the nearest surface; inf for none."""
        nearest = np.full(len(points_m), np.inf)
        for columns, beyond in ((self._boxes, _beyond_box), (self._cylinders, _beyond_cylinder)):
            for rows in columns.chunks(len(points_m)):
                distance = columns.distance(points_m[rows], beyond)
                nearest[rows] = np.minimum(nearest[rows], distance)
        return nearest


class _Columns:
    """Shapes of one kind, an array per quantity, (m,) each."""

    def __init__(self, prisms: list[Prism]) -> None:
        self.count = len(prisms)
        center = np.array([p.center_ne_m for p in prisms]).reshape(-1, 2)
        axes = np.array([p.axes_ne for p in prisms]).reshape(-1, 2, 2)
        half = np.array([p.half_m for p in prisms]).reshape(-1, 2)
        bottom = np.array([p.bottom_m if p.bottom_m > 0.0 else -_ROOTS_M for p in prisms])
        top = np.array([p.top_m for p in prisms])
        self.axes = (np.ascontiguousarray(axes[:, 0].T), np.ascontiguousarray(axes[:, 1].T))
        self.half = (half[:, 0].copy(), half[:, 1].copy())
        self.center_ne = np.ascontiguousarray(center.T)
        self.center = tuple((center * axes[:, i]).sum(axis=1) for i in (0, 1))
        self.middle_down = -(bottom + top) / 2.0
        self.half_height = (top - bottom) / 2.0
        self._own = np.zeros((3, 3, self.count))
        self._own[:2, 0], self._own[:2, 1], self._own[2, 2] = *self.axes, 1.0
        self._middle = np.array((*self.center, self.middle_down))
        self.size = np.array((*self.half, self.half_height))

    def chunks(self, rows: int) -> Iterator[slice]:
        """Cut the rows so that rows times shapes stay in the cache; nothing without shapes."""
        step = max(1, _CHUNK // max(1, self.count))
        return (slice(k, k + step) for k in range(0, rows if self.count else 0, step))

    def local(self, points_m: Floats, axis: int) -> Floats:
        """Turn (n, 3) points into (n, m) coordinates along an axis of every shape."""
        along: Floats = points_m[:, :2] @ self.axes[axis]
        along -= self.center[axis]
        return along

    def lines(self, origins_m: Floats, directions: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Give where (r, 3) rays begin along the axes, and their slopes, (2, r, m), and sizes."""
        at = np.stack((self.local(origins_m, 0), self.local(origins_m, 1)))
        slopes = np.stack((directions[:, :2] @ self.axes[0], directions[:, :2] @ self.axes[1]))
        return at, slopes, self.size, self.middle_down

    def offsets(self, points_m: Floats) -> Floats:
        """Turn (n, 3) points into (n, 3, m) coordinates from every shape's middle, x, y, down."""
        own = points_m @ self._own.reshape(3, 3 * self.count)
        offsets: Floats = own.reshape(len(points_m), 3, self.count)
        offsets -= self._middle
        return offsets

    def enter(self, origins_m: Floats, directions: Floats, span: Callable[..., Interval]) -> Floats:
        """Measure (r,) distances to the nearest shape that a ray enters."""
        near, far = self._within(origins_m, directions, span)
        near[near >= far] = np.inf
        nearest: Floats = near.min(axis=1)
        return nearest

    def through(
        self,
        origins_m: Floats,
        directions: Floats,
        lengths_m: Floats,
        span: Callable[..., Interval],
    ) -> Interval:
        """Measure where rays enter and leave every shape, (r, m); inf and -inf where they miss."""
        near, far = self._within(origins_m, directions, span)
        np.minimum(far, lengths_m[:, None], out=far)
        missed = near >= far
        near[missed], far[missed] = np.inf, -np.inf
        return near, far

    def _within(
        self, origins_m: Floats, directions: Floats, span: Callable[..., Interval]
    ) -> Interval:
        near, far = span(self, origins_m, directions)
        down = origins_m[:, 2:] - self.middle_down
        low, high = _slab(down, directions[:, 2:], self.half_height)
        np.maximum(near, low, out=near)
        np.minimum(far, high, out=far)
        np.maximum(near, 0.0, out=near)
        return near, far

    def plumb(self, points_m: Floats, beyond: Beyond) -> Floats:
        """Measure (n, 2) distances up and down to the nearest shape."""
        offsets = self.offsets(points_m)
        below, outside = offsets[:, 2] > 0.0, beyond(self, offsets)
        gap = np.maximum(outside[:, -1], 0.0)
        gap[outside[:, :-1].max(axis=1) >= 0.0] = np.inf
        within = gap == 0.0
        up = np.where(below | within, gap, np.inf).min(axis=1)
        down = np.where(~below | within, gap, np.inf).min(axis=1)
        return np.column_stack((up, down))

    def distance(self, points_m: Floats, beyond: Beyond) -> Floats:
        """Measure (n,) signed distances to the nearest shape."""
        outside = beyond(self, self.offsets(points_m))
        inside = np.minimum(outside.max(axis=1), 0.0)
        np.maximum(outside, 0.0, out=outside)
        inside += np.sqrt(np.einsum("nkm,nkm->nm", outside, outside))
        nearest: Floats = inside.min(axis=1)
        return nearest


def _separate(near_m: Floats, far_m: Floats) -> Ints:
    """Count, in each row of (r, m) intervals, those that neither overlap nor touch."""
    order = np.argsort(near_m, axis=1)
    near_m = np.take_along_axis(near_m, order, axis=1)
    end_m = np.maximum.accumulate(np.take_along_axis(far_m, order, axis=1), axis=1)
    is_first = np.isfinite(near_m)
    is_first[:, 1:] &= near_m[:, 1:] > end_m[:, :-1] + _SEAM_M
    counts: Ints = is_first.sum(axis=1)
    return counts


def _slab(offset: Floats, slope: Floats, half: Floats) -> Interval:
    """Bound rays to between two parallel faces: `offset` from their middle, (r, m)."""
    inverse = 1.0 / np.where(np.abs(slope) < 1e-12, 1e-12, slope)
    middle = offset * inverse
    reach = np.abs(inverse) * half
    far = reach - middle
    np.negative(middle, out=middle)
    middle -= reach
    return middle, far


def _box_span(boxes: _Columns, origins_m: Floats, directions: Floats) -> Interval:
    """Bound rays to between the sides of boxes (the slab method)."""
    near, far = _slab(boxes.local(origins_m, 0), directions[:, :2] @ boxes.axes[0], boxes.half[0])
    low, high = _slab(boxes.local(origins_m, 1), directions[:, :2] @ boxes.axes[1], boxes.half[1])
    return np.maximum(near, low, out=near), np.minimum(far, high, out=far)


def _cylinder_span(cylinders: _Columns, origins_m: Floats, directions: Floats) -> Interval:
    """Bound rays to the inside of endless cylinders: roots of a t^2 + 2 b t + c = 0."""
    x, y = cylinders.local(origins_m, 0), cylinders.local(origins_m, 1)
    dx, dy = directions[:, :2] @ cylinders.axes[0], directions[:, :2] @ cylinders.axes[1]
    a = np.maximum(dx * dx + dy * dy, 1e-18)
    b = x * dx + y * dy
    c = x * x + y * y - cylinders.half[0] ** 2
    square = b * b - a * c
    root = np.sqrt(np.maximum(square, 0.0))
    missed = square < 0.0
    return np.where(missed, np.inf, (-b - root) / a), np.where(missed, -np.inf, (-b + root) / a)


def _beyond_box(boxes: _Columns, offsets_m: Floats) -> Floats:
    """Signed distances beyond the faces along x, y and down, (n, 3, m)."""
    beyond = np.abs(offsets_m)
    beyond -= boxes.size
    return beyond


def _beyond_cylinder(cylinders: _Columns, offsets_m: Floats) -> Floats:
    """Signed distances beyond the mantle and beyond the lids, (n, 2, m)."""
    beyond = np.abs(offsets_m[:, 1:])
    np.hypot(offsets_m[:, 0], offsets_m[:, 1], out=beyond[:, 0])
    beyond -= cylinders.size[1:]
    return beyond


def _meet_boxes(boxes: _Columns, ring: Ring, max_range_m: float) -> None:
    """Stop level rays at the boxes within the range."""
    offsets = boxes.offsets(ring.origins_m)
    outside = _beyond_box(boxes, offsets)
    is_level = outside[:, 2] < 0.0
    np.maximum(outside, 0.0, out=outside)
    away = np.einsum("nkm,nkm->nm", outside[:, :2], outside[:, :2])
    owner, box = np.nonzero(is_level & (away <= max_range_m**2))
    if len(owner):
        place, axes = offsets[owner, :2, box].T, (boxes.axes[0][:, box], boxes.axes[1][:, box])
        ring.meet_boxes(owner, place, boxes.size[:2, box], axes)


def _meet_cylinders(cylinders: _Columns, ring: Ring, max_range_m: float) -> None:
    """Stop level rays at the cylinders within the range."""
    outside = _beyond_cylinder(cylinders, cylinders.offsets(ring.origins_m))
    owner, cylinder = np.nonzero((outside[:, 1] < 0.0) & (outside[:, 0] <= max_range_m))
    if len(owner):
        toward = cylinders.center_ne[:, cylinder].T - ring.origins_m[owner, :2]
        ring.meet_discs(owner, toward, cylinders.half[0][cylinder])


@dataclass(frozen=True)
class Room:
    """The planes around the world, each of which stops what goes out through it.

    Bounds are NED, m; an infinite one is no plane.
    """

    low_m: Floats
    """North, east and down (the ceiling), (3,)."""
    high_m: Floats
    """North, east and down (the floor), (3,)."""

    def cast(self, origins_m: Floats, directions: Floats) -> Floats:
        """Measure (r,) distances along rays to the first plane; 0 for what is already beyond."""
        bound = np.where(directions < 0.0, self.low_m, self.high_m)
        level = np.abs(directions) < 1e-12
        reach = (bound - origins_m) / np.where(level, 1.0, directions)
        reach[level] = np.inf
        nearest: Floats = np.maximum(reach.min(axis=1), 0.0)
        return nearest

    def scan(self, ring: Ring) -> None:
        """Stop level rays at the outer walls; 0 for who is already beyond."""
        if np.isfinite(self.low_m[0]):
            ring.meet_room(self.low_m[:2], self.high_m[:2])

    def plumb(self, points_m: Floats) -> Floats:
        """Measure (n, 2) distances up to the ceiling and down to the floor; 0 beyond them."""
        down = points_m[:, 2]
        away: Floats = np.column_stack((down - self.low_m[2], self.high_m[2] - down))
        np.maximum(away, 0.0, out=away)
        return away

    def clearance(self, points_m: Floats) -> Floats:
        """Measure (n,) signed distances to outer walls and ceiling, negative beyond them."""
        away = np.minimum(points_m - self.low_m, self.high_m - points_m)
        away[:, 2] = points_m[:, 2] - self.low_m[2]
        nearest: Floats = away.min(axis=1)
        return nearest
