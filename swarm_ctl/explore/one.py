"""The planner of one vehicle in flight, whatever its kind, asked in plain numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from swarm_ctl.explore import kernels
from swarm_ctl.explore.chance import Seed
from swarm_ctl.explore.explorer import Explorer
from swarm_ctl.explore.frontier import Others, find_way
from swarm_ctl.explore.planner import OnePlan, PlannerParams, Planning, plan_with

AskOne = Callable[[list[float], float, Sequence[float], Sequence[Sequence[float]]], OnePlan]
"""Plan one vehicle's next step, as `Explorer.step_one` does."""


def make_planner(
    params: PlannerParams,
    *,
    speed_m_s: float,
    climb_m_s: float,
    seeds: Sequence[Seed],
    sysid: int = 0,
    birth: int = 0,
) -> Planning:
    """Build the planner of one vehicle: with a memory for kind `explore`, else without.

    `sysid` and `birth` name the vehicle in the trails that it shares.
    """
    if params.kind != "explore":
        return plan_with(params, speed_m_s=speed_m_s, climb_m_s=climb_m_s, seeds=seeds)
    if len(seeds) != 1:
        raise ValueError(f"an explorer plans for one vehicle, not {len(seeds)}")
    return Explorer(
        params,
        speed_m_s=speed_m_s,
        climb_m_s=climb_m_s,
        seed=seeds[0],
        sysid=sysid,
        birth=birth,
    )


def ask_one(planner: Planning, dimensions: int) -> AskOne:
    """Ask a planner of one vehicle in plain numbers: arrays of one row are slow to make."""
    if isinstance(planner, Explorer):
        return planner.step_one

    def ask(
        place_m: list[float],
        heading_rad: float,
        ranges_m: Sequence[float],
        peers_m: Sequence[Sequence[float]],
    ) -> OnePlan:
        plan = planner.step(
            np.array([place_m]),
            np.array([heading_rad]),
            np.array([ranges_m]),
            np.array(peers_m).reshape(1, -1, dimensions),
        )
        return OnePlan(
            plan.velocity_m_s[0].tolist(),
            float(plan.heading_rad[0]),
            bool(plan.avoiding[0]),
            plan.target_m[0].tolist(),
            bool(plan.is_new[0]),
        )

    return ask


def warm_up(params: PlannerParams) -> None:
    """Run every compiled loop once: compiling in flight would stop the stream of setpoints.

    Takes seconds when numba is installed and has nothing in its cache, else next to nothing.
    """
    d = params.dimensions
    explorer = Explorer(params, speed_m_s=1.0, climb_m_s=1.0, seed=0)
    wall = np.full((1, d), 0.6)
    for step in range(4):
        place = [0.3 * step] * d
        explorer.step(
            np.array([place]), np.zeros(1), np.full((1, 6), 0.6), np.full((1, 0, d), math.nan)
        )
        explorer.observe_hits(wall)
        explorer.decide()
    explorer.way_to([0.9] * d, [0.0] * d)
    find_way(explorer.memory, [0.9] * d, Others((), ([0.0] * d,), 1.0), 1)
    grid, here = explorer.memory.grid, explorer.memory.cells([0.9] * d)
    kernels.unknown_within(grid, 0, 0, 0, 1)
    kernels.is_line_free(grid, here, here)
    kernels.look(grid, 0.0, 0.0, 0.0)
