"""Maps of ROS map_server: occupancy read from an image, and rays marched through it."""

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from mock_vehicle.errors import WorldError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

CLEARANCE_CAP_M = 2.0
"""Clearances beyond this are reported as this, m."""
_EPSILON_CELLS = 1e-5
"""How far a ray steps over the border of a cell; half a micrometre at 0.05 m."""
_PARALLEL = 1e-5
"""A slope, cells per metre, below which a ray counts as parallel to an axis of the map."""


class MapHeader(NamedTuple):
    """What a map_server YAML file says."""

    image: Path
    """The image, absolute."""
    resolution_m: float
    """Edge of a cell, m."""
    origin: tuple[float, float, float]
    """Pose x m, y m, yaw rad (counter-clockwise from east) of the lower-left corner."""
    negate: bool
    """Whether bright means occupied."""
    occupied_thresh: float
    """Occupied from this probability."""
    free_thresh: float
    """Free below this probability; between the two is unknown."""


class OccupancyMap:
    """Solid cells of a map, extruded from the floor to a height.

    `blocked` is (nx, ny), indexed along the map's own x and y axes, cut to the free cells and a
    rim of one solid cell. All beyond it is solid, and so is what the map calls unknown.
    """

    def __init__(
        self,
        blocked: Bools,
        cell_m: float,
        origin_ne_m: tuple[float, float],
        yaw_rad: float,
        height_m: float,
    ) -> None:
        self.blocked = blocked
        self.cell_m = cell_m
        self.origin_ne_m = origin_ne_m
        self.yaw_rad = yaw_rad
        self.height_m = height_m
        sin, cos = math.sin(yaw_rad), math.cos(yaw_rad)
        # columns: the map's x and y axes in north, east
        self._axes = np.array([[sin, cos], [cos, -sin]])
        self._steps = chessboard_distance(blocked)

    def cells(self, points_ned_m: Floats) -> Floats:
        """Turn (n, 3) NED points into (n, 2) fractional cells along the map's x and y."""
        away = points_ned_m[:, :2] - self.origin_ne_m
        cells: Floats = (away @ self._axes) / self.cell_m
        return cells

    def points(self, cells: Floats) -> Floats:
        """Turn (n, 2) fractional cells into (n, 2) north, east, m."""
        north_east: Floats = cells @ self._axes.T * self.cell_m + self.origin_ne_m
        return north_east

    def occupied(self, points_ned_m: Floats) -> Bools:
        """Tell which of (n, 3) points lie in a solid cell below the map's height."""
        below = -points_ned_m[:, 2] < self.height_m
        solid: Bools = below & (self._look(self._steps, self.cells(points_ned_m)) == 0)
        return solid

    def clearance(self, points_ned_m: Floats) -> Floats:
        """Measure (n,) distances to solid cells, m, negative inside, at most `CLEARANCE_CAP_M`.

        Exact at the centres of cells, elsewhere right to 0.71 of a cell, with the right sign.
        """
        aside = self._look(self._clearances, self.cells(points_ned_m)).astype(np.float64)
        above = np.maximum(-points_ned_m[:, 2] - self.height_m, 0.0)
        over = np.hypot(np.maximum(aside, 0.0), above)
        return np.minimum(np.where(above > 0.0, over, aside), CLEARANCE_CAP_M)

    def cast(self, origins_m: Floats, directions: Floats, max_range_m: float) -> Floats:
        """Measure (r,) distances along rays to the first solid cell, m; inf beyond `max_range_m`.

        Origins and unit directions are (r, 3) NED; a ray that begins inside reads 0. Rays march
        from border to border of the largest free square around them, all at once.
        """
        starts, ends = self._span_below_top(origins_m[:, 2], directions[:, 2], max_range_m)
        slopes = directions[:, :2] @ self._axes / self.cell_m
        parallel = np.abs(slopes) < _PARALLEL
        slopes[parallel] = 0.0
        ahead = np.where(slopes < 0.0, -1.0, 1.0)
        inverse = np.where(parallel, 1e12, 1.0 / np.where(parallel, 1.0, slopes))
        march = _March(self.cells(origins_m), slopes, ahead, inverse)
        return self._march(march, starts, ends)

    def crossings(self, origins_m: Floats, directions: Floats, lengths_m: Floats) -> Ints:
        """Count (r,) walls of solid cells that (r, 3) rays enter within (r,) lengths, m.

        Looked at every half cell, so a corner that is cut by less may be missed.
        """
        looks = int(lengths_m.max(initial=0.0) / (0.5 * self.cell_m)) + 1
        along = np.linspace(0.0, 1.0, looks + 1) * lengths_m[:, None]
        points = origins_m[:, None, :] + along[:, :, None] * directions[:, None, :]
        solid = self.occupied(points.reshape(-1, 3)).reshape(along.shape)
        counts: Ints = (solid[:, 1:] & ~solid[:, :-1]).sum(axis=1) + solid[:, 0]
        return counts

    def plumb(self, points_ned_m: Floats) -> Floats:
        """Measure (n, 2) distances up and down to solid cells, m: their tops, 0 inside, or inf."""
        solid = self._look(self._steps, self.cells(points_ned_m)) == 0
        above = -points_ned_m[:, 2] - self.height_m
        up = np.where(solid & (above <= 0.0), 0.0, np.inf)
        return np.column_stack((up, np.where(solid, np.maximum(above, 0.0), np.inf)))

    def _span_below_top(self, down_m: Floats, slope: Floats, far_m: float) -> tuple[Floats, Floats]:
        """Bound each ray to where it is lower than the map's top; end < start where it never is."""
        above_m = -down_m - self.height_m
        level = np.abs(slope) < 1e-12
        crossing = above_m / np.where(level, 1.0, slope)
        starts = np.where(above_m > 0.0, np.where(level | (slope < 0.0), np.inf, crossing), 0.0)
        leaving = (above_m <= 0.0) & (slope < 0.0) & ~level
        return starts, np.where(leaving, np.minimum(crossing, far_m), far_m)

    def _march(self, march: _March, starts: Floats, ends: Floats) -> Floats:
        """Advance every ray until it meets a solid cell or its end."""
        hits = np.full(len(starts), np.inf)
        ids = np.flatnonzero(starts <= ends)
        march, t, ends = _March(*(field[ids] for field in march)), starts[ids], ends[ids]
        while len(ids):
            cell = np.floor(march.origin + t[:, None] * march.slope)
            steps = self._look(self._steps, cell)
            solid = steps == 0
            hits[ids[solid]] = t[solid]
            edge = cell + (march.ahead < 0.0) + march.ahead * steps[:, None]
            reach = ((edge - march.origin) * march.inverse).min(axis=1)
            t = np.maximum(reach, t) + _EPSILON_CELLS * self.cell_m
            on = ~solid & (t <= ends)
            if not on.all():
                ids, t, ends = ids[on], t[on], ends[on]
                march = _March(*(field[on] for field in march))
        return hits

    def _look(self, table: NDArray[Any], cells: Floats) -> NDArray[Any]:
        """Read a table of cells at (n, 2) places; beyond its rim the nearest rim cell answers."""
        index = cells.astype(np.intp)
        np.maximum(index, 0, out=index)
        nx, ny = table.shape
        found: NDArray[Any] = table[
            np.minimum(index[:, 0], nx - 1), np.minimum(index[:, 1], ny - 1)
        ]
        return found

    @cached_property
    def _clearances(self) -> NDArray[np.float32]:
        """Signed distance from the centre of every cell to the nearest border of solid, m."""
        cap = min(90, math.ceil(CLEARANCE_CAP_M / self.cell_m) + 1)
        outside = _distance_to_squares(self.blocked, cap)
        inside = _distance_to_squares(~self.blocked, cap)
        return (np.where(self.blocked, -inside, outside) * self.cell_m).astype(np.float32)


