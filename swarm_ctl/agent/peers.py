"""The peers a vehicle can hear: measured by its radio, or told by beacons in a shared frame."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from swarm_ctl.agent.beacon import Beacon
from swarm_ctl.agent.frame import Shift
from swarm_ctl.agent.params import RangingParams
from swarm_ctl.agent.track import Track
from swarm_ctl.autopilot.telemetry import PeerFix
from swarm_ctl.model import Vec3

MET_S = 0.3
"""Fix and beacon this young belong together: in this time a vehicle moves a footprint's part."""
FRESH_S = 1.0
"""A peer silent for longer is out of range (ALGORITHM 3.4: seen in the last second)."""
BLIND_SIGMA_M = 0.5
"""A peer that is heard but not measured, as behind a blind angle, is known as long as this."""
KEPT_S = 3.0
"""A track whose last fix is older begins anew."""
LATENCY_S = 0.1
"""From a peer's position to its beacon here, about one tick; a velocity bridges it."""
STRANGE_S = 5.0
"""For so long after another mission's beacon nobody of that sysid is ours: it may be two."""
AGREE_M = 2.0
"""What the radio measures and what a peer tells may differ by so much, level, and mean the same."""


USUAL_M = 0.2
"""Being wrong by so much is what the separation has room for: contact is at 0.6 m, not at 1 m."""
DOUBT_SIGMAS = 3.0
MOST_DOUBT_M = 0.5
"""However little is known, no more is kept: vehicles that start side by side, or meet in a door,
would push each other back for ever; and 1.5 m apart, both stop in time from 1 m/s."""


class Neighbour(NamedTuple):
    """Where a peer is now, and how it moves."""

    offset_ned_m: Vec3
    """From this vehicle to the peer."""
    velocity_ned_m_s: Vec3
    """Zero when nothing is known of it."""
    doubt_m: float = 0.0
    """How much nearer than told by `offset_ned_m` it may be, beyond what is usual."""


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
    """One peer in this vehicle's own local frame: its track and its last beacon, if any."""

    track: Track | None = None
    """What the fixes tell; None before the first one."""
    beacon: Beacon | None = None
    beacon_s: float = -math.inf
    shift: Shift | None = None
    """From its frame into the own one, as of the last beacon; None when nothing is shared."""

    def is_known(self, now: float) -> bool:
        """Whether its place was measured, or told in a shared frame, just now."""
        is_told = now - self.beacon_s <= FRESH_S
        return (is_told and self.shift is not None) or self._is_tracked(now, is_told=is_told)

    def _is_tracked(self, now: float, *, is_told: bool) -> bool:
        """Whether it was measured just now, or tells well enough how it has moved since then."""
        if self.track is None:
            return False
        return now - self.track.fixed_s <= FRESH_S or (
            is_told and self.track.at(now)[2] <= BLIND_SIGMA_M
        )

    def measured(self, own: Vec3, now: float) -> Neighbour | None:
        """Give where its track leads to; the nearer of two places while fixes disagree with it."""
        if self.track is None or not self._is_tracked(now, is_told=now - self.beacon_s <= FRESH_S):
            return None
        place, velocity, sigma_m = self.track.at(now)
        offset, rival = _minus(place, own), self.track.rival_at(now)
        if rival is not None:
            offset = min(offset, _minus(rival, own), key=lambda way: math.hypot(*way))
        return Neighbour(offset, velocity, doubt_m(DOUBT_SIGMAS * sigma_m))

    def told(self, own: Vec3, now: float, acceleration_m_s2: float) -> Neighbour | None:
        """Move it on from where it said it was; as near in height as its height is doubtful."""
        if self.beacon is None or self.shift is None or now - self.beacon_s > FRESH_S:
            return None
        age_s = now - self.beacon_s
        place = _plus(_there(self.beacon, age_s), self.shift.offset_m)
        x, y, z = _minus(place, own)
        certain = math.copysign(max(0.0, abs(z) - self.shift.height_doubt_m), z)
        turned_m = 0.5 * acceleration_m_s2 * age_s * age_s
        return Neighbour(Vec3(x, y, certain), self.beacon.velocity_ned_m_s, doubt_m(turned_m))

    def meeting(self, sysid: int, now: float) -> Meeting | None:
        """Give its place in both frames just now: as measured, else as told."""
        if self.beacon is None or now - self.beacon_s > MET_S:
            return None
        there = _there(self.beacon, now - self.beacon_s)
        if self.track is not None and now - self.track.fixed_s <= MET_S:
            return Meeting(sysid, self.beacon, there, self.track.at(now)[0])
        if self.shift is None:
            return None
        return Meeting(sysid, self.beacon, there, _plus(there, self.shift.offset_m))


