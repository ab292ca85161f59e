"""The peers a vehicle can hear: measured by its radio, or told by beacons in a shared frame."""

from __future__ import annotations

import math
from collections.abc import Iterable

from swarm_ctl.agent.beacon import MOST_HEARD, Beacon
from swarm_ctl.agent.frame import Shift
from swarm_ctl.agent.params import FlightParams, RangingParams
from swarm_ctl.agent.peer import AGREE_M, FRESH_S, LISTED_S, Meeting, Neighbour, Peer
from swarm_ctl.agent.track import Track
from swarm_ctl.autopilot.telemetry import PeerFix
from swarm_ctl.model import Vec3

KEPT_S = 3.0
"""A track whose last fix is older begins anew."""
STRANGE_S = 5.0
"""For so long after another mission's beacon nobody of that sysid is ours: it may be two."""
OVERTAKEN = 64
"""Frames that a late one may be behind, a few seconds; a sender farther back has begun anew."""


class PeerTable:
    """Everybody this vehicle has heard."""

    def __init__(
        self,
        ranging: RangingParams | None = None,
        flight: FlightParams | None = None,
        *,
        sysid: int = 0,
    ) -> None:
        """Take how well the radio measures, how peers fly, and the own sysid."""
        flight = flight or FlightParams()
        self.unread = 0
        """Beacons of another build of this program, or broken."""
        self._sysid = sysid
        self._ranging = ranging or RangingParams()
        self._flown = flight.acceleration_m_s2, flight.speed_m_s
        self._peers: dict[int, Peer] = {}
        self._fresh: dict[int, Peer] = {}
        """Those of whom anything was heard or measured within `FRESH_S`, and no longer ago than
        the last look: nobody else can be known, however many were met."""
        self._silent: list[Peer] | None = None
        """Who is no longer heard but may still be near; None when that has to be found out."""
        self._contacts: tuple[int, ...] = ()
        self._heard: tuple[int, ...] = ()
        self._heard_s = math.nan
        self._turn = 0
        self._doubted: set[int] = set()
        self._strange_s: dict[int, float] = {}
        self._last: dict[int, tuple[int, float]] = {}

    def fix(self, fixes: Iterable[PeerFix], own_ned_m: Vec3, own_m_s: Vec3, now: float) -> None:
        """Take what the radio has measured, from where the vehicle was then."""
        self._heard_s = math.nan
        for sysid, (x, y, z), measured_s in fixes:
            peer = self._peer(sysid)
            late = now - measured_s
            place = Vec3(
                own_ned_m.x - late * own_m_s.x + x,
                own_ned_m.y - late * own_m_s.y + y,
                own_ned_m.z - late * own_m_s.z + z,
            )
            variance_m2 = self._ranging.variance_m2(x * x + y * y + z * z)
            if peer.track is not None and now - peer.track.fixed_s <= KEPT_S:
                peer.track.fix(place, variance_m2, measured_s, now)
                continue
            peer.track = Track(place, variance_m2, measured_s, self._flown[0])
            if peer.beacon is not None and now - peer.beacon_s <= FRESH_S:
                peer.track.hear(peer.beacon, now)

    def beacon(
        self,
        sysid: int,
        beacon: Beacon,
        now: float,
        shift: Shift | None = None,
        seq: int | None = None,
        *,
        is_near: bool = True,
    ) -> None:
        """Take a beacon, also of a peer that was never measured.

        `shift` leads from the peer's frame into the own one; None when they share nothing. One
        in a frame whose number `seq` is not newer than the last one's is doubled or overtaken:
        several ways may carry the same frames, each as slow as it is. One that comes over a network
        does not tell that its sender `is_near`.
        """
        if now - self._strange_s.get(sysid, -math.inf) < STRANGE_S:
            return
        last, last_s = self._last.get(sysid, (0, -math.inf))
        if seq is not None:
            if now - last_s <= FRESH_S and (last - seq) & 0xFF <= OVERTAKEN:
                return
            self._last[sysid] = seq, now
        self._strange_s.pop(sysid, None)
        self._heard_s = math.nan
        self._peer(sysid).hear(beacon, shift, now, is_near=is_near)

    def estrange(self, sysid: int, now: float) -> None:
        """Note that a vehicle flies another mission: it is measured, but not listened to."""
        self._strange_s[sysid] = now
        self._heard_s = math.nan
        if (peer := self._peers.get(sysid)) is not None:
            peer.estrange()

    def is_strange(self, sysid: int) -> bool:
        """Whether the last that it told was of another mission."""
        return sysid in self._strange_s

    def is_ours(self, sysid: int) -> bool:
        """Whether a peer's beacon of our mission has been heard."""
        peer = self._peers.get(sysid)
        return peer is not None and peer.beacon is not None

    def near(self, own_ned_m: Vec3, now: float) -> list[Neighbour]:
        """Give every peer whose place is known, dead-reckoned to now, ordered by sysid."""
        return [self._peers[sysid].near(own_ned_m, now) for sysid in self.heard(now)]

    def zones(self, own_ned_m: Vec3, within_m: float, now: float) -> list[Neighbour]:
        """Give where peers may be that fell silent lately, so near to here."""
        heard = self.heard(now)
        if self._silent is None:
            others = (peer for sysid, peer in self._peers.items() if sysid not in heard)
            self._silent = [peer for peer in others if peer.last is not None]
        if not self._silent:
            return []
        zones = [peer.zone(own_ned_m, within_m, now) for peer in self._silent]
        self._silent = [peer for peer in self._silent if peer.last is not None]
        return [zone for zone in zones if zone is not None]

    def heard(self, now: float) -> tuple[int, ...]:
        """Give the sysids of peers whose place is known, in order."""
        if now != self._heard_s:
            known = [sysid for sysid, peer in self._fresh.items() if peer.is_known(now)]
            if len(known) < len(self._fresh):
                fresh = self._fresh.items()
                self._fresh = {sysid: peer for sysid, peer in fresh if peer.is_fresh(now)}
            known.sort()
            heard, self._heard_s = tuple(known), now
            if heard != self._heard:
                self._heard, self._silent = heard, None
        return self._heard

    def is_anybody_about(self, now: float) -> bool:
        """Whether somebody came into reach just now of whom nobody knows where."""
        if len(self.heard(now)) == len(self._fresh):
            return False
        return any(peer.is_about(now) for peer in self._fresh.values())

    def announced(self, now: float) -> tuple[int, ...]:
        """Give whom to name in a beacon: who is heard, in turns when they are too many for one."""
        heard = self.heard(now)
        if len(heard) <= MOST_HEARD:
            return heard
        self._turn = (self._turn + MOST_HEARD) % len(heard)
        return (heard[self._turn :] + heard[: self._turn])[:MOST_HEARD]

    def cluster(self, now: float) -> tuple[int, ...]:
        """Give the peers connected to this vehicle, as far as it can know.

        That is whom it hears, whom those say they hear, and whom those named, a moment ago, that
        it heard itself until then.
        """
        found, edge = set[int](), list(self.heard(now))
        while edge:
            sysid = edge.pop()
            if sysid == self._sysid or sysid in found:
                continue
            found.add(sysid)
            named = self._peers[sysid].heard_s if sysid in self._peers else {}
            edge += [other for other, heard_s in named.items() if now - heard_s <= LISTED_S]
        return tuple(sorted(found))

    def met(self, now: float) -> list[Meeting]:
        """Give the peers whose place is known in both frames just now, by sysid."""
        met = []
        for sysid in sorted(self._fresh):
            meeting = self._fresh[sysid].meeting(sysid, now)
            if meeting is not None:
                met.append(meeting)
        return met

    def contacts(self, now: float) -> tuple[list[int], list[int]]:
        """Tell who came into range and who was lost since the last call."""
        before, self._contacts = self._contacts, self.heard(now)
        if before == self._contacts:
            return [], []
        gained, lost = set(self._contacts) - set(before), set(before) - set(self._contacts)
        return sorted(gained), sorted(lost)

    def doubts(self, own_ned_m: Vec3, now: float) -> list[tuple[int, float]]:
        """Tell, once for each peer, who is measured elsewhere than it says, by how many metres."""
        found = []
        for sysid in self.heard(now):
            peer = self._peers[sysid]
            if peer.shift is not None and sysid not in self._doubted:
                apart_m = peer.apart_m(own_ned_m, now)
                if apart_m > AGREE_M:
                    self._doubted.add(sysid)
                    found.append((sysid, apart_m))
        return found

    def _peer(self, sysid: int) -> Peer:
        peer = self._peers.get(sysid)
        if peer is None:
            peer = self._peers[sysid] = Peer(*self._flown)
        self._fresh[sysid] = peer
        return peer
