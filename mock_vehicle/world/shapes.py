"""Solid shapes as arrays: rays against all of them at once, and distances to the nearest."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.errors import WorldError

if TYPE_CHECKING:
    from pathlib import Path

    from mock_vehicle.world.spec import BoxSpec, CylinderSpec, WallSpec, WorldSpec

Floats = NDArray[np.float64]
Interval = tuple[Floats, Floats]

OPEN_SKY_HEIGHT_M = 3.0
"""Height of shapes that name none where there is no ceiling, m."""
_ROOTS_M = 1.0
"""How far shapes on the floor reach below it, so that no ray slips along the floor, m."""
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


class Shapes:
    """Upright solids in arrays; NED, metres."""

    def __init__(self, prisms: list[Prism]) -> None:
        self.prisms = prisms
        self._boxes = _Columns([p for p in prisms if not p.round])
        self._cylinders = _Columns([p for p in prisms if p.round])

    def cast(self, origins_m: Floats, directions: Floats) -> Floats:
        """Measure (r,) distances along (r, 3) rays to the nearest shape; 0 inside, inf for none."""
        nearest = np.full(len(origins_m), np.inf)
        for columns, span in ((self._boxes, _box_span), (self._cylinders, _cylinder_span)):
            for rows in columns.chunks(len(origins_m)):
                near = columns.enter(origins_m[rows], directions[rows], span)
                nearest[rows] = np.minimum(nearest[rows], near)
        return nearest

    def clearance(self, points_m: Floats) -> Floats:
        """Measure (n,) signed distances from (n, 3) points to the nearest surface; inf for none."""
        nearest = np.full(len(points_m), np.inf)
        for columns, aside in ((self._boxes, _box_aside), (self._cylinders, _cylinder_aside)):
            for rows in columns.chunks(len(points_m)):
                distance = columns.distance(points_m[rows], aside)
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
        self.center = tuple((center * axes[:, i]).sum(axis=1) for i in (0, 1))
        self.middle_down = -(bottom + top) / 2.0
        self.half_height = (top - bottom) / 2.0

    def chunks(self, rows: int) -> Iterator[slice]:
        """Cut the rows so that rows times shapes stay in the cache; nothing without shapes."""
        step = max(1, _CHUNK // max(1, self.count))
        return (slice(k, k + step) for k in range(0, rows if self.count else 0, step))

    def local(self, points_m: Floats, axis: int) -> Floats:
        """Turn (n, 3) points into (n, m) coordinates along an axis of every shape."""
        along: Floats = points_m[:, :2] @ self.axes[axis]
        along -= self.center[axis]
        return along

    def enter(self, origins_m: Floats, directions: Floats, span: Callable[..., Interval]) -> Floats:
        """Measure (r,) distances to the nearest shape that a ray enters."""
        near, far = span(self, origins_m, directions)
        down = origins_m[:, 2:] - self.middle_down
        low, high = _slab(down, directions[:, 2:], self.half_height)
        np.maximum(near, low, out=near)
        np.minimum(far, high, out=far)
        np.maximum(near, 0.0, out=near)
        near[near >= far] = np.inf
        nearest: Floats = near.min(axis=1)
        return nearest

    def distance(self, points_m: Floats, aside: Callable[..., Interval]) -> Floats:
        """Measure (n,) signed distances to the nearest shape."""
        x, y = aside(self, points_m)
        z = np.abs(points_m[:, 2:] - self.middle_down) - self.half_height
        inside = np.minimum(np.maximum(np.maximum(x, y), z), 0.0)
        for part in (x, y, z):
            np.maximum(part, 0.0, out=part)
        nearest: Floats = (np.sqrt(x * x + y * y + z * z) + inside).min(axis=1)
        return nearest


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


def _box_aside(boxes: _Columns, points_m: Floats) -> Interval:
    """Signed distances beyond the sides along x and y, (n, m) each."""
    x, y = (np.abs(boxes.local(points_m, i)) - boxes.half[i] for i in (0, 1))
    return x, y


def _cylinder_aside(cylinders: _Columns, points_m: Floats) -> Interval:
    """Signed distances beyond the mantle, (n, m), and a second axis that never matters."""
    beyond = np.hypot(cylinders.local(points_m, 0), cylinders.local(points_m, 1))
    beyond -= cylinders.half[0]
    return beyond, np.full_like(beyond, -np.inf)


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

    def clearance(self, points_m: Floats) -> Floats:
        """Measure (n,) signed distances to outer walls and ceiling, negative beyond them."""
        away = np.minimum(points_m - self.low_m, self.high_m - points_m)
        away[:, 2] = points_m[:, 2] - self.low_m[2]
        nearest: Floats = away.min(axis=1)
        return nearest


def build_prisms(path: Path, spec: WorldSpec) -> list[Prism]:
    """Turn the floor plan into solids in NED; walls are cut at their doors.

    WorldError for a wall without length, a door that does not fit, a shape above the ceiling.
    """
    prisms = []
    for index, box in enumerate(spec.boxes):
        prisms.append(_box(box, *_heights(path, f"boxes[{index}]", box, spec.ceiling_m)))
    for index, wall in enumerate(spec.walls):
        key = f"walls[{index}]"
        prisms += _wall(path, key, wall, *_heights(path, key, wall, spec.ceiling_m))
    for index, column in enumerate(spec.cylinders):
        heights = _heights(path, f"cylinders[{index}]", column, spec.ceiling_m)
        prisms.append(_cylinder(column, *heights))
    return prisms


def _heights(
    path: Path, key: str, shape: BoxSpec | WallSpec | CylinderSpec, ceiling_m: float | None
) -> tuple[float, float]:
    """Find bottom and top; a shape that names no height reaches to the ceiling."""
    limit = OPEN_SKY_HEIGHT_M if ceiling_m is None else ceiling_m
    if shape.height_m is not None:
        limit = shape.bottom_m + shape.height_m
    if limit <= shape.bottom_m:
        reason = f"{shape.bottom_m:g} m is not below its top at {limit:g} m"
        raise WorldError(path, f"{key}.bottom_m", reason)
    return shape.bottom_m, limit


def _box(box: BoxSpec, bottom_m: float, top_m: float) -> Prism:
    (x, y), (along, aside) = box.center_m, box.size_m
    half = (along / 2.0, aside / 2.0)
    return Prism((y, x), half, bottom_m, top_m, math.radians(box.yaw_deg))


def _cylinder(cylinder: CylinderSpec, bottom_m: float, top_m: float) -> Prism:
    x, y = cylinder.center_m
    half = (cylinder.radius_m, cylinder.radius_m)
    return Prism((y, x), half, bottom_m, top_m, round=True)


def _wall(path: Path, key: str, wall: WallSpec, bottom_m: float, top_m: float) -> list[Prism]:
    """Cut a wall into the pieces between its doors and the lintels above them."""
    (x0, y0), (x1, y1) = wall.from_m, wall.to_m
    length = math.hypot(x1 - x0, y1 - y0)
    if length == 0.0:
        raise WorldError(path, f"{key}.to_m", "is the same point as from_m")
    yaw = math.atan2(y1 - y0, x1 - x0)

    def piece(start: float, end: float, low_m: float) -> Prism:
        share = (start + end) / 2.0 / length
        center_ne = (y0 + share * (y1 - y0), x0 + share * (x1 - x0))
        return Prism(center_ne, ((end - start) / 2.0, wall.thickness_m / 2.0), low_m, top_m, yaw)

    gaps = _gaps(path, key, wall, length)
    edges = [0.0, *(edge for start, end, _ in gaps for edge in (start, end)), length]
    spans = zip(edges[::2], edges[1::2], strict=True)
    pieces = [piece(start, end, bottom_m) for start, end in spans if end > start]
    lintels = [(start, end, bottom_m + height) for start, end, height in gaps]
    return pieces + [piece(start, end, low) for start, end, low in lintels if low < top_m]


def _gaps(path: Path, key: str, wall: WallSpec, length: float) -> list[tuple[float, float, float]]:
    """Order the doors along a wall: start m, end m, height m (inf without a lintel)."""
    gaps = []
    last = 0.0
    for index, door in sorted(enumerate(wall.doors), key=lambda item: item[1].at_m):
        start, end = door.at_m - door.width_m / 2.0, door.at_m + door.width_m / 2.0
        if start < -1e-9 or end > length + 1e-9:
            reason = f"{door.at_m:g} m puts the door beyond the wall, which is {length:g} m long"
            raise WorldError(path, f"{key}.doors[{index}].at_m", reason)
        if start < last - 1e-9:
            reason = f"{door.at_m:g} m puts the door into another door"
            raise WorldError(path, f"{key}.doors[{index}].at_m", reason)
        last = end
        gaps.append((start, end, math.inf if door.height_m is None else door.height_m))
    return gaps
