"""Try planner parameters on cells of an experiment file: `python benchmarks/explore.py --help`.

Prints a line per cell: coverage with its 95 % interval, the least, the median times at which half
of the trials or more had covered a share, path, and CPU seconds per trial.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from swarm_ctl.experiment.batch import Case, Outcome, simulate
from swarm_ctl.experiment.cell import Cell, case_of
from swarm_ctl.experiment.report import statistic
from swarm_ctl.experiment.specs import load_experiment
from swarm_ctl.explore.planner import PlannerParams

FILE = Path(__file__).resolve().parents[1] / "missions" / "experiments" / "explore.yaml"
SHARES = (50, 75, 90, 95, 99)
SAMPLE_S = 6.0


def changed(cell: Cell, values: str) -> Cell:
    """Replace parameters of the planner by those of a JSON object."""
    given = cell.planner.model_dump(exclude_unset=True) | json.loads(values)
    return cell.model_copy(update={"planner": PlannerParams.model_validate(given)})


def trial(number: int, case: Case, seed: int) -> tuple[Outcome, float]:
    """Run one trial; also the CPU time it took, s."""
    began = time.process_time()
    outcome = simulate(case, seed, range(number, number + 1))
    return outcome, time.process_time() - began


def line(runs: list[tuple[Outcome, float]], sample_s: float) -> str:
    """Sum up the trials of a cell."""
    coverage = [100.0 * outcome.coverage[0] for outcome, _ in runs]
    mean, ci95, _, _ = statistic([float(share[-1]) for share in coverage])
    words = [f"{mean:.2f}" + (f" ± {ci95:.2f}" if ci95 is not None else "")]
    words += [f"min {min(share[-1] for share in coverage):.1f}"]
    for percent in SHARES:
        steps = [int((share < percent).sum()) + 1 for share in coverage if share[-1] >= percent]
        if 2 * len(steps) >= len(runs):
            words.append(f"t{percent} {statistics.median(steps) * sample_s:.0f}")
    words.append(f"path {statistics.fmean(float(outcome.path_m[0]) for outcome, _ in runs):.0f} m")
    return ", ".join([*words, f"cpu {statistics.fmean(cpu for _, cpu in runs):.2f} s"])


def main() -> None:
    """Read the command line, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--file", type=Path, default=FILE, help="experiment file")
    parser.add_argument("--cases", default="", help="beginnings of cells' names, with commas")
    parser.add_argument("--starts", default="rc", help="r: random ones, c: from one place")
    parser.add_argument("--seeds", type=int, default=20, help="trials of each cell")
    parser.add_argument("--first", type=int, default=7000, help="the first trial's number")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", default="{}", help="JSON of planner parameters")
    args = parser.parse_args()
    with ProcessPoolExecutor(args.workers) as pool:
        for cell in load_experiment(args.file).cells:
            if not cell.name.startswith(tuple(args.cases.split(","))):
                continue
            if ("r" if cell.start_m is None else "c") not in args.starts:
                continue
            case = case_of(changed(cell, args.set), SAMPLE_S, args.file, cell.name)
            numbers = range(args.first, args.first + args.seeds)
            runs = list(pool.map(partial(trial, case=case, seed=1), numbers))
            print(f"{cell.name}: {line(runs, SAMPLE_S)}", flush=True)


if __name__ == "__main__":
    main()
