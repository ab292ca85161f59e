"""Paths as lists of waypoints: position, connectivity, exploration status (paper, Eq. 8)."""

from __future__ import annotations

import json
import math
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Self

from swarm_ctl.model import ZERO, Vec3

FRAME = "local NED, origin at its own start"
WAYPOINT_S = 1.0
"""Mission time between two waypoints."""
REACHED_M = 0.5
"""A target counts as visited when the vehicle passes this close."""
ROUNDED_M = 1e-6
"""What is lost at most in the sum of two distances."""


class PathRecorder:
    """One vehicle's path: where it flew, and the local bests it chose to fly to.

    A flown waypoint's `next` is the index of the flown waypoint after it. A target is
    "unexplored" and leads nowhere until the vehicle passes it within 0.5 m; then it is "visited"
    and its `next` is the flown waypoint that came by.
    """

    def __init__(self, sysid: int) -> None:
        self.sysid = sysid
        self.length_m = 0.0
        """What was flown, straight from each flown waypoint to the next."""
        self.until_s = -math.inf
        """Mission time of the last waypoint flown."""
        self._waypoints: list[dict[str, Any] | str] = []
        """Those that were written, as text: it takes less, and long runs are written often."""
        self._stale: set[int] = set()
        """The others: they are new, or have changed since."""
        self._last: int | None = None
        """The last waypoint flown, and where it lies, as rounded."""
        self._last_m = ZERO
        self._open = array("q")
        """Targets not yet visited, and where each lies, three numbers each: many never are."""
        self._open_m = array("d")

    @classmethod
    def decoded(cls, encoded: Mapping[str, Any]) -> Self:
        """Go on with a path that `encoded` gave, or `paths.json` holds."""
        path = cls(encoded["sysid"])
        path._waypoints = [json.dumps(waypoint) for waypoint in encoded["waypoints"]]
        for index, waypoint in enumerate(encoded["waypoints"]):
            if waypoint["kind"] == "flown":
                place = Vec3(*waypoint["position_m"])
                path.length_m += 0.0 if path._last is None else math.dist(path._last_m, place)
                path._arrive(index, waypoint)
            elif waypoint["status"] == "unexplored":
                path._open.append(index)
                path._open_m.extend(waypoint["position_m"])
        return path

    def visited(self, time_s: float, position: Vec3, peers: Iterable[int]) -> None:
        """Add where the vehicle is, and the sysids it hears there; once a second is enough."""
        index = self._add(time_s, position, "flown", "visited", peers)
        before = position
        if self._last is not None:
            before = self._last_m
            self.length_m += math.dist(before, position)
            self._change(self._last, next=index)
        if self._open:
            self._visit(_passing(before, position, self._open_m), index)
        self._arrive(index, self._waypoint(index))

    def target(self, time_s: float, position: Vec3) -> None:
        """Add a new local best the planner chose."""
        self._open.append(self._add(time_s, position, "target", "unexplored", ()))
        self._open_m.extend(position)

    def go_on(self, pages: Iterable[Mapping[str, Any]]) -> None:
        """Add what the pages of a controller's journal tell of the time after the last waypoint."""
        since_s = self.until_s
        state: dict[str, Any] = {}
        for page in pages:
            state |= page
            if page["time_s"] <= since_s or state.get("explored_from_s") is None:
                continue
            if page["time_s"] >= self.until_s + WAYPOINT_S - 1e-3:
                self.visited(page["time_s"], Vec3(*state["position_ned_m"]), state["peers"])
            if page.get("target_ned_m"):
                self.target(page["time_s"], Vec3(*page["target_ned_m"]))

    def encoded(self) -> dict[str, Any]:
        """Give sysid, frame and the ordered waypoints, ready for JSON."""
        return {
            "sysid": self.sysid,
            "frame": FRAME,
            "waypoints": [self._waypoint(index) for index in range(len(self._waypoints))],
        }

    def text(self) -> str:
        """Give `encoded` as JSON text, a line per waypoint."""
        for index in self._stale:
            self._waypoints[index] = json.dumps(self._waypoints[index])
        self._stale.clear()
        lines = ",\n".join(map(str, self._waypoints))
        head = f'"sysid": {self.sysid}, "frame": {json.dumps(FRAME)}'
        return f'{{{head}, "waypoints": [\n{lines}\n]}}'

    def _add(
        self,
        time_s: float,
        position: Vec3,
        kind: Literal["flown", "target"],
        status: Literal["visited", "unexplored"],
        peers: Iterable[int],
    ) -> int:
        self._stale.add(len(self._waypoints))
        self._waypoints.append(
            {
                "time_s": round(float(time_s), 3),
                "position_m": [round(float(metres), 3) for metres in position],
                "next": None,
                "peers": [int(peer) for peer in peers],
                "status": status,
                "kind": kind,
            }
        )
        return len(self._waypoints) - 1

    def _visit(self, rows: list[int], index: int) -> None:
        for row in reversed(rows):
            self._change(self._open.pop(row), next=index, status="visited")
            del self._open_m[3 * row : 3 * row + 3]

    def _arrive(self, index: int, waypoint: Mapping[str, Any]) -> None:
        self._last, self._last_m = index, Vec3(*waypoint["position_m"])
        self.until_s = float(waypoint["time_s"])

    def _change(self, index: int, **values: object) -> None:
        self._waypoints[index] = self._waypoint(index) | values
        self._stale.add(index)

    def _waypoint(self, index: int) -> dict[str, Any]:
        """Give a waypoint, for nobody to change."""
        waypoint = self._waypoints[index]
        return waypoint if isinstance(waypoint, dict) else dict(json.loads(waypoint))


def write_paths(path: Path, recorders: Sequence[PathRecorder]) -> Iterator[None]:
    """Write `paths.json`, a vehicle for each time that something is asked for.

    A reader sees the old file until the new one is whole. OSError when it cannot be written.
    """
    draft = path.with_suffix(".tmp")
    with draft.open("w", encoding="utf-8") as file:
        file.write('{"vehicles": [')
        for number, recorder in enumerate(recorders):
            file.write((",\n" if number else "\n") + recorder.text())
            yield
        file.write("\n]}\n")
    draft.replace(path)


def _passing(start: Vec3, end: Vec3, targets: array[float]) -> list[int]:
    """Give the rows of targets within REACHED_M of the straight line from start to end."""
    reach_m = math.dist(start, end) + REACHED_M + ROUNDED_M
    (x, y, _), numbers = end, iter(targets)
    return [
        row
        for row, (tx, ty, tz) in enumerate(zip(numbers, numbers, numbers, strict=True))
        if abs(tx - x) <= reach_m  # as nearly none
        and abs(ty - y) <= reach_m
        and _miss_m(start, end, Vec3(tx, ty, tz)) <= REACHED_M
    ]


def _miss_m(start: Vec3, end: Vec3, place: Vec3) -> float:
    """Measure how far a place is from the straight line from start to end, m."""
    way = [b - a for a, b in zip(start, end, strict=True)]
    to = [b - a for a, b in zip(start, place, strict=True)]
    length2 = max(sum(part * part for part in way), 1e-12)
    along = sum(a * b for a, b in zip(to, way, strict=True)) / length2
    return math.dist(to, [min(max(along, 0.0), 1.0) * part for part in way])
