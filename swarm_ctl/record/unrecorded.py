"""Flights of which nothing is written down: for the many thousands that only virtual time flies."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

from swarm_ctl.model import Event, Vec3
from swarm_ctl.record.flight_journal import FlightJournal, Story
from swarm_ctl.record.folder import RunHash
from swarm_ctl.record.paths import PathRecorder


class Frames(Protocol):
    """What is told of every datagram."""

    def frame(self, index: int, outgoing: bool, data: bytes) -> None:
        """Take one datagram of the vehicle at an index."""

    def hexdigest(self) -> str:
        """Give the hash of all so far; empty where none is kept."""


class Log(Protocol):
    """What takes a vehicle's datagrams with their times."""

    def write(self, data: bytes, time_s: float) -> None:
        """Take one datagram."""


class Events(Protocol):
    """What takes facts."""

    def write(self, event: Event) -> None:
        """Take one fact."""


class Record(Protocol):
    """What controllers ask of the record of their run; a run folder is one."""

    @property
    def is_kept(self) -> bool:
        """Whether there will be something to read once all is over."""

    @property
    def hash(self) -> Frames:
        """What is told of every datagram."""

    @property
    def journal(self) -> Events:
        """What is told of every fact."""

    @property
    def resumed_s(self) -> float | None:
        """Mission time at which the run was taken up; None when it was begun."""

    @property
    def birth(self) -> int:
        """Tell this run from others before peers who remember them."""

    def story(self, sysid: int) -> Story | None:
        """Give what earlier controllers of a vehicle have written; None in a run just begun."""

    def restarts(self, sysid: int) -> int:
        """Count how often a vehicle's controller was begun anew."""

    def flight_journal(self, sysid: int) -> FlightJournal | None:
        """Give a controller's journal; None in runs without."""

    def tlog(self, sysid: int) -> Log:
        """Give a vehicle's telemetry log."""

    def waypoints(self, sysid: int) -> PathRecorder:
        """Give a vehicle's path; the same one every time."""

    def tick(self, now: float) -> None:
        """Write what is due."""


class Unrecorded:
    """Stand in for a run folder, and leave nothing on the disk."""

    is_kept = False
    resumed_s: float | None = None
    birth = 0

    def __init__(self, *, hashed: bool = False, events: Events | None = None) -> None:
        """Keep the hash of all frames if wanted, and pass facts on to who wants them."""
        self.hash: Frames = RunHash() if hashed else _Nothing()
        self.journal: Events = events or _Forgetful()
        self._tlog = _Forgetful()
        self._paths: dict[int, PathRecorder] = {}

    def story(self, sysid: int) -> Story | None:  # noqa: ARG002 - every run is new
        """Give None: every run is just begun."""
        return None

    def restarts(self, sysid: int) -> int:  # noqa: ARG002 - the same
        """Give 0: nobody comes back from the dead."""
        return 0

    def flight_journal(self, sysid: int) -> FlightJournal | None:  # noqa: ARG002 - none is kept
        """Give None."""
        return None

    def tlog(self, sysid: int) -> Log:  # noqa: ARG002 - one forgets for all
        """Give what forgets."""
        return self._tlog

    def waypoints(self, sysid: int) -> PathRecorder:
        """Give a vehicle's path in memory: its length is part of what a flight results in."""
        return self._paths.setdefault(sysid, _PathLength(sysid))

    def tick(self, now: float) -> None:
        """Do nothing."""


class _PathLength(PathRecorder):
    """A path that keeps its length, to the millimetre of its waypoints, and none of them."""

    def __init__(self, sysid: int) -> None:
        super().__init__(sysid)
        self._before: Vec3 | None = None

    def visited(self, time_s: float, position: Vec3, peers: Iterable[int]) -> None:  # noqa: ARG002
        """Add the way from the last one."""
        if self._before is not None:
            self.length_m += math.dist(self._before, position)
        self._before = Vec3(*(round(float(metres), 3) for metres in position))

    def target(self, time_s: float, position: Vec3) -> None:
        """Forget it."""


class _Nothing:
    """No hash."""

    def frame(self, index: int, outgoing: bool, data: bytes) -> None:
        """Forget it."""

    def hexdigest(self) -> str:
        """Give nothing."""
        return ""


class _Forgetful:
    """A log that keeps nothing."""

    def write(self, *_: object) -> None:
        """Forget it."""
