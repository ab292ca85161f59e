"""Streams of bytes cut into frames."""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from struct import Struct
from struct import error as StructError  # noqa: N812 - a class deserves a class's name

from fastcrc.crc16 import mcrf4xx

from swarm_ctl.wire.codec import V1, V2, Data, Frame, Message, Read, message
from swarm_ctl.wire.tables import CRC_EXTRAS
from swarm_ctl.wire.tally import Tally

_SIGNED = 0x01
_SIGNATURE_LENGTH = 13
_GARBAGE, _UNREADABLE = -1, -2  # in place of an id: no frame here; a frame with unknown flags
_MAGICS = b"\xfd\xfe"
_MAGIC = re.compile(b"[" + _MAGICS + b"]")
_RIM = Struct("<xBB4xB").unpack_from  # length, flags and low byte of the id of MAVLink 2
_NAMED = Counter((number & 0xFF, extra) for number, extra in CRC_EXTRAS.items())
"""Of how many messages low byte of the id and CRC_EXTRA are these: of one, or the CRC of another
message would be right, too."""


class Parser(Tally):
    """Cut a stream of bytes into frames and decode those of the subscribed messages."""

    def __init__(self, subscribed: Iterable[str | int | Message] | None) -> None:
        """Subscribe to messages, or to all of the dialect by None."""
        super().__init__()
        self._rest = b""
        self._subscribed = _ids(frozenset(CRC_EXTRAS if subscribed is None else subscribed))
        self._readers: dict[int, Read] = {}
        """By id, of messages that have come."""
        self._usual: dict[int, Read] = {}
        """By the id's low byte; another message with the same one has another CRC."""

    def feed(self, data: Data) -> list[Frame]:
        """Take the next bytes, in any chunks, and give the subscribed frames they complete.

        A datagram of one frame without a signature, as autopilots send them, has the shortest way.
        """
        if self._rest:
            return self._resume(data)
        try:
            if len(data) == data[1] + 12:
                frame = self._usual[data[7]](data, data)
                if frame is not None:
                    self.stats.frames += 1
                    return [] if frame is True else [frame]
        except (StructError, LookupError, TypeError):
            pass  # `_cut` finds out what it is
        return self._cut(data) if isinstance(data, bytes) else self._resume(data)

    def _cut(self, data: bytes) -> list[Frame]:
        """Give the frames of any bytes that begin with one; what is left of the last one waits.

        One long loop, because every call in it would cost each frame a tenth of its time.
        """
        frames: list[Frame] = []
        usual, at, end, good = self._usual, 0, len(data), 0
        while at < end:
            try:
                length, flags, low = _RIM(data, at)
                tail = at + 12 + length
                body = data[at:tail]
                # flags mean a signature, or what a reader refuses
                stop = tail + _SIGNATURE_LENGTH if flags else tail
                raw = data[at:stop] if flags else body
                frame = usual[low](body, raw) if stop <= end else None
            except (StructError, KeyError):
                frame = None
            if frame is None:
                stop = self._read_odd(data, at, frames)
                if stop == at:
                    self._rest = data[at:]
                    break
            else:
                good += 1
                if frame is not True:
                    frames.append(frame)
            at = stop
        self.stats.frames += good
        return frames

    def _read_odd(self, data: bytes, at: int, frames: list[Frame]) -> int:
        """Take what is no frame of MAVLink 2 as we know it, or the first of its id.

        Gives where to go on; that is `at` while bytes are missing.
        """
        start, stop, number, length, flags, seq, source = _header(data, at)
        if stop > len(data):
            return at
        tail = start + length
        extra = CRC_EXTRAS.get(number)
        if not extra or mcrf4xx(data[at + 1 : tail] + extra) != data[tail] | data[tail + 1] << 8:
            return self._refuse(data, at, stop, number, flags, source, seq)
        read = self._readers.get(number) or self._begin_to_read(number)
        self.next_seq.setdefault(source, seq)
        plain = message(number).plain(data[start:tail], seq, source)
        frame = read(plain, data[at:stop])
        if frame is not True:
            frames.append(frame)
        self.stats.frames += 1
        return stop

    def _begin_to_read(self, number: int) -> Read:
        known, low = message(number), number & 0xFF
        maker = known.reader if number in self._subscribed else known.skimmer
        read = self._readers[number] = maker(self)
        if _NAMED[low, CRC_EXTRAS[number]] == 1:
            self._usual.setdefault(low, read)
        return read

    def _resume(self, data: Data) -> list[Frame]:
        """Go on with the incomplete frame of the last time."""
        data = bytes(data)
        rest, self._rest = self._rest, b""
        frames = self._cut(rest + data)
        if len(self._rest) > len(data) and _starts_with_frame(data):
            # A whole frame came while we still wait: the rest of the old one was never sent.
            self.stats.skipped_bytes += len(self._rest) - len(data)
            self._rest = b""
            frames += self._cut(data)
        return frames

    def _refuse(
        self, data: bytes, at: int, stop: int, number: int, flags: int, source: int, seq: int
    ) -> int:
        """Count what gives no message, and say where to go on."""
        if number == _GARBAGE or number in CRC_EXTRAS:
            self.stats.bad_crc += number != _GARBAGE
            return self._skip(data, at)
        if flags > _SIGNED:
            self.stats.bad_flags += 1
        else:
            self.stats.unknown += 1
            if source in self.next_seq:
                self.follow(source, seq)
        # No CRC vouches for its length, hence another frame must follow it, or nothing.
        is_plausible = stop == len(data) or data[stop] in _MAGICS
        return stop if is_plausible else self._skip(data, at)

    def _skip(self, data: bytes, at: int) -> int:
        """Go to the next byte after `at` that could start a frame."""
        start = _seek(data, at + 1)
        self.stats.skipped_bytes += start - at
        return start


