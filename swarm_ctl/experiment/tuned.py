"""What came of a study: its trials, and its winner on a seed that it has not seen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from swarm_ctl.experiment.report import Statistic, statistic
from swarm_ctl.experiment.space import Tune
from swarm_ctl.experiment.specs import Experiment
from swarm_ctl.experiment.sweep import TRIALS_CSV, as_csv, write_whole

BEST = "best.yaml"


class Score(NamedTuple):
    """How much an experiment covers."""

    repeats: tuple[float, ...]
    """The objective in each repeat, %; repeat t has the same starts whatever the parameters."""
    cells: tuple[float, ...]
    """Mean of each cell, %."""

    def statistic(self) -> Statistic:
        """Give the objective with its interval."""
        return statistic(self.repeats)


class Tried(NamedTuple):
    """A trial of the study."""

    number: int
    """Its place among those that were completed."""
    value: float
    ci95: float | None
    cells: tuple[float, ...]
    params: dict[str, Any]


class Check(NamedTuple):
    """The file's own parameters and the best ones on a seed that the study has not seen."""

    seed: int
    own: Score
    best: Score

    def gain(self) -> Statistic:
        """Give what the best is better by, repeat by repeat, %."""
        pairs = zip(self.best.repeats, self.own.repeats, strict=True)
        return statistic([best - own for best, own in pairs])

    def verdict(self) -> str:
        """Say whether the winner still wins."""
        gain = self.gain()
        mean, half = gain.mean or 0.0, gain.ci95 or 0.0
        what = f"Seed {self.seed}, not seen by the study, {gain.values} repeats: the best covers "
        if abs(mean) <= half:
            return f"{what}as much as the default ({mean:+.2f} ± {half:.2f} %)."
        more = "more" if mean > 0.0 else "LESS"
        return f"{what}{abs(mean):.2f} ± {half:.2f} % {more} than the default."


@dataclass(frozen=True, slots=True)
class Tuned:
    """What `tune_experiment` gives."""

    experiment: Experiment
    space: Tune
    folder: Path
    own: Score | None
    """The file's own parameters on the seed of the study."""
    trials: tuple[Tried, ...]
    importance: Mapping[str, float]
    """Share of each parameter in how much the value varies; empty if unknown."""
    check: Check | None

    @property
    def is_interrupted(self) -> bool:
        """Tell whether the same call would go on."""
        return self.check is None

    @property
    def best(self) -> Tried | None:
        """Give the trial with the largest value, the first of equal ones."""
        return max(self.trials, key=lambda tried: tried.value, default=None)


def so_far(trials: Sequence[Tried], own: Score) -> str:
    """Say in a few words how far a study has come."""
    default = f"default {own.statistic().mean:.2f} %"
    if not trials:
        return default
    best = max(trials, key=lambda tried: tried.value)
    return f"best {best.value:.2f} % in trial {best.number}, {default}"


def write_files(source: Path, tuned: Tuned) -> None:
    """Write `trials.csv` and, if there is a trial, `best.yaml`, a block for other files."""
    names = list(tuned.space.parameters)
    header = ["trial", "value", "ci95", *names, *(cell.name for cell in tuned.experiment.cells)]
    lines = [
        (one.number, one.value, one.ci95, *(one.params[name] for name in names), *one.cells)
        for one in tuned.trials
    ]
    write_whole(tuned.folder / TRIALS_CSV, as_csv(header, lines))
    if (best := tuned.best) is None:
        return
    planners = [cell.planner.model_dump(exclude_unset=True) for cell in tuned.experiment.cells]
    common = {k: v for k, v in planners[0].items() if all(p.get(k, ...) == v for p in planners)}
    said = [f"{source.name}, seed {tuned.experiment.seed}, trial {best.number} of the study"]
    said += [f"{words}: {best} (default {own})" for words, own, best in _measured(tuned)]
    said += [] if tuned.check is None else [tuned.check.verdict()]
    block = yaml.safe_dump({"planner": {**common, **best.params}}, sort_keys=False)
    write_whole(tuned.folder / BEST, "".join(f"# {line}\n" for line in said) + block)


def tuned_lines(tuned: Tuned) -> RenderableType:
    """Show the best parameters beside the file's own, and what both cover; fits 80 columns."""
    best = tuned.best
    if best is None or tuned.own is None:
        return Text("interrupted before the first trial was done")
    table = Table(title=tuned.experiment.description or None, title_justify="left", box=None)
    table.add_column("", no_wrap=True)
    for name in ("default", "best", "importance"):
        table.add_column(name, justify="right", no_wrap=True)
    for name, value in best.params.items():
        share = tuned.importance.get(name)
        own = {getattr(cell.planner, name) for cell in tuned.experiment.cells}
        default = _shown(own.pop()) if len(own) == 1 else "by cell"
        table.add_row(name, default, _shown(value), "" if share is None else f"{share:.0%}")
    for row in _measured(tuned):
        table.add_row(*row)
    end = "interrupted: the same command continues" if tuned.is_interrupted else "results"
    last = f"{end}: {tuned.folder}  ({len(tuned.trials)} trials; ± is a 95 % interval of the mean)"
    verdict = [] if tuned.check is None else [Text(tuned.check.verdict()), Text()]
    return Group(table, Text(), *verdict, Text(last))


def _measured(tuned: Tuned) -> Iterator[tuple[str, str, str]]:
    """Give words, the file's own and the best of each measurement."""
    best, seed = tuned.best, tuned.experiment.seed
    if best is not None and tuned.own is not None:
        found = Statistic(best.value, best.ci95, None, 0)
        yield f"explored, %, seed {seed}", _ours(tuned.own.statistic()), _ours(found)
    if (check := tuned.check) is not None:
        own, winner = check.own.statistic(), check.best.statistic()
        yield f"explored, %, seed {check.seed}", _ours(own), _ours(winner)


def _ours(of: Statistic) -> str:
    return f"{of.mean:.2f}" + ("" if of.ci95 is None else f" ± {of.ci95:.2f}")


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value).lower()
