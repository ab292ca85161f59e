"""Measure what a bad radio costs `explore`: `python benchmarks/radio.py --help`.

Three parts: `batch`, the kinematic engine in two dimensions, set up as ALGORITHM 2.2 (ten robots,
20 m x 20 m, 0.2 m/s, 600 s), where it has figures; `flights`, through controllers, MAVLink,
autopilots and the mock's radio, ten vehicles in the hall of `missions/open_3d.yaml`, 300 s; and
`split`, the same hall with a swarm that falls in halves from 100 s to 200 s.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from many import MISSIONS, Hall, Job, Row, pursue

from swarm_ctl.experiment.batch import simulate
from swarm_ctl.experiment.cell import case_of
from swarm_ctl.experiment.report import statistic
from swarm_ctl.experiment.specs import load_experiment

FILE = MISSIONS / "experiments" / "explore.yaml"
LOSSES, RADII_M = (0.0, 0.1, 0.3, 0.5, 0.7), (1.0, 2.0, 4.0)
RADIOS = [(loss, 2.0) for loss in LOSSES] + [(0.0, radius_m) for radius_m in RADII_M]
"""Loss and radius of each case; one of them, loss 0 and 2 m, is in both rows."""
STARTS = {"r": None, "c": (10.0, 2.0)}
"""Anywhere, or all at the paper's place."""
SPLIT = {"from_s": 100.0, "until_s": 200.0, "groups": [[1, 2, 3, 4, 5], [6, 7, 8, 9, 10]]}
STUDY: Mapping[tuple[str, float, float], float] = {
    ("r", 0.0, 2.0): 97.6, ("c", 0.0, 2.0): 97.5, ("r", 0.3, 2.0): 97.4, ("c", 0.3, 2.0): 97.4,
    ("r", 0.7, 2.0): 96.4, ("c", 0.7, 2.0): 95.8, ("r", 0.0, 1.0): 93.7, ("c", 0.0, 1.0): 92.6,
    ("r", 0.0, 4.0): 98.7, ("c", 0.0, 4.0): 98.2, ("3-D", 0.0, 2.0): 97.9, ("3-D", 0.0, 4.0): 97.7,
}  # fmt: skip
"""ALGORITHM's figures, % (2.2 FULL, 2.3 F3, 2.4, 3.3), by start or 3-D, loss and radius."""


@dataclass(frozen=True)
class Trial:
    """One trial of the batch engine in the open."""

    seed: int
    start: str
    loss: float
    radius_m: float

    def name(self) -> str:
        """Name this trial among others of one file."""
        return json.dumps(asdict(self), sort_keys=True)

    def do(self) -> Row:
        """Simulate it."""
        cell = (
            load_experiment(FILE)
            .cells[0]
            .model_copy(
                update={
                    "start_m": STARTS[self.start],
                    "message_loss": self.loss,
                    "radio_m": self.radius_m,
                }
            )
        )
        case = case_of(cell, cell.duration_s, FILE, cell.name)
        outcome = simulate(case, 1, range(self.seed, self.seed + 1))
        return {"coverage": float(outcome.coverage[0][-1])}


def hall(seed: int, **radio: Any) -> Hall:
    """Give a flight in the hall with another radio."""
    return Hall(seed, world={"radio": radio})


Jobs = dict[tuple[Any, ...], list[Job]]
"""Seeds of one case each."""


def batch(seeds: Sequence[int], starts: str) -> Jobs:
    """Give the trials of the batch engine."""
    return {
        (start, *radio): [Trial(seed, start, *radio) for seed in seeds]
        for start, radio in itertools.product(starts, RADIOS)
    }


def flights(seeds: Sequence[int], starts: str) -> Jobs:
    """Give the flights on other radios; starts are anywhere."""
    del starts
    return {
        ("3-D", loss, radius_m): [
            hall(seed, loss_fraction=loss, radius_m=radius_m) for seed in seeds
        ]
        for loss, radius_m in RADIOS
    }


def split(seeds: Sequence[int], starts: str) -> Jobs:
    """Give the flights of a swarm that falls apart, and of one that does not."""
    del starts
    return {
        ("whole",): [hall(seed, loss_fraction=0.0, radius_m=2.0) for seed in seeds],
        ("split",): [hall(seed, partitions=[SPLIT]) for seed in seeds],
    }


