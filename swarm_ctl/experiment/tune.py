"""Tune planner parameters with Optuna: a study that resumes, and a check of its winner."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.samplers import BaseSampler, TPESampler
from optuna.trial import FrozenTrial, TrialState
from sqlalchemy.exc import SQLAlchemyError

from swarm_ctl.errors import MissionError, plain
from swarm_ctl.experiment import sweep
from swarm_ctl.experiment.space import Span, Tune, load_tune, whole, with_planner
from swarm_ctl.experiment.specs import Experiment, load_experiment
from swarm_ctl.experiment.sweep import Compute, Progress, Row, jobs_of
from swarm_ctl.experiment.tuned import Check, Score, Tried, Tuned, so_far, write_files

STUDY = "study.db"
SPEC = "spec"
"""Attribute of a study: what decides on its values."""
DRAWS = 2_000_000
"""Beside the seed: the generator of a study's draws, which no trial of an experiment has."""
MANY = 10
"""Trials below which nothing is said of importance."""
CHECK = 50
"""Least number of repeats of the check on a seed that the study has not seen."""


def tune_experiment(
    path: Path,
    *,
    trials: int,
    compute: Compute,
    workers: int = 1,
    seed: int | None = None,
    storage: str | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
) -> Tuned:
    """Search the parameters that the block `tune` of an experiment file names.

    `trials` are all of the study, with those that it has. `workers` are asked for and computed at
    a time; study and results depend on the seed and on them. `storage` is Optuna's URL, by default
    SQLite in `out`, which is `runs/tune-NAME-SEED`. Ctrl-C ends it with what is done, and the same
    call continues. MissionError for a bad file, storage or folder, or another study in it.
    """
    experiment = load_experiment(path, seed=seed)
    space = load_tune(path, experiment)
    for name, number in (("trials", trials), ("workers", workers)):
        if number < 1:
            raise MissionError(path, name, f"must be at least 1, not {number}")
    folder = out or Path("runs") / f"tune-{experiment.name}-{experiment.seed}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = f"{folder}: cannot keep the results: {plain(error)}"
        raise MissionError(path, "out", reason) from None
    with _study(path, experiment, space, storage, folder) as study:
        search = _Search(path, experiment, space, study, compute)
        own, check = None, None
        try:
            [own] = search.measure(experiment, [{}])
            search.run(own, trials, workers, progress)
            check = search.check()
        except KeyboardInterrupt:
            pass
        tried = _tried(study)
        importance = _importance(study) if len(tried) >= MANY else {}
        tuned = Tuned(experiment, space, folder, own, tried, importance, check)
    write_files(path, tuned)
    return tuned


class _Search:
    """The loop: Optuna is asked for parameters and told what came of them."""

    def __init__(
        self,
        path: Path,
        experiment: Experiment,
        space: Tune,
        study: optuna.Study,
        compute: Compute,
    ) -> None:
        self._path = path
        self._experiment = experiment
        self._space = space
        self._study = study
        self._compute = compute

    def run(self, own: Score, trials: int, workers: int, progress: Progress | None) -> None:
        """Go on until the study has its trials, `workers` at a time, told in order."""
        ranges = {name: _range(name, span) for name, span in self._space.parameters.items()}
        while True:
            tried = _tried(self._study)
            if progress is not None:
                progress(len(tried), trials, so_far(tried, own))
            if len(tried) >= trials:
                return
            count = min(workers, trials - len(tried))
            asked = [self._study.ask(ranges) for _ in range(count)]
            try:
                scores = self.measure(self._experiment, [trial.params for trial in asked])
                for trial, score in zip(asked, scores, strict=True):
                    trial.set_user_attr("ci95", score.statistic().ci95)
                    trial.set_user_attr("cells", score.cells)
                    self._study.tell(trial, score.statistic().mean)
            finally:  # no trial is left half done, whatever ended this
                for trial in asked:
                    self._study.tell(trial, state=TrialState.FAIL, skip_if_finished=True)

    def measure(self, experiment: Experiment, points: Sequence[Mapping[str, Any]]) -> list[Score]:
        """Run an experiment with each set of planner parameters."""
        path = self._path
        batches = [jobs_of(path, with_planner(path, experiment, values)) for values in points]
        rows: dict[int, list[Row]] = {}
        for job, these in self._compute([job for batch in batches for job in batch]):
            rows[id(job)] = these
        scores = []
        for batch in batches:
            cells: list[list[float]] = [[] for _ in experiment.cells]
            for job in batch:
                cells[job.index] += [float(row[0] or 0.0) for row in rows[id(job)]]
            scores.append(_score(cells, self._space))
        return scores

    def check(self) -> Check:
        """Measure the winner and the file's own parameters on the next seed."""
        best = max(_tried(self._study), key=lambda tried: tried.value)
        seed = self._experiment.seed + 1
        repeats = max(self._experiment.trials, CHECK)
        unseen = self._experiment.model_copy(update={"seed": seed, "trials": repeats})
        return Check(seed, *self.measure(unseen, [{}, best.params]))


