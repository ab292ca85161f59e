"""The run folder: all that a run leaves behind, written as the run goes."""

from __future__ import annotations

import contextlib
import hashlib
import importlib.metadata
import itertools
import json
import platform
import struct
from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import swarm_ctl
from swarm_ctl.errors import SwarmError, plain
from swarm_ctl.record.flight_journal import FlightJournal, Story, open_journals, read_flight_journal
from swarm_ctl.record.journal import Journal
from swarm_ctl.record.paths import PathRecorder, write_paths
from swarm_ctl.record.resume import JOURNALS, head_of, journals_in, unfinished_run
from swarm_ctl.record.tlog import EPOCH_S, FLUSH_S, TlogWriter

PATHS_S = 5.0
"""Mission time that a writing of `paths.json` takes: what it tells is at most twice as old."""

Mode = Literal["udp", "virtual", "fly"]
"""Against mock vehicles over UDP or in memory, or with real vehicles."""


class RunHash:
    """A running SHA-256 over every frame in and out: equal when two runs were equal."""

    def __init__(self) -> None:
        self._sha256 = hashlib.sha256()

    def frame(self, index: int, outgoing: bool, data: bytes) -> None:
        """Add one datagram of the vehicle at an index."""
        self._sha256.update(struct.pack(">I?I", index, outgoing, len(data)))
        self._sha256.update(data)

    def hexdigest(self) -> str:
        """Give the hash of all frames so far."""
        return self._sha256.hexdigest()


