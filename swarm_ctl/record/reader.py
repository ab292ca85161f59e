"""A run folder read back, as much of it as there is: for reports and exports."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.agent.beacon import BEACON_TYPE, decode
from swarm_ctl.errors import SwarmError
from swarm_ctl.frames import Geodetic, enu_to_ned, geodetic_to_ned
from swarm_ctl.model import Vec3
from swarm_ctl.record.journal import read_journal
from swarm_ctl.record.spread import Contacts, read_contacts
from swarm_ctl.record.tlog import EPOCH_S, find_frames
from swarm_ctl.record.truth import Truth, read_truth

FLOATS = NDArray[np.float64]


@contextlib.contextmanager
def telling_what_is_damaged(path: Path) -> Iterator[None]:
    """Turn what a damaged record leads to, whatever is asked of it, into one SwarmError."""
    try:
        yield
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        said = f"{type(error).__name__}: {error}"
        raise SwarmError(f"{path}: its record is damaged or of another version ({said})") from error


@dataclass(frozen=True, slots=True)
class Track:
    """Where one vehicle flew."""

    sysid: int
    time_s: FLOATS
    """(t,), mission time, rising."""
    ned_m: FLOATS
    """(t, 3), in the launch frame where the run knows one, else from the vehicle's own start."""


@dataclass(frozen=True, slots=True)
class Battery:
    """What one autopilot told of its battery (SYS_STATUS)."""

    time_s: FLOATS
    left_fraction: FLOATS
    power_w: FLOATS
    """Voltage times current; NaN where the autopilot measures no current."""