@cache
def _ids(keys: frozenset[str | int | Message]) -> frozenset[int]:
    """Give the ids of messages; all who subscribe to the same ones share them."""
    return frozenset(key.id if isinstance(key, Message) else message(key).id for key in keys)


def split(data: bytes) -> Iterator[bytes]:
    """Walk over the whole frames of a datagram by magic and length, without checking them."""
    at, end = 0, len(data)
    while at + 2 < end:
        if data[at] == V2 and not data[at + 2]:
            stop = at + 12 + data[at + 1]
        else:
            at = _seek(data, at)
            stop = _header(data, at)[1]
        if stop <= end:
            yield data[at:stop]
            at = stop
        else:
            at = _seek(data, at + 1)


def _seek(data: bytes, at: int) -> int:
    """Find the first byte from `at` on that could start a frame, or the end."""
    found = _MAGIC.search(data, at)
    return found.start() if found else len(data)


def _header(data: bytes, at: int) -> tuple[int, int, int, int, int, int, int]:
    """Read whatever is at `at`: payload start, frame end, id, payload length, flags, seq, source.

    Bytes that have not come yet read as zero; the end of the frame then lies beyond the data.
    """
    head = data[at : at + 12].ljust(12, b"\0")
    if head[0] == V1:
        length, seq, source, number = struct.unpack_from("<xBBHB", head)
        return at + 6, at + 8 + length, number, length, 0, seq, source
    magic, length, flags, seq, source, number = struct.unpack_from("<BBBxBHI", head)
    if magic != V2:
        return at, at + 1, _GARBAGE, 0, 0, 0, 0
    stop = at + 12 + length + (_SIGNATURE_LENGTH if flags & _SIGNED else 0)
    number = _UNREADABLE if flags > _SIGNED else number & 0xFFFFFF
    return at + 10, stop, number, length, flags, seq, source


def _starts_with_frame(data: bytes) -> bool:
    """Whether the data starts with a whole frame of a known id with a right CRC."""
    first = next(split(data), b"")
    probe = Parser(())
    probe.feed(first)
    return probe.stats.frames == 1 and data.startswith(first)
