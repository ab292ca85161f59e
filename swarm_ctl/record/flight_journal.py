"""One journal per controller: all that its successor needs to go on, on the disk line by line."""

from __future__ import annotations

import fcntl
import json
import os
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from swarm_ctl.errors import SwarmError
from swarm_ctl.record.append import AppendFile

FORMAT = 1
_LINE = re.compile(rb'(\{.*),"crc":"([0-9a-f]{8})"\}', re.DOTALL)
_JSON = json.JSONEncoder(default=str, separators=(",", ":"))
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


@dataclass(frozen=True, slots=True)
class Story:
    """What a journal tells, as far as it can be believed."""

    head: dict[str, Any] = field(default_factory=dict)
    """Its first line: format, mission and vehicle."""
    pages: list[dict[str, Any]] = field(default_factory=list)
    size: int = 0
    """Bytes of the lines that were read; what follows was torn by the kill."""
    crc: int = 0
    found: int = 0
    """Bytes of the file."""
    fault: str = ""
    """Why it cannot be gone on from, in words."""

    @property
    def restarts(self) -> int:
        """How often another process has gone on."""
        return max((page.get("restart", 0) for page in self.pages), default=0)

    def now(self, speed: float) -> float:
        """Tell the mission time that has come since the last line, by the clock."""
        if not self.pages:
            return 0.0
        last, utc = self.pages[-1], datetime.now(UTC).timestamp()
        return float(last["time_s"] + max(0.0, utc - last["utc"]) * speed)

    @property
    def is_whole(self) -> bool:
        """Whether no power failure can have taken its end: the machine was not booted since."""
        boots = [line["boot"] for line in (self.head, *self.pages) if "boot" in line]
        return bool(boots) and boots[-1] == boot_id() != ""


class FlightJournal:
    """Append lines to `journals/vehicle-001.jsonl`.

    A line is a JSON object whose last key is the CRC-32 of all that was written before it, so
    that a line changed, lost or swapped breaks the chain. A killed process loses nothing; what a
    power failure may take is bounded by `RunFolder.sync`.
    """

    def __init__(self, path: Path, head: Mapping[str, Any], after: Story | None = None) -> None:
        """Begin a journal, or go on `after` what is written; SwarmError if another process does."""
        self.file = AppendFile(path)
        self._crc = after.crc if after else 0
        self._first: dict[str, Any] = {}
        try:
            fcntl.flock(self.file.fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            is_ours = after is None or os.fstat(self.file.fd).st_size == after.found
        except OSError:
            is_ours = False
        if not is_ours:
            self.file.close()
            raise SwarmError(f"{path}: another process is flying this vehicle")
        if after:
            os.ftruncate(self.file.fd, after.size)
        if not after or not after.head:
            self.append({"format": FORMAT, **head, "boot": boot_id()})
        if after:
            self._first = {"restart": after.restarts + 1, "boot": boot_id()}

    def append(self, page: Mapping[str, Any]) -> None:
        """Write a line; the journal ends for good where one cannot be written."""
        utc = round(datetime.now(UTC).timestamp(), 3)
        line, self._crc = _encode({**page, **self._first, "utc": utc}, self._crc)
        self._first = {}
        self.file.write(line)

    def close(self) -> None:
        """Close the file."""
        self.file.close()


def read_flight_journal(path: Path, expected: Mapping[str, Any]) -> Story:
    """Read a journal as far as its chain holds; a torn last line is no fault.

    It must be of a mission and vehicle as `expected`.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        return Story(fault=f"its journal cannot be read: {error.strerror or error}")
    lines = data.split(b"\n")[:-1]
    entries, size, crc = [], 0, 0
    for line in lines:
        entry, crc_next = _decode(line, crc)
        if entry is None:
            break
        entries.append(entry)
        size, crc = size + len(line) + 1, crc_next
    head, pages = (entries[0], entries[1:]) if entries else ({}, [])
    fault = ""
    if len(entries) < len(lines) - 1:
        fault = f"its journal is broken in line {len(entries) + 1}"
    elif head and {"format": FORMAT, **expected}.items() - head.items():
        fault = "its journal is of another mission, vehicle or version"
    elif not pages and list(path.parent.glob(f"{path.stem}.broken*")):
        fault = "its journal was broken"
    return Story(head, pages, size, crc, len(data), fault)


def open_journals(
    folder: Path, head: Mapping[str, Any], sysids: Iterable[int], stories: Mapping[int, Story]
) -> dict[int, FlightJournal]:
    """Open the journals of several vehicles, or none; one that is broken is laid aside."""
    journals: dict[int, FlightJournal] = {}
    try:
        for sysid in sysids:
            file, story = folder / f"vehicle-{sysid:03d}.jsonl", stories.get(sysid)
            if story and story.fault:
                aside = len(list(folder.glob(f"{file.stem}.broken*")))
                file.rename(file.with_suffix(f".broken{aside or ''}"))
                story = None
            journals[sysid] = FlightJournal(file, {**head, "sysid": sysid}, story)
    except SwarmError:
        for journal in journals.values():
            journal.close()
        raise
    return journals


def boot_id() -> str:
    """Name the time since this machine was booted; empty where nobody knows."""
    try:
        return _BOOT_ID.read_text("ascii").strip()
    except OSError:
        return ""


def _encode(entry: Mapping[str, Any], crc: int) -> tuple[bytes, int]:
    body = _JSON.encode(entry).encode()[:-1]
    crc = zlib.crc32(body, crc)
    return body + b',"crc":"%08x"}\n' % crc, crc


def _decode(line: bytes, crc: int) -> tuple[dict[str, Any] | None, int]:
    match = _LINE.fullmatch(line)
    if match is None or zlib.crc32(match[1], crc) != int(match[2], 16):
        return None, crc
    return json.loads(match[1] + b"}"), int(match[2], 16)
