"""What came of an experiment: means with intervals beside the paper's figures, and pictures."""

from __future__ import annotations

import dataclasses
import math
import re
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from swarm_ctl.experiment.batch import Case, simulate
from swarm_ctl.experiment.cell import METRICS, Cell
from swarm_ctl.experiment.specs import Experiment
from swarm_ctl.record.truth import Truth

_SHOWN = {
    "coverage_percent": ("explored, %", 2),
    "time_s": ("time, s", 0),
    "victims_found": ("victims", 2),
    "collisions": ("collisions", 2),
    "energy_kwh": ("energy, kWh", 4),
}


class Statistic(NamedTuple):
    """Mean of the trials that have a value, and half the width of its 95 % interval."""

    mean: float | None
    ci95: float | None
    """Student's; none for fewer than two values."""
    sd: float | None
    values: int
    """How many had one."""


def statistic(values: Sequence[float | None]) -> Statistic:
    """Summarise the values that are there."""
    known = [value for value in values if value is not None]
    if len(known) < 2:
        return Statistic(known[0] if known else None, None, None, len(known))
    sd = statistics.stdev(known)
    half = student95(len(known) - 1) * sd / math.sqrt(len(known))
    return Statistic(statistics.fmean(known), half, sd, len(known))


def student95(freedom: int) -> float:
    """Give the two-sided 95 % quantile of Student's t; Abramowitz and Stegun, 26.7.5."""
    exact = {1: 12.7062, 2: 4.3027, 3: 3.1824, 4: 2.7764, 5: 2.5706}  # the series is off
    if freedom in exact:
        return exact[freedom]
    z, v = 1.959964, float(freedom)
    return (
        z
        + (z**3 + z) / (4 * v)
        + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * v**2)
        + (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * v**3)
    )


@dataclass(frozen=True, slots=True)
class CellResult:
    """The trials of a cell, in short."""

    cell: Cell
    trials: int
    typical: int
    """The trial whose coverage is nearest to the mean."""
    statistics: Mapping[str, Statistic]
    """By the columns of `trials.csv`."""

    def ours(self, metric: str) -> Statistic:
        """Give one of METRICS; the time is what was given, as in the paper."""
        if metric == "time_s":
            return Statistic(self.cell.duration_s, None, None, self.trials)
        return self.statistics[metric]

    def paper(self, metric: str) -> float | None:
        """Give the paper's figure for one of METRICS."""
        value: float | None = getattr(self.cell.paper, metric)
        return value


@dataclass(frozen=True, slots=True)
class ExperimentResult:
    """What `run_experiment` gives; cells without a finished trial are left out."""

    experiment: Experiment
    folder: Path
    cells: tuple[CellResult, ...]
    is_interrupted: bool = False
    notes: tuple[str, ...] = ()
    """What could not be done, a sentence each."""

    def with_notes(self, notes: Sequence[str]) -> ExperimentResult:
        """Add sentences."""
        return dataclasses.replace(self, notes=(*self.notes, *notes))

    def table(self) -> tuple[list[str], list[list[Any]]]:
        """Give `cells.csv`: header and lines, full precision."""
        header = ["cell", "figure", "trials"]
        for metric in METRICS:
            header += [metric, f"{metric}_ci95", f"{metric}_paper"]
        extra = [n for n in (self.cells[0].statistics if self.cells else {}) if n not in METRICS]
        lines = []
        for result in self.cells:
            line: list[Any] = [result.cell.name, result.cell.figure, result.trials]
            for metric in METRICS:
                ours = result.ours(metric)
                line += [ours.mean, ours.ci95, result.paper(metric)]
            lines.append(line + [result.statistics[name].mean for name in extra])
        return header + extra, lines

    def dump(self) -> dict[str, Any]:
        """Give `summary.json`."""
        return {
            "experiment": self.experiment.name,
            "description": self.experiment.description,
            "trials": self.experiment.trials,
            "seed": self.experiment.seed,
            "cells": [
                {
                    "name": one.cell.name,
                    "figure": one.cell.figure,
                    "quote": one.cell.quote,
                    "paper": one.cell.paper.model_dump(exclude_none=True),
                    "typical_trial": one.typical,
                    **{name: value._asdict() for name, value in one.statistics.items()},
                }
                for one in self.cells
            ],
        }


