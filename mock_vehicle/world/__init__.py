"""The simulated world: what a rangefinder hits, what hides what, where vehicles start.

Files are floor plans (x east, y north, z up, degrees); everything here is NED, metres, radians.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.errors import WorldError
from mock_vehicle.maps import CLEARANCE_CAP_M, OccupancyMap, load_map
from mock_vehicle.world.floor import Grid, centres, flood, headings, on_floor, rows
from mock_vehicle.world.shapes import OPEN_SKY_HEIGHT_M, Prism, Room, Shapes, build_prisms
from mock_vehicle.world.spec import GridStarts, WorldSpec, read_spec

if TYPE_CHECKING:
    from pathlib import Path

    from mock_vehicle.world.spec import RandomSpec

__all__ = ["Grid", "Victim", "World", "WorldSpec", "load_world"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

START_CLEARANCE_M = 0.3
"""Least distance from a start to anything solid, m."""
_START_HEIGHT_M = 0.15
"""Height at which a vehicle on the floor is wide, m."""
_SEE_TOLERANCE_M = 1e-3
"""How far short of a point a surface may lie that the point itself is on, m."""
_DRAWN_CELLS = 250_000
"""A map with more cells is drawn coarser."""


class Victim(NamedTuple):
    """Somebody to find."""

    name: str
    """Unique name."""
    position_ned_m: tuple[float, float, float]
    """NED, m."""


class World:
    """Walls, shapes, map, floor and ceiling, and whom to find between them.

    All points are NED, m, float64. Solids are closed: inside, distances are 0 or negative.
    """

    def __init__(
        self, path: Path, spec: WorldSpec, shapes: Shapes, chart: OccupancyMap | None
    ) -> None:
        self.path = path
        self.spec = spec
        self.name = spec.name
        self.ceiling_m = spec.ceiling_m
        self.victims = [
            Victim(v.name, (v.position_m[1], v.position_m[0], -v.position_m[2]))
            for v in spec.victims
        ]
        self._shapes = shapes
        self._map = chart
        self.low_ned_m, self.high_ned_m = self._bounds()
        self._room = self._planes()

    def _bounds(self) -> tuple[Floats, Floats]:
        """Find the box around the world; under open sky it ends at the tallest solid or 3 m."""
        tops = [prism.top_m for prism in self._shapes.prisms] + [OPEN_SKY_HEIGHT_M]
        tops += [] if self._map is None else [self._map.height_m]
        top = max(tops) if self.ceiling_m is None else self.ceiling_m
        if self._map is None:
            (x, y), (width, depth) = self.spec.origin_m, self.spec.size_m or (0.0, 0.0)
            low, high = np.array([y, x]), np.array([y + depth, x + width])
        else:
            nx, ny = self._map.blocked.shape
            free = np.array([[1, 1], [nx - 1, 1], [nx - 1, ny - 1], [1, ny - 1]], dtype=np.float64)
            corners = self._map.points(free)
            low, high = corners.min(axis=0), corners.max(axis=0)
        return np.append(low, -top), np.append(high, 0.0)

    def _planes(self) -> Room:
        """Keep of the box what is solid: floor, ceiling if any, outer walls if closed."""
        low, high = self.low_ned_m.copy(), self.high_ned_m.copy()
        if self._map is not None or not self.spec.closed:
            low[:2], high[:2] = -np.inf, np.inf
        if self.ceiling_m is None:
            low[2] = -np.inf
        return Room(low, high)

    def cast(self, origins_m: Floats, directions: Floats, max_range_m: float) -> Floats:
        """Measure (r,) distances along rays to the first surface, m; inf beyond `max_range_m`.

        Origins and unit directions are (r, 3) NED. Floor and ceiling are surfaces too; a ray that
        begins inside something solid reads 0.
        """
        distance = self._room.cast(origins_m, directions)
        np.minimum(distance, self._shapes.cast(origins_m, directions), out=distance)
        if self._map is not None:
            chart = self._map.cast(origins_m, directions, max_range_m)
            np.minimum(distance, chart, out=distance)
        distance[distance > max_range_m] = np.inf
        return distance

    def clearance(self, points_m: Floats) -> Floats:
        """Measure (n,) distances from (n, 3) points to the nearest solid but the floor, m.

        Negative or 0 inside, in an outer wall and above the ceiling; at most 2 m (a cap). Beside
        the cells of a map right to 0.71 of a cell, else exact.
        """
        nearest = np.minimum(self._room.clearance(points_m), self._shapes.clearance(points_m))
        if self._map is not None:
            np.minimum(nearest, self._map.clearance(points_m), out=nearest)
        return np.minimum(nearest, CLEARANCE_CAP_M, out=nearest)

    def occupied(self, points_m: Floats) -> Bools:
        """Tell which of (n, 3) points are inside something solid; the floor does not count."""
        solid: Bools = self._room.clearance(points_m) < 0.0
        solid |= self._shapes.clearance(points_m) <= 0.0
        if self._map is not None:
            solid |= self._map.occupied(points_m)
        return solid

    def line_of_sight(self, a_m: Floats, b_m: Floats) -> Bools:
        """Tell, for (n, 3) pairs of points, whether nothing solid lies between; (n,).

        A point on a surface is seen from the side it faces.
        """
        away = b_m - a_m
        distance = np.sqrt((away * away).sum(axis=1))
        directions = away / np.maximum(distance, 1e-9)[:, None]
        seen_to = self.cast(a_m, directions, float(distance.max(initial=0.0)))
        clear: Bools = seen_to >= distance - _SEE_TOLERANCE_M
        return clear

    def occupancy(self, cell_m: float, height_m: float) -> Grid:
        """Slice the world at a height; a cell is blocked when its centre is in something solid."""
        low, size = self.low_ned_m[:2], (self.high_ned_m - self.low_ned_m)[:2]
        count = np.maximum(np.ceil(size / cell_m - 1e-9), 1).astype(int)
        middle = centres(low, cell_m, (count[0], count[1]), height_m)
        return Grid(low.copy(), cell_m, self.occupied(middle.reshape(-1, 3)).reshape(count))

    def free_cells(self, cell_m: float, height_m: float, seeds_ned_m: Floats) -> Bools:
        """Mark the cells of `occupancy`, (north, east), that can be reached from (k, 3) seeds.

        A way leads from centre to centre of cells that share a side, with nothing solid between,
        so a wall thinner than a cell still holds. Seeds in blocked cells reach nothing.
        """
        grid = self.occupancy(cell_m, height_m)
        seeds = np.floor((seeds_ned_m[:, :2] - grid.origin_ne_m) / cell_m).astype(int)
        inside = ((seeds >= 0) & (seeds < grid.blocked.shape)).all(axis=1)
        middle = centres(grid.origin_ne_m, cell_m, grid.blocked.shape, height_m)
        north = self._passable(middle[:-1], middle[1:], ~grid.blocked[:-1] & ~grid.blocked[1:])
        east = self._passable(
            middle[:, :-1], middle[:, 1:], ~grid.blocked[:, :-1] & ~grid.blocked[:, 1:]
        )
        return flood(~grid.blocked, north, east, seeds[inside])

    def _passable(self, a_m: Floats, b_m: Floats, free: Bools) -> Bools:
        """Keep of the free pairs of neighbours, (nx, ny), those with nothing solid between them."""
        passable = free.copy()
        step = np.abs(b_m - a_m).max()
        doubtful = free.copy()
        doubtful[free] = self.clearance(a_m[free]) < 2.0 * step
        passable[doubtful] = self.line_of_sight(a_m[doubtful], b_m[doubtful])
        return passable

    def starts(self, n: int, seed: int) -> tuple[Floats, Floats]:
        """Place n vehicles: (n, 3) NED on the floor, m, and (n,) headings clockwise from north.

        Fewer vehicles get the first of the same places. WorldError when there is no room for n, or
        a place is nearer than 0.3 m to something solid.
        """
        rule = self.spec.starts
        if isinstance(rule, tuple):
            points, yaw = np.array([s.position_m for s in rule]), [s.yaw_deg for s in rule]
            if len(rule) < n:
                raise WorldError(self.path, "starts", f"lists {len(rule)} places, not {n}")
            places, yaws_deg = on_floor(points.reshape(-1, 2)[:n, ::-1]), np.array(yaw[:n])
        elif isinstance(rule, GridStarts):
            places, yaws_deg = rows(rule.grid, n)
        else:
            return self._random_starts(rule.random, n, seed)
        self._check_starts(places)
        return places, headings(np.asarray(yaws_deg, dtype=np.float64))

    def _check_starts(self, places_m: Floats) -> None:
        """Raise WorldError for the first place that is inside or too near to something solid."""
        clearance = self.clearance(places_m - [0.0, 0.0, _START_HEIGHT_M])
        for index in np.flatnonzero(clearance < START_CLEARANCE_M)[:1]:
            north, east, _ = places_m[index]
            listed = isinstance(self.spec.starts, tuple)
            key = f"starts[{index}].position_m" if listed else "starts.grid"
            which = "" if listed else f"vehicle {index + 1} at "
            gap = clearance[index]
            near = "is inside something" if gap <= 0.0 else f"is only {gap:.2f} m from something"
            raise WorldError(self.path, key, f"{which}({east:g}, {north:g}) {near} solid")

    def _random_starts(self, rule: RandomSpec, n: int, seed: int) -> tuple[Floats, Floats]:
        """Throw darts at the floor and keep those far enough from solids and from each other."""
        darts, noses = (np.random.default_rng([seed, stream]) for stream in (0, 1))
        room = min(max(rule.margin_m, START_CLEARANCE_M), CLEARANCE_CAP_M)
        low, high = self.low_ned_m[:2], self.high_ned_m[:2]
        kept = np.empty((0, 3))
        for _ in range(64):
            batch = on_floor(darts.uniform(low, high, (512, 2)))
            for dart in batch[self.clearance(batch - [0.0, 0.0, _START_HEIGHT_M]) >= room]:
                if len(kept) < n and (np.hypot(*(kept - dart).T[:2]) >= rule.spacing_m).all():
                    kept = np.vstack([kept, dart])
            if len(kept) >= n:
                return kept, noses.uniform(-math.pi, math.pi, n)
        reason = f"there is room for {len(kept)} vehicles {rule.spacing_m:g} m apart, not for {n}"
        raise WorldError(self.path, "starts.random", reason)

    def outline(self) -> dict[str, Any]:
        """Describe the world for drawing, JSON-able.

        `low`, `high` [n, e, d] bound it (the outer walls, if `closed`); `polygons` are the shapes
        from above, `points_ne_m` with `bottom_m` and `top_m` above the floor; `victims` have
        `name` and `position_ned_m`. `map` is null or solid cells: cell (i, j) begins at
        `origin_ne_m` plus i `cell_m` along the map's x axis, which points `yaw_rad`
        counter-clockwise from east, plus j along its y axis; of `shape` [nx, ny], j running
        fastest, `blocked_rle` holds the lengths of runs, first free, then solid, and so on.
        """
        return {
            "name": self.name,
            "low": self.low_ned_m.tolist(),
            "high": self.high_ned_m.tolist(),
            "ceiling_m": self.ceiling_m,
            "closed": self.spec.closed and self._map is None,
            "polygons": [_polygon(prism) for prism in self._shapes.prisms],
            "victims": [
                v._asdict() | {"position_ned_m": [*v.position_ned_m]} for v in self.victims
            ],
            "map": None if self._map is None else _drawn_map(self._map),
        }

    def check(self) -> None:
        """Raise WorldError for what stands outside the world or inside something solid."""
        for kind in ("boxes", "cylinders"):
            for index, shape in enumerate(getattr(self.spec, kind)):
                self._check_inside(f"{kind}[{index}].center_m", shape.center_m)
        for index, wall in enumerate(self.spec.walls):
            self._check_inside(f"walls[{index}].from_m", wall.from_m)
            self._check_inside(f"walls[{index}].to_m", wall.to_m)
        self._check_victims()
        if isinstance(self.spec.starts, tuple):
            self.starts(len(self.spec.starts), seed=0)
        elif isinstance(self.spec.starts, GridStarts):
            self.starts(1, seed=0)

    def _check_inside(self, key: str, position_m: tuple[float, ...]) -> None:
        x, y, z = (*position_m, 0.0)[:3]
        point = np.array([y, x, -z])
        if (point < self.low_ned_m - 1e-6).any() or (point > self.high_ned_m + 1e-6).any():
            (n0, e0, d0), (n1, e1, _) = self.low_ned_m, self.high_ned_m
            where = ", ".join(f"{value:g}" for value in position_m)
            span = f"x {e0:g}..{e1:g}, y {n0:g}..{n1:g}, z 0..{-d0:g} m"
            raise WorldError(self.path, key, f"({where}) is outside the world, {span}")

    def _check_victims(self) -> None:
        names: set[str] = set()
        for index, victim in enumerate(self.spec.victims):
            key = f"victims[{index}].position_m"
            self._check_inside(key, victim.position_m)
            if self.occupied(np.array([self.victims[index].position_ned_m]))[0]:
                where = ", ".join(f"{value:g}" for value in victim.position_m)
                raise WorldError(self.path, key, f"({where}) is inside something solid")
            if victim.name in names:
                reason = f"{victim.name} is the name of another victim"
                raise WorldError(self.path, f"victims[{index}].name", reason)
            names.add(victim.name)


def load_world(path: Path) -> World:
    """Read a world file and the map it names; WorldError names file and key of what is wrong."""
    spec = read_spec(path)
    world = World(path, spec, Shapes(build_prisms(path, spec)), _load_map(path, spec))
    world.check()
    return world


def _load_map(path: Path, spec: WorldSpec) -> OccupancyMap | None:
    if spec.map is None:
        if spec.size_m is None:
            raise WorldError(path, "size_m", "is required without a map")
        return None
    for key in ("size_m", "origin_m"):
        if key in spec.model_fields_set:
            raise WorldError(path, key, "cannot go with map, which has an extent of its own")
    file = path.parent / spec.map.file
    if not file.is_file():
        raise WorldError(path, "map.file", f"{spec.map.file} does not exist")
    return load_map(file, spec.map.height_m or spec.ceiling_m or OPEN_SKY_HEIGHT_M)


def _polygon(prism: Prism) -> dict[str, Any]:
    points = prism.outline_ne_m().round(3).tolist()
    return {"points_ne_m": points, "bottom_m": prism.bottom_m, "top_m": prism.top_m}


def _drawn_map(chart: OccupancyMap) -> dict[str, Any]:
    """Describe a map for drawing, in runs; a big one coarser, solid wherever any cell is."""
    factor = math.ceil(math.sqrt(max(1.0, chart.blocked.size / _DRAWN_CELLS)))
    padding = [(0, -size % factor) for size in chart.blocked.shape]
    padded = np.pad(chart.blocked, padding, constant_values=True)
    nx, ny = (size // factor for size in padded.shape)
    blocked = padded.reshape(nx, factor, ny, factor).any(axis=(1, 3))
    edges = np.flatnonzero(np.diff(blocked.reshape(-1), prepend=False, append=False))
    return {
        "origin_ne_m": list(chart.origin_ne_m),
        "cell_m": chart.cell_m * factor,
        "yaw_rad": chart.yaw_rad,
        "height_m": chart.height_m,
        "shape": [nx, ny],
        "blocked_rle": np.diff(edges, prepend=0, append=blocked.size).tolist(),
    }
