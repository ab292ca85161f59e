"""One peer: where it was measured, where it says it is, and the zone of one that fell silent."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from swarm_ctl.agent.beacon import Beacon
from swarm_ctl.agent.frame import Shift
from swarm_ctl.agent.phases import Phase
from swarm_ctl.agent.track import AGREEING, Track
from swarm_ctl.model import ZERO, Vec3

MET_S = 0.3
"""Fix and beacon this young belong together: in this time a vehicle moves a footprint's part."""
FRESH_S = 1.0
"""A peer silent for longer is out of range (ALGORITHM 3.4: seen in the last second)."""
LISTED_S = 2.0
"""Whom a peer has not named for so long it hears no more: it tells long lists in turns."""
MOST_NAMED = 64
"""Of so many whom a peer has named, those are forgotten whom it hears no more."""
BLIND_SIGMA_M = 0.5
"""A peer that is heard but not measured, as behind a blind angle, is known as long as this."""
LATENCY_S = 0.1
"""From a peer's position to its beacon here, about one tick; a velocity bridges it."""
AGREE_M = 2.0
"""What the radio measures and what a peer tells may differ by so much, level, and mean the same."""
USUAL_M = 0.2
"""Being wrong by so much is what the separation has room for: contact is at 0.6 m, not at 1 m."""
DOUBT_SIGMAS = 3.0
MOST_DOUBT_M = 0.5
"""However little is known of a peer in contact, no more is kept: vehicles that start side by side,
or meet in a door, would push each other back for ever; and 1.5 m apart, both stop in time from
1 m/s."""
MUTE_S = 2.0
"""Who is measured and has told nothing new for so long may not give way: it is doubted most."""
WARY_S = 0.6
"""For so long after a peer came into reach its first fix is waited for, two or three of which may
be lost; a radio that measures nobody, as in a blind angle, stops nobody for longer."""
ZONE_S = 5.0
"""For so long after contact a peer that fell silent nearby is kept away from; then it may be
anywhere, and who stopped in a door would keep it shut."""
ZONE_M = 1.0
"""Most that is kept, beside the separation, from where it was."""
RISING_M_S = 1.0
"""How fast who takes off climbs at most, soon."""
STILL_M_S = 0.1
"""Who tells one place again and again, and a larger velocity, has frozen."""
_DOWN = frozenset({Phase.CONNECTING, Phase.READY, Phase.LANDING, Phase.DONE})
"""Who fell silent in one of these stands on the ground, or nearly; above it, all may fly."""


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

    acceleration_m_s2: float
    """What it brakes and turns with."""
    speed_m_s: float
    """How fast it flies."""
    track: Track | None = None
    """What the fixes tell; None before the first one."""
    beacon: Beacon | None = None
    beacon_s: float = -math.inf
    """When the last beacon came that told anything new."""
    met_s: float = -math.inf
    """When the radio brought the first one, or the first one after a silence."""
    shift: Shift | None = None
    """From its frame into the own one, as of the last beacon; None when nothing is shared."""
    heard_s: dict[int, float] = field(default_factory=dict)
    """Whom it hears itself, and when it said so last."""
    last: tuple[Neighbour, Vec3, float] | None = None
    """Where it was when its place was known last, from where, and when."""

    def hear(
        self, beacon: Beacon, shift: Shift | None, now: float, *, is_near: bool = True
    ) -> None:
        """Take a beacon; one that says the same again of who moves is no news."""
        for sysid in beacon.heard:
            self.heard_s[sysid] = now
        if len(self.heard_s) > MOST_NAMED:
            named = self.heard_s.items()
            self.heard_s = {sysid: named_s for sysid, named_s in named if now - named_s <= LISTED_S}
        before, velocity = self.beacon, beacon.velocity_ned_m_s
        if (
            before is not None
            and before.position_ned_m == beacon.position_ned_m
            and before.velocity_ned_m_s == velocity
            and math.hypot(*velocity) > STILL_M_S
        ):
            return
        if is_near and now - self.beacon_s > FRESH_S:
            self.met_s = now
        self.beacon, self.beacon_s, self.shift = beacon, now, shift
        if self.track is not None:
            self.track.hear(beacon, now)

    def estrange(self) -> None:
        """Forget what it told: it flies another mission."""
        self.beacon, self.beacon_s, self.shift = None, -math.inf, None
        self.heard_s.clear()

    def is_fresh(self, now: float) -> bool:
        """Whether anything was measured of it, or told by it, within `FRESH_S`."""
        if now - self.beacon_s <= FRESH_S:
            return True
        return self.track is not None and now - self.track.fixed_s <= FRESH_S

    def is_known(self, now: float) -> bool:
        """Whether its place was measured, or told in a shared frame, just now."""
        return self._is_told(now) or self._is_tracked(now)

    def _is_told(self, now: float) -> bool:
        return self.shift is not None and now - self.beacon_s <= FRESH_S

    def _is_tracked(self, now: float) -> bool:
        """Whether it was measured just now, or tells well enough how it has moved since then."""
        if self.track is None:
            return False
        if now - self.track.fixed_s <= FRESH_S:
            return True
        return now - self.beacon_s <= FRESH_S and self.track.at(now)[2] <= BLIND_SIGMA_M

    def is_about(self, now: float) -> bool:
        """Whether it came into reach just now, and may be anywhere there."""
        return now - self.met_s <= WARY_S and not self.is_known(now)

    def is_at_odds(self, now: float) -> bool:
        """Whether it tells nothing new though it flies, or what its fixes contradict."""
        if self.beacon is None:
            return False
        is_mute = now - self.beacon_s > MUTE_S and self.beacon.phase not in _DOWN
        return is_mute or (self.track is not None and self.track.odds >= AGREEING)

    def near(self, own: Vec3, now: float) -> Neighbour:
        """Give where it is, if that is known: as measured, else as told.

        Where the two are at odds the nearer one counts, which is safe.
        """
        measured = self.measured(own, now)
        if measured is None or self.shift is not None:
            told = self.told(own, now)
            measured = told if measured is None else _nearer(measured, told)
        if measured is None:
            raise ValueError("a peer whose place is not known is not near")
        self.last = measured, own, now
        if self.beacon is not None and self.beacon.phase is Phase.TAKEOFF:
            return _rising(measured)
        return measured

    def measured(self, own: Vec3, now: float) -> Neighbour | None:
        """Give where its track leads to; the nearer of two places while fixes disagree with it."""
        track = self.track
        if track is None or not self._is_tracked(now):
            return None
        (x, y, z), velocity, sigma_m = track.at(now)
        offset = Vec3(x - own[0], y - own[1], z - own[2])
        if track.rivals and (rival := track.rival_at(now)) is not None:
            offset = min(offset, minus(rival, own), key=lambda way: math.hypot(*way))
        doubt = MOST_DOUBT_M if self.is_at_odds(now) else doubt_m(DOUBT_SIGMAS * sigma_m)
        return Neighbour(offset, velocity, doubt)

    def told(self, own: Vec3, now: float) -> Neighbour | None:
        """Move it on from where it said it was; as near in height as its height is doubtful."""
        if self.beacon is None or self.shift is None or now - self.beacon_s > FRESH_S:
            return None
        age_s = now - self.beacon_s
        place = plus(_there(self.beacon, age_s), self.shift.offset_m)
        x, y, z = minus(place, own)
        certain = math.copysign(max(0.0, abs(z) - self.shift.height_doubt_m), z)
        turned_m = 0.5 * self.acceleration_m_s2 * age_s * age_s
        return Neighbour(Vec3(x, y, certain), self.beacon.velocity_ned_m_s, doubt_m(turned_m))

    def zone(self, own: Vec3, within_m: float, now: float) -> Neighbour | None:
        """Give the zone of one that fell silent in the air, `within_m` of here; None without.

        It lies where the peer was, and grows with what it could have flown since then.
        """
        if self.last is None:
            return None
        (offset, velocity, _), place, known_s = self.last
        age_s, is_down = now - known_s, self.beacon is not None and self.beacon.phase in _DOWN
        if age_s > ZONE_S or is_down or math.hypot(*offset) > within_m:
            self.last = None
            return None
        fastest = math.hypot(*velocity) + self.acceleration_m_s2 * age_s
        reach_m = min(fastest, self.speed_m_s) * age_s
        return Neighbour(minus(plus(place, offset), own), ZERO, min(reach_m, ZONE_M))

    def meeting(self, sysid: int, now: float) -> Meeting | None:
        """Give its place in both frames just now: as measured, else as told."""
        if self.beacon is None or now - self.beacon_s > MET_S:
            return None
        there = _there(self.beacon, now - self.beacon_s)
        if self.track is not None and now - self.track.fixed_s <= MET_S:
            return Meeting(sysid, self.beacon, there, self.track.at(now)[0])
        if self.shift is None:
            return None
        return Meeting(sysid, self.beacon, there, plus(there, self.shift.offset_m))

    def apart_m(self, own: Vec3, now: float) -> float:
        """Give how far what is measured and what is told are apart; 0 without either."""
        if self.shift is None:
            return 0.0
        measured, told = self.measured(own, now), self.told(own, now)
        return 0.0 if measured is None or told is None else _apart_m(measured, told)


