"""Victims that a vehicle has seen, told from peer to peer until everybody in reach knows of them.

A victim is the number that the sensor gives it (LANDING_TARGET's `target_num`), whoever sees it:
places drift apart with the vehicles' own frames, numbers do not. Each vehicle tells which numbers
it knows, and where those lie that a peer in contact has not said it knows; so what is lost is
told again, what is doubled changes nothing, and where nothing is new next to nothing is sent.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from swarm_ctl.agent.beacon import FAR_CM, centimetres, metres
from swarm_ctl.agent.peer import Meeting
from swarm_ctl.agent.phases import BEFORE_START
from swarm_ctl.model import Vec3

VICTIMS_TYPE = 40420
"""TUNNEL payload type, the next after those of `beacon.py`."""
VERSION = 1
AGAIN_S = 0.5
"""Between two tellings of what a peer in contact seems not to know."""
REMIND_S = 5.0
"""Between two tellings when all seem to know: some 10 bytes a second."""
PER_PAYLOAD = 5
"""Reports told at once: a TUNNEL takes 128 bytes."""

_HEAD = struct.Struct("<BB")
"""Version, bytes of the set of known numbers, which follows (bit i: victim i)."""
_REPORT = struct.Struct("<BI3i")
"""Number, finder, place in the teller's own frame, cm."""


class Report(NamedTuple):
    """A victim as it is told."""

    number: int
    """0 to 255, the same for all vehicles."""
    finder: int
    """sysid of the vehicle that saw it."""
    position_ned_m: Vec3
    """In the frame of whoever holds the report."""


class Victims:
    """What one vehicle knows of victims, and what its peers have said they know."""

    def __init__(self, sysid: int) -> None:
        self.seen: dict[int, Vec3] = {}
        """By its own sensor, where it saw each first, in its own frame."""
        self.known: dict[int, Report] = {}
        """Seen or told, in the order in which this vehicle came to know."""
        self.news: list[tuple[int, Report]] = []
        """What was told since somebody last cleared it, and by whom."""
        self.unread = 0
        """Payloads of another build of this program, or broken."""
        self._sysid = sysid
        self._has_told_s = -math.inf
        self._peers: dict[int, int] = {}
        """The numbers that each peer in contact says it knows, as bits."""
        self._turn = 0

    def see(self, number: int, position_ned_m: Vec3) -> bool:
        """Take what the own sensor sees; tell whether this vehicle had known nothing of it.

        Own eyes are more exact than what was told.
        """
        if number in self.seen:
            return False
        self.seen[number] = position_ned_m
        told = self.known.get(number)
        finder = self._sysid if told is None else told.finder
        self._learn(Report(number, finder, position_ned_m))
        return told is None

    def hear(self, sysid: int, payload: bytes, meeting: Meeting | None) -> None:
        """Take what a peer tells; what is new is `news`, in the own frame.

        Nothing is new without a `meeting`, which leads from the peer's frame into the own one.
        """
        message = decode(payload)
        if message is None:
            self.unread += 1
            return
        self._peers[sysid], reports = message
        if meeting is None or meeting.beacon.phase in BEFORE_START:
            return
        here, there = meeting.here_ned_m, meeting.there_ned_m
        for number, finder, told in reports:
            if number not in self.known:
                own = (p + h - t for p, h, t in zip(told, here, there, strict=True))
                report = Report(number, finder, Vec3(*own))
                self.news.append((sysid, report))
                self._learn(report)

    def outgoing(self, contacts: Iterable[int], now: float) -> bytes:
        """Give the payload to broadcast now to the peers in contact; empty when none is due.

        What a peer knew is forgotten with the contact: it may come back with less.
        """
        self._peers = {sysid: self._peers.get(sysid, 0) for sysid in contacts}
        if not self.known or not self._peers:
            return b""
        lacked = self._lacked()
        if now < self._has_told_s + (AGAIN_S if lacked else REMIND_S) - 1e-6:
            return b""
        self._has_told_s = now
        turn = self._turn % max(len(lacked), 1)
        self._turn = turn + PER_PAYLOAD
        return encode(self.known, (lacked[turn:] + lacked[:turn])[:PER_PAYLOAD])

    def remember(self, seen: dict[int, Vec3], known: Iterable[Report]) -> None:
        """Go on with what an earlier process knew."""
        self.known = {report.number: report for report in known}
        for number, place in seen.items():
            self.see(number, place)

    def _learn(self, report: Report) -> None:
        self.known[report.number] = report
        self._has_told_s = -math.inf

    def _lacked(self) -> list[Report]:
        """Give the reports that a peer in contact has not said it knows."""
        shared = -1
        for known in self._peers.values():
            shared &= known
        return [report for number, report in self.known.items() if not shared >> number & 1]


def encode(known: Iterable[int], reports: Sequence[Report]) -> bytes:
    """Pack the numbers that are known and at most PER_PAYLOAD reports."""
    numbers = sum(1 << number for number in known)
    told = numbers.to_bytes((numbers.bit_length() + 7) // 8, "little")
    packed = [_HEAD.pack(VERSION, len(told)), told]
    for report in reports[:PER_PAYLOAD]:
        place = centimetres(report.position_ned_m)
        packed.append(_REPORT.pack(report.number, report.finder, *place))
    return b"".join(packed)


def decode(payload: bytes) -> tuple[int, list[Report]] | None:
    """Read what a peer knows, as bits, and its reports; None when it is none of ours or broken."""
    if len(payload) < _HEAD.size:
        return None
    version, size = _HEAD.unpack_from(payload)
    told, packed = payload[_HEAD.size : _HEAD.size + size], payload[_HEAD.size + size :]
    if version != VERSION or len(told) < size or size > 32 or len(packed) % _REPORT.size:
        return None
    reports = []
    for number, finder, *place in _REPORT.iter_unpack(packed):
        if max(map(abs, place)) > FAR_CM:
            return None
        reports.append(Report(number, finder, metres(place)))
    return int.from_bytes(told, "little"), reports