PARTS = {"batch": batch, "flights": flights, "split": split}


def table(jobs: Jobs, coverage: Mapping[str, float]) -> Iterator[str]:
    """Give a line per case, for a page: explored %, with its 95 % interval."""
    yield "| case | explored, % | least | seeds | ALGORITHM |"
    yield "|---|---|---|---|---|"
    for case, several in jobs.items():
        shares = [100.0 * coverage[job.name()] for job in several]
        mean, half, _, count = statistic(shares)
        words = [
            ", ".join(map(str, case)),
            f"{mean:.2f} ± {half or 0.0:.2f}",
            f"{min(shares):.1f}",
            str(count),
            str(STUDY.get(case, "")) if len(case) == 3 else "",
        ]
        yield f"| {' | '.join(words)} |"
    if ("split",) in jobs:
        lost = [
            100.0 * (coverage[whole.name()] - coverage[apart.name()])
            for whole, apart in zip(jobs["whole",], jobs["split",], strict=True)
        ]
        mean, half, _, _ = statistic(lost)
        yield f"lost by the split: {mean:.2f} ± {half or 0.0:.2f} points, seed by seed"


KINDS = {
    "r": ("2-D batch, anywhere", "#1f77b4"),
    "c": ("2-D batch, at (10, 2)", "#e8710a"),
    "3-D": ("3-D flights", "#2a9d4a"),
}
AXES = ((1, "messages lost, %", 100.0), (2, "radio radius, m", 1.0))
"""Place in a case's name, words, and factor."""


def draw(jobs: Jobs, coverage: Mapping[str, float], picture: Path) -> None:
    """Draw explored ground over loss and radius, and ALGORITHM's figures as crosses."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - slow to import

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    for axis, (index, label, scale) in zip(figure.subplots(1, 2, sharey=True), AXES, strict=True):
        usual = (2.0, 0.0)[index - 1]
        for kind, (words, colour) in KINDS.items():
            cases = sorted(
                (case for case in jobs if case[0] == kind and case[3 - index] == usual),
                key=lambda case: float(case[index]),
            )
            if not cases:
                continue
            found = [statistic([100.0 * coverage[j.name()] for j in jobs[case]]) for case in cases]
            axis.errorbar(
                [scale * case[index] for case in cases],
                [one.mean for one in found],
                [one.ci95 or 0.0 for one in found],
                color=colour, marker="o", capsize=3, label=words,
            )  # fmt: skip
            known = [(scale * case[index], STUDY[case]) for case in cases if case in STUDY]
            axis.plot([at for at, _ in known], [share for _, share in known], "x", color=colour)
        axis.set_xlabel(label)
        axis.grid(visible=True, alpha=0.3)
    figure.axes[0].set_ylabel("explored, % (x: the study)")
    figure.axes[0].legend(fontsize=8, loc="lower left")
    figure.savefig(picture, dpi=150)


def main() -> None:
    """Read the command line, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    for part, seeds in (("batch", 100), ("flights", 10), ("split", 20)):
        words = f"seeds of each case of {part}, {seeds} unless said; 0 leaves it out"
        parser.add_argument(f"--{part}", type=int, default=seeds, help=words)
    parser.add_argument("--starts", default="rc", help="of batch: r anywhere, c at one place")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--file", type=Path, help="JSON lines to go on from")
    parser.add_argument("--picture", type=Path, help="draw batch and flights into this file")
    options = parser.parse_args()
    drawn: Jobs = {}
    coverage: dict[str, float] = {}
    for part, jobs_of in PARTS.items():
        if not (count := getattr(options, part)):
            continue
        jobs = jobs_of(range(1, count + 1), options.starts)
        wanted = itertools.chain.from_iterable(zip(*jobs.values(), strict=True))
        names = {job.name() for several in jobs.values() for job in several}
        for row in pursue(wanted, options.file, options.workers):
            if row["job"] not in names:
                continue
            coverage[row["job"]] = row["coverage"]
            if row.get("contacts") or row.get("troubles"):
                print(f"{row['job']}: {row['contacts']} contacts, {row['troubles']}", flush=True)
        print("\n".join(table(jobs, coverage)), flush=True)
        drawn |= jobs
    if options.picture:
        draw(drawn, coverage, options.picture)


if __name__ == "__main__":
    main()
