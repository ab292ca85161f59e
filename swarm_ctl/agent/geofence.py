"""The last word on every velocity: fence, floor, ceiling, walls and peers as half-spaces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from swarm_ctl.agent.params import FlightParams, Limits
from swarm_ctl.agent.peer import Neighbour
from swarm_ctl.explore.safety import Constraint, limit_velocity, peer_limit, wall_limit
from swarm_ctl.model import Vec3

BEAM_BEARINGS_RAD = (0.0, math.pi, -math.pi / 2.0, math.pi / 2.0)
"""Front, back, left and right rangefinder, clockwise from the vehicle's heading."""
UP, DOWN = Vec3(0.0, 0.0, -1.0), Vec3(0.0, 0.0, 1.0)
VERTICAL_BRAKING_M_S2 = 0.5
"""Half of what ArduPilot brakes with vertically (WPNAV_ACCEL_Z 1 m/s2)."""
FENCE_M = 0.3
"""Kept to the fence: what a vehicle overshoots, also one whose controller is killed there."""
GIVE_WAY_M = 0.6
"""A peer this much beyond the separation, straight ahead, is passed on the right."""
SOON_S = 1.0
"""In so long a vehicle that flies level has left the way of one that climbs or descends."""
GIVE_WAY, IN_THE_WAY = 0.6, 0.7
"""Speed aside per speed ahead; cosine of the angle within which a peer is in the way."""


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
        self._speed = flight.speed_m_s
        self._climb = flight.climb_m_s
        self._braking = flight.acceleration_m_s2 / 2.0
        self._response_s = flight.response_s

    def confine(
        self,
        velocity: Vec3,
        motion: Motion,
        ranges_m: Sequence[float],
        peers: Sequence[Neighbour],
        *,
        knows_place: bool = True,
    ) -> Vec3:
        """Give the nearest velocity that respects every limit.

        `ranges_m` are in the order front, back, left, right, up, down (inf = clear). Distances
        are taken as they will be when the vehicle has begun to obey: it flies on for
        `flight.response_s` first, and longer behind a slow link. A vehicle that does not know its
        place is not pushed off floor, ceiling or fence: it would be for ever.
        """
        peers = self._levelled(peers) if self._is_level else peers
        velocity = self._keep_right(velocity, peers)
        constraints = [  # the last one wins where they contradict: walls leave the least room
            *(self._fence(motion) if knows_place else ()),
            *self._peers(motion, peers),
            *self._walls(motion, ranges_m),
        ]
        return limit_velocity(velocity, constraints, self._speed, self._climb)

    def _fence(self, motion: Motion) -> list[Constraint]:
        """Bound the speed outwards from here, and from where the vehicle is about to be."""
        (x, y, z), (vx, vy, vz) = motion.position_ned_m, motion.velocity_ned_m_s
        response_s, limits = self._response_s + motion.late_s, self._limits
        low, high = sorted((-z, -(z + vz * response_s)))
        floor = wall_limit(low - limits.floor_m, 0.0, VERTICAL_BRAKING_M_S2)
        ceiling = wall_limit(limits.ceiling_m - high, 0.0, VERTICAL_BRAKING_M_S2)
        fence = [Constraint(0.0, 0.0, 1.0, floor), Constraint(0.0, 0.0, -1.0, ceiling)]
        for north, east in ((x + vx * response_s, y + vy * response_s), (x, y)):
            away = math.hypot(north, east)
            if away > 0.5 * limits.radius_m:
                room = wall_limit(limits.radius_m - away, FENCE_M, self._braking)
                fence.append(Constraint(north / away, east / away, 0.0, room))
        return fence

    def _walls(self, motion: Motion, ranges_m: Sequence[float]) -> list[Constraint]:
        kept: list[Constraint] = []
        for first in (0, 2, 4):
            one_m, other_m = ranges_m[first : first + 2]
            if one_m < math.inf or other_m < math.inf:
                one, other = _beam(first, motion.yaw_rad), _beam(first + 1, motion.yaw_rad)
                rooms = _between(self._room(motion, one, one_m), self._room(motion, other, other_m))
                seen = zip((one, other), rooms, strict=True)
                kept += [Constraint(*beam, room) for beam, room in seen if room < math.inf]
        return kept

    def _room(self, motion: Motion, beam: Vec3, distance_m: float) -> float:
        """Give the largest speed along a beam, m/s."""
        if distance_m == math.inf:
            return math.inf
        (vx, vy, vz), (x, y, z) = motion.velocity_ned_m_s, beam
        response_s = self._response_s + motion.late_s
        left_m = distance_m - response_s * max(0.0, vx * x + vy * y + vz * z)
        braking = VERTICAL_BRAKING_M_S2 if z else self._braking
        return wall_limit(left_m, self._limits.wall_m, braking)

    def _keep_right(self, velocity: Vec3, peers: Sequence[Neighbour]) -> Vec3:
        """Turn right of a peer in the way, as ships do: two that meet head-on would both stop."""
        speed = math.hypot(velocity.x, velocity.y)
        for offset, _, doubt_m in peers:
            distance = math.hypot(offset.x, offset.y)
            if distance > self._limits.separation_m + doubt_m + GIVE_WAY_M or speed < 1e-6:
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

    def _peers(self, motion: Motion, peers: Sequence[Neighbour]) -> list[Constraint]:
        vx, vy, vz = motion.velocity_ned_m_s
        response_s, constraints = self._response_s + motion.late_s, []
        for offset, velocity, doubt_m in peers:
            distance = max(math.hypot(*offset), 1e-3)
            x, y, z = (component / distance for component in offset)
            own = vx * x + vy * y + vz * z
            coming = -(velocity.x * x + velocity.y * y + velocity.z * z)
            room = self._towards_peer(distance - doubt_m, own, coming, response_s)
            constraints.append(Constraint(x, y, z, room))
        return constraints

    def _towards_peer(
        self, distance_m: float, own_m_s: float, coming_m_s: float, response_s: float
    ) -> float:
        """Give the largest speed towards a peer, m/s, from what both fly along the line between.

        Who is slower than that will be as fast before it is told to brake: two that turn towards
        each other at once have no speed yet that would warn them.
        """
        kept = self._limits.separation_m, self._braking, self._speed
        left_m = distance_m - response_s * max(0.0, own_m_s + coming_m_s)
        soon_m = distance_m - response_s * max(0.0, coming_m_s)
        return min(peer_limit(left_m, *kept), max(0.0, peer_limit(soon_m, *kept, response_s)))


def _beam(index: int, yaw_rad: float) -> Vec3:
    """Give the direction of a rangefinder."""
    if index >= len(BEAM_BEARINGS_RAD):
        return (UP, DOWN)[index - len(BEAM_BEARINGS_RAD)]
    bearing_rad = yaw_rad + BEAM_BEARINGS_RAD[index]
    return Vec3(math.cos(bearing_rad), math.sin(bearing_rad), 0.0)


def _between(one_m_s: float, other_m_s: float) -> tuple[float, float]:
    """Let neither of two opposite walls push farther than the other leaves room.

    One wall that is very near is seen by the wide beams on both sides, too; were each to push, the
    whole velocity would be cut off, and with it the way off that wall.
    """
    if one_m_s >= 0.0 <= other_m_s:
        return one_m_s, other_m_s
    return max(one_m_s, -max(other_m_s, 0.0)), max(other_m_s, -max(one_m_s, 0.0))
