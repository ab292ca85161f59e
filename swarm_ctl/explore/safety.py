"""The velocity safety filter: half-space limits from peers and walls, then the speed limits.

Every line works component by component, on floats for one vehicle and on arrays (n,) for a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore.chance import Floats
from swarm_ctl.model import Vec3

Number = TypeVar("Number", float, NDArray[np.float64])

TOLERANCE_M_S = 0.01
"""Approach beyond a limit that is let pass where limits contradict each other."""
_SETTLED_M_S = 1e-6


class Constraint(NamedTuple):
    """A half space of velocities, v . n <= limit; n is a unit vector towards what is in the way."""

    nx: float | Floats
    ny: float | Floats
    nz: float | Floats
    limit: float | Floats
    """m/s; negative: move away at least this fast."""


def peer_limit(
    distance_m: Number, separation_m: float, braking_m_s2: float, speed_m_s: float
) -> Number:
    """Give the largest speed towards a peer, m/s; negative below the separation.

    With e = distance - separation: min(sqrt(a e), 2 e), each of the two taking half of the closing
    speed; for e < 0 max(-speed, 2 e). `braking_m_s2` (a) is half of what the vehicle can do.
    """
    excess = distance_m - separation_m
    braked = (braking_m_s2 * _larger(excess, 0.0)) ** 0.5
    limit: Number = _smaller(braked, _larger(2.0 * excess, -speed_m_s))
    return limit


def wall_limit(
    distance_m: Number, standoff_m: float, braking_m_s2: float, pushout_m_s: float = 0.5
) -> Number:
    """Give the largest speed towards a wall, m/s: min(sqrt(2 a e), 2 e), e = distance - standoff.

    For e < 0 it is negative, down to -`pushout_m_s`.
    """
    excess = distance_m - standoff_m
    braked = (2.0 * braking_m_s2 * _larger(excess, 0.0)) ** 0.5
    limit: Number = _smaller(braked, _larger(2.0 * excess, -pushout_m_s))
    return limit


@overload
def limit_velocity(
    velocity: tuple[float, float, float],
    constraints: Sequence[Constraint],
    horizontal_m_s: float,
    vertical_m_s: float,
    sweeps: int = 8,
) -> Vec3: ...
@overload
def limit_velocity(
    velocity: tuple[Floats, Floats, Floats],
    constraints: Sequence[Constraint],
    horizontal_m_s: float,
    vertical_m_s: float,
    sweeps: int = 8,
) -> tuple[Floats, Floats, Floats]: ...
def limit_velocity(
    velocity: tuple[Any, Any, Any],
    constraints: Sequence[Constraint],
    horizontal_m_s: float,
    vertical_m_s: float,
    sweeps: int = 8,
) -> tuple[Any, Any, Any]:
    """Bring a velocity into all half spaces, as near as projecting on each in turn comes.

    Then shorten it, direction preserved, to the two positive speed limits. Where the half spaces
    have no common point or `sweeps` do not suffice, it is shortened until it approaches nothing
    faster than the limit, or than 0, by more than TOLERANCE_M_S. Every component of the velocity
    and of the constraints is a float or an array (n,), in any one frame whose z is vertical.
    """
    x, y, z = _project(velocity, constraints, sweeps)
    kappa = horizontal_m_s / _larger((x * x + y * y) ** 0.5, horizontal_m_s)
    kappa = _smaller(kappa, vertical_m_s / _larger(abs(z), vertical_m_s))
    for nx, ny, nz, limit in constraints:
        allowed = _larger(limit, 0.0) + TOLERANCE_M_S
        kappa = _smaller(kappa, allowed / _larger(x * nx + y * ny + z * nz, allowed))
    return Vec3(x * kappa, y * kappa, z * kappa)


def _project(
    velocity: tuple[Any, Any, Any], constraints: Sequence[Constraint], sweeps: int
) -> tuple[Any, Any, Any]:
    """Project on each half space in turn (Gauss-Seidel) until no vehicle's velocity changes."""
    x, y, z = velocity
    for _ in range(sweeps):
        worst = 0.0
        for nx, ny, nz, limit in constraints:
            excess = _larger(x * nx + y * ny + z * nz - limit, 0.0)
            x, y, z = x - excess * nx, y - excess * ny, z - excess * nz
            worst = _larger(excess, worst)
        if (worst if isinstance(worst, float) else worst.max(initial=0.0)) < _SETTLED_M_S:
            break
    return x, y, z


# The conditional expressions save a call: these two are half of the filter's time on floats.
def _larger(a: Any, b: Any) -> Any:
    return (a if a > b else b) if isinstance(a, float) else np.maximum(a, b)  # noqa: FURB136


def _smaller(a: Any, b: Any) -> Any:
    return (a if a < b else b) if isinstance(a, float) else np.minimum(a, b)  # noqa: FURB136
