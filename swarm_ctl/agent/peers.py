"""The peers a vehicle can hear: measured by its radio, or told by beacons in a shared frame."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from swarm_ctl.agent.beacon import Beacon
from swarm_ctl.agent.frame import Shift
from swarm_ctl.autopilot.telemetry import PeerFix
from swarm_ctl.model import ZERO, Vec3

MET_S = 0.3
"""Fix and beacon this young belong together: in this time a vehicle moves a footprint's part."""
FRESH_S = 1.0
"""A peer silent for longer is out of range (ALGORITHM 3.4: seen in the last second)."""
LATENCY_S = 0.1
"""From a peer's position to its beacon here, about one tick; a velocity bridges it."""
AGREE_M = 2.0
"""What the radio measures and what a peer tells may differ by so much, level, and mean the same."""


class Neighbour(NamedTuple):
    """Where a peer is now, and how it moves."""

    offset_ned_m: Vec3
    """From this vehicle to the peer."""
    velocity_ned_m_s: Vec3
    """Zero when it has not told."""


class Meeting(NamedTuple):
    """One place in two frames: where a peer is."""

    sysid: int
    beacon: Beacon
    there_ned_m: Vec3
    """In the peer's own frame."""
    here_ned_m: Vec3
    """In this vehicle's own frame."""


@dataclass(slots=True)
class Peer:
    """One peer in this vehicle's own local frame: its last fix and its last beacon, if any."""

    position_ned_m: Vec3 = ZERO
    fixed_s: float = -math.inf
    beacon: Beacon | None = None
    beacon_s: float = -math.inf
    shift: Shift | None = None
    """From its frame into the own one, as of the last beacon; None when nothing is shared."""

    def is_known(self, now: float) -> bool:
        """Whether its place was measured, or told in a shared frame, just now."""
        is_told = self.shift is not None and now - self.beacon_s <= FRESH_S
        return is_told or now - self.fixed_s <= FRESH_S

    def measured(self, own: Vec3, now: float) -> Neighbour | None:
        """Move it on from its last fix, at the velocity it told if that is fresh."""
        if now - self.fixed_s > FRESH_S:
            return None
        has_told = self.beacon is not None and now - self.beacon_s <= FRESH_S
        velocity = self.beacon.velocity_ned_m_s if self.beacon and has_told else ZERO
        place = _moved(self.position_ned_m, velocity, now - self.fixed_s)
        return Neighbour(_minus(place, own), velocity)

    def told(self, own: Vec3, now: float) -> Neighbour | None:
        """Move it on from where it said it was; as near in height as its height is doubtful."""
        if self.beacon is None or self.shift is None or now - self.beacon_s > FRESH_S:
            return None
        place = _plus(_there(self.beacon, now - self.beacon_s), self.shift.offset_m)
        x, y, z = _minus(place, own)
        certain = math.copysign(max(0.0, abs(z) - self.shift.height_doubt_m), z)
        return Neighbour(Vec3(x, y, certain), self.beacon.velocity_ned_m_s)

    def meeting(self, sysid: int, now: float) -> Meeting | None:
        """Give its place in both frames just now: as measured, else as told."""
        if self.beacon is None or now - self.beacon_s > MET_S:
            return None
        if now - self.fixed_s <= MET_S:
            there = _there(self.beacon, self.fixed_s - self.beacon_s)
            return Meeting(sysid, self.beacon, there, self.position_ned_m)
        if self.shift is None:
            return None
        there = _there(self.beacon, now - self.beacon_s)
        return Meeting(sysid, self.beacon, there, _plus(there, self.shift.offset_m))


