"""Telemetry logs as ground stations read them: a time stamp before every MAVLink frame."""

from __future__ import annotations

import contextlib
import os
import re
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from swarm_ctl import wire
from swarm_ctl.record.append import AppendFile

EPOCH_S = 1_704_067_200.0
"""2024-01-01T00:00:00Z: what mission time 0 is in a log of virtual time, so that runs compare."""

FLUSH_S = 2.0
"""Mission time after which what is buffered goes to the disk; a killed run loses no more."""
STAMP_BYTES = 8


class TlogWriter:
    """Append frames to one vehicle's `.tlog`; mavutil, MAVExplorer and QGroundControl read it."""

    def __init__(self, path: Path, *, epoch_s: float = EPOCH_S, flush_s: float = FLUSH_S) -> None:
        """Begin a log, or go on with one behind its last whole frame."""
        self.file = AppendFile(path)
        os.ftruncate(self.file.fd, _whole_bytes(path))
        self._flush_s = flush_s
        self._epoch_us = round(epoch_s * 1e6)
        self._waiting: list[bytes] = []
        """Datagrams: to cut many into frames at once takes less time than one now and then."""
        self._times_s: list[float] = []

    def write(self, data: bytes, time_s: float) -> None:
        """Log the whole frames of a datagram at a mission time; never raises."""
        self._waiting.append(data)
        self._times_s.append(time_s)
        if time_s - self._times_s[0] >= self._flush_s:
            self._flush()

    def close(self) -> None:
        """Write what is buffered and close the file."""
        self._flush()
        self.file.close()

    def _flush(self) -> None:
        self.file.write(b"".join(map(self._record, self._waiting, self._times_s)))
        self._waiting.clear()
        self._times_s.clear()

    def _record(self, data: bytes, time_s: float) -> bytes:
        stamp = struct.pack(">Q", self._epoch_us + round(time_s * 1e6))
        return stamp.join((b"", *wire.split(data)))


def _whole_bytes(path: Path) -> int:
    """Tell where the last whole frame of a log ends, which a kill may have torn."""
    data = path.read_bytes()
    at, after = 0, 0
    while after <= len(data):
        at = after
        if at + STAMP_BYTES + 3 > len(data):
            break
        magic, length, flags = data[at + STAMP_BYTES : at + STAMP_BYTES + 3]
        if magic not in {0xFD, 0xFE}:
            return len(data)  # not torn but broken: leave to its readers what can be read
        is_v2 = magic == 0xFD
        after = at + STAMP_BYTES + length + (12 + 13 * (flags & 1) if is_v2 else 8)
    return at


def count_frames(path: Path) -> Counter[tuple[int, int, int]]:
    """Count the frames of a log by sysid, compid and message id; MAVLink 1 counts, too."""
    counts: Counter[tuple[int, int, int]] = Counter()
    data = path.read_bytes() if path.exists() else b""
    at = STAMP_BYTES
    while at + 10 <= len(data):
        magic, length, flags = data[at : at + 3]
        if magic == 0xFD:
            number = data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
            counts[data[at + 5], data[at + 6], number] += 1
            at += length + 12 + 13 * (flags & 1) + STAMP_BYTES
        elif magic == 0xFE:
            counts[data[at + 3], data[at + 4], data[at + 5]] += 1
            at += length + 8 + STAMP_BYTES
        else:
            break
    return counts


def find_frames(path: Path, name: str, sysid: int) -> Iterator[tuple[float, Any]]:
    """Give UTC time and message of each MAVLink 2 frame of one name that a system has sent.

    Looks for the bytes of the frame's head, which is a hundred times as fast as to read every
    frame. A log that is missing has none.
    """
    with contextlib.suppress(OSError):
        yield from _found(path.read_bytes(), name, sysid)


def _found(data: bytes, name: str, sysid: int) -> Iterator[tuple[float, Any]]:
    parser = wire.Parser([name])
    number = wire.message(name).id.to_bytes(3, "little")
    head = b"\xfd.[\x00\x01].." + re.escape(bytes([sysid & 0xFF])) + b"." + re.escape(number)
    for match in re.finditer(head, data, re.DOTALL):
        at = match.start()
        tail = at + 10 + data[at + 1]
        is_whole = wire.checksum(data[at + 1 : tail]) == data[tail : tail + 2]
        if at >= STAMP_BYTES and is_whole:
            (stamp_us,) = struct.unpack(">Q", data[at - STAMP_BYTES : at])
            for frame in parser.feed(data[at : tail + 2 + 13 * (data[at + 2] & 1)]):
                yield stamp_us * 1e-6, frame.values
