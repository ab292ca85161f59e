"""What peers know of the logs of trails, and what those in contact lack."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left, insort
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from swarm_ctl.explore.pieces import Shift

MOST_ORIGINS = 250
CONTACT_S = 3.0
"""A peer met so lately is told what it lacks. Batch trials meet once a second: where 70 % of all
beacons get lost, they explore a point less with 1.5 s."""
RESEND_S = 0.8
"""What was sent and not acknowledged by a summary for so long is sent again."""
MOST_KNOWN = 0xFFFF
"""More entries than any log has."""


class Peer:
    """What this vehicle knows of one that it has heard."""

    __slots__ = ("heard_s", "known", "origin", "sent", "shift_m")

    def __init__(self) -> None:
        self.origin: int | None = None
        """The log that it writes; None until it has told."""
        self.heard_s = -math.inf
        self.shift_m: Shift | None = None
        """Where its frame is in one's own; None until it has been met."""
        self.known = array("H")
        """Entries that it has, by the place of their log in `Contacts`; none beyond the last."""
        self.sent: dict[int, tuple[int, float]] = {}
        """Up to where a log was sent to it lately, and when."""

    def has(self, place: int) -> int:
        """Tell how many entries of a log it has."""
        return self.known[place] if place < len(self.known) else 0

    def learn(self, place: int, length: int) -> None:
        """Take how many entries of a log it has."""
        if place >= len(self.known):
            self.known.extend([0] * (place + 1 - len(self.known)))
        self.known[place] = min(length, MOST_KNOWN)


class Lack(NamedTuple):
    """A log that somebody in contact lacks the end of; sorted, the largest lack comes first."""

    rest: int
    """Less than zero by the number of entries."""
    origin: int
    begin: int
    """The first entry that is lacking, not counting what is on its way."""


class Contacts:
    """The peers, and what those in contact lack; only what may have changed is looked at again.

    Time must not go back.
    """

    def __init__(self) -> None:
        self._peers: dict[int, Peer] = {}
        self._near: dict[int, Peer] = {}
        """Those in contact; the last to be met comes last."""
        self._places: dict[int, int] = {}
        """All logs that were ever told of, numbered: what peers have of each stands in arrays."""
        self._lengths: dict[int, int] = {}
        """Of the logs that may be told."""
        self._lacks: dict[int, Lack] = {}
        self._order: list[Lack] = []
        """The same, sorted."""
        self._stale: set[int] = set()
        """Logs whose lack may have changed."""
        self._on_way: list[tuple[float, int]] = []
        """When which log was sent, until it has to be there."""

    def get(self, sysid: int) -> Peer | None:
        """Give what is known of a peer that has been heard."""
        return self._peers.get(sysid)

    def meet(self, sysid: int, now: float, shift_m: Shift) -> None:
        """Note that a peer is in radio range, and where its frame is in one's own."""
        peer = self._hear(sysid)
        if peer is not None:
            peer.heard_s, peer.shift_m = now, shift_m
            if self._near.pop(sysid, None) is None:
                self._stale.update(self._lengths)
            self._near[sysid] = peer

    def hear_summary(self, sysid: int, pairs: Sequence[tuple[int, int]]) -> Peer | None:
        """Note what a peer says it has; its own log, the first, tells whether it began anew."""
        peer = self._hear(sysid)
        if peer is not None:
            self._write(peer, pairs[0][0])
            for origin, length in pairs[:MOST_ORIGINS]:
                self._know(peer, origin, length)
        return peer

    def hear_piece(self, peer: Peer, origin: int, end: int) -> None:
        """Note that a peer must have what it told."""
        if end > peer.has(self._place(origin)):
            self._know(peer, origin, end)

    def offer(self, origin: int, length: int) -> None:
        """Note how much there is of a log that may be told."""
        if self._lengths.get(origin) != length:
            self._lengths[origin] = length
            self._stale.add(origin)

    def lacks(self, most: int, now: float) -> list[Lack]:
        """Tell of which logs peers in contact lack the end, at most `most` of them."""
        self._part(now)
        on_way, stale = self._on_way, self._stale
        while on_way and not now - on_way[0][0] < RESEND_S:
            _, origin = on_way.pop(0)
            stale.add(origin)
            for peer in self._near.values():
                if origin in peer.sent and not _is_on_way(peer.sent[origin], now):
                    del peer.sent[origin]
        if stale:
            self._look(stale, now)
            stale.clear()
        return self._order[:most]

    def sent(self, lack: Lack, end: int, now: float) -> None:
        """Note that what was lacking of a log is on its way, up to an entry."""
        place = self._place(lack.origin)
        for peer in self._told():
            sent = peer.sent.get(lack.origin, (0, -math.inf))
            if lack.begin <= max(peer.has(place), _on_way(sent, now)) < end:
                peer.sent[lack.origin] = (end, now)
        self._stale.add(lack.origin)
        self._on_way.append((now, lack.origin))

    def _hear(self, sysid: int) -> Peer | None:
        if sysid not in self._peers and len(self._peers) >= MOST_ORIGINS:
            return None
        return self._peers.setdefault(sysid, Peer())

    def _write(self, peer: Peer, origin: int) -> None:
        """Note whose log a peer writes: when that is another one, it has begun anew elsewhere."""
        if peer.origin == origin:
            return
        if peer.origin is not None:
            peer.shift_m = None
            peer.known, peer.sent = array("H"), {}
        peer.origin = origin
        self._stale.update(self._lengths)

    def _place(self, origin: int) -> int:
        return self._places.setdefault(origin, len(self._places))

    def _know(self, peer: Peer, origin: int, length: int) -> None:
        # Where nobody lacks anything, nobody does when one knows more.
        place = self._place(origin)
        if origin in self._lacks or length < peer.has(place):
            self._stale.add(origin)
        peer.learn(place, length)

    def _part(self, now: float) -> None:
        """Leave out who has not been met for long: without it, no log lacks more."""
        gone = []
        for sysid, peer in self._near.items():
            if now - peer.heard_s <= CONTACT_S:
                break
            gone.append(sysid)
        for sysid in gone:
            sent = self._near.pop(sysid).sent
            for origin in [origin for origin in sent if not _is_on_way(sent[origin], now)]:
                del sent[origin]
            self._stale.update(self._lacks)

    def _told(self) -> list[Peer]:
        return [peer for peer in self._near.values() if peer.origin is not None]

    def _look(self, origins: Iterable[int], now: float) -> None:
        """Find anew what those in contact lack of these logs."""
        told = [(peer.known, peer.sent) for peer in self._told()]
        lacks, order, lengths, places = self._lacks, self._order, self._lengths, self._places
        for origin in origins:
            begin = length = lengths.get(origin, 0)
            place = places.setdefault(origin, len(places))
            for known, sent in told:
                has = known[place] if place < len(known) else 0
                if has < begin:
                    if origin in sent:
                        has = max(has, _on_way(sent[origin], now))
                    begin = min(begin, has)
            before = lacks.get(origin)
            lack = Lack(begin - length, origin, begin) if begin < length else None
            if lack == before:
                continue
            if before is not None:
                del order[bisect_left(order, before)], lacks[origin]
            if lack is not None:
                lacks[origin] = lack
                insort(order, lack)


def _is_on_way(sent: tuple[int, float], now: float) -> bool:
    return now - sent[1] < RESEND_S


def _on_way(sent: tuple[int, float], now: float) -> int:
    """Tell up to where a log is on its way that was sent up to an entry at a time."""
    return sent[0] if _is_on_way(sent, now) else 0