class PeerTable:
    """Everybody this vehicle has heard."""

    def __init__(
        self, ranging: RangingParams | None = None, acceleration_m_s2: float = 2.0
    ) -> None:
        """Take how well the radio measures, and what peers can brake with."""
        self.unread = 0
        """Beacons of another build of this program, or broken."""
        self._ranging = ranging or RangingParams()
        self._acceleration_m_s2 = acceleration_m_s2
        self._peers: dict[int, Peer] = {}
        self._contacts: set[int] = set()
        self._doubted: set[int] = set()
        self._strange_s: dict[int, float] = {}

    def fix(self, fixes: Iterable[PeerFix], own_ned_m: Vec3, own_m_s: Vec3, now: float) -> None:
        """Take what the radio has measured, from where the vehicle was then."""
        for sysid, offset, measured_s in fixes:
            peer = self._peers.setdefault(sysid, Peer())
            place = _plus(_moved(own_ned_m, own_m_s, measured_s - now), offset)
            variance_m2 = self._ranging.variance_m2(math.hypot(*offset))
            if peer.track is not None and now - peer.track.fixed_s <= KEPT_S:
                peer.track.fix(place, variance_m2, measured_s, now)
                continue
            peer.track = Track(place, variance_m2, measured_s, self._acceleration_m_s2)
            if peer.beacon is not None and now - peer.beacon_s <= FRESH_S:
                peer.track.hear(peer.beacon, now)

    def beacon(self, sysid: int, beacon: Beacon, now: float, shift: Shift | None = None) -> None:
        """Take a beacon, also of a peer that was never measured.

        `shift` leads from the peer's frame into the own one; None when they share nothing.
        """
        if now - self._strange_s.get(sysid, -math.inf) < STRANGE_S:
            return
        self._strange_s.pop(sysid, None)
        peer = self._peers.setdefault(sysid, Peer())
        peer.beacon, peer.beacon_s, peer.shift = beacon, now, shift
        if peer.track is not None:
            peer.track.hear(beacon, now)

    def estrange(self, sysid: int, now: float) -> None:
        """Note that a vehicle flies another mission: it is measured, but not listened to."""
        self._strange_s[sysid] = now
        if (peer := self._peers.get(sysid)) is not None:
            peer.beacon, peer.beacon_s, peer.shift = None, -math.inf, None

    def is_strange(self, sysid: int) -> bool:
        """Whether the last that it told was of another mission."""
        return sysid in self._strange_s

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
        return [_safest(*self._places(peer, own_ned_m, now)) for peer in peers]

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
            if sysid in self._doubted or peer.shift is None:
                continue
            measured, told = self._places(peer, own_ned_m, now)
            if measured is None or told is None:
                continue
            if (apart_m := _apart_m(measured, told)) > AGREE_M:
                self._doubted.add(sysid)
                found.append((sysid, apart_m))
        return found

    def _places(
        self, peer: Peer, own: Vec3, now: float
    ) -> tuple[Neighbour | None, Neighbour | None]:
        """Give where a peer was measured, and where it says it is."""
        return peer.measured(own, now), peer.told(own, now, self._acceleration_m_s2)


def doubt_m(error_m: float) -> float:
    """Give what is to be kept beside the separation from a peer that may be so far off."""
    return min(max(error_m - USUAL_M, 0.0), MOST_DOUBT_M)


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