class PeerTable:
    """Everybody this vehicle has heard."""

    def __init__(self) -> None:
        self.unread = 0
        """Beacons of another build of this program, or broken."""
        self._peers: dict[int, Peer] = {}
        self._contacts: set[int] = set()
        self._doubted: set[int] = set()

    def fix(self, fixes: Iterable[PeerFix], own_ned_m: Vec3, now: float) -> None:
        """Take what the radio measured just now."""
        for sysid, offset in fixes:
            peer = self._peers.setdefault(sysid, Peer())
            peer.position_ned_m = _plus(own_ned_m, offset)
            peer.fixed_s = now

    def beacon(self, sysid: int, beacon: Beacon, now: float, shift: Shift | None = None) -> None:
        """Take a beacon, also of a peer that was never measured.

        `shift` leads from the peer's frame into the own one; None when they share nothing.
        """
        peer = self._peers.setdefault(sysid, Peer())
        peer.beacon, peer.beacon_s, peer.shift = beacon, now, shift

    def is_ours(self, sysid: int) -> bool:
        """Whether a peer's beacon of our mission has been heard."""
        peer = self._peers.get(sysid)
        return peer is not None and peer.beacon is not None

    def near(self, own_ned_m: Vec3, now: float) -> list[Neighbour]:
        """Give every peer whose place is known, dead-reckoned to now, ordered by sysid.

        A fix wins over what the peer tells: it is measured, while two estimates may have drifted.
        Where the two are at odds the nearer one wins, which is safe.
        """
        peers = (self._peers[sysid] for sysid in self.heard(now))
        return [_safest(peer.measured(own_ned_m, now), peer.told(own_ned_m, now)) for peer in peers]

    def heard(self, now: float) -> tuple[int, ...]:
        """Give the sysids of peers whose place is known, in order."""
        return tuple(sorted(sysid for sysid, peer in self._peers.items() if peer.is_known(now)))

    def met(self, now: float) -> list[Meeting]:
        """Give the peers whose place is known in both frames just now, by sysid."""
        meetings = (peer.meeting(sysid, now) for sysid, peer in sorted(self._peers.items()))
        return [meeting for meeting in meetings if meeting is not None]

    def contacts(self, now: float) -> tuple[list[int], list[int]]:
        """Tell who came into range and who was lost since the last call."""
        heard = set(self.heard(now))
        gained, lost = sorted(heard - self._contacts), sorted(self._contacts - heard)
        self._contacts = heard
        return gained, lost

    def doubts(self, own_ned_m: Vec3, now: float) -> list[tuple[int, float]]:
        """Tell, once for each peer, who is measured elsewhere than it says, by how many metres."""
        found = []
        for sysid in self.heard(now):
            peer = self._peers[sysid]
            measured, told = peer.measured(own_ned_m, now), peer.told(own_ned_m, now)
            if sysid in self._doubted or measured is None or told is None:
                continue
            if (apart_m := _apart_m(measured, told)) > AGREE_M:
                self._doubted.add(sysid)
                found.append((sysid, apart_m))
        return found


def _safest(measured: Neighbour | None, told: Neighbour | None) -> Neighbour:
    known = [place for place in (measured, told) if place is not None]
    if len(known) == 2 and _apart_m(*known) > AGREE_M:
        return min(known, key=lambda place: math.hypot(*place.offset_ned_m))
    return known[0]


def _apart_m(one: Neighbour, other: Neighbour) -> float:
    """Give how far apart two places are, level: barometers drift by metres."""
    return math.dist(one.offset_ned_m[:2], other.offset_ned_m[:2])


def _there(beacon: Beacon, age_s: float) -> Vec3:
    """Give where a peer is in its own frame, so long after its beacon came."""
    return _moved(beacon.position_ned_m, beacon.velocity_ned_m_s, age_s + LATENCY_S)


def _moved(place: Vec3, velocity: Vec3, age_s: float) -> Vec3:
    x, y, z = velocity
    return Vec3(place.x + x * age_s, place.y + y * age_s, place.z + z * age_s)


def _plus(one: Vec3, other: Vec3) -> Vec3:
    return Vec3(one.x + other.x, one.y + other.y, one.z + other.z)


def _minus(one: Vec3, other: Vec3) -> Vec3:
    return Vec3(one.x - other.x, one.y - other.y, one.z - other.z)
