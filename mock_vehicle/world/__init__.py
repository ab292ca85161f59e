"""The simulated world: what a rangefinder hits, what hides what, where vehicles start.

Files are floor plans (x east, y north, z up, degrees); everything here is NED, metres, radians.
"""

from __future__ import annotations

import importlib.util
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.errors import WorldError
from mock_vehicle.maps import CLEARANCE_CAP_M, OccupancyMap, load_map
from mock_vehicle.world.bounds import check_size
from mock_vehicle.world.floor import Grid, centres, flood, largest_area
from mock_vehicle.world.outline import drawn_map, polygon
from mock_vehicle.world.plan import OPEN_SKY_HEIGHT_M, build_prisms
from mock_vehicle.world.reading import read_faults, read_spec
from mock_vehicle.world.ring import Ring
from mock_vehicle.world.shapes import Room, Shapes
from mock_vehicle.world.spec import GridStarts, WorldSpec
from mock_vehicle.world.starts import place

if TYPE_CHECKING:
    from pathlib import Path

__all__ = [
    "Grid",
    "Ring",
    "Victim",
    "World",
    "WorldSpec",
    "build_world",
    "load_world",
    "read_faults",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

_SEE_TOLERANCE_M = 1e-3
"""How far short of a point a surface may lie that the point itself is on, m."""


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
        self.prisms = shapes.prisms
        """The solids, walls cut into pieces at their doors."""
        self._shapes = shapes
        self._map = chart
        self.low_ned_m, self.high_ned_m = self._bounds()
        self._room = self._planes()
        self._loops: ModuleType | None = None

    def compile(self) -> None:
        """Look around by loops that numba compiles, where it is installed; not so with a map."""
        if self._map is None and importlib.util.find_spec("numba") is not None:
            self._loops = importlib.import_module("mock_vehicle.world.loops")

    def _bounds(self) -> tuple[Floats, Floats]:
        """Find the box around the world; under open sky it ends at the tallest solid or 3 m."""
        tops = [prism.top_m for prism in self.prisms] + [OPEN_SKY_HEIGHT_M]
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
        loops, room = self._loops, self._room
        lines = None if loops is None else self._shapes.lines(origins_m, directions)
        if loops is not None and lines is not None:
            distance = np.empty(len(origins_m))
            rays = (max_range_m, origins_m, directions, room.low_m, room.high_m)
            loops.cast(*rays, *lines, distance)
            return distance
        distance = room.cast(origins_m, directions)
        np.minimum(distance, self._shapes.cast(origins_m, directions), out=distance)
        if self._map is not None:
            chart = self._map.cast(origins_m, directions, max_range_m)
            np.minimum(distance, chart, out=distance)
        distance[distance > max_range_m] = np.inf
        return distance

    def scan(self, ring: Ring, max_range_m: float) -> None:
        """Stop level rays at the first surface: as `cast` would, in a fraction of the time.

        Beyond `max_range_m` the rays have met nothing.
        """
        self._room.scan(ring)
        self._shapes.scan(ring, max_range_m)
        if self._map is not None:
            origins = np.repeat(ring.origins_m, ring.count, axis=0)
            chart = self._map.cast(origins, ring.directions(), max_range_m)
            ring.meet(chart.reshape(ring.ranges_m.shape))
        ring.ranges_m[ring.ranges_m > max_range_m] = np.inf

    def look(
        self,
        ring: Ring,
        max_range_m: float,
        bodies: tuple[Ints, Ints],
        radius_m: float,
        bodies_m: Floats | None = None,
    ) -> Floats:
        """Stop level rays as `scan` does, and measure up and down as `plumb` does, (n, 2).

        The others, of (seer, seen) indices, are spheres: other origins, or rows of `bodies_m`, of
        which the origins come first.
        """
        bodies_m = ring.origins_m if bodies_m is None else bodies_m
        loops, room = self._loops, self._room
        solids = None if loops is None else self._shapes.solids(ring.origins_m)
        if loops is None or solids is None:
            self.scan(ring, max_range_m)
            upright = self.plumb(ring.origins_m, max_range_m)
            if len(bodies[0]):
                ring.meet_spheres(upright, *bodies, radius_m, bodies_m)
            return upright
        upright = np.empty((len(ring.origins_m), 2))
        reach = (max_range_m, max_range_m**2)
        rays = (ring.north, ring.east, ring.ranges_m, upright)
        loops.look(*reach, ring.origins_m, room.low_m, room.high_m, *solids, *rays)
        if len(bodies[0]):
            loops.see_bodies(radius_m**2, ring.origins_m, bodies_m, *bodies, *rays)
        return upright

    def plumb(self, points_m: Floats, max_range_m: float) -> Floats:
        """Measure (n, 2) distances straight up and down from (n, 3) points, as `cast` would, m."""
        distance = np.minimum(self._room.plumb(points_m), self._shapes.plumb(points_m))
        if self._map is not None:
            np.minimum(distance, self._map.plumb(points_m), out=distance)
        distance[distance > max_range_m] = np.inf
        return distance

    def clearance(self, points_m: Floats) -> Floats:
        """Measure (n,) distances from (n, 3) points to the nearest solid but the floor, m.

        Negative or 0 inside, in an outer wall and above the ceiling; at most 2 m (a cap). Beside
        the cells of a map right to 0.71 of a cell, else exact.
        """
        loops, room = self._loops, self._room
        solids = None if loops is None else self._shapes.solids(points_m)
        if loops is not None and solids is not None:
            nearest = np.empty(len(points_m))
            shapes = (solids.boxes, solids.box_sizes, *solids[3:6])
            loops.clear(CLEARANCE_CAP_M, points_m, room.low_m, room.high_m, *shapes, nearest)
            return nearest
        nearest = np.minimum(room.clearance(points_m), self._shapes.clearance(points_m))
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

    def walls_between(self, a_m: Floats, b_m: Floats) -> Ints:
        """Count, for (n, 3) pairs of points, the solids in the line of sight; (n,).

        Pieces that touch are one, as the wall beside a door and the one above it.
        """
        away = b_m - a_m
        lengths = np.sqrt((away * away).sum(axis=1))
        directions = away / np.maximum(lengths, 1e-9)[:, None]
        counts = self._shapes.crossings(a_m, directions, lengths)
        if self._map is not None:
            counts += self._map.crossings(a_m, directions, lengths)
        return counts

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
        seeds = grid.cells(seeds_ned_m)
        return flood(~grid.blocked, *self._ways(grid, height_m), seeds[grid.holds(seeds)])

    def largest_area(self, cell_m: float, height_m: float) -> Grid:
        """Slice the world at a height as `occupancy`, but block all except the largest free area.

        Its cells can be reached from one another, as `free_cells` has it.
        """
        grid = self.occupancy(cell_m, height_m)
        area = largest_area(~grid.blocked, *self._ways(grid, height_m))
        return grid._replace(blocked=~area)

    def _ways(self, grid: Grid, height_m: float) -> tuple[Bools, Bools]:
        """Tell where the next cell northwards and eastwards can be entered."""
        free = ~grid.blocked
        middle = centres(grid.origin_ne_m, grid.cell_m, free.shape, height_m)
        north = self._passable(middle[:-1], middle[1:], free[:-1] & free[1:])
        east = self._passable(middle[:, :-1], middle[:, 1:], free[:, :-1] & free[:, 1:])
        return north, east

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
        return place(self, n, seed)

    def outline(self) -> dict[str, Any]:
        """Describe the world for drawing, JSON-able.

        `low`, `high` [n, e, d] bound it (the outer walls, if `closed`); `origin` is the place of
        0, 0, 0 on the globe; `polygons` are the shapes from above, `points_ne_m` with `bottom_m`
        and `top_m` above the floor; `victims` have `name` and `position_ned_m`. `map` is null or
        solid cells: cell (i, j) begins at `origin_ne_m` plus i `cell_m` along the map's x axis,
        which points `yaw_rad` counter-clockwise from east, plus j along its y axis; of `shape`
        [nx, ny], j running fastest, `blocked_rle` holds the lengths of runs, first free, then
        solid, and so on.
        """
        return {
            "name": self.name,
            "low": self.low_ned_m.tolist(),
            "high": self.high_ned_m.tolist(),
            "ceiling_m": self.ceiling_m,
            "closed": self.spec.closed and self._map is None,
            "origin": self.spec.gnss.model_dump(exclude={"reception"}),
            "polygons": [polygon(prism) for prism in self.prisms],
            "victims": [
                v._asdict() | {"position_ned_m": [*v.position_ned_m]} for v in self.victims
            ],
            "map": None if self._map is None else drawn_map(self._map),
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
    return build_world(path, read_spec(path))


def build_world(path: Path, spec: WorldSpec) -> World:
    """Build what a world file says; its path is where a map lies, and what WorldError names."""
    world = World(path, spec, Shapes(build_prisms(path, spec)), _load_map(path, spec))
    north_m, east_m, down_m = (world.high_ned_m - world.low_ned_m).tolist()
    check_size(path, spec, (north_m, east_m, down_m))
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
