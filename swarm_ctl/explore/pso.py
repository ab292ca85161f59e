"""The motion of a particle and its limits (Eq. 6)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarm_ctl.explore.chance import Floats


def next_motion(
    motion_m: Floats,
    local_best_m: Floats,
    global_best_m: Floats,
    chance: Floats,
    weights: tuple[float, float, float],
) -> Floats:
    """Give V(t+1), metres per planner step, in local NED; all vectors (n, d).

    V(t+1) = omega V(t) + p rand (P_lb - x) + n rand (P_gb - x), `weights` being (omega, p, n).
    `chance` holds the numbers in [0, 1): (n, 2d), one per term and axis, or (n, 2), one per term.
    """
    omega, p_omega, n_omega = weights
    terms = chance.shape[1] // 2
    motion = omega * motion_m
    motion += p_omega * chance[:, :terms] * local_best_m
    if n_omega:
        motion += n_omega * chance[:, terms:] * global_best_m
    return motion


def limit_motion(motion_m: Floats, level_m: float, climb_m: float) -> tuple[Floats, Floats]:
    """Shorten (n, d) motions to `level_m` along the ground and, in 3-D, `climb_m` up or down.

    The direction is preserved: V = kappa V', kappa = min(1, v_h / |V'_h|, v_z / |V'_z|). Both
    limits are positive. The second value is the limited length along the ground (n,).
    """
    ground_m = np.hypot(motion_m[:, 0], motion_m[:, 1])
    kappa = level_m / np.maximum(ground_m, level_m)
    if motion_m.shape[1] == 3:
        np.minimum(kappa, climb_m / np.maximum(np.abs(motion_m[:, 2]), climb_m), out=kappa)
    return motion_m * kappa[:, None], ground_m * kappa


def fly(
    motion_m: Floats,
    local_best_m: Floats,
    global_best_m: Floats,
    chance: Floats,
    weights: tuple[float, float, float],
    level_m: float,
    climb_m: float,
) -> tuple[Floats, Floats]:
    """Give the next motions within the limits and their lengths along the ground."""
    motion_m = next_motion(motion_m, local_best_m, global_best_m, chance, weights)
    return limit_motion(motion_m, level_m, climb_m)


def fly_one(
    motion_m: Sequence[float],
    local_best_m: Sequence[float],
    global_best_m: Sequence[float],
    chance: Sequence[float],
    weights: tuple[float, float, float],
    level_m: float,
    climb_m: float,
) -> list[float]:
    """Give what `fly` gives for one vehicle and one number per term: bit for bit, sooner."""
    omega, p_omega, n_omega = weights
    pull, push = p_omega * chance[0], n_omega * chance[1]
    motion = [
        omega * before + pull * local_best + push * global_best
        for before, local_best, global_best in zip(
            motion_m, local_best_m, global_best_m, strict=True
        )
    ]
    # numpy's hypot is the C library's, and so is this one; math.hypot rounds otherwise.
    kappa = level_m / max(abs(complex(motion[0], motion[1])), level_m)
    if len(motion) == 3:
        steep = climb_m / max(abs(motion[2]), climb_m)
        if steep < kappa or steep != steep:  # noqa: PLR0124 - what is no number must show
            kappa = steep
    return [part * kappa for part in motion]
