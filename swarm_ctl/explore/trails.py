"""What vehicles tell each other of where they have been: append-only logs, one per origin.

Every log is written by one vehicle, in its own frame, and copied by all others; a copy is always a
prefix. That makes the logs a CRDT: pieces may be lost, doubled or reordered, and whoever has heard
the same entries knows the same. A vehicle that begins anew, in a frame that begins elsewhere and
knowing nothing of what it wrote before, begins another log; what others have of the first one stays
true, and where it was. Rasters are never exchanged: between frames that are not aligned to a cell
they would grow by half a cell at every hop (ALGORITHM 2.6).
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import NamedTuple

from swarm_ctl.explore.contacts import MOST_ORIGINS, Contacts
from swarm_ctl.explore.pieces import (
    LINE,
    MOST_ENTRIES,
    VERSION,
    Entry,
    Piece,
    Shift,
    decode,
    encode,
    points,
    read_summary,
    varint,
)

SUMMARY_BYTES = 80
MOST_BIRTH = 2**20 - 1
MOST_WAITING = 64
"""Pieces per origin that wait for what comes before them."""
FAR_M = 327.67
"""What a shift can say in int16 centimetres; the logs of frames farther off are not passed on."""
STALE_S = 10.0
"""A peer not met for longer may have begun anew elsewhere meanwhile, which takes longer than this:
what it tells has no place until it is met."""


class News(NamedTuple):
    """Entries that were not known before, and how to read them."""

    shift_m: Shift
    before_cm: tuple[int, ...] | None
    """The last point of the trail that the entries go on from."""
    kinds: Sequence[int]
    numbers_cm: Sequence[int]
    """Their points, one after the other."""


class _Log:
    """The prefix that is known of one origin's log: seven bytes an entry, as there are many."""

    def __init__(self) -> None:
        self.kinds = bytearray()
        self.numbers_cm = array("h")
        """The points of all entries, one after the other."""
        self.last_cm: tuple[int, ...] | None = None
        self.shift_m: Shift | None = None
        self.waiting: dict[int, Piece] = {}

    def __len__(self) -> int:
        return len(self.kinds)

    def extend(self, kinds: Sequence[int], numbers_cm: Sequence[int], shift_m: Shift) -> News:
        news = News(shift_m, self.last_cm, kinds, numbers_cm)
        self.kinds.extend(kinds)
        self.numbers_cm.extend(numbers_cm)
        dimensions = len(numbers_cm) // len(kinds)
        for at in range(len(kinds) - 1, -1, -1):
            if kinds[at] <= LINE:
                self.last_cm = tuple(numbers_cm[at * dimensions : (at + 1) * dimensions])
                break
        return news


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
        self._contacts = Contacts()
        self._turn = 0

    # -- one's own log -------------------------------------------------------------------------

    def append(self, kind: int, point_m: Sequence[float]) -> None:
        """Write a line into one's own log; what int16 centimetres cannot say is left out."""
        own = self._logs[self.own]
        point = tuple(round(value * 100.0) for value in point_m)
        if len(own) < MOST_ENTRIES and all(abs(value) <= 32767 for value in point):
            own.extend([kind], point, ())
            self._contacts.offer(self.own, len(own))

    def length(self, origin: int) -> int:
        """Tell how many entries of an origin's log are known."""
        return len(self._logs[origin]) if origin in self._logs else 0

    def entries(self, origin: int) -> Sequence[Entry]:
        """Give what is known of an origin's log."""
        log = self._logs.get(origin, _Log())
        return tuple(map(Entry, log.kinds, points(log.numbers_cm, self._dimensions)))

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
            while begin < len(log):
                data, count = encode(origin, begin, log.shift_m or (), log.kinds, log.numbers_cm)
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
        self._contacts.meet(sysid, now, shift_m)

    def summary(self) -> bytes:
        """Tell what is known, at most SUMMARY_BYTES: own log first, the others take turns."""
        packed = bytearray([VERSION])
        origins = list(self._logs)
        others = origins[1:]
        turn = self._turn % len(others) if others else 0
        for told, origin in enumerate([self.own, *others[turn:], *others[:turn]]):
            pair = varint(origin) + varint(len(self._logs[origin].kinds))
            if len(packed) + len(pair) > SUMMARY_BYTES:
                self._turn += told - 1
                break
            packed += pair
        return bytes(packed)

    def hear_summary(self, sysid: int, data: bytes) -> None:
        """Take what a peer says it knows."""
        pairs = read_summary(data)
        if pairs is None:
            self.malformed += 1
            return
        peer = self._contacts.hear_summary(sysid, pairs) if pairs else None
        if peer is None or peer.shift_m is None:
            return
        origin = pairs[0][0]
        log = self._logs.get(origin)
        if log is not None and origin != self.own:
            log.shift_m = peer.shift_m
            self._offer(origin, log)

    # -- pieces --------------------------------------------------------------------------------

    def outbox(self, most: int, now: float) -> list[bytes]:
        """Give at most `most` payloads with what peers in contact lack, the largest lack first."""
        payloads: list[bytes] = []
        for lack in self._contacts.lacks(most, now):
            if len(payloads) == most:
                break
            begin, log = lack.begin, self._logs[lack.origin]
            while begin < len(log) and len(payloads) < most:
                data, count = encode(
                    lack.origin, begin, log.shift_m or (), log.kinds, log.numbers_cm
                )
                payloads.append(data)
                begin += count
            self._contacts.sent(lack, begin, now)
        return payloads

    def hear_chunk(self, sysid: int, data: bytes, now: float) -> list[News]:
        """Take a piece from a peer: what of it is new, in order; idempotent."""
        piece = decode(data, self._dimensions)
        if piece is None:
            self.malformed += 1
            return []
        peer = self._contacts.get(sysid)
        is_placed = peer is not None and now - peer.heard_s <= STALE_S
        if peer is None or not is_placed or peer.shift_m is None or self._is_full:
            self.dropped += 1
            return []
        self._contacts.hear_piece(peer, piece.origin, piece.end)
        if piece.origin == self.own:
            return []
        shift_m = peer.shift_m
        if piece.origin != peer.origin:
            shift_m = tuple(
                [own + cm / 100.0 for own, cm in zip(shift_m, piece.shift_cm, strict=True)]
            )
        return self._merge(piece, shift_m)

    @property
    def _is_full(self) -> bool:
        return len(self._logs) > MOST_ORIGINS

    def _merge(self, piece: Piece, shift_m: Shift) -> list[News]:
        log = self._logs.setdefault(piece.origin, _Log())
        log.shift_m = shift_m
        if len(log.waiting) >= MOST_WAITING:
            self.dropped += 1
        elif piece.end > len(log):
            held = log.waiting.get(piece.begin)
            if held is None or held.end < piece.end:
                log.waiting[piece.begin] = piece
        news = []
        for begin in sorted(log.waiting):
            if begin > len(log):
                break
            kinds, numbers_cm = log.waiting.pop(begin).beyond(len(log))
            if kinds and len(log) + len(kinds) <= MOST_ENTRIES:
                news.append(log.extend(kinds, numbers_cm, shift_m))
        self._offer(piece.origin, log)
        return news

    def _offer(self, origin: int, log: _Log) -> None:
        """Let peers be told of a log, unless its frame is unknown or too far off."""
        is_near = log.shift_m is not None and max(map(abs, log.shift_m)) <= FAR_M
        self._contacts.offer(origin, len(log) if is_near else 0)


def log_of(sysid: int, birth: int) -> int:
    """Give the number of the log that a vehicle began at a birth, 0 to MOST_BIRTH.

    At birth 0 it is the sysid, which has 8 bits in MAVLink, and travels in one byte.
    """
    return (birth & MOST_BIRTH) << 8 | sysid
