"""Studies: what may be tuned, what comes out, and that an interrupted one goes on unharmed."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

import optuna
import pytest
import yaml
from rich.console import Console

from swarm_ctl.cli import main
from swarm_ctl.errors import MissionError
from swarm_ctl.experiment import tune
from swarm_ctl.experiment.report import Statistic
from swarm_ctl.experiment.space import load_tune
from swarm_ctl.experiment.specs import load_experiment
from swarm_ctl.experiment.sweep import Job, Row, locally, processes, run_experiment
from swarm_ctl.experiment.tune import tune_experiment
from swarm_ctl.experiment.tuned import Check, Score, Tuned, tuned_lines

MISSIONS = Path(__file__).resolve().parents[2] / "missions"
EXAMPLE = MISSIONS / "experiments" / "tune_lf_pso.yaml"
SHORT: dict[str, Any] = {
    "trials": 3,
    "pictures": False,
    "defaults": {
        "world": str(MISSIONS / "worlds" / "open_2d.yaml"),
        "vehicles": 2,
        "duration_s": 12,
        "planner": {"period_s": 1.0, "avoid_speed_fraction": 1.0},
    },
    "cells": [{"name": "anywhere"}, {"name": "(10, 2)", "start_m": [10, 2]}],
    "tune": {
        "parameters": {
            "inertia": {"low": 0.1, "high": 0.9},
            "levy_min_m": {"low": 0.01, "high": 1.0, "log": True},
            "candidates": {"low": 2, "high": 5},
            "keep_repulsion": {"choices": [True, False]},
        }
    },
}

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write the short experiment with some of its keys, or of its block `tune`, changed."""

    def writer(tune: Any = ..., **changes: Any) -> Path:
        content = {**json.loads(json.dumps(SHORT)), **changes}
        if isinstance(tune, dict):
            content["tune"] |= tune
        elif tune is not ...:
            content["tune"] = tune
        path = tmp_path / "short.yaml"
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        return path

    return writer


@pytest.fixture(autouse=True, scope="module")
def small_check() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(tune, "CHECK", 4)
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Tuned, Path]:
    """Give a study of twelve trials that nobody interrupted, and its folder."""
    folder = tmp_path_factory.mktemp("whole")
    path = folder / "short.yaml"
    path.write_text(yaml.safe_dump(SHORT), encoding="utf-8")
    return study(path, folder / "out"), folder / "out"


def study(path: Path, out: Path, trials: int = 12, **options: Any) -> Tuned:
    return tune_experiment(
        path, trials=trials, out=out, **{"compute": locally(1), **options}
    )  # fmt: skip


def lines(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((out / "trials.csv").read_text("utf-8").splitlines()))


def files(out: Path) -> tuple[bytes, bytes]:
    return (out / "trials.csv").read_bytes(), (out / "best.yaml").read_bytes()


# -- what comes out ------------------------------------------------------------------------------


