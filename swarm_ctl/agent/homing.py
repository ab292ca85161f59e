"""The way home over ground that this vehicle has flown itself: no map, no global position."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections import deque
from collections.abc import Callable
from itertools import pairwise
from struct import Struct

from swarm_ctl.model import Vec3

CELL_M = 0.5
APPROACH = 0.6
"""Speed per distance to the last place, 1/s: vehicles that follow late do not overshoot."""
ROUTE_S = 8.0
"""How long a way home is followed before it is looked for again."""
STUCK_M = 0.3
"""Who is where a route began already waits for a peer, or cuts a corner that the guard forbids."""
STUCK_TIMES = 2
FIRST_DETOUR = 2
"""Routes over own ground before a shorter way is tried again; the next time twice as many."""
FAR = 1 << 20
"""Cells farther off along an axis, 500 km, are taken for one."""
NONE = -1
PLACE = Struct("3d")
Cell = tuple[int, int, int]


class Trail:
    """Cells visited, joined where the vehicle flew from one into the next.

    They are numbered in the order in which they were entered, from home on, and what is known of
    them stands in arrays: objects would take five times as much.
    """

    def __init__(self) -> None:
        self.fresh: list[Vec3] | None = None
        """Where cells were entered since somebody took these away, in order: marked again, all
        give the same trail. None as long as nobody does."""
        self._keys, self._numbers = array("q"), array("i")
        """Of all cells, sorted by key."""
        self._places = array("d")
        """Where each cell was entered first, three numbers each."""
        self._first = array("i")
        """The first link of each cell, of those to cells that it is joined with."""
        self._to, self._after = array("i"), array("i")
        """Of each link: the cell it leads to, and the next link of the same cell."""
        self._came_from = array("i")
        """The next cell on the way home from each."""
        self._steps = array("i")
        """How many cells that way has."""
        self._knows_ways = False
        """Whether they need not be found anew."""
        self._here = NONE
        self._cell: Cell | None = None
        """The same, by its place."""

    def mark(self, position_ned_m: Vec3) -> None:
        """Remember being here, in the vehicle's own local frame."""
        cell = _cell(position_ned_m)
        if cell == self._cell:
            return
        if self.fresh is not None:
            self.fresh.append(position_ned_m)
        key, before = _key(cell), self._here
        at = bisect_left(self._keys, key)
        is_new = at == len(self._keys) or self._keys[at] != key
        if is_new:
            self._begin(at, key, position_ned_m)
        self._here, self._cell = self._numbers[at], cell
        if before != NONE and (is_new or before not in self._joined(self._here)):
            self._join(self._here, before, is_new=is_new)

    def length_m(self) -> float:
        """Give the length of the way home."""
        return sum((math.dist(a, b) for a, b in pairwise(self._way_home())), 0.0)

    def way_home(self) -> list[Vec3]:
        """Fewest-cells way from here to where the trail began, the start last."""
        return [Vec3(*place) for place in self._way_home()]

    def _way_home(self) -> list[tuple[float, ...]]:
        if self._here == NONE:
            return []
        if not self._knows_ways:
            self._find_ways()
        way, cell = [], self._here
        came_from, places, place = self._came_from, self._places, PLACE.unpack_from
        while cell:
            cell = came_from[cell]
            way.append(place(places, PLACE.size * cell))
        return way

    def _begin(self, at: int, key: int, place: Vec3) -> None:
        """Give a cell the next number."""
        self._keys.insert(at, key)
        self._numbers.insert(at, len(self._numbers))
        self._places.extend(place)
        for of_each in (self._first, self._came_from, self._steps):
            of_each.append(NONE)

    def _join(self, cell: int, before: int, *, is_new: bool) -> None:
        """Join two cells; ways home stay as they are unless the two were not equally far away."""
        self._link(cell, before)
        self._link(before, cell)
        if not self._knows_ways:
            return
        if is_new:
            self._came_from[cell] = before
            self._steps[cell] = self._steps[before] + 1
        elif self._steps[cell] != self._steps[before]:
            self._knows_ways = False

    def _joined(self, cell: int) -> list[int]:
        """Give the cells that one is joined with."""
        cells, link = [], self._first[cell]
        while link != NONE:
            cells.append(self._to[link])
            link = self._after[link]
        return cells

    def _link(self, cell: int, other: int) -> None:
        """Lead from a cell to another as well."""
        self._to.append(other)
        self._after.append(self._first[cell])
        self._first[cell] = len(self._to) - 1

    def _find_ways(self) -> None:
        """Find the way home from every cell; neighbours take turns by their keys."""
        count = len(self._numbers)
        rank = sorted(range(count), key=self._numbers.__getitem__)
        first, to, after = self._first.tolist(), self._to.tolist(), self._after.tolist()
        came_from, steps, queue = [NONE] * count, self._steps, [0]
        came_from[0] = steps[0] = 0
        for cell in queue:
            found, link = [], first[cell]
            while link != NONE:
                if came_from[to[link]] == NONE:
                    found.append(to[link])
                link = after[link]
            if len(found) > 1:
                found.sort(key=rank.__getitem__)
            for other in found:
                came_from[other], steps[other] = cell, steps[cell] + 1
            queue += found
        self._came_from, self._knows_ways = array("i", came_from), True


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
        self._begun_ned_m: list[Vec3] = []
        """Where routes began since the last turn: three of them may lead round in a circle."""
        self._times_stuck = 0
        self._is_own = False
        """Whether the route followed now leads over own ground."""
        self._own_routes, self._detour_routes = 0, FIRST_DETOUR
        self._arrived_s: float | None = None

    def restart(self) -> None:
        """Look for a way as soon as one is asked for."""
        self._route, self._begun_ned_m = None, []
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
        to pass, and no longer once those lead nowhere either. Behind the corner that was in the way
        there is often a shorter one.
        """
        if self._route is None or now >= self._until_s:
            self._times_stuck += any(math.dist(place, p) < STUCK_M for p in self._begun_ned_m)
            if self._times_stuck >= STUCK_TIMES:
                self._turn()
            self._begun_ned_m.append(place)
            self._is_own = self._own_routes > 0
            self._own_routes -= self._is_own
            self._route = Route(way(self._is_own))
            self._until_s = now + ROUTE_S
        return self._route

    def _turn(self) -> None:
        """Take the other kind of way: over own ground, or whatever is shorter."""
        self._times_stuck, self._begun_ned_m = 0, []
        if self._is_own:
            self._own_routes = 0
        else:
            self._own_routes = self._detour_routes
            self._detour_routes *= 2


def _cell(position: Vec3) -> Cell:
    x, y, z = position
    floor = math.floor
    return floor(x / CELL_M + 0.5), floor(y / CELL_M + 0.5), floor(z / CELL_M + 0.5)


def _key(cell: Cell) -> int:
    """Tell a cell by one number of 63 bits; in the same order."""
    x, y, z = cell
    if not (-FAR <= x < FAR and -FAR <= y < FAR and -FAR <= z < FAR):
        x, y, z = [min(max(-FAR, part), FAR - 1) for part in cell]
    return (x * 2 * FAR + y) * 2 * FAR + z