@dataclass(frozen=True)
class Run:
    """One flown run; what a killed run did not come to write is empty."""

    path: Path
    started: dict[str, Any]
    """`mission.json`."""
    summary: dict[str, Any]
    """`summary.json`."""
    entries: list[dict[str, Any]]
    """`events.jsonl`."""
    truth: Truth
    paths: list[dict[str, Any]] = field(default_factory=list)
    """The vehicles of `paths.json`."""
    given_origin: Geodetic | None = None
    """Where somebody says that the launch frame begins."""

    @classmethod
    def read(cls, path: Path, summary: Mapping[str, Any] | None = None) -> Self:
        """Read a run folder; a summary that is not written yet can be given.

        Raises SwarmError when the folder is none of a run.
        """
        started = _json(path / "mission.json")
        if not isinstance(started.get("mission"), dict):
            raise SwarmError(f"{path}: is no run folder: it has no mission.json of a run")
        return cls(
            path,
            started,
            dict(summary or _json(path / "summary.json")),
            read_journal(path / "events.jsonl") if (path / "events.jsonl").exists() else [],
            read_truth(path),
            list(_json(path / "paths.json").get("vehicles", ())),
        )

    _accuracies: dict[int, FLOATS] = field(default_factory=dict, repr=False)

    @property
    def mission(self) -> dict[str, Any]:
        """Give the resolved mission."""
        mission: dict[str, Any] = self.started["mission"]
        return mission

    @property
    def name(self) -> str:
        """Give the mission's name."""
        return str(self.mission.get("name", self.path.name))

    @property
    def is_real(self) -> bool:
        """Whether real vehicles flew, which nobody saw from outside."""
        return self.started.get("mode") == "fly"

    @property
    def epoch_s(self) -> float:
        """Give the UTC time of mission time 0, as the telemetry logs count it."""
        if self.started.get("mode") == "virtual":
            return EPOCH_S
        return self.started_utc.timestamp()

    @property
    def started_utc(self) -> datetime:
        """Tell when the run was begun, by the clock on the wall."""
        return datetime.fromisoformat(self.started["started_utc"]).astimezone(UTC)

    @cached_property
    def sysids(self) -> list[int]:
        """Name everybody of whom there is a word."""
        told = {entry["sysid"] for entry in self.entries if "sysid" in entry}
        return sorted(told | {path["sysid"] for path in self.paths} | set(self._truth_starts))

    @cached_property
    def starts_ned_m(self) -> dict[int, Vec3]:
        """Tell where each vehicle's own frame begins in the launch frame; empty: nobody knows.

        The launch frame is the world's against mock vehicles, else the mission's survey, else
        begins at the first vehicle that satellites have placed; one alone has its own.
        """
        if self._truth_starts:
            return self._truth_starts
        if self._frame.get("shared") == "surveyed":
            surveyed = self._frame["starts_m"].items()
            return {int(sysid): enu_to_ned(Vec3(*start)) for sysid, start in surveyed}
        if told := self._told_starts:
            first = told[min(told)]
            return {sysid: geodetic_to_ned(start, first) for sysid, start in told.items()}
        return {self.sysids[0]: Vec3(0.0, 0.0, 0.0)} if len(self.sysids) == 1 else {}

    @cached_property
    def origin(self) -> Geodetic | None:
        """Tell where the launch frame begins on the globe; None: nobody knows.

        What was given comes first, then the mock's world, the survey, the satellites.
        """
        if self.given_origin is not None:
            return self.given_origin
        if world := self.truth.world.get("origin"):
            return Geodetic(world["latitude_deg"], world["longitude_deg"], world["amsl_m"])
        if surveyed := self._frame.get("origin"):
            return Geodetic(*surveyed)
        return self._told_starts[min(self._told_starts)] if self._told_starts else None

    @cached_property
    def tracks(self) -> list[Track]:
        """Tell where everybody flew: as the referee saw it, else as the vehicles did."""
        arrays = self.truth.arrays
        if {"track_time_s", "track_ned_m", "sysids"} <= arrays.keys():
            seen = zip(arrays["sysids"].tolist(), _by_vehicle(arrays["track_ned_m"]), strict=True)
            return [_track(sysid, arrays["track_time_s"], ned_m) for sysid, ned_m in seen]
        return [self._own_track(path) for path in self.paths]

    @cached_property
    def contacts(self) -> Contacts | None:
        """Tell who could talk to whom; None when nobody knows."""
        return read_contacts(self.path)

    def events(self, *names: str) -> list[dict[str, Any]]:
        """Give the events of these names, in their order."""
        return [entry for entry in self.entries if entry.get("event") in names]

    def battery(self, sysid: int) -> Battery:
        """Read from a vehicle's telemetry log how its battery went down."""
        frames = list(find_frames(self.tlog(sysid), "SYS_STATUS", sysid))
        rows = [(time_s - self.epoch_s, *_battery(status)) for time_s, status in frames]
        return Battery(*np.array(rows, dtype=float).reshape(-1, 3).T)

    def accuracy_m(self, sysid: int, time_s: float) -> float | None:
        """Give how exactly an autopilot knew its place by its own words (ESTIMATOR_STATUS).

        Level, one standard deviation, relative to where its estimator began; None: it told not.
        """
        if sysid not in self._accuracies:
            frames = find_frames(self.tlog(sysid), "ESTIMATOR_STATUS", sysid)
            rows = [(at_s - self.epoch_s, status.pos_horiz_accuracy) for at_s, status in frames]
            self._accuracies[sysid] = np.array(rows, dtype=float).reshape(-1, 2)
        told = self._accuracies[sysid]
        before = int(np.searchsorted(told[:, 0], time_s, side="right")) - 1
        accuracy_m = float(told[before, 1]) if before >= 0 else math.nan
        return accuracy_m if math.isfinite(accuracy_m) else None

    def tlog(self, sysid: int) -> Path:
        """Name a vehicle's telemetry log; of one that a shard flew, in the shard's folder."""
        log = Path("tlogs", f"vehicle-{sysid:03d}.tlog")
        return next(self.path.glob(f"*/{log}"), self.path / log)

    def in_launch_frame(self, sysid: int, own_ned_m: Vec3) -> Vec3 | None:
        """Move a place of a vehicle's own frame into the launch frame; None: nobody knows how."""
        start = self.starts_ned_m.get(sysid)
        return None if start is None else Vec3(*map(sum, zip(start, own_ned_m, strict=True)))

    @property
    def _frame(self) -> dict[str, Any]:
        return self.mission.get("frame") or {}

    @cached_property
    def _told_starts(self) -> dict[int, Geodetic]:
        """Read from the beacons where satellites have put each vehicle's start."""
        if self._frame.get("shared") != "gnss":
            return {}
        told = {sysid: _told_start(self.tlog(sysid), sysid) for sysid in self.sysids}
        return {sysid: start for sysid, start in told.items() if start is not None}

    @cached_property
    def _truth_starts(self) -> dict[int, Vec3]:
        arrays = self.truth.arrays
        if not {"sysids", "starts_ned_m"} <= arrays.keys():
            return {}
        starts = arrays["starts_ned_m"].astype(float).tolist()
        return {s: Vec3(*at) for s, at in zip(arrays["sysids"].tolist(), starts, strict=True)}

    def _own_track(self, path: Mapping[str, Any]) -> Track:
        flown = [waypoint for waypoint in path["waypoints"] if waypoint["kind"] == "flown"]
        start = np.array(self.starts_ned_m.get(path["sysid"], (0.0, 0.0, 0.0)))
        places = np.array([waypoint["position_m"] for waypoint in flown], dtype=float)
        times_s = np.array([waypoint["time_s"] for waypoint in flown], dtype=float)
        return _track(path["sysid"], times_s, places.reshape(-1, 3) + start)


def _battery(status: Any) -> tuple[float, float]:
    """Give what is left and the power of a SYS_STATUS; NaN is what it does not tell."""
    left = status.battery_remaining / 100.0 if status.battery_remaining >= 0 else math.nan
    is_measured = status.voltage_battery < 0xFFFF and status.current_battery >= 0
    power_w = status.voltage_battery * status.current_battery * 1e-5  # mV times cA
    return left, power_w if is_measured else math.nan


def _told_start(log: Path, sysid: int) -> Geodetic | None:
    for _, tunnel in find_frames(log, "TUNNEL", sysid):
        beacon = None
        if tunnel.payload_type == BEACON_TYPE:
            beacon = decode(bytes(tunnel.payload[: tunnel.payload_length]))
        if beacon is not None and isinstance(beacon.start, Geodetic):
            return beacon.start
    return None


def _by_vehicle(ned_m: NDArray[Any]) -> NDArray[Any]:
    return ned_m.astype(float).transpose(1, 0, 2)


def _track(sysid: int, times_s: NDArray[Any], ned_m: NDArray[Any]) -> Track:
    known = np.isfinite(ned_m).all(axis=1)
    return Track(sysid, times_s[known].astype(float), ned_m[known])


def _json(path: Path) -> dict[str, Any]:
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return value if isinstance(value, dict) else {}