def result_lines(result: ExperimentResult) -> RenderableType:
    """Show the table: ours with its 95 % interval, the paper's figure, the difference.

    A line per cell and figure of the paper, and at least the coverage; fits 80 columns.
    """
    table = Table(title=result.experiment.description or None, title_justify="left", box=None)
    table.add_column("")
    table.add_column("", no_wrap=True)
    for name in ("ours", "paper", "off by"):
        table.add_column(name, justify="right", no_wrap=True)
    for one in result.cells:
        name = f"{one.cell.name}  {one.cell.figure}".rstrip()
        for metric, (words, _) in _SHOWN.items():
            if metric == "coverage_percent" or one.paper(metric) is not None:
                table.add_row(
                    name, words, _ours(one, metric), _paper(one, metric), _off(one, metric)
                )
                name = ""
    end = "interrupted: the same command continues" if result.is_interrupted else "results"
    trials = sum(one.trials for one in result.cells)
    line = Text(f"{end}: {result.folder}  ({trials} trials; ± is a 95 % interval of the mean)")
    return Group(table, Text(), line, *(Text(note, style="yellow") for note in result.notes))


def _ours(one: CellResult, metric: str) -> str:
    ours, digits = one.ours(metric), _SHOWN[metric][1]
    if ours.mean is None:
        return ""
    interval = "" if ours.ci95 is None else f" ± {ours.ci95:.{digits}f}"
    return f"{ours.mean:.{digits}f}{interval}"


def _paper(one: CellResult, metric: str) -> str:
    value = one.paper(metric)
    return "" if value is None else f"{value:g}"


def _off(one: CellResult, metric: str) -> Text:
    """Show the difference, green where the paper's figure is within the interval."""
    paper, ours = one.paper(metric), one.ours(metric)
    if paper is None or ours.mean is None or metric == "time_s":
        return Text()
    off = ours.mean - paper
    inside = ours.ci95 is not None and abs(off) <= ours.ci95
    return Text(f"{off:+.2f}", style="green" if inside else "")


def draw_pictures(result: ExperimentResult, cases: Mapping[str, Case]) -> list[str]:
    """Draw `paths-CELL.png` of each cell's typical trial, like the paper's Figs 3-8; notes."""
    try:
        import matplotlib.figure  # noqa: F401, PLC0415 - an extra, and slow to import
    except ImportError:
        return ["no pictures: matplotlib is missing (pip install 'swarm-ctl[experiment]')"]
    from swarm_ctl.record.ground import paths_figure  # noqa: PLC0415 - an extra
    from swarm_ctl.record.looks import DPI  # noqa: PLC0415 - an extra

    notes = []
    for one in result.cells:
        truth, share = _retrace(cases[one.cell.name], result.experiment.seed, one.typical)
        summary = {
            "mission": f"{one.cell.figure} {one.cell.name}".strip(),
            "vehicles": one.cell.vehicles,
            "planner": one.cell.planner.kind,
            "seed": f"{result.experiment.seed}, trial {one.typical}",
            "duration_s": one.cell.duration_s,
            "coverage_fraction": share,
        }
        slug = re.sub(r"[^a-z0-9]+", "-", one.cell.name.lower()).strip("-")
        try:
            picture = result.folder / f"paths-{slug}.png"
            paths_figure(truth, summary).savefig(picture, dpi=DPI, facecolor="white")
        except OSError as error:
            notes.append(f"no picture of {one.cell.name}: {error.strerror or error}")
    return notes


def _retrace(case: Case, seed: int, trial: int) -> tuple[Truth, float]:
    """Run one trial again, which gives the same paths, as the referee of a flight would see it."""
    outcome = simulate(case, seed, range(trial, trial + 1), tracks=True)
    field, tracks = case.field, outcome.tracks_m[0]
    d = case.dimensions
    victims = np.array(field.victims_m, dtype=np.float64).reshape(-1, d)
    step = outcome.found_step[0]
    found_s = np.where(step >= 0, step * case.planner.period_s, np.nan)
    size = np.ceil((np.subtract(field.high_m, field.low_m)) / field.cell_m - 1e-9).astype(int)
    boxes = [
        {"points_ne_m": [[a, b], [a, f], [e, f], [e, b]], "bottom_m": 0.0, "top_m": 3.0}
        for a, b, e, f in case.boxes[:, [0, 1, d, d + 1]].tolist()
    ]
    if d == 2:
        tracks = np.concatenate([tracks, np.full((*tracks.shape[:2], 1), -0.3)], axis=2)
        victims = np.concatenate([victims, np.zeros((len(victims), 1))], axis=1)
    arrays = {
        "track_ned_m": tracks,
        "blocked": np.zeros(size[:2], dtype=np.bool_),
        "origin_ne_m": np.array(field.low_m[:2]),
        "cell_m": np.array(field.cell_m),
        "victims_ned_m": victims,
        "victim_found_s": found_s,
    }
    return Truth(arrays=arrays, world={"polygons": boxes}), float(outcome.coverage[0, -1])