class _March(NamedTuple):
    """Rays in cells of the map, (k, 2) each."""

    origin: Floats
    slope: Floats
    ahead: Floats
    inverse: Floats


def chessboard_distance(blocked: Bools) -> NDArray[np.int32]:
    """Count, for every cell, king's moves to the nearest blocked cell; 0 inside.

    A cell at distance D stands in the middle of a free square of (2 D - 1) cells. Two passes over
    the rows are exact for this metric (Rosenfeld and Pfaltz 1968).
    """
    far = sum(blocked.shape)
    distance = np.where(blocked, 0, far).astype(np.int32)
    column = np.arange(blocked.shape[1], dtype=np.int32)
    _sweep(distance, column)
    _sweep(distance[::-1, ::-1], column)
    return distance


def _sweep(distance: NDArray[np.int32], column: NDArray[np.int32]) -> None:
    """Pass distances on to the next row's three neighbours and rightwards within a row."""
    before = np.full(distance.shape[1] + 2, np.iinfo(np.int32).max - 1, dtype=np.int32)
    for row in distance:
        near = np.minimum(np.minimum(before[:-2], before[2:]), before[1:-1]) + 1
        np.minimum(row, near, out=near)
        np.minimum.accumulate(near - column, out=near)
        row[:] = near + column
        before[1:-1] = row


def _distance_to_squares(solid: Bools, cap: int) -> NDArray[np.float32]:
    """Measure, in cells, from every cell's centre to the nearest square of `solid`, up to `cap`.

    Exact: the nearest solid cell of each row first, then the best of the rows within `cap`. It is
    counted in squares of half cells, which fit 16 bits for `cap` up to 90.
    """
    limit = (2 * cap - 1) ** 2
    along = np.minimum(_distance_in_row(solid), cap).astype(np.uint16)
    squares = np.where(along == 0, 0, (2 * along.astype(np.int32) - 1) ** 2).astype(np.uint16)
    best = squares.copy()
    for offset in range(1, min(cap, len(solid))):
        aside = np.uint16((2 * offset - 1) ** 2)
        np.minimum(best[offset:], squares[:-offset] + aside, out=best[offset:])
        np.minimum(best[:-offset], squares[offset:] + aside, out=best[:-offset])
    return (np.sqrt(np.minimum(best, limit)) / 2.0).astype(np.float32)


