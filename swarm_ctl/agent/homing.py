"""The way home over ground that this vehicle has flown itself: no map, no global position."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from itertools import pairwise

from swarm_ctl.model import ZERO, Vec3

CELL_M = 0.5
APPROACH = 0.6
"""Speed per distance to the last place, 1/s: vehicles that follow late do not overshoot."""
ROUTE_S = 8.0
"""How long a way home is followed before it is looked for again."""
STUCK_M = 0.3
"""Who came no farther on a way home waits for a peer, or cuts a corner that the guard forbids."""
STUCK_TIMES = 2
FIRST_DETOUR = 2
"""Routes over own ground before a shorter way is tried again; the next time twice as many."""
Cell = tuple[int, int, int]


class Trail:
    """Cells visited, joined where the vehicle flew from one into the next."""

    def __init__(self) -> None:
        self.fresh: list[Vec3] | None = None
        """Where cells were entered since somebody took these away, in order: marked again, all
        give the same trail. None as long as nobody does."""
        self._places: dict[Cell, Vec3] = {}
        self._joined: dict[Cell, tuple[Cell, ...]] = {}
        """A few each, for whom a set is four times as large."""
        self._came_from: dict[Cell, Cell] = {}
        """The next cell on the way home from each; empty when that has to be found anew."""
        self._steps: dict[Cell, int] = {}
        """How many cells that way has."""
        self._here: Cell | None = None

    def mark(self, position_ned_m: Vec3) -> None:
        """Remember being here, in the vehicle's own local frame."""
        cell = _cell(position_ned_m)
        if cell == self._here:
            return
        if self.fresh is not None:
            self.fresh.append(position_ned_m)
        is_new = cell not in self._places
        if is_new:
            self._places[cell] = position_ned_m
            self._joined[cell] = ()
        if self._here is not None and self._here not in self._joined[cell]:
            self._join(cell, self._here, is_new=is_new)
        self._here = cell

    def length_m(self) -> float:
        """Give the length of the way home."""
        if self._here is None:
            return 0.0
        return sum(math.dist(a, b) for a, b in pairwise(self.way_home()))

    def _join(self, cell: Cell, before: Cell, *, is_new: bool) -> None:
        """Join two cells; ways home stay as they are unless the two were not equally far away."""
        self._joined[cell] += (before,)
        self._joined[before] += (cell,)
        if not self._came_from:
            return
        if is_new:
            self._came_from[cell] = before
            self._steps[cell] = self._steps[before] + 1
        elif self._steps[cell] != self._steps[before]:
            self._came_from.clear()

    def way_home(self) -> list[Vec3]:
        """Fewest-cells way from here to where the trail began, the start last."""
        if self._here is None:
            return []
        home = next(iter(self._places))
        if not self._came_from:
            self._find_ways(home)
        way, cell = [], self._here
        while cell != home:
            cell = self._came_from[cell]
            way.append(self._places[cell])
        return way

    def _find_ways(self, home: Cell) -> None:
        """Find the way home from every cell."""
        came_from, steps, queue = self._came_from, self._steps, deque([home])
        came_from[home], steps[home] = home, 0
        while queue:
            cell = queue.popleft()
            for neighbour in sorted(self._joined[cell]):
                if neighbour not in came_from:
                    came_from[neighbour], steps[neighbour] = cell, steps[cell] + 1
                    queue.append(neighbour)


class Route:
    """Follow a list of places, one after the other."""

    def __init__(self, places: list[Vec3], reach_m: float = 0.35) -> None:
        self._places = deque(places)
        self._reach_m = reach_m

    def is_done(self) -> bool:
        """Whether the last place was reached."""
        return not self._places

    def velocity(self, position_ned_m: Vec3, speed_m_s: float) -> Vec3:
        """Steer to the next place, slower near the last one."""
        while self._places and self._is_at(self._places[0], position_ned_m):
            self._places.popleft()
        if not self._places:
            return Vec3(0.0, 0.0, 0.0)
        target = self._places[0]
        distance = math.dist(target, position_ned_m)
        is_last = len(self._places) == 1
        scale = (min(speed_m_s, APPROACH * distance) if is_last else speed_m_s) / distance
        return Vec3(*((t - p) * scale for t, p in zip(target, position_ned_m, strict=True)))

    def _is_at(self, place: Vec3, position: Vec3) -> bool:
        """Reached level, and nearly so in height: two-dimensional missions keep their own."""
        level_m = math.hypot(place.x - position.x, place.y - position.y)
        return level_m < self._reach_m and abs(place.z - position.z) < 2.0 * self._reach_m


class Homeward:
    """The way home as it is flown: looked for again and again, over own ground once stuck."""

    def __init__(self) -> None:
        self._route: Route | None = None
        self._until_s = 0.0
        self._from_ned_m = ZERO
        self._times_stuck = 0
        self._own_routes, self._detour_routes = 0, FIRST_DETOUR
        self._arrived_s: float | None = None

    def restart(self) -> None:
        """Look for a way as soon as one is asked for."""
        self._route = None
        self.go_on()

    def go_on(self) -> None:
        """Note that the vehicle is not there, or there no longer."""
        self._arrived_s = None

    def waits_s(self, now: float) -> float:
        """Note that the vehicle is there; give for how long it has been."""
        if self._arrived_s is None:
            self._arrived_s = now
        return now - self._arrived_s

    def route(self, place: Vec3, now: float, way: Callable[[bool], list[Vec3]]) -> Route:
        """Give the route to follow from here.

        `way(own)` finds one, over ground flown by this vehicle alone when `own` is true: it is for
        a while, and each time for longer, once routes have led nowhere for longer than a peer takes
        to pass. Behind the corner that was in the way there is often a shorter one.
        """
        if self._route is None or now >= self._until_s:
            is_stuck = self._route is not None and math.dist(place, self._from_ned_m) < STUCK_M
            self._times_stuck += is_stuck
            if self._times_stuck >= STUCK_TIMES:
                self._times_stuck, self._own_routes = 0, self._detour_routes
                self._detour_routes *= 2
            self._route = Route(way(self._own_routes > 0))
            self._own_routes = max(0, self._own_routes - 1)
            self._until_s, self._from_ned_m = now + ROUTE_S, place
        return self._route


def _cell(position: Vec3) -> Cell:
    x, y, z = position
    floor = math.floor
    return floor(x / CELL_M + 0.5), floor(y / CELL_M + 0.5), floor(z / CELL_M + 0.5)