def test_every_trial_lies_where_it_may_and_the_best_is_the_largest(
    whole: tuple[Tuned, Path],
) -> None:
    tuned, out = whole
    rows = lines(out)
    assert [int(row["trial"]) for row in rows] == list(range(12))
    for row in rows:
        assert 0.1 <= float(row["inertia"]) <= 0.9
        assert 0.01 <= float(row["levy_min_m"]) <= 1.0
        assert row["candidates"] in {"2", "3", "4", "5"}
        assert row["keep_repulsion"] in {"True", "False"}
        mean = (float(row["anywhere"]) + float(row["(10, 2)"])) / 2
        assert float(row["value"]) == pytest.approx(mean)
    assert len({row["inertia"] for row in rows}) == 12
    assert tuned.best is not None
    assert tuned.best.value == max(float(row["value"]) for row in rows)
    assert sum(tuned.importance.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("objective", ["mean", "worst"])
def test_the_best_planner_pasted_into_the_file_gives_what_was_promised(
    write: Write, tmp_path: Path, objective: str
) -> None:
    tuned = study(write({"objective": objective}), tmp_path / "out")
    assert tuned.best is not None
    assert tuned.own is not None
    assert tuned.check is not None
    pasted = yaml.safe_load((tmp_path / "out" / "best.yaml").read_text("utf-8"))
    assert pasted["planner"].keys() >= {"period_s", "avoid_speed_fraction", "inertia"}
    best = write(defaults=SHORT["defaults"] | pasted)
    reduced: Callable[[list[float]], float] = min if objective == "worst" else fmean

    def covered(path: Path, name: str, **options: Any) -> float:
        result = run_experiment(path, workers=1, out=tmp_path / name, **options)
        means = [cell.ours("coverage_percent").mean for cell in result.cells]
        return reduced([mean for mean in means if mean is not None])

    assert covered(best, "best") == pytest.approx(tuned.best.value)
    unseen = covered(best, "unseen", seed=2, trials=4)
    assert unseen == pytest.approx(tuned.check.best.statistic().mean)
    assert covered(write(), "own") == pytest.approx(tuned.own.statistic().mean)


def test_the_table_shows_the_default_beside_the_best_and_fits_80_columns(
    whole: tuple[Tuned, Path],
) -> None:
    tuned, _ = whole
    text = shown(tuned, width=80)
    assert tuned.best is not None
    assert f"{tuned.best.value:.2f} ± " in text
    assert "inertia" in text
    assert "explored, %, seed 1" in text
    assert "explored, %, seed 2" in text
    assert "Seed 2, not seen by the study, 4 repeats: the best covers" in text
    assert "…" not in text


@pytest.mark.parametrize(
    ("best", "words"),
    [
        ((5.0, 6.0, 5.5), "3.00 ± 0.00 % more than the default"),
        ((1.0, 2.0, 1.5), "1.00 ± 0.00 % LESS than the default"),
        ((1.0, 4.0, 2.5), "as much as the default (+0.00 ± 2.48 %)"),
    ],
)
def test_nobody_is_told_of_a_gain_that_is_chance(best: tuple[float, ...], words: str) -> None:
    own = (2.0, 3.0, 2.5)
    check = Check(2, Score(own, (2.5,)), Score(best, (2.5,)))
    assert isinstance(check.gain(), Statistic)
    assert words in check.verdict()


# -- the same again ------------------------------------------------------------------------------


def test_the_same_seed_is_the_same_study_and_another_is_not(
    write: Write, tmp_path: Path, whole: tuple[Tuned, Path]
) -> None:
    for name, seed in (("again", 1), ("other", 2)):
        study(write(), tmp_path / name, seed=seed)
    assert files(tmp_path / "again") == files(whole[1])
    points = [{row["inertia"] for row in lines(tmp_path / name)} for name in ("again", "other")]
    assert not points[0] & points[1]


def test_two_at_a_time_are_the_same_in_processes_of_their_own(write: Write, tmp_path: Path) -> None:
    study(write(), tmp_path / "here", 4, workers=2)
    with processes(2) as compute:
        study(write(), tmp_path / "beside", 4, workers=2, compute=compute)
    assert files(tmp_path / "here") == files(tmp_path / "beside")


def until(limit: int, computed: list[int]) -> Callable[..., Iterator[tuple[Job, list[Row]]]]:
    """Compute until Ctrl-C is pressed before job `limit`; note the seeds of what was computed."""

    def compute(jobs: Sequence[Job]) -> Iterator[tuple[Job, list[Row]]]:
        for job in jobs:
            if len(computed) == limit:
                raise KeyboardInterrupt
            computed.append(job.seed)
            yield from locally(1)([job])

    return compute


@pytest.mark.parametrize("limit", [1, 3, 25, 27])
def test_an_interrupted_study_goes_on_as_if_it_had_not_been(
    write: Write, tmp_path: Path, limit: int, whole: tuple[Tuned, Path]
) -> None:
    path, out = write(), tmp_path / "out"
    first: list[int] = []
    tuned = study(path, out, compute=until(limit, first))
    assert tuned.is_interrupted
    assert len(tuned.trials) == min(12, max(0, limit // 2 - 1))
    assert tuned.trials == whole[0].trials[: len(tuned.trials)]
    assert (out / "best.yaml").exists() == bool(tuned.trials)
    assert "nterrupted" in shown(tuned)
    second: list[int] = []
    assert not study(path, out, compute=until(99, second)).is_interrupted
    assert len(second) == 2 + 2 * (12 - len(tuned.trials)) + 4, "no trial is computed twice"
    assert files(out) == files(whole[1])


def test_a_killed_study_goes_on_too(
    write: Write, tmp_path: Path, whole: tuple[Tuned, Path]
) -> None:
    path, out = write(), tmp_path / "out"
    study(path, out, 11)
    storage = optuna.storages.RDBStorage(f"sqlite:///{out / 'study.db'}")
    optuna.load_study(study_name="short-1", storage=storage).ask()  # and then nothing more
    storage.engine.dispose()
    study(path, out)
    assert files(out) == files(whole[1])


def test_more_trials_go_on_and_fewer_change_nothing(
    write: Write, tmp_path: Path, whole: tuple[Tuned, Path]
) -> None:
    for trials in (5, 12, 3):
        study(write(), tmp_path / "out", trials)
    assert files(tmp_path / "out") == files(whole[1])


# -- where it is kept ----------------------------------------------------------------------------


def test_a_study_may_be_kept_elsewhere(write: Write, tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'shared.db'}"
    first = study(write(), tmp_path / "one", 3, storage=url)
    second = study(write(), tmp_path / "two", 5, storage=url)
    assert second.trials[:3] == first.trials
    assert not (tmp_path / "one" / "study.db").exists()


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("nowhere", "the storage cannot be used: Could not parse SQLAlchemy URL"),
        ("sqlite:////nowhere/at/all.db", "the storage cannot be used: (sqlite3.OperationalError)"),
        ("postgresql://127.0.0.1/study", "the storage cannot be used: Failed to import DB access"),
        ("magic://study", "the storage cannot be used: Can't load plugin"),
    ],
)
def test_a_storage_that_cannot_be_is_one_sentence(
    write: Write, tmp_path: Path, url: str, sentence: str
) -> None:
    with pytest.raises(MissionError) as caught:
        study(write(), tmp_path / "out", storage=url)
    assert caught.value.key == "storage"
    assert sentence in caught.value.reason
    assert "\n" not in str(caught.value)


def test_a_folder_that_cannot_be_is_one_sentence(write: Write, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(MissionError, match="cannot keep the results"):
        study(write(), tmp_path / "file")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "study.db").write_text("no database, but a letter of some length" * 99)
    with pytest.raises(MissionError, match=r"study\.db cannot be used: .*not a database"):
        study(write(), tmp_path / "out")


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"trials": 4}, "trials"),
        ({"cells": [*SHORT["cells"], {"name": "more"}]}, "cells"),
        ({"tune": {"objective": "worst"}}, "tune.objective"),
        ({"tune": {"parameters": {"inertia": {"low": 0.1, "high": 0.8}}}}, "tune.parameters"),
    ],
)
def test_another_study_in_the_folder_is_refused(
    write: Write, tmp_path: Path, changes: dict[str, Any], key: str
) -> None:
    study(write(), tmp_path / "out", 2)
    before = files(tmp_path / "out")
    with pytest.raises(MissionError, match="holds another study") as caught:
        study(write(**changes), tmp_path / "out", 2)
    assert f"its {key} differs" in caught.value.reason
    assert files(tmp_path / "out") == before


