"""Time the batch engine on one core: `python benchmarks/batch.py [--json FILE]`."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import machine

from swarm_ctl.experiment.batch import Case, Field, has_numba, simulate
from swarm_ctl.explore.planner import PlannerParams

STEPS, TRIALS, REPEATS = 600, 200, 3
TARGETS = {"numpy": 0.5, "compiled": 3.0}
"""Million robot-steps per second for the hybrid with Table I and coverage marking, N = 10."""


def case(robots: int, kind: str = "lf-pso", boxes: int = 0) -> Case:
    """Describe the paper's field, with boxes in rows if wanted."""
    places = [(2.0 + 4.0 * (i % 4), 2.0 + 4.0 * (i // 4)) for i in range(boxes)]
    field = Field((0.0, 0.0), (20.0, 20.0), tuple((n, e, n + 1.0, e + 1.5) for n, e in places))
    params = PlannerParams.model_validate(
        {"kind": kind, "period_s": 1.0, "avoid_speed_fraction": 1.0}
    )
    return Case(field, params, robots, STEPS, STEPS)


def million_per_s(given: Case, trials: int, *, fast: bool) -> float:
    """Measure million robot-steps per second of CPU, the best of some runs."""
    simulate(given, 1, range(2), fast=fast)
    best = 0.0
    for _ in range(REPEATS):
        begin = time.process_time()
        simulate(given, 1, range(trials), fast=fast)
        steps = trials * given.robots * given.steps
        best = max(best, steps / (time.process_time() - begin) / 1e6)
    return best


def measure() -> dict[str, float]:
    """Measure every case."""
    ways = {"numpy": False} | ({"compiled": True} if has_numba() else {})
    figures = {}
    for way, fast in ways.items():
        figures[way] = million_per_s(case(10), TRIALS, fast=fast)
        for trials in (20, 50, 400):
            figures[f"{way}, {trials} trials"] = million_per_s(case(10), trials, fast=fast)
        figures[f"{way}, LF alone"] = million_per_s(case(10, "levy"), TRIALS, fast=fast)
        figures[f"{way}, N = 30"] = million_per_s(case(30), TRIALS // 4, fast=fast)
        figures[f"{way}, 16 boxes"] = million_per_s(case(10, boxes=16), TRIALS // 4, fast=fast)
    return figures


def main() -> None:
    """Print the table, and write it as JSON if told."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the figures to this file, M/s")
    options = parser.parse_args()
    figures = measure()
    print(f"N = 10, {TRIALS} trials of {STEPS} steps unless said; M robot-steps per s of CPU")
    print(f"{'case':24} {'M/s':>8} {'target':>8}")
    for name, value in figures.items():
        print(f"{name:24} {value:8.2f} {TARGETS.get(name, ''):>8}")
    machine.write(options.json, figures)


if __name__ == "__main__":
    main()
