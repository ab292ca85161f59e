"""Let pairs fly at each other, and say how near they come: `python benchmarks/head_on.py --help`.

What keeps vehicles apart is seldom tried to its end: in open space, level, at full speed, with the
radio of `robot_hours.py` and beams that point anywhere. Ten pairs a flight, 8 m apart, two rows.
"""

from __future__ import annotations

import argparse
import itertools
import math
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from many import HALL, MISSIONS, changed
from numpy.typing import NDArray
from robot_hours import FLIGHT, WORLD

from swarm_ctl.experiment.arena import Arena
from swarm_ctl.explore.planner import Plan, PlannerParams
from swarm_ctl.mission import load_mission
from swarm_ctl.record.unrecorded import Unrecorded

Floats = NDArray[np.float64]
APART_M, LANES_M, ROWS_M = 8.0, (2.0, 6.0, 10.0, 14.0, 18.0), (1.0, 11.0)
ASIDE_M = 0.3
"""By so much at most they would miss each other."""
LONGEST_WAIT_S = 0.7
DURATION_S = 20.0


class Charge:
    """Turn the nose anywhere, wait a moment, and fly straight on."""

    courses_rad: Iterator[float]
    """Of those that will be made, in order."""

    def __init__(
        self,
        params: PlannerParams,
        *,
        speed_m_s: float,
        climb_m_s: float,  # noqa: ARG002 - every planner is told
        seeds: list[Any],
    ) -> None:
        dice = [np.random.default_rng(seed) for seed in seeds]
        self._speed_m_s, self._period_s = speed_m_s, params.period_s
        self._yaw_rad = np.array([one.uniform(-np.pi, np.pi) for one in dice])
        self._wait_s = np.array([one.uniform(0.0, LONGEST_WAIT_S) for one in dice])
        self._course_rad = np.array([next(self.courses_rad) for _ in seeds])

    def step(
        self, position_m: Floats, _heading_rad: Floats, _ranges_m: Floats, _peers_m: Floats
    ) -> Plan:
        """Give the same velocity again and again."""
        velocity_m_s = np.zeros_like(position_m)
        go = np.where(self._wait_s <= 0.0, self._speed_m_s, 0.0)
        self._wait_s -= self._period_s
        velocity_m_s[:, 0] = go * np.cos(self._course_rad)
        velocity_m_s[:, 1] = go * np.sin(self._course_rad)
        never = np.zeros(len(position_m), dtype=bool)
        return Plan(velocity_m_s, self._yaw_rad.copy(), never, position_m, never)


def starts(seed: int) -> list[dict[str, Any]]:
    """Put one of each pair in the west, then one in the east."""
    dice = np.random.default_rng(seed)
    pairs = [
        ([east_m, north_m], [east_m + APART_M, north_m + float(dice.uniform(-ASIDE_M, ASIDE_M))])
        for north_m in LANES_M
        for east_m in ROWS_M
    ]
    return [{"position_m": place} for pair in pairs for place in pair]


def closest_m(seed: int) -> list[float]:
    """Fly ten pairs; give how near the two of each came."""
    places = starts(seed)
    with tempfile.TemporaryDirectory() as folder:
        world = MISSIONS / "worlds" / "open_3d.yaml"
        flown = load_mission(
            changed(HALL, {"flight": FLIGHT}, Path(folder) / "mission.yaml"),
            world=changed(world, {**WORLD, "starts": places}, Path(folder) / "world.yaml"),
            vehicles=len(places),
            planner=f"{__name__}:Charge",
            duration_s=DURATION_S,
            seed=seed,
        )
        Charge.courses_rad = itertools.cycle((math.pi / 2.0, -math.pi / 2.0))
        arena = Arena(flown, Unrecorded())
    agents = [controller.agent for controller in arena.controllers]
    position = arena.fleet.dynamics.position_ned_m
    least = np.full(len(places) // 2, np.inf)
    while any(agent.explored_to_s is None for agent in agents):
        arena.step()
        least = np.minimum(least, np.linalg.norm(position[0::2] - position[1::2], axis=1))
    found: list[float] = least.tolist()
    return found


def main() -> None:
    """Read the command line, fly, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=60, help="of ten pairs each")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    with ProcessPoolExecutor(options.workers) as pool:
        flights = pool.map(closest_m, range(1, options.flights + 1))
        near = np.sort([apart_m for flight in flights for apart_m in flight])
    low = ", ".join(f"{100.0 * part:g} % {np.quantile(near, part):.3f}" for part in (0.01, 0.05))
    below = ", ".join(f"{limit} m: {np.count_nonzero(near < limit)}" for limit in (0.6, 0.65, 0.7))
    print(f"{len(near)} pairs: closest {near[0]:.3f} m, {low}, median {np.median(near):.3f}")
    print(f"nearer than {below}")


if __name__ == "__main__":
    main()
