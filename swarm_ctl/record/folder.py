"""The run folder: all that a run leaves behind, written as the run goes."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
import struct
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import swarm_ctl
from swarm_ctl.errors import SwarmError
from swarm_ctl.record.journal import Journal
from swarm_ctl.record.paths import PathRecorder, write_paths
from swarm_ctl.record.tlog import EPOCH_S, TlogWriter

PATHS_S = 10.0
"""Mission time between two writings of `paths.json`."""

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

    def __init__(self, path: Path, journal: Journal, *, epoch_s: float) -> None:
        self.path = path
        self.journal = journal
        self.hash = RunHash()
        self._epoch_s = epoch_s
        self._tlogs: dict[int, TlogWriter] = {}
        self._paths: dict[int, PathRecorder] = {}
        self._paths_due_s = PATHS_S

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
    ) -> Self:
        """Make `out`, or `runs/<name>-<utc>/`, and write how to repeat the run at once.

        `resolved` is the mission with every value, ready for JSON. A log of real time is stamped
        in UTC; virtual time counts from a fixed date, so that two runs are equal byte for byte.
        Raises SwarmError when the folder holds something already or cannot be made.
        """
        utc = utc or datetime.now(UTC)
        path = out or _unused(Path("runs") / f"{name}-{utc:%Y%m%dT%H%M%SZ}")
        path = _make(path.absolute())
        started = {"mission": dict(resolved), "seed": seed, "mode": mode, "versions": _versions()}
        text = json.dumps({**started, "started_utc": utc.isoformat()}, indent=2)
        (path / "mission.json").write_text(text + "\n", encoding="utf-8")
        (path / "tlogs").mkdir()
        journal = Journal(
            path / "events.jsonl",
            seed=seed,
            mission=name,
            vehicles=resolved.get("vehicles"),
            mode=mode,
            swarm_ctl=swarm_ctl.__version__,
        )
        return cls(path, journal, epoch_s=EPOCH_S if mode == "virtual" else utc.timestamp())

    def tlog(self, sysid: int) -> TlogWriter:
        """Give a vehicle's telemetry log, `tlogs/vehicle-001.tlog`; the same one every time."""
        if sysid not in self._tlogs:
            file = self.path / "tlogs" / f"vehicle-{sysid:03d}.tlog"
            self._tlogs[sysid] = TlogWriter(file, epoch_s=self._epoch_s)
        return self._tlogs[sysid]

    def waypoints(self, sysid: int) -> PathRecorder:
        """Give a vehicle's path, part of `paths.json`; the same one every time."""
        return self._paths.setdefault(sysid, PathRecorder(sysid))

    def tick(self, now: float) -> None:
        """Write `paths.json` when its time has come; call it as often as you like."""
        if now >= self._paths_due_s:
            self._paths_due_s = now + PATHS_S
            self._write_paths()

    def close(self) -> None:
        """Write the paths and close every file."""
        try:
            self._write_paths()
        finally:  # a full disk takes the paths, not the logs
            for tlog in self._tlogs.values():
                tlog.close()
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

    def _write_paths(self) -> None:
        write_paths(self.path / "paths.json", (self._paths[sysid] for sysid in sorted(self._paths)))


def _make(path: Path) -> Path:
    try:
        path.mkdir(parents=True, exist_ok=True)
        full = any(path.iterdir())
    except OSError as error:
        raise SwarmError(f"{path}: cannot be the run folder: {error.strerror}") from None
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
