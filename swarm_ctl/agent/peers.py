"""The peers a vehicle can hear: measured by its radio, dead-reckoned by their beacons."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from swarm_ctl.agent.beacon import Beacon
from swarm_ctl.autopilot.telemetry import PeerFix
from swarm_ctl.model import ZERO, Vec3

MET_S = 0.3
"""Fix and beacon this young belong together: in this time a vehicle moves a footprint's part."""
FRESH_S = 1.0
"""A peer silent for longer is out of range (ALGORITHM 3.4: seen in the last second)."""


@dataclass(slots=True)
class Peer:
    """One peer in this vehicle's own local frame: its last fix and its last beacon, if any."""

    position_ned_m: Vec3 = ZERO
    fixed_s: float = -math.inf
    beacon: Beacon | None = None
    beacon_s: float = -math.inf


class Neighbour(NamedTuple):
    """Where a peer is now, and how it moves."""

    offset_ned_m: Vec3
    """From this vehicle to the peer."""
    velocity_ned_m_s: Vec3
    """Zero when it has not told."""


class PeerTable:
    """Everybody this vehicle has heard."""

    def __init__(self) -> None:
        self._peers: dict[int, Peer] = {}
        self._contacts: set[int] = set()

    def fix(self, fixes: Iterable[PeerFix], own_ned_m: Vec3, now: float) -> None:
        """Take what the radio measured just now."""
        for sysid, offset in fixes:
            peer = self._peers.setdefault(sysid, Peer())
            peer.position_ned_m = Vec3(*(o + p for o, p in zip(own_ned_m, offset, strict=True)))
            peer.fixed_s = now

    def beacon(self, sysid: int, beacon: Beacon, now: float) -> None:
        """Take a beacon, also of a peer that was never measured."""
        peer = self._peers.setdefault(sysid, Peer())
        peer.beacon, peer.beacon_s = beacon, now

    def is_ours(self, sysid: int) -> bool:
        """Whether a peer's beacon of our mission has been heard."""
        peer = self._peers.get(sysid)
        return peer is not None and peer.beacon is not None

    def near(self, own_ned_m: Vec3, now: float) -> list[Neighbour]:
        """Give every fresh peer, dead-reckoned to now, ordered by sysid."""
        return [_neighbour(self._peers[sysid], own_ned_m, now) for sysid in self.heard(now)]

    def heard(self, now: float) -> tuple[int, ...]:
        """Give the sysids of fresh peers, in order."""
        return tuple(sorted(i for i, p in self._peers.items() if now - p.fixed_s <= FRESH_S))

    def met(self, now: float) -> list[tuple[int, Peer]]:
        """Give the peers that were measured and told of themselves just now, by sysid."""
        return [
            (sysid, peer)
            for sysid, peer in sorted(self._peers.items())
            if now - peer.fixed_s <= MET_S and now - peer.beacon_s <= MET_S
        ]

    def contacts(self, now: float) -> tuple[list[int], list[int]]:
        """Tell who came into range and who was lost since the last call."""
        heard = set(self.heard(now))
        gained, lost = sorted(heard - self._contacts), sorted(self._contacts - heard)
        self._contacts = heard
        return gained, lost


def _neighbour(peer: Peer, own: Vec3, now: float) -> Neighbour:
    """Move a peer on from its last fix, at the velocity it told if that is fresh."""
    has_told = peer.beacon is not None and now - peer.beacon_s <= FRESH_S
    velocity = peer.beacon.velocity_ned_m_s if peer.beacon and has_told else ZERO
    age, place = now - peer.fixed_s, peer.position_ned_m
    offset = Vec3(
        place.x + velocity.x * age - own.x,
        place.y + velocity.y * age - own.y,
        place.z + velocity.z * age - own.z,
    )
    return Neighbour(offset, velocity)
