"""The velocity safety filter: half-space limits from peers and walls, then the speed limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarm_ctl.model import Vec3

TOLERANCE_M_S = 0.01
"""Approach beyond a limit that is let pass where limits contradict each other."""
_SETTLED_M_S = 1e-6


Constraint = tuple[float, float, float, float]
"""A half space of velocities, v . n <= limit: the three components of n, a unit vector towards what
is in the way, and the limit in m/s; negative: move away at least this fast."""


def peer_limit(
    distance_m: float,
    separation_m: float,
    braking_m_s2: float,
    speed_m_s: float,
    response_s: float = 0.0,
) -> float:
    """Give the largest speed towards a peer, m/s; negative below the separation.

    With e = distance - separation: min(sqrt(a e), 2 e), each of the two taking half of the closing
    speed; for e < 0 max(-speed, 2 e). `braking_m_s2` (a) is half of what the vehicle can do. With
    a `response_s` (T), e is what is left when the speed itself has been flown so long.
    """
    excess = distance_m - separation_m
    if not excess > 0.0:
        return max(-speed_m_s, 2.0 * excess)
    flown = 0.5 * braking_m_s2 * response_s
    by_braking = math.sqrt(flown * flown + braking_m_s2 * excess) - flown
    return min(by_braking, 2.0 * excess / (1.0 + 2.0 * response_s))


def wall_limit(
    distance_m: float, standoff_m: float, braking_m_s2: float, pushout_m_s: float = 0.5
) -> float:
    """Give the largest speed towards a wall, m/s: min(sqrt(2 a e), 2 e), e = distance - standoff.

    For e < 0 it is negative, down to -`pushout_m_s`.
    """
    excess = distance_m - standoff_m
    if not excess > 0.0:
        return max(-pushout_m_s, 2.0 * excess)
    return min(math.sqrt(2.0 * braking_m_s2 * excess), 2.0 * excess)


def limit_velocity(
    velocity: tuple[float, float, float],
    constraints: Sequence[Constraint],
    horizontal_m_s: float,
    vertical_m_s: float,
    sweeps: int = 8,
) -> Vec3:
    """Bring a velocity into all half spaces, as near as projecting on each in turn comes.

    Then shorten it, direction preserved, to the two positive speed limits. Where the half spaces
    have no common point or `sweeps` do not suffice, it is shortened until it approaches nothing
    faster than the limit, or than 0, by more than TOLERANCE_M_S. Velocity and constraints are in
    any one frame whose z is vertical.
    """
    x, y, z, is_inside = _project(velocity, constraints, sweeps)
    level, steep = math.sqrt(x * x + y * y), abs(z)
    kappa = horizontal_m_s / level if level > horizontal_m_s else 1.0
    if steep > vertical_m_s:
        kappa = min(kappa, vertical_m_s / steep)
    if not is_inside:
        for nx, ny, nz, limit in constraints:
            allowed = max(0.0, limit) + TOLERANCE_M_S
            approach = x * nx + y * ny + z * nz
            if approach > allowed:
                kappa = min(kappa, allowed / approach)
    return Vec3(x * kappa, y * kappa, z * kappa)


def _project(
    velocity: tuple[float, float, float], constraints: Sequence[Constraint], sweeps: int
) -> tuple[float, float, float, bool]:
    """Project on each half space in turn (Gauss-Seidel) until the velocity does not change.

    The last value tells whether it lies in all of them; else it may, or nearly.
    """
    x, y, z = velocity
    worst = 0.0
    for _ in range(sweeps):
        worst = 0.0
        for nx, ny, nz, limit in constraints:
            excess = x * nx + y * ny + z * nz - limit
            if excess > 0.0:
                x, y, z = x - excess * nx, y - excess * ny, z - excess * nz
                worst = max(worst, excess)
        if worst < _SETTLED_M_S:
            break
    return x, y, z, not worst
