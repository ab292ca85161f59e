"""What is known of a mission, and the frames by which a browser keeps up with it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from swarm_ctl.model import Vec3

Frame = dict[str, Any]
"""JSON for the browser: what has changed, and what is small enough to be told every time."""
Cell = tuple[int, ...]
"""A place that was seen: index north, east and, in three dimensions, down."""

TRAIL_POINTS = 80
"""Places of a vehicle that are kept for its trail: 40 s at two a second."""
LOG_LINES = 1000
"""Lines of the log that a browser which comes later still gets."""
UNLOGGED = frozenset({"VictimHeard"})
"""Events that all vehicles tell of one fact: drawn, not written."""
MOST_CELLS = 500_000
"""Seen places that are kept; a page that showed more would stutter."""


class Line(NamedTuple):
    """A line of the event log."""

    time_s: float
    """Mission time."""
    sysid: int
    """0 is nobody's: the mission's, or the console's own."""
    kind: str
    """The event's name, as `PhaseChanged`."""
    words: str


class Victim(NamedTuple):
    """Somebody who was found."""

    number: int
    place_ned_m: Vec3 | None
    """In the frame of the picture; None when nobody knows where the finder is."""
    finder: int
    """sysid of who found it."""
    time_s: float
    """Mission time at which it was first told."""


class Grid(NamedTuple):
    """How the indices of seen places become metres."""

    cell_m: float
    north_m: float = 0.0
    """The southern edge of cells with index 0."""
    east_m: float = 0.0
    """The western edge of cells with index 0."""
    layers: int = 1
    """Cells above each other; a place is drawn full when all of them were seen."""


@dataclass(slots=True)
class Vehicle:
    """One vehicle as it was last heard of."""

    sysid: int
    phase: str = "connecting"
    place_ned_m: Vec3 | None = None
    """In the frame of the picture; None when nobody knows where its own frame begins."""
    yaw_rad: float = 0.0
    battery_fraction: float | None = None
    silent_s: float | None = None
    """Since its autopilot was last heard by its controller; None when nobody tells."""
    peers: tuple[int, ...] = ()
    """sysids it hears."""
    note: str = ""
    """Its last event, in a few words."""
    status: str = "online"
    """`online`, `offline` (its controller is gone) or `done`."""
    is_waiting: bool = False
    """It stands ready until it is told to start."""
    trail: deque[Vec3] = field(default_factory=lambda: deque(maxlen=TRAIL_POINTS))
    points: int = 0
    """Places that were ever added to the trail."""

    def move(self, place_ned_m: Vec3, yaw_rad: float) -> None:
        """Take a new place, and draw the trail to it."""
        self.place_ned_m, self.yaw_rad = place_ned_m, yaw_rad
        self.trail.append(place_ned_m)
        self.points += 1

    def row(self, points: int) -> list[Any]:
        """Tell all but the trail that the browser has already, of which it knows so many points."""
        fresh = min(self.points - points, len(self.trail))
        return [
            self.sysid,
            self.phase,
            _rounded(self.place_ned_m),
            round(self.yaw_rad, 2),
            None if self.battery_fraction is None else round(100 * self.battery_fraction),
            None if self.silent_s is None else round(min(self.silent_s, 999.0), 1),
            "waiting" if self.is_waiting and self.status == "online" else self.status,
            self.peers,
            self.note,
            [_rounded(self.trail[i]) for i in range(len(self.trail) - fresh, len(self.trail))],
        ]


@dataclass(slots=True)
class Cursor:
    """How far one browser is; what it lacks is the next frame."""

    picture: Picture | None = None
    head: Mapping[str, Any] | None = None
    cells: int = 0
    lines: int = 0
    curve: int = 0
    points: dict[int, int] = field(default_factory=dict)
    """Of each vehicle's trail."""


class Picture:
    """A mission as far as it is known; lists only grow, so that a browser needs what is new."""

    def __init__(self, head: Mapping[str, Any], grid: Grid) -> None:
        """Begin with what does not change: mission, world, how places were cut into cells."""
        self.head = head
        """Mission, seed, planner, world; replace it as a whole when more becomes known."""
        self.grid = grid
        self.time_s = 0.0
        """Mission time."""
        self.vehicles: dict[int, Vehicle] = {}
        self.victims: dict[int, Victim] = {}
        self.curve: list[tuple[float, float]] = []
        """Mission time, and how much is seen: a share, or square or cubic metres."""
        self._cells: list[Cell] = []
        self._seen: set[Cell] = set()
        self._lines: deque[Line] = deque(maxlen=LOG_LINES)
        self._told = 0

    def vehicle(self, sysid: int) -> Vehicle:
        """Give a vehicle; a new one when it was never heard of."""
        return self.vehicles.setdefault(sysid, Vehicle(sysid))

    def see(self, cells: Iterable[Cell]) -> None:
        """Add places that were seen; those known already are left out."""
        for cell in cells:
            if cell not in self._seen and len(self._seen) < MOST_CELLS:
                self._seen.add(cell)
                self._cells.append(cell)

    @property
    def seen(self) -> int:
        """How many places were seen."""
        return len(self._seen)

    def tell(self, line: Line) -> None:
        """Add a line to the log."""
        self._lines.append(line)
        self._told += 1

    def find(self, victim: Victim) -> None:
        """Take a victim; who told first stands, but a place that was missing is taken later."""
        known = self.victims.get(victim.number)
        if known is None:
            self.victims[victim.number] = victim
        elif known.place_ned_m is None:
            self.victims[victim.number] = known._replace(place_ned_m=victim.place_ned_m)

    def frame(self, cursor: Cursor) -> Frame:
        """Give what a browser lacks, and take note that it has it now."""
        frame: Frame = {"time": round(self.time_s, 1)}
        if cursor.picture is not self:
            frame["reset"] = True
            cursor.picture, cursor.head, cursor.points = self, None, {}
            cursor.cells = cursor.curve = 0
            cursor.lines = self._told - len(self._lines)
        if cursor.head is not self.head:
            frame["head"], cursor.head = {**self.head, "grid": self.grid._asdict()}, self.head
        frame["vehicles"] = [
            self.vehicles[sysid].row(cursor.points.get(sysid, 0)) for sysid in sorted(self.vehicles)
        ]
        cursor.points = {one.sysid: one.points for one in self.vehicles.values()}
        frame["victims"] = [
            [one.number, _rounded(one.place_ned_m), one.finder, round(one.time_s, 1)]
            for one in self.victims.values()
        ]
        frame["cells"] = [index for cell in self._cells[cursor.cells :] for index in cell[:2]]
        frame["log"] = self._lines_from(cursor.lines)
        frame["curve"] = self.curve[cursor.curve :]
        cursor.cells, cursor.lines, cursor.curve = len(self._cells), self._told, len(self.curve)
        return frame

    def _lines_from(self, number: int) -> list[list[Any]]:
        fresh = min(self._told - number, len(self._lines))
        return [list(self._lines[i]) for i in range(len(self._lines) - fresh, len(self._lines))]


def _rounded(place: Vec3 | None) -> list[float] | None:
    return None if place is None else [round(metres, 2) for metres in place]