def doubt_m(error_m: float) -> float:
    """Give what is to be kept beside the separation from a peer that may be so far off."""
    return min(max(error_m - USUAL_M, 0.0), MOST_DOUBT_M)


def _rising(peer: Neighbour) -> Neighbour:
    """Take who is about to climb, still on the ground perhaps, for climbing already."""
    x, y, z = peer.velocity_ned_m_s
    return peer._replace(velocity_ned_m_s=Vec3(x, y, min(z, -RISING_M_S)))


def _nearer(measured: Neighbour, told: Neighbour | None) -> Neighbour:
    if told is None or _apart_m(measured, told) <= AGREE_M:
        return measured
    return min(measured, told, key=lambda place: math.hypot(*place.offset_ned_m))


def _apart_m(one: Neighbour, other: Neighbour) -> float:
    """Give how far apart two places are, level: barometers drift by metres."""
    return math.dist(one.offset_ned_m[:2], other.offset_ned_m[:2])


def _there(beacon: Beacon, age_s: float) -> Vec3:
    """Give where a peer is in its own frame, so long after its beacon came."""
    (x, y, z), (vx, vy, vz) = beacon.position_ned_m, beacon.velocity_ned_m_s
    age_s += LATENCY_S
    return Vec3(x + vx * age_s, y + vy * age_s, z + vz * age_s)


def plus(one: Vec3, other: Vec3) -> Vec3:
    """Add two vectors."""
    return Vec3(one[0] + other[0], one[1] + other[1], one[2] + other[2])


def minus(one: Vec3, other: Vec3) -> Vec3:
    """Take one vector from another."""
    return Vec3(one[0] - other[0], one[1] - other[1], one[2] - other[2])
