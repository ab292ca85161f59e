"""The way that a vehicle has flown, written into its own log as straight lines."""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarm_ctl.explore.memory import three
from swarm_ctl.explore.pieces import LINE, START
from swarm_ctl.explore.trails import Trails

DEVIATION_M = 0.1
"""How far a trail may stray from the straight line between two points of its log."""
SEGMENT_M = 3.0
"""Longest straight line of a log: what is not in the log yet cannot be told."""


class Logbook:
    """Append to `trails` where the way bends or gets long; points are metres in the own frame.

    Lines over ground that the vehicle has swept before are left out: the log tells of it already,
    and so ends with the hall, however long the flight.
    """

    def __init__(self, trails: Trails) -> None:
        self._trails = trails
        self._vertex: list[float] = []
        self._is_told = False
        """Whether the log's trail leads to the vertex."""
        self._since: list[list[float]] = []
        self.is_new = False
        """Whether the way since the vertex leads over ground that the log does not tell of."""

    def begin(self, place_m: list[float]) -> None:
        """Begin a new way here."""
        self._append(START, place_m)

    def resume(self, vertex_m: list[float], place_m: list[float]) -> None:
        """Go on with a way over new ground whose last point in the log is `vertex_m`."""
        self._vertex, self._since = vertex_m, [place_m]
        self._is_told = self.is_new = True

    def mark(self, place_m: list[float], *, is_new: bool) -> None:
        """Go on to a place; end a line at the last one when the way bends or gets long behind it.

        `is_new` tells whether the log tells nothing yet of some ground on the way from there.
        """
        if self._since and (
            math.dist(self._vertex, place_m) > SEGMENT_M
            or _strays(self._since, self._vertex, place_m)
        ):
            self._end_line()
        if is_new and not self._is_told:
            self._trails.append(START, self._vertex)
            self._is_told = True
        self._since.append(place_m)
        self.is_new |= is_new

    def write_out(self, longer_than_m: float) -> None:
        """Append the last place if the log ends that far behind it, so that it can be told."""
        if self.is_new and math.dist(self._vertex, self._since[-1]) > longer_than_m:
            self._end_line()

    def _end_line(self) -> None:
        """Go on from the last place, in the log as well if what leads there is new."""
        if self.is_new:
            self._append(LINE, self._since[-1])
        else:
            self._vertex, self._since, self._is_told = self._since[-1], [], False

    def _append(self, kind: int, point_m: list[float]) -> None:
        self._trails.append(kind, point_m)
        self._vertex, self._since = point_m, []
        self._is_told, self.is_new = True, False


def _strays(points: Sequence[list[float]], start: list[float], end: list[float]) -> bool:
    """Tell whether a point is farther than DEVIATION_M from a segment."""
    (x0, y0, z0), (x1, y1, z1), length2 = three(start), three(end), math.dist(start, end) ** 2
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    for point in points:
        (x, y, z), t = three(point), 0.0
        if length2 > 0.0:
            along = dx * (x - x0) + dy * (y - y0) + dz * (z - z0)
            t = min(1.0, max(0.0, along / length2))
        foot = x0 + t * dx, y0 + t * dy, z0 + t * dz
        if math.dist((x, y, z), foot) > DEVIATION_M:
            return True
    return False
