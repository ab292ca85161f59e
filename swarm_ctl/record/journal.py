"""Events as JSON lines, on the disk as they happen: a killed run leaves a readable journal."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from swarm_ctl.errors import SwarmError
from swarm_ctl.model import Event
from swarm_ctl.record.append import AppendFile


class Journal:
    """Append events to `events.jsonl`; its first line says how the run can be repeated."""

    def __init__(self, path: Path, **first: Any) -> None:
        """Begin a journal, or go on with one, with a line that says so."""
        self.file = AppendFile(path)
        os.ftruncate(self.file.fd, path.read_bytes().rfind(b"\n") + 1)  # what a kill has torn
        self._line(first)

    def write(self, event: Event) -> None:
        """Append one event; never raises."""
        self._line(
            {
                "event": event.name,
                "time_s": round(event.time_s, 6),
                "sysid": event.sysid,
                "data": event.data,
            }
        )

    def close(self) -> None:
        """Close the file."""
        self.file.close()

    def _line(self, entry: dict[str, Any]) -> None:
        # what JSON cannot say is written as text: a flight goes on
        self.file.write(json.dumps(entry, default=str).encode() + b"\n")


def read_journal(path: Path) -> list[dict[str, Any]]:
    """Read every whole line; a last line torn by a kill is left out.

    Raises SwarmError when a line in between is broken.
    """
    lines = path.read_text(encoding="utf-8", errors="replace").split("\n")
    entries: list[dict[str, Any]] = []
    for number, line in enumerate(lines[:-1], start=1):  # behind the last newline: torn or empty
        try:
            entries.append(json.loads(line))
        except json.JSONDecodeError:
            raise SwarmError(f"{path}: line {number} is not JSON") from None
    return entries
