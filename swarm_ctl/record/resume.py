"""Which run was killed and can be taken up again."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import swarm_ctl
from swarm_ctl.errors import SwarmError

JOURNALS = "journals"
"""Where in a run folder the controllers' journals are."""
UNFINISHED_S = 600.0
"""A run that was killed longer ago is over: its vehicles are down."""


def find_unfinished(
    runs: Path, resolved: Mapping[str, Any], sysids: Iterable[int], utc: datetime
) -> Path | None:
    """Find the newest run of a mission with these vehicles that was killed a short while ago."""
    wanted = sorted(sysids)
    for path in sorted(runs.glob(f"{resolved['name']}-*"), key=last_written, reverse=True):
        with contextlib.suppress(SwarmError):
            unfinished_run(path, resolved, utc)
            if sorted(journals_in(path)) == wanted:
                return path
    return None


def unfinished_run(path: Path, resolved: Mapping[str, Any], utc: datetime) -> dict[str, Any]:
    """Read how a run began; SwarmError says why it is none that can be gone on with."""
    try:
        started: dict[str, Any] = json.loads((path / "mission.json").read_text("utf-8"))
        mission = started["mission"]
    except (OSError, ValueError, KeyError, TypeError):
        raise SwarmError(f"{path}: holds no run that could be taken up") from None
    if mission != json.loads(json.dumps(resolved)):
        raise SwarmError(f"{path}: is the run of another mission")
    if (path / "summary.json").exists():
        raise SwarmError(f"{path}: this run has ended; name a new folder")
    ago_s = utc.timestamp() - last_written(path)
    if ago_s > UNFINISHED_S:
        words = (
            f"this run was left {ago_s / 60.0:.0f} minutes ago, and its vehicles are down by now"
        )
        raise SwarmError(f"{path}: {words}; name a new folder")
    return started


def journals_in(path: Path) -> dict[int, Path]:
    """Give the journals of a run's controllers by sysid."""
    files = (path / JOURNALS).glob("vehicle-*.jsonl")
    return {int(file.stem.removeprefix("vehicle-")): file for file in sorted(files)}


def last_written(path: Path) -> float:
    """Give the UTC, in seconds, of the last line in a journal of a run, or of its beginning."""
    files = [path / "mission.json", *journals_in(path).values()]
    return max((file.stat().st_mtime for file in files if file.exists()), default=0.0)


def head_of(resolved: Mapping[str, Any]) -> dict[str, Any]:
    """Say in a journal's first line what mission it is of, and what can read it."""
    text = json.dumps(dict(resolved), sort_keys=True)
    return {
        "swarm_ctl": swarm_ctl.__version__,
        "mission": resolved["name"],
        "mission_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "seed": resolved["seed"],
    }