class _Repeatable(BaseSampler):
    """TPE whose draws depend on the seed and on a trial's place in the study alone.

    So a study that was interrupted goes on as if it had not been.
    """

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._tpe = TPESampler()

    def infer_relative_search_space(
        self, study: optuna.Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        failed = study.get_trials(deepcopy=False, states=[TrialState.FAIL])
        place = trial.number - sum(other.number < trial.number for other in failed)
        drawn = np.random.SeedSequence([self._seed, DRAWS, place]).generate_state(1)
        self._tpe = TPESampler(seed=int(drawn[0]))
        return self._tpe.infer_relative_search_space(study, trial)

    def sample_relative(
        self,
        study: optuna.Study,
        trial: FrozenTrial,
        search_space: dict[str, BaseDistribution],
    ) -> dict[str, Any]:
        return self._tpe.sample_relative(study, trial, search_space)

    def sample_independent(
        self,
        study: optuna.Study,
        trial: FrozenTrial,
        param_name: str,
        param_distribution: BaseDistribution,
    ) -> Any:
        return self._tpe.sample_independent(study, trial, param_name, param_distribution)


@contextmanager
def _study(
    path: Path, experiment: Experiment, space: Tune, url: str | None, folder: Path
) -> Iterator[optuna.Study]:
    """Open the study of an experiment; another one under its name is refused."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    name = f"{experiment.name}-{experiment.seed}"
    key, place = ("storage", "the storage") if url else ("out", str(folder / STUDY))
    try:
        storage = optuna.storages.RDBStorage(url or f"sqlite:///{folder.resolve() / STUDY}")
        study = optuna.create_study(
            storage=storage,
            sampler=_Repeatable(experiment.seed),
            study_name=name,
            direction="maximize",
            load_if_exists=True,
        )
    except (SQLAlchemyError, ImportError, ValueError) as error:
        reason = f"{place} cannot be used: {str(error).splitlines()[0]}"
        raise MissionError(path, key, reason) from None
    try:
        spec = {**sweep.spec_of(experiment), "tune": space.model_dump(mode="json")}
        kept = study.user_attrs.setdefault(SPEC, spec)
        if kept != spec:
            differs = sweep.difference(kept, spec)
            reason = f"{place} holds another study {name} (its {differs} differs); name a new one"
            raise MissionError(path, key, reason)
        study.set_user_attr(SPEC, spec)
        if url is None:  # nobody else works on it: what runs in it was killed
            for left in study.get_trials(deepcopy=False, states=[TrialState.RUNNING]):
                study.tell(left.number, state=TrialState.FAIL)
        yield study
    finally:
        storage.remove_session()
        storage.engine.dispose()


def _range(name: str, span: Span) -> BaseDistribution:
    if span.choices is not None:
        return CategoricalDistribution(span.choices)
    low, high = span.ends()
    if whole(name):
        return IntDistribution(int(low), int(high), log=span.log)
    return FloatDistribution(low, high, log=span.log)


def _score(cells: Sequence[Sequence[float]], space: Tune) -> Score:
    """Reduce the coverage of cells and repeats, %."""
    means = tuple(sum(cell) / len(cell) for cell in cells)
    if space.objective == "worst":
        return Score(tuple(cells[means.index(min(means))]), means)
    together = tuple(sum(repeat) / len(repeat) for repeat in zip(*cells, strict=True))
    return Score(together, means)


def _tried(study: optuna.Study) -> tuple[Tried, ...]:
    done = study.get_trials(deepcopy=False, states=[TrialState.COMPLETE])
    return tuple(
        Tried(
            place,
            float(trial.value or 0.0),
            trial.user_attrs["ci95"],
            tuple(trial.user_attrs["cells"]),
            trial.params,
        )
        for place, trial in enumerate(sorted(done, key=lambda trial: trial.number))
    )


def _importance(study: optuna.Study) -> dict[str, float]:
    evaluator = optuna.importance.PedAnovaImportanceEvaluator()
    try:
        return optuna.importance.get_param_importances(study, evaluator=evaluator)
    except (ValueError, RuntimeError):  # all of one value
        return {}