# -- mistakes in the block -----------------------------------------------------------------------


def only(name: str, **span: Any) -> dict[str, Any]:
    return {"parameters": {name: span}}


@pytest.mark.parametrize(
    ("block", "key", "reason"),
    [
        (None, "tune", "is missing; it names what to tune"),
        ([1], "tune", "must be a block of keys, not a list"),
        ({"parameters": {}}, "tune.parameters", "must hold at least one"),
        ({"parameters": 3}, "tune.parameters", "must be a block of keys, not 3"),
        ({"objektive": "mean"}, "tune.objektive", "unknown key; did you mean objective?"),
        ({"objective": "best"}, "tune.objective", "must be 'mean' or 'worst', not 'best'"),
        (only("inertai", low=0, high=1), "tune.parameters.inertai", "did you mean inertia?"),
        (only("inertia"), "tune.parameters.inertia.low", "is missing; a parameter has low and"),
        (only("inertia", low=0.1), "tune.parameters.inertia.high", "is missing"),
        (only("inertia", low=0.1, hihg=1), "tune.parameters.inertia.hihg", "did you mean high?"),
        (only("inertia", low="a", high=1), "tune.parameters.inertia.low", "a number, not 'a'"),
        (
            only("inertia", low=0.9, high=0.1),
            "tune.parameters.inertia.low",
            "must be less than high (0.1), not 0.9",
        ),
        (
            only("inertia", low=0.1, high=1.5),
            "tune.parameters.inertia.high",
            "must be less than 1, not 1.5",
        ),
        (only("inertia", low=-1, high=0.5), "tune.parameters.inertia.low", "must be at least 0"),
        (
            only("inertia", low=0, high=0.5, log=True),
            "tune.parameters.inertia.low",
            "must be more than 0 where log is true, not 0",
        ),
        (
            only("candidates", low=1.5, high=4),
            "tune.parameters.candidates.low",
            "must be a whole number, not 1.5",
        ),
        (only("kind", low=1, high=2), "tune.parameters.kind.low", "is no number; name its choices"),
        (only("keep_repulsion", low=0, high=1), "tune.parameters.keep_repulsion.low", "no number"),
        (only("kind", choices=["pso", "ant"]), "tune.parameters.kind.choices", "not 'ant'"),
        (
            only("inertia", choices=[]),
            "tune.parameters.inertia.choices",
            "must hold at least one",
        ),
        (
            only("inertia", choices=[0.1, 0.2], low=0),
            "tune.parameters.inertia.low",
            "does not go with choices",
        ),
        (
            only("period_s", choices=[1.0, 900.0]),
            "tune.parameters",
            "duration_s must be at least planner.period_s; this would be so in cell 'anywhere'",
        ),
        (
            only("levy_min_m", low=1, high=30),
            "tune.parameters",
            "levy_min_m must be at most levy_max_m (20), not 30; this would be so in cell",
        ),
        (
            only("levy_min_m", low=1, high=3)
            | {
                "parameters": {"levy_max_m": {"low": 2, "high": 9}}
                | only("levy_min_m", low=1, high=3)["parameters"]
            },
            "tune.parameters",
            "levy_min_m must be at most levy_max_m",
        ),
    ],
)
def test_a_bad_block_gets_one_clear_sentence(
    write: Write, tmp_path: Path, block: Any, key: str, reason: str
) -> None:
    with pytest.raises(MissionError) as caught:
        study(write(block), tmp_path / "out")
    assert caught.value.key == key
    assert reason in caught.value.reason
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_the_example_is_valid_and_an_experiment_too() -> None:
    experiment = load_experiment(EXAMPLE)
    assert load_tune(EXAMPLE, experiment).parameters["levy_min_m"].log


