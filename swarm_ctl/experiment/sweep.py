"""Run an experiment in chunks of trials that are kept as they finish, so that it can resume."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swarm_ctl.errors import MissionError, plain
from swarm_ctl.experiment import pool
from swarm_ctl.experiment.batch import Case, simulate
from swarm_ctl.experiment.cell import Cell, case_of
from swarm_ctl.experiment.report import CellResult, ExperimentResult, draw_pictures, statistic
from swarm_ctl.experiment.specs import Experiment, load_experiment

CHUNK = 50
"""Trials in a chunk: half a second's work for ten robots. It has no influence on any result."""
EXPLORE_CHUNK = 5
"""The same for kind `explore`, whose trials take a hundred times as long."""
SPEC, CHUNKS, TRIALS_CSV, CELLS_CSV, SUMMARY = (
    "experiment.json",
    "chunks",
    "trials.csv",
    "cells.csv",
    "summary.json",
)
_TIMES = (50, 75, 90)
"""Shares of the field, %, whose time is reported."""
COLUMNS = (
    "coverage_percent", "victims_found", "collisions", "bumps", "path_m", "energy_kwh",
    *(f"t{share}_s" for share in _TIMES),
)  # fmt: skip
"""Columns of `trials.csv` after cell and trial."""

Row = tuple[float | None, ...]
"""One trial, in the order of COLUMNS; None: the share was not reached."""
Progress = Callable[[int, int, str], None]
"""Called with trials done, trials in all and the name of the cell."""


@dataclass(frozen=True, slots=True)
class Job:
    """Consecutive trials of one cell; it can be computed anywhere, and pickled."""

    cell: Cell
    case: Case
    seed: int
    index: int
    """Of the cell in the experiment."""
    first: int
    count: int

    @property
    def file_name(self) -> str:
        """Name of its chunk file."""
        return f"{self.index:03d}-{self.first:07d}.json"


Compute = Callable[[Sequence[Job]], Iterator[tuple[Job, list[Row]]]]
"""Gives the result of every job, in any order. `locally` is one; a cluster may be another."""


def run_job(job: Job) -> list[Row]:
    """Compute a job; the same rows wherever and beside whatever it runs."""
    case = job.case
    outcome = simulate(case, job.seed, range(job.first, job.first + job.count))
    period_s = case.planner.period_s
    ends = [*range(case.sample_steps, case.steps, case.sample_steps), case.steps]
    times_s = np.array([0, *ends]) * period_s
    rows = []
    for trial in range(job.count):
        share = np.concatenate([[0.0], 100.0 * outcome.coverage[trial]])
        path_m = float(outcome.path_m[trial])
        energy_kwh = job.cell.energy.kwh(case.robots, case.steps * period_s, path_m)
        times = [
            float(np.interp(percent, share, times_s)) if share[-1] >= percent else None
            for percent in _TIMES
        ]
        victims = np.count_nonzero(outcome.found_step[trial] >= 0)
        counts = (victims, outcome.collisions[trial], outcome.bumps[trial])
        rows.append((float(share[-1]), *map(int, counts), path_m, energy_kwh, *times))
    return rows


def locally(workers: int) -> Compute:
    """Compute in this process, or in several on this machine that end with the last job."""

    def compute(jobs: Sequence[Job]) -> Iterator[tuple[Job, list[Row]]]:
        with processes(workers) as these:
            yield from these(jobs)

    return compute


@contextmanager
def processes(workers: int) -> Iterator[Compute]:
    """Compute in this process, or in several on this machine that live as long as the block."""
    with pool.processes(workers, run_job) as compute:
        yield compute


def run_experiment(
    path: Path,
    *,
    trials: int | None = None,
    workers: int | None = None,
    seed: int | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
    compute: Compute | None = None,
) -> ExperimentResult:
    """Run an experiment file, or what of it is not in the folder yet; then write the results.

    `trials` and `seed` replace the file's own, `workers` are processes (none: one per core), `out`
    is by default `runs/NAME-TRIALS-SEED`. Ctrl-C ends it with what is done, and `is_interrupted`;
    the same call continues. MissionError for a bad file or a folder of another experiment.
    """
    experiment = load_experiment(path, trials=trials, seed=seed)
    if workers is not None and workers < 1:
        raise MissionError(path, "workers", f"must be at least 1, not {workers}")
    name = f"{experiment.name}-{experiment.trials}-{experiment.seed}"
    folder = _Folder(out or Path("runs") / name, path, experiment)
    jobs = jobs_of(path, experiment)
    missing = [job for job in jobs if job.file_name not in folder.done]
    compute = compute or locally(min(workers or os.cpu_count() or 1, max(1, len(missing))))
    count, total = sum(j.count for j in jobs) - sum(j.count for j in missing), _total(jobs)
    is_interrupted = False
    try:
        for job, rows in compute(missing):
            folder.keep(job, rows)
            count += job.count
            if progress is not None:
                progress(count, total, job.cell.name)
    except KeyboardInterrupt:
        is_interrupted = True
    return _finish(folder, experiment, jobs, is_interrupted=is_interrupted)


