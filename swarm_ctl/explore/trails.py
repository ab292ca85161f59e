"""What vehicles tell each other of where they have been: append-only logs, one per origin.

Every log is written by one vehicle, in its own frame, and copied by all others; a copy is always a
prefix. That makes the logs a CRDT: pieces may be lost, doubled or reordered, and whoever has heard
the same entries knows the same. A vehicle that begins anew, in a frame that begins elsewhere and
knowing nothing of what it wrote before, begins another log; what others have of the first one stays
true, and where it was. Rasters are never exchanged: between frames that are not aligned to a cell
they would grow by half a cell at every hop (ALGORITHM 2.6).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

START, LINE, WALL_X, WALL_Y, WALL_Z = range(5)
"""Kinds of entries: a trail begins; goes on straight from its last point; walls by their axis."""

PAYLOAD_BYTES = 120
SUMMARY_BYTES = 80
MOST_ENTRIES = 20_000
"""Per origin; 20 minutes of the densest trail. More is somebody's mistake."""
MOST_ORIGINS = 250
MOST_BIRTH = 2**20 - 1
MOST_WAITING = 64
"""Pieces per origin that wait for what comes before them."""
FAR_M = 327.67
"""What a shift can say in int16 centimetres; the logs of frames farther off are not passed on."""
CONTACT_S = 3.0
"""A peer met so lately is told what it lacks. Batch trials meet once a second: where 70 % of all
beacons get lost, they explore a point less with 1.5 s."""
STALE_S = 10.0
"""A peer not met for longer may have begun anew elsewhere meanwhile, which takes longer than this:
what it tells has no place until it is met."""
RESEND_S = 0.8
"""What was sent and not acknowledged by a summary for so long is sent again."""

_VERSION = 1

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
    entries: list[Entry]


class News(NamedTuple):
    """Entries that were not known before, and how to read them."""

    shift_m: Shift
    before_cm: tuple[int, ...] | None
    """The last point of the trail that the entries go on from."""
    entries: list[Entry]


