"""A run folder played back: the same picture as live, at any mission time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.bus.news import news
from swarm_ctl.console.picture import UNLOGGED, Cell, Grid, Line, Picture, Victim
from swarm_ctl.model import Event, Vec3
from swarm_ctl.record.reader import Battery, Run, Track
from swarm_ctl.record.truth import Truth

FLOATS = NDArray[np.float64]
MOVES_M = 0.05
"""A vehicle that moved less between two samples keeps its heading."""
OWN_STARTS = (
    "Nobody knows where one vehicle started from another: each is drawn from its own start."
)


class Flown(NamedTuple):
    """What a run tells of one vehicle over time."""

    track: Track
    yaws_rad: FLOATS
    """At each place of the track the way it went on, for want of its heading."""
    battery: Battery

    @classmethod
    def read(cls, run: Run, track: Track) -> Self:
        """Read what the folder has beside a track."""
        ne_m = track.ned_m[:, :2]
        steps = np.diff(ne_m, axis=0, append=ne_m[-1:])
        moved = np.hypot(steps[:, 0], steps[:, 1]) > MOVES_M
        last = np.maximum.accumulate(np.where(moved, np.arange(len(steps)), 0))
        yaws = np.arctan2(steps[:, 1], steps[:, 0])
        return cls(track, yaws[last], run.battery(track.sysid))

    def at(self, time_s: float) -> tuple[Vec3, float]:
        """Give place and heading at a mission time, between the samples."""
        place = (float(np.interp(time_s, self.track.time_s, axis)) for axis in self.track.ned_m.T)
        return Vec3(*place), float(self.yaws_rad[max(0, _index(self.track.time_s, time_s))])

    def left_fraction(self, time_s: float) -> float | None:
        """Give what was left in the battery; None before it was told."""
        index = _index(self.battery.time_s, time_s)
        left = self.battery.left_fraction[index] if index >= 0 else math.nan
        return None if math.isnan(left) else float(left)


@dataclass(frozen=True, slots=True)
class Replay:
    """What a run folder tells, in the order of mission time."""

    run: Run
    head: Mapping[str, Any]
    grid: Grid
    duration_s: float
    flown: Mapping[int, Flown]
    events: Sequence[Mapping[str, Any]]
    """Those about a vehicle."""
    event_times_s: FLOATS
    cells: Sequence[Cell]
    """Places in the order in which they were seen."""
    cell_times_s: FLOATS

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read a run folder; SwarmError when it is none."""
        run = Run.read(folder)
        told = (entry for entry in run.entries if "sysid" in entry)
        events = sorted(told, key=lambda entry: float(entry["time_s"]))
        times_s = np.array([event["time_s"] for event in events], dtype=np.float64)
        tracks = [track for track in run.tracks if len(track.time_s)]
        ends_s = [float(track.time_s[-1]) for track in tracks]
        duration_s = max([1.0, *times_s[-1:].tolist(), *ends_s])
        flown = {track.sysid: Flown.read(run, track) for track in tracks}
        head = _head(run, duration_s)
        grid, cells, cell_times_s = _seen(run.truth)
        return cls(run, head, grid, duration_s, flown, events, times_s, cells, cell_times_s)

    def at(self, time_s: float) -> Picture:
        """Draw how things were at a mission time."""
        picture = Picture(self.head, self.grid)
        picture.time_s = -math.inf
        for sysid in self.run.sysids:
            picture.vehicle(sysid)
        self.advance(picture, time_s)
        return picture

    def advance(self, picture: Picture, time_s: float) -> None:
        """Add to a picture what happened since its time."""
        since_s, picture.time_s = picture.time_s, time_s
        for event in self.events[_between(self.event_times_s, since_s, time_s)]:
            self._happen(picture, event)
        picture.see(self.cells[_between(self.cell_times_s, since_s, time_s)])
        for sysid, flown in self.flown.items():
            vehicle, track = picture.vehicle(sysid), flown.track
            for place in track.ned_m[_between(track.time_s, since_s, time_s)].tolist():
                vehicle.move(Vec3(*place), 0.0)
            vehicle.place_ned_m, vehicle.yaw_rad = flown.at(time_s)
            vehicle.battery_fraction = flown.left_fraction(time_s)

    def _happen(self, picture: Picture, event: Mapping[str, Any]) -> None:
        name, data, sysid = event["event"], event.get("data", {}), event["sysid"]
        vehicle = picture.vehicle(sysid)
        match name:
            case "PhaseChanged":
                vehicle.phase = data["after"]
            case "ContactsChanged":
                peers = {*vehicle.peers, *data["gained"]} - {*data["lost"]}
                vehicle.peers = tuple(sorted(peers))
            case "VictimFound" | "VictimHeard":
                place = self.run.in_launch_frame(sysid, Vec3(*data["position_ned_m"]))
                finder = data.get("finder", sysid)
                picture.find(Victim(data["victim"], place, finder, event["time_s"]))
        told = news(Event(event["time_s"], sysid, name, data), run="", number=0)
        if told is not None and name not in UNLOGGED:
            vehicle.note = told.words
            picture.tell(Line(told.time_s, sysid, name, told.words))


def _index(times_s: FLOATS, time_s: float) -> int:
    """Give the last sample that is not later than a time; -1 when there is none."""
    return int(np.searchsorted(times_s, time_s, side="right")) - 1


def _between(times_s: FLOATS, since_s: float, until_s: float) -> slice:
    """Give what came after a time, up to another one and with it."""
    return slice(_index(times_s, since_s) + 1, _index(times_s, until_s) + 1)


def _seen(truth: Truth) -> tuple[Grid, list[Cell], FLOATS]:
    """Take when each place was first seen."""
    if "seen_s" not in truth.arrays:
        return Grid(1.0), [], np.empty(0)
    seen_s = truth.arrays["seen_s"].astype(np.float64)
    known = np.isfinite(seen_s) & truth.arrays["free"].astype(bool)
    cells, times_s = np.argwhere(known), seen_s[known]
    order = np.argsort(times_s, kind="stable")
    north_m, east_m = truth.arrays["origin_ne_m"]
    grid = Grid(float(truth.arrays["cell_m"]), float(north_m), float(east_m))
    return grid, [tuple(cell) for cell in cells[order].tolist()], times_s[order]


def _head(run: Run, duration_s: float) -> dict[str, Any]:
    """Tell what stays the same all through the replay, the whole curve included."""
    arrays = run.truth.arrays
    curve = zip(
        arrays.get("coverage_time_s", np.empty(0)).tolist(),
        (100.0 * arrays.get("coverage_fraction", np.empty(0))).tolist(),
        strict=False,
    )
    return {
        "mode": "replay",
        "run": run.path.resolve().name,
        "mission": run.name,
        "duration_s": duration_s,
        "victims_total": run.truth.numbers.get("victims_total"),
        "world": run.truth.world or None,
        "unit": "%",
        "curve": [(round(time_s, 1), round(percent, 2)) for time_s, percent in curve],
        "found_s": [event["time_s"] for event in run.events("VictimFound")],
        "note": "" if run.starts_ned_m else OWN_STARTS,
    }