def jobs_of(path: Path, experiment: Experiment) -> list[Job]:
    """Cut an experiment into jobs, in the order of its file."""
    jobs = []
    for index, cell in enumerate(experiment.cells):
        case = case_of(cell, experiment.sample_s, path, f"cells.{index}")
        size = min(CHUNK, EXPLORE_CHUNK) if cell.planner.kind == "explore" else CHUNK
        for first in range(0, experiment.trials, size):
            count = min(size, experiment.trials - first)
            jobs.append(Job(cell, case, experiment.seed, index, first, count))
    return jobs


def _total(jobs: Sequence[Job]) -> int:
    return sum(job.count for job in jobs)


def _finish(
    folder: _Folder, experiment: Experiment, jobs: Sequence[Job], *, is_interrupted: bool
) -> ExperimentResult:
    """Put the chunks together in the order of the file, whoever computed them, and when."""
    rows: list[list[Row]] = [[] for _ in experiment.cells]
    for job in jobs:
        if job.file_name in folder.done:
            rows[job.index] += folder.read(job)
    cells = tuple(
        _cell_result(cell, these)
        for cell, these in zip(experiment.cells, rows, strict=True)
        if these
    )
    result = ExperimentResult(experiment, folder.path, cells, is_interrupted=is_interrupted)
    lines = [
        (cell.name, trial, *row)
        for cell, these in zip(experiment.cells, rows, strict=True)
        for trial, row in enumerate(these)
    ]
    if not is_interrupted:
        write_whole(folder.path / TRIALS_CSV, as_csv(("cell", "trial", *COLUMNS), lines))
        write_whole(folder.path / CELLS_CSV, as_csv(*result.table()))
        write_whole(folder.path / SUMMARY, json.dumps(result.dump(), indent=2) + "\n")
        if experiment.pictures:
            cases = {job.cell.name: job.case for job in jobs}
            result = result.with_notes(draw_pictures(result, cases))
    return result


def _cell_result(cell: Cell, rows: Sequence[Row]) -> CellResult:
    columns = {name: [row[i] for row in rows] for i, name in enumerate(COLUMNS)}
    coverage = [share for share in columns["coverage_percent"] if share is not None]
    mean = sum(coverage) / len(coverage)
    typical = min(range(len(rows)), key=lambda trial: abs(coverage[trial] - mean))
    statistics = {name: statistic(values) for name, values in columns.items()}
    return CellResult(cell, len(rows), typical, statistics)


class _Folder:
    """The chunks of one experiment; another one is refused."""

    def __init__(self, path: Path, source: Path, experiment: Experiment) -> None:
        self.path = path
        spec = spec_of(experiment)
        try:
            (path / CHUNKS).mkdir(parents=True, exist_ok=True)
            if (path / SPEC).exists():
                _refuse_another(path, source, spec)
            else:
                write_whole(path / SPEC, json.dumps(spec, indent=2) + "\n")
        except OSError as error:
            reason = f"{path}: cannot keep the results: {plain(error)}"
            raise MissionError(source, "", reason) from None
        self.done = {chunk.name for chunk in (path / CHUNKS).glob("*.json")}

    def keep(self, job: Job, rows: list[Row]) -> None:
        """Write a finished job, all of it or nothing."""
        write_whole(self.path / CHUNKS / job.file_name, json.dumps(rows) + "\n")
        self.done.add(job.file_name)

    def read(self, job: Job) -> list[Row]:
        """Read a finished job."""
        text = (self.path / CHUNKS / job.file_name).read_text(encoding="utf-8")
        return [tuple(row) for row in json.loads(text)]


def spec_of(experiment: Experiment) -> dict[str, Any]:
    """Give what decides on the results: the cells, with the worlds' text, trials and seed."""
    spec = experiment.model_dump(mode="json", exclude={"description", "pictures", "tune"})
    worlds = {str(cell.world): cell.world.read_text(encoding="utf-8") for cell in experiment.cells}
    texts = [worlds.pop(world) for world in sorted(worlds)]
    for cell in spec["cells"]:
        cell["world"] = Path(cell["world"]).name
        for key in ("figure", "quote", "paper"):
            del cell[key]  # words beside the numbers may change
    return {**spec, "worlds": texts}


def _refuse_another(path: Path, source: Path, spec: dict[str, Any]) -> None:
    try:
        kept = json.loads((path / SPEC).read_text(encoding="utf-8"))
    except ValueError:
        kept = None
    if kept != spec:
        key = difference(kept, spec)
        reason = f"{path} holds another experiment (its {key} differs); name a new folder"
        raise MissionError(source, "out", reason)


def difference(kept: Any, given: Any, key: str = "") -> str:
    """Name the first key that differs."""
    if isinstance(kept, dict) and isinstance(given, dict) and kept.keys() == given.keys():
        pairs = [(name, kept[name], given[name]) for name in given]
    elif isinstance(kept, list) and isinstance(given, list) and len(kept) == len(given):
        pairs = [(str(i), *pair) for i, pair in enumerate(zip(kept, given, strict=True))]
    else:
        return key or SPEC
    name, one, other = next(pair for pair in pairs if pair[1] != pair[2])
    return difference(one, other, f"{key}.{name}" if key else name)


def as_csv(header: Sequence[str], lines: Sequence[Sequence[Any]]) -> str:
    """Write lines; floats in their shortest exact form, so that equal numbers are equal bytes."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(lines)
    return text.getvalue()


def write_whole(path: Path, text: str) -> None:
    """Replace a file as a whole."""
    half = path.with_name(path.name + ".tmp")
    half.write_text(text, encoding="utf-8")
    half.replace(path)
