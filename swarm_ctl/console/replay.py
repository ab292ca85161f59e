"""A run folder played back: the same picture as live, at any mission time."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.console.picture import Cell, Grid, Line, Picture, Victim
from swarm_ctl.console.words import QUIET, in_words
from swarm_ctl.errors import SwarmError
from swarm_ctl.model import Vec3
from swarm_ctl.record.journal import read_journal
from swarm_ctl.record.truth import Truth, read_truth

FLOATS = NDArray[np.float64]
MOVES_M = 0.05
"""A vehicle that moved less between two samples keeps its heading."""


class Track(NamedTuple):
    """Where one vehicle was, in the frame of the picture."""

    times_s: FLOATS
    """Mission time of each sample, rising."""
    places_ned_m: FLOATS
    """Samples by 3."""
    yaws_rad: FLOATS
    """The way it went, for want of its heading."""

    @classmethod
    def of(cls, times_s: FLOATS, places_ned_m: FLOATS) -> Self:
        """Take samples, and find the way from each to the next."""
        steps = np.diff(places_ned_m[:, :2], axis=0, append=places_ned_m[-1:, :2])
        yaws = np.arctan2(steps[:, 1], steps[:, 0])
        moved = np.hypot(steps[:, 0], steps[:, 1]) > MOVES_M
        last = np.maximum.accumulate(np.where(moved, np.arange(len(steps)), 0))
        return cls(times_s, places_ned_m, yaws[last])

    def at(self, time_s: float) -> tuple[Vec3, float]:
        """Give place and heading at a mission time, between the samples."""
        place = (float(np.interp(time_s, self.times_s, axis)) for axis in self.places_ned_m.T)
        index = max(0, int(np.searchsorted(self.times_s, time_s, side="right")) - 1)
        return Vec3(*place), float(self.yaws_rad[index])


@dataclass(frozen=True, slots=True)
class Replay:
    """What a run folder tells, in the order of mission time."""

    head: Mapping[str, Any]
    grid: Grid
    duration_s: float
    sysids: Sequence[int]
    tracks: Mapping[int, Track]
    origins: Mapping[int, Vec3]
    """Where each vehicle's own frame begins in the frame of the picture."""
    events: Sequence[Mapping[str, Any]]
    event_times_s: FLOATS
    cells: Sequence[Cell]
    """Places in the order in which they were seen."""
    cell_times_s: FLOATS

    @classmethod
    def read(cls, run: Path) -> Self:
        """Read a run folder; SwarmError when it is none."""
        mission, events, truth = _mission(run), _events(run), read_truth(run)
        tracks = _true_tracks(truth) or _own_tracks(run)
        times_s = np.array([event["time_s"] for event in events], dtype=np.float64)
        ends_s = [track.times_s[-1] for track in tracks.values()]
        duration_s = float(max([1.0, *times_s[-1:], *ends_s]))
        sysids = sorted({*tracks, *(event["sysid"] for event in events)})
        grid, cells, cell_times_s = _seen(truth)
        head = _head(run, mission, truth, duration_s, events)
        origins = {
            sysid: Vec3(*map(float, place))
            for sysid, place in zip(
                truth.arrays.get("sysids", ()), truth.arrays.get("starts_ned_m", ()), strict=False
            )
        }
        return cls(
            head, grid, duration_s, sysids, tracks, origins, events, times_s, cells, cell_times_s
        )

    def at(self, time_s: float) -> Picture:
        """Draw how things were at a mission time."""
        picture = Picture(self.head, self.grid)
        picture.time_s = -math.inf
        for sysid in self.sysids:
            picture.vehicle(sysid)
        self.advance(picture, time_s)
        return picture

    def advance(self, picture: Picture, time_s: float) -> None:
        """Add to a picture what happened since its time."""
        since_s, picture.time_s = picture.time_s, time_s
        for event in self.events[_between(self.event_times_s, since_s, time_s)]:
            self._happen(picture, event)
        picture.see(self.cells[_between(self.cell_times_s, since_s, time_s)])
        for sysid, track in self.tracks.items():
            vehicle = picture.vehicle(sysid)
            for place in track.places_ned_m[_between(track.times_s, since_s, time_s)]:
                vehicle.move(Vec3(*map(float, place)), 0.0)
            vehicle.place_ned_m, vehicle.yaw_rad = track.at(time_s)

    def _happen(self, picture: Picture, event: Mapping[str, Any]) -> None:
        name, data, sysid = event["event"], event.get("data", {}), event["sysid"]
        vehicle = picture.vehicle(sysid)
        match name:
            case "PhaseChanged":
                vehicle.phase = data["after"]
            case "ContactsChanged":
                peers = {*vehicle.peers, *data["gained"]} - {*data["lost"]}
                vehicle.peers = tuple(sorted(peers))
            case "VictimFound":
                place = _sum(self.origins.get(sysid), data.get("position_ned_m"))
                picture.find(Victim(data["victim"], place, sysid, event["time_s"]))
        if name not in QUIET:
            vehicle.note = in_words(name, data)
            picture.tell(Line(event["time_s"], sysid, name, vehicle.note))


