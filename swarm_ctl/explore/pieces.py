"""How pieces of trails and summaries of them travel: a few bytes per entry of a log."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import NamedTuple

START, LINE, WALL_X, WALL_Y, WALL_Z = range(5)
"""Kinds of entries: a trail begins; goes on straight from its last point; walls by their axis."""

PAYLOAD_BYTES = 120
MOST_ENTRIES = 20_000
"""Per origin; what is flown over again is not told again. More is somebody's mistake."""
VERSION = 1
_PAIRS = [bytes([pair & 15, pair >> 4]) for pair in range(256)]
"""The two kinds that a byte says."""

Shift = tuple[float, ...]
"""What to add to a position in another frame to have it in one's own, m. All axes lie along north
by compass; with no compass this is where a rotation would have to go, too."""


class Entry(NamedTuple):
    """One line of a log."""

    kind: int
    point_cm: tuple[int, ...]
    """In the frame of the log's origin."""


class Piece(NamedTuple):
    """A run of entries, as it travels."""

    origin: int
    begin: int
    shift_cm: tuple[int, ...]
    """From the origin's frame into the sender's."""
    kinds: bytes
    numbers_cm: array[int]
    """The points, one after the other."""

    @property
    def end(self) -> int:
        """The length of a log that ends with it."""
        return self.begin + len(self.kinds)

    def beyond(self, known: int) -> tuple[bytes, array[int]]:
        """Give kinds and numbers of what is new where the log is known up to a length."""
        skip = known - self.begin
        if skip <= 0:
            return self.kinds, self.numbers_cm
        return self.kinds[skip:], self.numbers_cm[skip * len(self.shift_cm) :]


def points(numbers_cm: Iterable[int], dimensions: int) -> Iterator[tuple[int, ...]]:
    """Give the points that numbers are, one after the other."""
    return zip(*[iter(numbers_cm)] * dimensions, strict=True)


def encode(
    origin: int, begin: int, shift_m: Shift, kinds: bytearray, numbers_cm: array[int]
) -> tuple[bytes, int]:
    """Pack as many entries of a log from `begin` on as a payload takes; give it and their number.

    Version and dimensions, origin, begin, shift, count, kinds (half a byte each), points.
    """
    dimensions = len(shift_m)
    head = bytes([VERSION << 4 | dimensions]) + varint(origin) + varint(begin)
    shift = [max(-32767, min(32767, round(value * 100.0))) for value in shift_m]
    head += struct.pack(f"<{dimensions}h", *shift)
    room = PAYLOAD_BYTES - len(head) - 2
    chosen = kinds[begin : begin + 2 * room // (4 * dimensions + 1)]
    count = len(chosen)
    chosen += bytes(count % 2)
    packed = bytes([low | high << 4 for low, high in zip(chosen[::2], chosen[1::2], strict=True)])
    numbers = numbers_cm[begin * dimensions : (begin + count) * dimensions]
    data = head + bytes([count]) + packed + struct.pack(f"<{len(numbers)}h", *numbers)
    return data, count


@lru_cache(256)  # one piece is heard by many, where many fly in one process
def decode(data: bytes, dimensions: int) -> Piece | None:
    """Read a payload; None when it is none of ours or broken."""
    try:
        if data[0] != VERSION << 4 | dimensions:
            return None
        origin, at = _read_varint(data, 1)
        begin, at = _read_varint(data, at)
        shift = struct.unpack_from(f"<{dimensions}h", data, at)
        at += 2 * dimensions
        count = data[at]
        pairs = data[at + 1 : at + 1 + (count + 1) // 2]
        shorts = struct.unpack_from(f"<{count * dimensions}h", data, at + 1 + len(pairs))
    except (IndexError, ValueError, struct.error):
        return None
    kinds = b"".join([_PAIRS[pair] for pair in pairs])[:count]
    if begin > MOST_ENTRIES or (count and max(kinds) > WALL_Z):
        return None
    return Piece(origin, begin, shift, kinds, array("h", shorts))


def read_summary(summary: bytes) -> list[tuple[int, int]] | None:
    """Give the origins and lengths of logs that a summary tells; None when it is broken."""
    try:
        numbers = list(_varints(summary[1:]))
        pairs = list(zip(numbers[::2], numbers[1::2], strict=True))
    except (IndexError, ValueError):
        return None
    return pairs if summary[:1] == bytes([VERSION]) else None


@lru_cache(4096)
def varint(number: int) -> bytes:
    """Pack a number, seven bits a byte, the lowest first."""
    packed = bytearray()
    while number >= 128:
        packed.append(number & 127 | 128)
        number >>= 7
    packed.append(number)
    return bytes(packed)


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    number, shift = 0, 0
    while data[at] >= 128:
        number |= (data[at] & 127) << shift
        shift += 7
        at += 1
        if shift > 28:
            raise ValueError("a number of more than 35 bits")
    return number | data[at] << shift, at + 1


def _varints(data: bytes) -> Iterator[int]:
    at = 0
    while at < len(data):
        number, at = _read_varint(data, at)
        yield number
