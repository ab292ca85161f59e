"""What shards tell each other, as bytes: where vehicles are, and frames that they broadcast.

A letter is one datagram, and is understood alone: a head, rows, frames. Little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

MAGIC = b"MVS1"
LETTER_BYTES = 1400
"""What fits into one datagram without fragments."""
ON_AIR, GROUNDED = 0x01, 0x02
"""Bits of a row's `flags`: its radio works; it stands on the ground."""

ROW = np.dtype(
    [
        ("vehicle", "<u2"),
        ("flags", "u1"),
        ("loss", "u1"),
        ("position_ned_m", "<f4", 3),
        ("velocity_ned_m_s", "<f4", 3),
    ]
)
"""A vehicle, counted from 0 through the mission; `loss` is its radio's, in 255ths."""
_HEAD = struct.Struct("<4sIHHHd")
"""Magic, tag of the mission, shard, number of rows, number of frames, mission time in s."""
_FRAME = struct.Struct("<HH")
"""Who broadcast it, and its length."""
ROWS_MAX = (LETTER_BYTES - _HEAD.size) // ROW.itemsize
FAR_M, LATE_S = 1e6, 1e8
"""Nothing in any world is farther from its origin, and no mission lasts longer."""

Rows = NDArray[np.void]
NO_ROWS: Rows = np.empty(0, dtype=ROW)
Sent = tuple[int, bytes]
"""A vehicle, counted from 0 through the mission, and a frame that it broadcast."""


class Letter(NamedTuple):
    """What one datagram says."""

    tag: int
    shard: int
    time_s: float
    """The sender's mission time."""
    rows: Any
    """Array of `ROW`."""
    frames: list[Sent]


def write_rows(tag: int, shard: int, time_s: float, rows: Rows) -> list[bytes]:
    """Pack where vehicles are into as many letters as it takes."""
    loads = (rows[at : at + ROWS_MAX] for at in range(0, len(rows), ROWS_MAX))
    return [_HEAD.pack(MAGIC, tag, shard, len(load), 0, time_s) + load.tobytes() for load in loads]


def write_frames(tag: int, shard: int, time_s: float, frames: Sequence[Sent]) -> list[bytes]:
    """Pack what vehicles broadcast into as many letters as it takes."""
    return [
        _HEAD.pack(MAGIC, tag, shard, 0, len(load), time_s)
        + b"".join(_FRAME.pack(vehicle, len(frame)) + frame for vehicle, frame in load)
        for load in _loads(frames)
    ]


def _loads(frames: Sequence[Sent]) -> Iterator[list[Sent]]:
    """Share out frames so that each load fits into a letter."""
    load: list[Sent] = []
    size = _HEAD.size
    for vehicle, frame in frames:
        more = _FRAME.size + len(frame)
        if load and size + more > LETTER_BYTES:
            yield load
            load, size = [], _HEAD.size
        load.append((vehicle, frame))
        size += more
    if load:
        yield load


def read(data: bytes) -> Letter | None:
    """Read a letter; None when it is none, or anything in it cannot be. Never raises."""
    if len(data) < _HEAD.size:
        return None
    magic, tag, shard, count, frames_count, time_s = _HEAD.unpack_from(data)
    end = _HEAD.size + count * ROW.itemsize
    if magic != MAGIC or end > len(data) or not 0.0 <= time_s < LATE_S:
        return None
    rows = np.frombuffer(data, ROW, count, _HEAD.size) if count else NO_ROWS
    frames = _frames(data, end, frames_count)
    if frames is None or not _are_possible(rows):
        return None
    return Letter(tag, shard, time_s, rows, frames)


def _are_possible(rows: Any) -> bool:
    """Tell whether all numbers are numbers, and none is beyond any world; NaN is not below."""
    told = np.abs((rows["position_ned_m"], rows["velocity_ned_m_s"]))
    return bool((told < FAR_M).all())


def _frames(data: bytes, at: int, count: int) -> list[Sent] | None:
    """Cut the frames out, which must end where the letter does."""
    frames: list[Sent] = []
    for _ in range(count):
        if at + _FRAME.size > len(data):
            return None
        vehicle, length = _FRAME.unpack_from(data, at)
        at += _FRAME.size + length
        if at > len(data):
            return None
        frames.append((vehicle, data[at - length : at]))
    return frames if at == len(data) else None