def _between(times_s: FLOATS, since_s: float, until_s: float) -> slice:
    """Give what came after a time, up to another one and with it."""
    first, last = np.searchsorted(times_s, (since_s, until_s), side="right")
    return slice(int(first), int(last))


def _sum(origin: Vec3 | None, offset: Sequence[float] | None) -> Vec3 | None:
    if origin is None or offset is None:
        return None
    return Vec3(*(a + b for a, b in zip(origin, offset, strict=True)))


def _mission(run: Path) -> dict[str, Any]:
    """Read `mission.json`, which every run folder has."""
    try:
        value = json.loads((run / "mission.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise SwarmError(f"{run}: is no run folder: it has no mission.json") from None
    except (OSError, ValueError) as error:
        raise SwarmError(f"{run}/mission.json: cannot be read: {error}") from None
    return dict(value)


def _events(run: Path) -> list[dict[str, Any]]:
    """Read the facts about vehicles."""
    try:
        entries = read_journal(run / "events.jsonl")
    except OSError as error:
        raise SwarmError(f"{run}/events.jsonl: cannot be read: {error.strerror}") from None
    told = [entry for entry in entries if "sysid" in entry]
    return sorted(told, key=lambda entry: float(entry["time_s"]))


def _true_tracks(truth: Truth) -> dict[int, Track]:
    """Take where the referee saw everybody."""
    if "track_ned_m" not in truth.arrays:
        return {}
    times_s, places = truth.arrays["track_time_s"], truth.arrays["track_ned_m"].astype(np.float64)
    sysids = truth.arrays.get("sysids", np.arange(1, places.shape[1] + 1))
    if not len(times_s):
        return {}
    return {int(sysid): Track.of(times_s, places[:, i]) for i, sysid in enumerate(sysids)}


def _own_tracks(run: Path) -> dict[int, Track]:
    """Take where each vehicle believes it flew, from its own start."""
    try:
        vehicles = json.loads((run / "paths.json").read_text(encoding="utf-8"))["vehicles"]
    except (OSError, ValueError, KeyError):
        return {}
    tracks = {}
    for vehicle in vehicles:
        flown = [point for point in vehicle["waypoints"] if point["kind"] == "flown"]
        if flown:
            times_s = np.array([point["time_s"] for point in flown])
            places = np.array([point["position_m"] for point in flown])
            tracks[vehicle["sysid"]] = Track.of(times_s, places)
    return tracks


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


def _head(
    run: Path,
    mission: Mapping[str, Any],
    truth: Truth,
    duration_s: float,
    events: Sequence[Mapping[str, Any]],
) -> dict[str, Any]:
    """Tell what stays the same all through the replay, the whole curve included."""
    flown = mission.get("mission", {})
    times_s = truth.arrays.get("coverage_time_s", np.empty(0))
    shares = truth.arrays.get("coverage_fraction", np.empty(0))
    return {
        "mode": "replay",
        "run": run.resolve().name,
        "mission": flown.get("name", run.name),
        "planner": flown.get("planner", {}).get("kind", ""),
        "seed": mission.get("seed"),
        "duration_s": duration_s,
        "victims_total": truth.numbers.get("victims_total"),
        "world": truth.world or None,
        "unit": "%",
        "curve": [
            (round(float(time), 1), round(100.0 * float(share), 2))
            for time, share in zip(times_s, shares, strict=False)
        ],
        "found_s": [e["time_s"] for e in events if e["event"] == "VictimFound"],
    }