def _distance_in_row(solid: Bools) -> NDArray[np.int32]:
    """Count cells to the nearest solid one in the same row; large where there is none."""
    column = np.arange(solid.shape[1], dtype=np.int32)
    far = np.int32(solid.shape[1] + 1_000)
    left = np.maximum.accumulate(np.where(solid, column, -far), axis=1)
    right = np.minimum.accumulate(np.where(solid, column, 2 * far)[:, ::-1], axis=1)[:, ::-1]
    nearest: NDArray[np.int32] = np.minimum(column - left, right - column)
    return nearest


def load_map(path: Path, height_m: float) -> OccupancyMap:
    """Read a map_server map (mode trinary) and raise its walls to `height_m`.

    Unknown cells count as solid. WorldError names the file and the key that is wrong.
    """
    header = _read_header(path)
    grey = _read_image(path, header.image)
    occupancy = grey / 255.0 if header.negate else (255.0 - grey) / 255.0
    blocked = ~(occupancy < header.free_thresh)[::-1].T  # from image rows to x, y
    return _cut(path, blocked, header, height_m)


def _cut(path: Path, blocked: Bools, header: MapHeader, height_m: float) -> OccupancyMap:
    """Keep the free cells and a solid rim of one cell around them."""
    lines = [np.flatnonzero(~blocked.all(axis=axis)) for axis in (1, 0)]
    if not len(lines[0]):
        raise WorldError(path, "image", f"{header.image.name} has no free cell")
    x, y = (int(line[0]) for line in lines)
    free = blocked[x : int(lines[0][-1]) + 1, y : int(lines[1][-1]) + 1]
    east, north, yaw = header.origin
    along, aside = (x - 1) * header.resolution_m, (y - 1) * header.resolution_m
    corner_ne = (
        north + along * math.sin(yaw) + aside * math.cos(yaw),
        east + along * math.cos(yaw) - aside * math.sin(yaw),
    )
    rimmed = np.pad(free, 1, constant_values=True)
    return OccupancyMap(rimmed, header.resolution_m, corner_ne, yaw, height_m)


def _read_header(path: Path) -> MapHeader:
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise WorldError(path, "", f"cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise WorldError(path, "", "is not YAML: " + " ".join(str(error).split())) from error
    if not isinstance(data, dict):
        raise WorldError(path, "", "should hold keys like image: and resolution:")
    return _check_header(path, data)


def _check_header(path: Path, data: dict[str, Any]) -> MapHeader:
    if data.get("mode", "trinary") != "trinary":
        raise WorldError(path, "mode", f"{data['mode']} is not supported, only trinary is")
    if not isinstance(data.get("image"), str):
        raise WorldError(path, "image", "should name the image file")
    resolution = _number(path, data, "resolution")
    if resolution <= 0.0:
        raise WorldError(path, "resolution", f"should be greater than 0 m, not {resolution}")
    occupied, free = (_number(path, data, key) for key in ("occupied_thresh", "free_thresh"))
    if not 0.0 < occupied <= 1.0:
        raise WorldError(path, "occupied_thresh", f"should be within 0..1, not {occupied}")
    if not 0.0 <= free < occupied:
        reason = f"should be within 0..occupied_thresh ({occupied}), not {free}"
        raise WorldError(path, "free_thresh", reason)
    negate = data.get("negate", 0)
    if negate not in (0, 1):
        raise WorldError(path, "negate", f"should be 0 or 1, not {negate!r}")
    image, pose = path.parent / data["image"], _origin(path, data)
    return MapHeader(image, resolution, pose, bool(negate), occupied, free)


def _origin(path: Path, data: dict[str, Any]) -> tuple[float, float, float]:
    origin = data.get("origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise WorldError(path, "origin", f"should be [x, y, yaw], not {origin!r}")
    pose = {f"origin[{i}]": value for i, value in enumerate(origin)}
    x, y, yaw = (_number(path, pose, key) for key in pose)
    return x, y, yaw


def _number(path: Path, data: dict[str, Any], key: str) -> float:
    value = data.get(key)
    if value is None:
        raise WorldError(path, key, "is required")
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise WorldError(path, key, f"should be a number, not {value!r}")
    return float(value)


def _read_image(path: Path, image: Path) -> NDArray[np.float32]:
    """Read grey levels 0..255, (rows, columns) from the top; colours count by their mean."""
    try:
        with Image.open(image) as picture:
            return _grey(picture)
    except FileNotFoundError as error:
        raise WorldError(path, "image", f"{image.name} does not exist") from error
    except (OSError, SyntaxError, ValueError, UnidentifiedImageError) as error:
        raise WorldError(path, "image", f"{image.name} cannot be read as an image") from error


def _grey(picture: Image.Image) -> NDArray[np.float32]:
    if picture.mode.startswith("I"):  # 16 bits
        return np.asarray(picture, dtype=np.float32) / np.float32(257.0)
    if picture.mode in {"1", "L", "LA"}:
        return np.asarray(picture.convert("L"), dtype=np.float32)
    mean: NDArray[np.float32] = np.asarray(picture.convert("RGB"), dtype=np.float32).mean(axis=2)
    return mean