class RunFolder:
    """Where one run's mission, journal, logs, paths, truth, pictures and summary lie."""

    is_kept = True

    def __init__(
        self,
        path: Path,
        journal: Journal,
        *,
        epoch_s: float,
        journals: Mapping[int, FlightJournal] | None = None,
    ) -> None:
        """Write into a folder that is there: events, and journals of controllers if there are."""
        self.path = path
        self.journal = journal
        self.hash = RunHash()
        self.resumed_s: float | None = None
        """Mission time at which the run was taken up; None when it was begun."""
        self._epoch_s = epoch_s
        self._stories: dict[int, Story] = {}
        self._flight_journals = dict(journals or {})
        self._tlogs: dict[int, TlogWriter] = {}
        self._paths: dict[int, PathRecorder] = {}
        self._paths_due_s = PATHS_S
        self._writing: Iterator[None] | None = None
        """What writes `paths.json`, while it does."""
        self._written = 0
        """Vehicles that it has written."""

    @classmethod
    def create(
        cls,
        out: Path | None,
        name: str,
        resolved: Mapping[str, Any],
        *,
        seed: int,
        mode: Mode,
        utc: datetime | None = None,
        journaled: Iterable[int] = (),
        faults: Sequence[str] = (),
        shard: Mapping[str, int] | None = None,
    ) -> Self:
        """Make `out`, or `runs/<name>-<utc>/`, and write how to repeat the run at once.

        `resolved` is the mission with every value, ready for JSON, `faults` what is broken on
        purpose, as the command line has it, `shard` which part of a world this is. A log of real
        time is stamped in UTC; virtual time counts from a fixed date, so that two runs are equal
        byte for byte.
        With journals of the sysids that are `journaled` it can be taken up by `reopen`.
        Raises SwarmError when the folder holds something already or cannot be made.
        """
        utc = utc or datetime.now(UTC)
        path = make_folder(out, name, utc)
        if wanted := list(journaled):
            (path / JOURNALS).mkdir()
        started = {
            "mission": dict(resolved),
            "seed": seed,
            "mode": mode,
            "faults": list(faults),
            "versions": _versions(),
            "started_utc": utc.isoformat(),
        }
        if shard:
            started["shard"] = dict(shard)
        text = json.dumps(started, indent=2)
        (path / "mission.json").write_text(text + "\n", encoding="utf-8")
        (path / "tlogs").mkdir()
        journals = open_journals(path / JOURNALS, head_of(resolved), wanted, {})
        journal = Journal(
            path / "events.jsonl",
            event="RunStarted",
            seed=seed,
            mission=name,
            vehicles=resolved.get("vehicles"),
            mode=mode,
            swarm_ctl=swarm_ctl.__version__,
        )
        return cls(path, journal, epoch_s=_epoch_s(mode, utc), journals=journals)

    @classmethod
    def reopen(
        cls,
        path: Path,
        resolved: Mapping[str, Any],
        sysids: Collection[int],
        *,
        speed: float = 1.0,
    ) -> Self:
        """Go on with a journaled run that was killed: all that was recorded stays and is added to.

        Mission time has gone on since the last line, `speed` times as fast as the clock. Raises
        SwarmError when the run is another one, has ended, or is being flown.
        """
        path = path.absolute()
        started = unfinished_run(path, resolved, datetime.now(UTC))
        head, files = head_of(resolved), journals_in(path)
        if set(files) - set(sysids):
            raise SwarmError(f"{path}: is the run of other vehicles")
        stories = {
            sysid: read_flight_journal(file, {**head, "sysid": sysid})
            for sysid, file in files.items()
        }
        journals = open_journals(path / JOURNALS, head, sysids, stories)
        epoch_s = _epoch_s(started["mode"], datetime.fromisoformat(started["started_utc"]))
        now = max((story.now(speed) for story in stories.values()), default=0.0)
        events = Journal(path / "events.jsonl", event="RunResumed", time_s=round(now, 3))
        folder = cls(path, events, epoch_s=epoch_s, journals=journals)
        folder._stories, folder.resumed_s = stories, now
        folder._reread_paths()
        return folder

    @property
    def started_utc(self) -> datetime:
        """When mission time was 0."""
        return datetime.fromtimestamp(self._epoch_s, UTC)

    @property
    def birth(self) -> int:
        """Tell this run from others before peers who remember them; 0 in virtual time."""
        return self.started_utc.microsecond

    def now(self, speed: float) -> float:
        """Tell the mission time of a run that goes on, by the clock; 0 of one that begins."""
        return max((story.now(speed) for story in self._stories.values()), default=0.0)

    def story(self, sysid: int) -> Story | None:
        """Give what a vehicle's controllers have written so far; None in a run just begun."""
        return None if self.resumed_s is None else self._stories.get(sysid, Story())

    def restarts(self, sysid: int) -> int:
        """Count how often a vehicle's controller was begun anew, this time included."""
        story = self.story(sysid)
        return 0 if story is None else story.restarts + 1

    def flight_journal(self, sysid: int) -> FlightJournal | None:
        """Give a controller's journal, `journals/vehicle-001.jsonl`; None in runs without."""
        return self._flight_journals.get(sysid)

    def sync(self) -> None:
        """Wait until the disk has the controllers' journals; meant for another thread.

        Raises OSError when any file has ended because it could not be written.
        """
        for journal in self._flight_journals.values():
            journal.file.sync()
        for file in (self.journal.file, *(tlog.file for tlog in self._tlogs.values())):
            if file.fault:
                raise OSError(None, file.fault, str(file.path))

    def tlog(self, sysid: int) -> TlogWriter:
        """Give a vehicle's telemetry log, `tlogs/vehicle-001.tlog`; the same one every time."""
        if sysid not in self._tlogs:
            file = self.path / "tlogs" / f"vehicle-{sysid:03d}.tlog"
            flush_s = 0.0 if self._flight_journals else FLUSH_S
            self._tlogs[sysid] = TlogWriter(file, epoch_s=self._epoch_s, flush_s=flush_s)
        return self._tlogs[sysid]

    def waypoints(self, sysid: int) -> PathRecorder:
        """Give a vehicle's path, part of `paths.json`; the same one every time."""
        return self._paths.setdefault(sysid, PathRecorder(sysid))

    def tick(self, now: float) -> None:
        """Write `paths.json` anew every PATHS_S; call it as often as you like.

        Each call writes a part of it: at once, hundreds of vehicles take too long.
        """
        if self._writing is None:
            self._writing, self._written = self._write_paths(), 0
        wanted = int((1.0 - (self._paths_due_s - now) / PATHS_S) * len(self._paths))
        try:
            for _ in itertools.islice(self._writing, max(0, wanted - self._written)):
                self._written += 1
            if now >= self._paths_due_s:
                self._paths_due_s = now + PATHS_S
                deque(self._writing, maxlen=0)
                self._writing = None
        except OSError:
            self._writing = None
            raise

    def close(self) -> None:
        """Write the paths and close every file."""
        self._writing = None
        try:
            deque(self._write_paths(), maxlen=0)
        finally:  # a full disk takes the paths, not the logs
            for tlog in self._tlogs.values():
                tlog.close()
            for journal in self._flight_journals.values():
                journal.close()
            self.journal.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _reread_paths(self) -> None:
        """Take up the paths: from their file, and what came after it from the journals."""
        with contextlib.suppress(OSError):
            written = json.loads((self.path / "paths.json").read_text("utf-8"))["vehicles"]
            self._paths = {path["sysid"]: PathRecorder.decoded(path) for path in written}
        for sysid, story in self._stories.items():
            self.waypoints(sysid).go_on(story.pages)

    def _write_paths(self) -> Iterator[None]:
        paths = [self._paths[sysid] for sysid in sorted(self._paths)]
        return write_paths(self.path / "paths.json", paths)


def _epoch_s(mode: Mode, utc: datetime) -> float:
    """Give when mission time was 0: virtual time counts from a fixed date."""
    return EPOCH_S if mode == "virtual" else utc.timestamp()


def make_folder(out: Path | None, name: str, utc: datetime) -> Path:
    """Make `out`, or `runs/<name>-<utc>/`; SwarmError when it holds something or cannot be."""
    path = out or _unused(Path("runs") / f"{name}-{utc:%Y%m%dT%H%M%SZ}")
    return _make(path.absolute())


def _make(path: Path) -> Path:
    try:
        path.mkdir(parents=True, exist_ok=True)
        full = any(path.iterdir())
    except OSError as error:
        raise SwarmError(f"{path}: cannot be the run folder: {plain(error)}") from None
    if full:
        raise SwarmError(f"{path}: holds files already; name a new or an empty folder")
    return path


def _unused(path: Path) -> Path:
    """Count up when two runs start within one second."""
    taken = (path.with_name(f"{path.name}-{count}") for count in range(2, 1000))
    return path if not path.exists() else next(other for other in taken if not other.exists())


def _versions() -> dict[str, str]:
    return {
        "swarm_ctl": swarm_ctl.__version__,
        "python": platform.python_version(),
        "numpy": importlib.metadata.version("numpy"),
        "pymavlink": importlib.metadata.version("pymavlink"),
    }