class _Log:
    """The prefix that is known of one origin's log."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self.last_cm: tuple[int, ...] | None = None
        self.shift_m: Shift | None = None
        self.waiting: dict[int, Piece] = {}

    def extend(self, entries: Sequence[Entry], shift_m: Shift) -> News:
        news = News(shift_m, self.last_cm, list(entries))
        self.entries.extend(entries)
        for entry in entries:
            if entry.kind <= LINE:
                self.last_cm = entry.point_cm
        return news


class _Peer:
    """What this vehicle knows of one that it has heard."""

    def __init__(self) -> None:
        self.origin: int | None = None
        """The log that it writes; None until it has told."""
        self.heard_s = -math.inf
        self.shift_m: Shift | None = None
        self.known: dict[int, int] = {}
        self.sent: dict[int, tuple[int, float]] = {}

    def writes(self, origin: int) -> None:
        """Note whose log it writes: when that is another one, it has begun anew elsewhere."""
        if self.origin not in {None, origin}:
            self.shift_m = None
            self.known, self.sent = {}, {}
        self.origin = origin

    def has(self, origin: int, now: float) -> int:
        """Give how much of a log it has, counting what is on its way."""
        known = self.known.get(origin, 0)
        length, sent_s = self.sent.get(origin, (0, -math.inf))
        return max(known, length) if now - sent_s < RESEND_S else known


class Trails:
    """The logs of all origins that one vehicle knows of, and what its peers know of them."""

    def __init__(self, sysid: int, dimensions: int, birth: int = 0) -> None:
        """Begin a log; `birth` tells it from those that the same vehicle has begun before."""
        self.sysid = sysid
        self.own = log_of(sysid, birth)
        """The own log among all origins."""
        self.malformed = 0
        """Summaries and pieces that were none."""
        self.dropped = 0
        """Pieces of vehicles whose frame was not known yet, or too far ahead to wait."""
        self._dimensions = dimensions
        self._logs: dict[int, _Log] = {self.own: _Log()}
        self._logs[self.own].shift_m = (0.0,) * dimensions
        self._peers: dict[int, _Peer] = {}
        self._turn = 0

    # -- one's own log -------------------------------------------------------------------------

    def append(self, kind: int, point_m: Sequence[float]) -> None:
        """Write a line into one's own log; what int16 centimetres cannot say is left out."""
        own = self._logs[self.own]
        point = tuple(round(value * 100.0) for value in point_m)
        if len(own.entries) < MOST_ENTRIES and all(abs(value) <= 32767 for value in point):
            own.extend([Entry(kind, point)], ())

    def length(self, origin: int) -> int:
        """Tell how many entries of an origin's log are known."""
        return len(self._logs[origin].entries) if origin in self._logs else 0

    def entries(self, origin: int) -> Sequence[Entry]:
        """Give what is known of an origin's log."""
        return tuple(self._logs[origin].entries) if origin in self._logs else ()

    def last_m(self, origin: int) -> list[float]:
        """Give the last point of an origin's trail, in its own frame, m; empty before the first."""
        log = self._logs.get(origin)
        return [cm / 100.0 for cm in log.last_cm] if log and log.last_cm else []

    # -- what outlives this process ------------------------------------------------------------

    def beyond(self, known: dict[int, int]) -> list[bytes]:
        """Give what is known beyond these lengths, packed as for peers, and move them on."""
        payloads = []
        for origin, log in self._logs.items():
            begin = known.get(origin, 0)
            while begin < len(log.entries):
                data, count = encode(origin, begin, log.shift_m or (), log.entries)
                payloads.append(data)
                begin += count
            known[origin] = begin
        return payloads

    def read_back(self, data: bytes) -> list[News]:
        """Take a payload that `beyond` gave once, of the own log as well."""
        piece = decode(data, self._dimensions)
        if piece is None:
            self.malformed += 1
            return []
        return self._merge(piece, tuple(cm / 100.0 for cm in piece.shift_cm))

    # -- contacts ------------------------------------------------------------------------------

    def meet(self, sysid: int, now: float, shift_m: Shift) -> None:
        """Note that a peer is in radio range, and where its frame is in one's own."""
        peer = self._peer(sysid)
        if peer is not None:
            peer.heard_s, peer.shift_m = now, shift_m

    def summary(self) -> bytes:
        """Tell what is known, at most SUMMARY_BYTES: own log first, the others take turns."""
        packed = bytearray([_VERSION])
        origins = list(self._logs)
        others = origins[1:]
        turn = self._turn % len(others) if others else 0
        for told, origin in enumerate([self.own, *others[turn:], *others[:turn]]):
            pair = _varint(origin) + _varint(len(self._logs[origin].entries))
            if len(packed) + len(pair) > SUMMARY_BYTES:
                self._turn += told - 1
                break
            packed += pair
        return bytes(packed)

    def hear_summary(self, sysid: int, data: bytes) -> None:
        """Take what a peer says it knows."""
        pairs = _pairs(data)
        peer = self._peer(sysid)
        if pairs is None:
            self.malformed += 1
        elif peer is not None and pairs:
            peer.writes(pairs[0][0])
            peer.known.update(pairs[:MOST_ORIGINS])
            log = self._logs.get(pairs[0][0])
            if log is not None and pairs[0][0] != self.own and peer.shift_m is not None:
                log.shift_m = peer.shift_m

    # -- pieces --------------------------------------------------------------------------------

    def outbox(self, most: int, now: float) -> list[bytes]:
        """Give at most `most` payloads with what peers in contact lack, the largest lack first."""
        near = [
            peer
            for peer in self._peers.values()
            if peer.origin is not None and now - peer.heard_s <= CONTACT_S
        ]
        lacks = []
        for origin, log in self._logs.items():
            if near and log.shift_m is not None and max(map(abs, log.shift_m)) <= FAR_M:
                length = len(log.entries)
                if all(peer.known.get(origin, 0) >= length for peer in near):
                    continue  # as with most logs, most of the time
                begin = min(peer.has(origin, now) for peer in near)
                if begin < length:
                    lacks.append((begin - length, origin, begin))
        payloads: list[bytes] = []
        for _, origin, start in sorted(lacks):
            begin = start
            log = self._logs[origin]
            while begin < len(log.entries) and len(payloads) < most:
                data, count = encode(origin, begin, log.shift_m or (), log.entries)
                payloads.append(data)
                begin += count
            for peer in near:
                if start <= peer.has(origin, now) < begin:
                    peer.sent[origin] = (begin, now)
        return payloads

    def hear_chunk(self, sysid: int, data: bytes, now: float) -> list[News]:
        """Take a piece from a peer: what of it is new, in order; idempotent."""
        piece = decode(data, self._dimensions)
        if piece is None:
            self.malformed += 1
            return []
        peer = self._peers.get(sysid)
        is_placed = peer is not None and now - peer.heard_s <= STALE_S
        if peer is None or not is_placed or peer.shift_m is None or self._is_full:
            self.dropped += 1
            return []
        peer.known[piece.origin] = max(
            peer.known.get(piece.origin, 0), piece.begin + len(piece.entries)
        )
        if piece.origin == self.own:
            return []
        shift = tuple(
            own + cm / 100.0 for own, cm in zip(peer.shift_m, piece.shift_cm, strict=True)
        )
        return self._merge(piece, peer.shift_m if piece.origin == peer.origin else shift)

    @property
    def _is_full(self) -> bool:
        return len(self._logs) > MOST_ORIGINS

    def _merge(self, piece: Piece, shift_m: Shift) -> list[News]:
        log = self._logs.setdefault(piece.origin, _Log())
        log.shift_m = shift_m
        if len(log.waiting) >= MOST_WAITING:
            self.dropped += 1
        else:
            held = log.waiting.get(piece.begin)
            if held is None or len(held.entries) < len(piece.entries):
                log.waiting[piece.begin] = piece
        news = []
        for begin in sorted(log.waiting):
            if begin > len(log.entries):
                break
            fresh = log.waiting.pop(begin).entries[len(log.entries) - begin :]
            if fresh and len(log.entries) + len(fresh) <= MOST_ENTRIES:
                news.append(log.extend(fresh, shift_m))
        return news

    def _peer(self, sysid: int) -> _Peer | None:
        if sysid not in self._peers and len(self._peers) >= MOST_ORIGINS:
            return None
        return self._peers.setdefault(sysid, _Peer())


