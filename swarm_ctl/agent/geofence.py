"""The last word on every velocity: fence, floor, ceiling, walls and peers as half-spaces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from swarm_ctl.agent.blind import NO_WALLS, Remembered
from swarm_ctl.agent.params import FlightParams, Limits
from swarm_ctl.agent.peer import Neighbour
from swarm_ctl.explore.safety import Constraint, limit_velocity, peer_limit, wall_limit
from swarm_ctl.model import ZERO, Vec3

VERTICAL_BRAKING_M_S2 = 0.5
"""Half of what ArduPilot brakes with vertically (WPNAV_ACCEL_Z 1 m/s2)."""
FENCE_M = 0.3
"""Kept to the fence: what a vehicle overshoots, also one whose controller is killed there."""
GIVE_WAY_M = 0.6
"""A peer this much beyond the separation, straight ahead, is passed on the right."""
PRESSED = 0.76
"""A wall nearer than this part of `limits.wall_m` is about to be touched."""
ALONG = 0.3
"""Of what is demanded beside a wall that is about to be touched: wide beams do not tell where
exactly it is, and who flies along may fly into it."""
NEARLY = 0.9
"""A peer nearer than this part of `limits.separation_m` is too near to be pushed towards."""
PUSH_M_S = 0.5
"""As fast as walls push off, at most."""
CRAWL_M_S = 0.3
"""Between two beams that both see something, who is no faster is not slowed down for it."""
HALF = math.sqrt(0.5)
SOON_S = 1.0
"""In so long a vehicle that flies level has left the way of one that climbs or descends."""
GIVE_WAY, IN_THE_WAY = 0.6, 0.7
"""Speed aside per speed ahead; cosine of the angle within which a peer is in the way."""


Beams = tuple[tuple[float, float, float, float, float], ...]
"""Pairs of opposite beams: what the two of them see, m, and the direction of the first."""


class Motion(NamedTuple):
    """How the vehicle moves, in its own local frame."""

    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    yaw_rad: float
    late_s: float = 0.0
    """How much longer than usual the link takes, there and back."""


class Guard:
    """Bend a demanded velocity until it breaks no limit (ALGORITHM 3.4)."""

    def __init__(self, limits: Limits, flight: FlightParams, *, is_level: bool = False) -> None:
        """Take the limits; a mission that `is_level` lets peers push sideways only."""
        self._is_level = is_level
        self._limits = limits
        self._wall_m = limits.wall_m
        self._speed = flight.speed_m_s
        self._climb = flight.climb_m_s
        self._braking = flight.acceleration_m_s2 / 2.0
        self._response_s = flight.response_s
        self._top = top = math.hypot(self._speed, self._climb)
        """No velocity gets past the speed limits: what allows this much in its way forbids none."""
        braking = min(self._braking, VERTICAL_BRAKING_M_S2)
        self._far_m = limits.wall_m + max(top * top / (2.0 * braking), 0.5 * top)
        """A wall farther off allows as much, to who does not move."""
        self._pressing_m_s = 2.0 * (PRESSED - 1.0) * limits.wall_m
        self._nearly_m_s = 2.0 * (NEARLY - 1.0) * limits.separation_m
        """What walls and peers allow who are as near as that, m/s."""

    def confine(
        self,
        velocity: Vec3,
        motion: Motion,
        ranges_m: Sequence[float],
        peers: Sequence[Neighbour],
        walls: Sequence[Remembered] = NO_WALLS,
        *,
        knows_place: bool = True,
    ) -> Vec3:
        """Give the nearest velocity that respects every limit.

        `ranges_m` are in the order front, back, left, right, up, down (inf = clear); `walls` are
        remembered where those are silent. Distances are taken as they will be when the vehicle
        has begun to obey: it flies on for `flight.response_s` first, and longer behind a slow
        link. A vehicle that does not know its place is not pushed off floor, ceiling or fence: it
        would be for ever.
        """
        peers = self._levelled(peers) if self._is_level else peers
        if peers:
            velocity = self._keep_right(velocity, peers)
        seen = self._walls(motion, ranges_m)
        pressing = [wall for wall in seen if wall[3] < self._pressing_m_s]
        if any(not nz for _, _, nz, _ in pressing):
            velocity = Vec3(velocity.x * ALONG, velocity.y * ALONG, velocity.z * ALONG)
        constraints = self._fence(motion) if knows_place else []
        if peers:
            constraints += self._peers(motion, peers, _push(pressing))
        # What is seen comes last, and so wins a contradiction: walls leave the least room.
        constraints += self._remembered(motion, walls) + seen
        return limit_velocity(velocity, constraints, self._speed, self._climb)

    def _fence(self, motion: Motion) -> list[Constraint]:
        """Bound the speed outwards from here, and from where the vehicle is about to be."""
        (x, y, z), (vx, vy, vz) = motion.position_ned_m, motion.velocity_ned_m_s
        response_s, limits = self._response_s + motion.late_s, self._limits
        soon_m = -(z + vz * response_s)
        low, high = (-z, soon_m) if -z <= soon_m else (soon_m, -z)
        floor = wall_limit(low - limits.floor_m, 0.0, VERTICAL_BRAKING_M_S2)
        ceiling = wall_limit(limits.ceiling_m - high, 0.0, VERTICAL_BRAKING_M_S2)
        fence: list[Constraint] = [(0.0, 0.0, 1.0, floor), (0.0, 0.0, -1.0, ceiling)]
        for north, east in ((x + vx * response_s, y + vy * response_s), (x, y)):
            away = math.hypot(north, east)
            if away > 0.5 * limits.radius_m:
                room = wall_limit(limits.radius_m - away, FENCE_M, self._braking)
                fence.append((north / away, east / away, 0.0, room))
        return fence

    def _walls(self, motion: Motion, ranges_m: Sequence[float]) -> list[Constraint]:
        """Bound the speed along each beam that ends at a near wall, two opposite ones at once."""
        kept: list[Constraint] = []
        vx, vy, vz = motion.velocity_ned_m_s
        response_s = self._response_s + motion.late_s
        far_m = self._far_m + response_s * math.sqrt(vx * vx + vy * vy + vz * vz)
        front_m, back_m, left_m, right_m, up_m, down_m = ranges_m
        if front_m > far_m and back_m > far_m and left_m > far_m and right_m > far_m:
            beams: Beams = ((up_m, down_m, 0.0, 0.0, -1.0),)
            pillars = []
        else:
            north, east = math.cos(motion.yaw_rad), math.sin(motion.yaw_rad)
            beams = (
                (front_m, back_m, north, east, 0.0),
                (left_m, right_m, east, -north, 0.0),
                (up_m, down_m, 0.0, 0.0, -1.0),
            )
            pillars = self._pillars(motion, ranges_m, far_m, HALF * north, HALF * east)
        for one_m, other_m, x, y, z in beams:
            if one_m > far_m and other_m > far_m:
                continue
            flown_m = self._flown_m(motion, x, y, z)
            one, other = _between(
                self._to_wall(one_m, max(0.0, flown_m), z),
                self._to_wall(other_m, max(0.0, -flown_m), z),
            )
            if one < self._top:
                kept.append((x, y, z, one))
            if other < self._top:
                kept.append((-x, -y, -z, other))
        return kept + pillars

    def _flown_m(self, motion: Motion, x: float, y: float, z: float) -> float:
        """Give how far the vehicle flies along a direction before it begins to obey, m."""
        vx, vy, vz = motion.velocity_ned_m_s
        return (self._response_s + motion.late_s) * (vx * x + vy * y + vz * z)

    def _to_wall(self, distance_m: float, flown_m: float, z: float) -> float:
        """Give the largest speed towards a wall, m/s, of who flies on for `flown_m` towards it.

        The direction is level unless `z`. Who is blown on towards a wall that is too near already
        is told to leave it the faster.
        """
        braking = VERTICAL_BRAKING_M_S2 if z else self._braking
        room = wall_limit(distance_m - flown_m, self._wall_m, braking)
        return max(room - flown_m, -PUSH_M_S) if room < 0.0 else room

    def _pillars(
        self,
        motion: Motion,
        ranges_m: Sequence[float],
        far_m: float,
        north: float,
        east: float,
    ) -> list[Constraint]:
        """Bound the speed towards what two wide beams side by side both see: it lies between them.

        Along either of them a pillar comes nearer more slowly than it does. Who flies no faster
        than CRAWL_M_S is stopped in time by the beam that it is in at last: doors have pillars.
        `north` and `east` are those of the heading, HALF as long.
        """
        kept: list[Constraint] = []
        front_m, back_m, left_m, right_m = ranges_m[:4]
        for ahead_m, aside_m, x, y in (
            (front_m, left_m, north + east, east - north),
            (front_m, right_m, north - east, east + north),
            (back_m, left_m, east - north, -east - north),
            (back_m, right_m, -north - east, north - east),
        ):
            farther_m = max(ahead_m, aside_m)
            if farther_m <= far_m:
                left_m = farther_m - max(0.0, self._flown_m(motion, x, y, 0.0))
                room = wall_limit(left_m, PRESSED * self._wall_m, self._braking)
                if room < self._top:
                    kept.append((x, y, 0.0, max(CRAWL_M_S, room)))
        return kept

    def _remembered(self, motion: Motion, walls: Sequence[Remembered]) -> list[Constraint]:
        """Bound the speed towards walls that nobody sees any more; they do not push."""
        kept: list[Constraint] = []
        for (x, y, z), distance_m in walls:
            room = self._to_wall(distance_m, max(0.0, self._flown_m(motion, x, y, z)), z)
            kept.append((x, y, z, max(0.0, room)))
        return kept

    def _keep_right(self, velocity: Vec3, peers: Sequence[Neighbour]) -> Vec3:
        """Turn right of a peer in the way, as ships do: two that meet head-on would both stop."""
        speed = math.hypot(velocity.x, velocity.y)
        if speed < 1e-6:
            return velocity
        near_m = self._limits.separation_m + GIVE_WAY_M
        for offset, _, doubt_m in peers:
            distance = math.hypot(offset.x, offset.y)
            if distance > near_m + doubt_m:
                continue
            ahead = (velocity.x * offset.x + velocity.y * offset.y) / max(distance * speed, 1e-6)
            if ahead > IN_THE_WAY:
                aside = speed * GIVE_WAY / max(distance, 1e-3)
                return Vec3(
                    velocity.x - offset.y * aside, velocity.y + offset.x * aside, velocity.z
                )
        return velocity

    def _levelled(self, peers: Sequence[Neighbour]) -> list[Neighbour]:
        """Flatten peers at about the own height; who is far above or below is in nobody's way.

        Unless it comes closer: whoever takes off from below is at the own height soon.
        """
        separation_m = self._limits.separation_m
        return [
            Neighbour(Vec3(offset.x, offset.y, 0.0), velocity, doubt_m)
            for offset, velocity, doubt_m in peers
            if abs(offset.z) < separation_m or abs(offset.z + SOON_S * velocity.z) < separation_m
        ]

    def _peers(
        self, motion: Motion, peers: Sequence[Neighbour], push_m_s: Vec3
    ) -> list[Constraint]:
        """Bound the speed towards peers; walls push half as fast as else towards one that is near.

        Who stopped between the two would be blown into the wall, a body's radius away.
        """
        constraints: list[Constraint] = []
        vx, vy, vz = motion.velocity_ned_m_s
        response_s = self._response_s + motion.late_s
        for (x, y, z), (px, py, pz), doubt_m in peers:
            distance = max(math.hypot(x, y, z), 1e-3)
            x, y, z = x / distance, y / distance, z / distance  # noqa: PLW2901 - a unit vector now
            own = vx * x + vy * y + vz * z
            coming = -(px * x + py * y + pz * z)
            room = self._towards_peer(distance - doubt_m, own, coming, response_s)
            if push_m_s is not ZERO:
                pushed = 0.5 * (push_m_s.x * x + push_m_s.y * y + push_m_s.z * z)
                if pushed > max(room, 0.0) and self._is_clear(distance, own, coming, response_s):
                    room = pushed
            if room < self._top:
                constraints.append((x, y, z, room))
        return constraints

    def _is_clear(
        self, distance_m: float, own_m_s: float, coming_m_s: float, response_s: float
    ) -> bool:
        """Whether a peer is far enough to be pushed towards, wherever else it may be in doubt."""
        room = self._towards_peer(distance_m, own_m_s, coming_m_s, response_s)
        return room > self._nearly_m_s

    def _towards_peer(
        self, distance_m: float, own_m_s: float, coming_m_s: float, response_s: float
    ) -> float:
        """Give the largest speed towards a peer, m/s, from what both fly along the line between.

        Who is slower than that will be as fast before it is told to brake: two that turn towards
        each other at once have no speed yet that would warn them.
        """
        kept_m, braking, speed = self._limits.separation_m, self._braking, self._speed
        left_m = distance_m - response_s * max(0.0, own_m_s + coming_m_s)
        soon_m = distance_m - response_s * max(0.0, coming_m_s)
        soon_m_s = peer_limit(soon_m, kept_m, braking, speed, response_s)
        return min(peer_limit(left_m, kept_m, braking, speed), max(0.0, soon_m_s))


def _push(walls: Sequence[Constraint]) -> Vec3:
    """Give the velocity with which walls that are about to be touched push off."""
    if not walls:
        return ZERO
    return Vec3(
        sum(nx * limit for nx, _, _, limit in walls),
        sum(ny * limit for _, ny, _, limit in walls),
        sum(nz * limit for _, _, nz, limit in walls),
    )


def _between(one_m_s: float, other_m_s: float) -> tuple[float, float]:
    """Let neither of two opposite walls push farther than the other leaves room.

    One wall that is very near is seen by the wide beams on both sides, too; were each to push, the
    whole velocity would be cut off, and with it the way off that wall.
    """
    if one_m_s >= 0.0 <= other_m_s:
        return one_m_s, other_m_s
    return max(one_m_s, -max(other_m_s, 0.0)), max(other_m_s, -max(one_m_s, 0.0))