# -- at the shell --------------------------------------------------------------------------------


def shell(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object
) -> tuple[int, str, str]:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(sys, "argv", ["swarm-ctl", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    said, complained = capsys.readouterr()
    return int(ended.value.code or 0), said, complained


def test_a_study_is_told_at_the_shell(
    write: Write,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ("tune", write(), "--trials", 3, "--out", tmp_path / "out")
    code, said, complained = shell(monkeypatch, capsys, *words)
    assert code == 0
    assert "results: " in said
    assert "best" in complained, "the bar"
    code, said, complained = shell(monkeypatch, capsys, "tune", write(None), *words[2:])
    assert (code, said) == (2, "")
    assert "short.yaml: tune: is missing" in complained


@pytest.mark.parametrize(
    ("package", "words", "extra"),
    [
        ("optuna", ("tune",), "swarm-ctl[tune]"),
        ("distributed", ("experiment", "--cluster", "tcp://127.0.0.1:1"), "swarm-ctl[cluster]"),
    ],
)
def test_a_missing_extra_is_named(
    write: Write,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    package: str,
    words: tuple[str, ...],
    extra: str,
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    for module in ("tune", "cluster"):
        monkeypatch.delitem(sys.modules, f"swarm_ctl.experiment.{module}", raising=False)
    code, said, complained = shell(monkeypatch, capsys, *words, write())
    assert (code, said) == (2, "")
    assert complained == f"this needs {package}, which is missing: pip install '{extra}'\n"


def test_workers_and_a_cluster_do_not_go_together(
    write: Write, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("experiment", write(), "--workers", 2, "--cluster", "tcp://127.0.0.1:1")
    code, _, complained = shell(monkeypatch, capsys, *words)
    assert (code, complained.count("\n")) == (2, 1)
    assert "a --cluster has its own" in complained


def test_an_experiment_at_home_imports_nothing_of_the_extras(write: Write, tmp_path: Path) -> None:
    words = ["swarm-ctl", "experiment", str(write()), "--workers", "1"]
    program = f"""
import sys
from swarm_ctl.cli import main
sys.argv = {[*words, "--out", str(tmp_path / "out")]!r}
try:
    main()
finally:
    print({{"optuna", "sqlalchemy", "distributed", "dask"}} & sys.modules.keys())
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert done.stdout.endswith("set()\n")


def shown(tuned: Tuned, width: int = 200) -> str:
    console = Console(width=width)
    with console.capture() as capture:
        console.print(tuned_lines(tuned))
    return capture.get()