def log_of(sysid: int, birth: int) -> int:
    """Give the number of the log that a vehicle began at a birth, 0 to MOST_BIRTH.

    At birth 0 it is the sysid, which has 8 bits in MAVLink, and travels in one byte.
    """
    return (birth & MOST_BIRTH) << 8 | sysid


def encode(origin: int, begin: int, shift_m: Shift, entries: Sequence[Entry]) -> tuple[bytes, int]:
    """Pack as many entries from `begin` on as a payload takes; give it and their number.

    Version and dimensions, origin, begin, shift, count, kinds (half a byte each), points.
    """
    dimensions = len(shift_m)
    head = bytes([_VERSION << 4 | dimensions]) + _varint(origin) + _varint(begin)
    shift = (max(-32767, min(32767, round(value * 100.0))) for value in shift_m)
    head += struct.pack(f"<{dimensions}h", *shift)
    room = PAYLOAD_BYTES - len(head) - 2
    chosen = entries[begin : begin + 2 * room // (4 * dimensions + 1)]
    kinds = [entry.kind for entry in chosen] + [0] * (len(chosen) % 2)
    packed = bytes(low | high << 4 for low, high in zip(kinds[::2], kinds[1::2], strict=True))
    points = [value for entry in chosen for value in entry.point_cm]
    data = head + bytes([len(chosen)]) + packed + struct.pack(f"<{len(points)}h", *points)
    return data, len(chosen)


def decode(data: bytes, dimensions: int) -> Piece | None:
    """Read a payload; None when it is none of ours or broken."""
    try:
        if data[0] != _VERSION << 4 | dimensions:
            return None
        origin, at = _read_varint(data, 1)
        begin, at = _read_varint(data, at)
        shift = struct.unpack_from(f"<{dimensions}h", data, at)
        at += 2 * dimensions
        count = data[at]
        kinds = data[at + 1 : at + 1 + (count + 1) // 2]
        numbers = struct.unpack_from(f"<{count * dimensions}h", data, at + 1 + len(kinds))
    except (IndexError, ValueError, struct.error):
        return None
    entries = []
    for index in range(count):
        kind = kinds[index // 2] >> 4 * (index % 2) & 15
        if kind > WALL_Z:
            return None
        entries.append(Entry(kind, numbers[index * dimensions : (index + 1) * dimensions]))
    return Piece(origin, begin, shift, entries) if begin <= MOST_ENTRIES else None


def _pairs(summary: bytes) -> list[tuple[int, int]] | None:
    try:
        numbers = list(_varints(summary[1:]))
        pairs = list(zip(numbers[::2], numbers[1::2], strict=True))
    except (IndexError, ValueError):
        return None
    return pairs if summary[:1] == bytes([_VERSION]) else None


def _varint(number: int) -> bytes:
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
