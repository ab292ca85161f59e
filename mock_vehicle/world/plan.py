"""From floor plan to solids: boxes, columns, and walls cut at their doors; x, y become NED."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mock_vehicle.errors import WorldError
from mock_vehicle.world.shapes import Prism

if TYPE_CHECKING:
    from pathlib import Path

    from mock_vehicle.world.spec import BoxSpec, CylinderSpec, WallSpec, WorldSpec

OPEN_SKY_HEIGHT_M = 3.0
"""Height of shapes that name none where there is no ceiling, m."""


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
