"""Experiment files: read, run in chunks, resumed, and written so that equal is equal in bytes."""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml
from rich.console import Console

from swarm_ctl.errors import MissionError
from swarm_ctl.experiment import sweep
from swarm_ctl.experiment.cell import Energy
from swarm_ctl.experiment.report import ExperimentResult, result_lines, statistic, student95
from swarm_ctl.experiment.specs import load_experiment
from swarm_ctl.experiment.sweep import Job, Row, locally, run_experiment

FILES = Path(__file__).resolve().parents[2] / "missions" / "experiments"
WORLD = FILES.parent / "worlds" / "open_2d.yaml"
SHORT: dict[str, Any] = {
    "trials": 5,
    "sample_s": 10.0,
    "pictures": False,
    "defaults": {
        "world": str(WORLD),
        "vehicles": 3,
        "duration_s": 40,
        "planner": {"period_s": 1.0, "avoid_speed_fraction": 1.0},
    },
    "cells": [
        {"name": "hybrid", "figure": "Fig. 3", "paper": {"coverage_percent": 5.0}},
        {"name": "LF, (10, 2)", "planner": {"kind": "levy"}, "start_m": [10, 2]},
    ],
}

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write the short experiment with some keys changed; `...` deletes one."""

    def writer(**changes: Any) -> Path:
        content = json.loads(json.dumps(SHORT))
        for key, value in changes.items():
            *blocks, last = key.split("__")
            place = content
            for block in blocks:
                place = place[int(block)] if block.isdigit() else place[block]
            place[last] = value
        path = tmp_path / "short.yaml"
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        return path

    return writer


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep, "CHUNK", 2)


@pytest.mark.parametrize("path", sorted(FILES.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_experiment_is_valid_and_says_what_it_quotes(path: Path) -> None:
    experiment = load_experiment(path)
    assert experiment.name == path.stem
    if path.stem.startswith("explore"):  # the paper knows no memory
        return
    assert all(cell.paper.coverage_percent for cell in experiment.cells)
    varied = [cell for cell in experiment.cells if "C1" not in cell.name]
    assert all(cell.quote for cell in varied)


def test_a_hall_without_a_ceiling_is_refused(write: Write, tmp_path: Path) -> None:
    text = WORLD.read_text(encoding="utf-8").replace("ceiling_m: 3\n", "")
    (tmp_path / "sky.yaml").write_text(text, encoding="utf-8")
    path = write(defaults__world="sky.yaml", cells__1__planner={"kind": "levy", "dimensions": 3})
    with pytest.raises(MissionError, match="has no ceiling_m, which planning in 3-D needs") as no:
        load_experiment(path)
    assert no.value.key == "cells.1.world"


def test_a_cell_takes_what_it_does_not_say_from_the_defaults(write: Write) -> None:
    hybrid, levy = load_experiment(write()).cells
    assert (hybrid.vehicles, levy.vehicles) == (3, 3)
    assert (hybrid.planner.kind, levy.planner.kind) == ("lf-pso", "levy")
    assert levy.planner.period_s == 1.0
    assert hybrid.world == WORLD


@pytest.mark.parametrize(
    ("changes", "key", "reason"),
    [
        ({"trials": 0}, "trials", "must be at least 1, not 0"),
        ({"trials": "ten"}, "trials", "must be a whole number, not 'ten'"),
        ({"trails": 9}, "trails", "unknown key; did you mean trials?"),
        ({"inertia": 0.5}, "inertia", "unknown key; did you mean defaults.planner.inertia?"),
        ({"cells": []}, "cells", "must hold at least one"),
        ({"cells__0__vehicels": 4}, "cells.0.vehicels", "unknown key; did you mean vehicles?"),
        ({"defaults__vehicels": 4}, "defaults.vehicels", "unknown key; did you mean vehicles?"),
        ({"cells__1__vehicles": 0}, "cells.1.vehicles", "must be at least 1, not 0"),
        ({"cells__1__start_m": [10]}, "cells.1.start_m.1", "is missing"),
        ({"cells__1__start_m": [10, 25]}, "cells.1.start_m", "does not fit"),
        ({"cells__1__name": "hybrid"}, "cells.1.name", "'hybrid' is the name of an earlier cell"),
        (
            {"cells__0__message_loss": 0.3},
            "cells.0.message_loss",
            "is for planner.kind explore only, not for lf-pso",
        ),
        (
            {"defaults__odometry_drift": 0.01},
            "defaults.odometry_drift",
            "is for planner.kind explore only",
        ),
        ({"cells__0__beam_m": 2}, "cells.0.beam_m", "is for planner.kind explore only"),
        ({"cells__1__climb_m_s": 1}, "cells.1.climb_m_s", "is for planner.dimensions 3 only"),
        (
            {"cells__0__planner": {"dimensions": 3}, "cells__0__footprint": "disc"},
            "cells.0.footprint",
            "in 3-D it is a sphere",
        ),
        (
            {"cells__0__planner": {"dimensions": 3}, "cells__0__start_height_m": 2.8},
            "cells.0.start_height_m",
            "a robot of 0.6 m does not fit at a height of 2.8 m",
        ),
        (
            {"cells__0__planner": {"kind": "explore"}, "cells__0__message_loss": 1.5},
            "cells.0.message_loss",
            "must be at most 1, not 1.5",
        ),
        (
            {"cells__0__planner": {"kind": "explore"}, "cells__0__beam_m": 0.5},
            "cells.0.beam_m",
            "must be at least planner.avoid_distance_m, 0.9, not 0.5",
        ),
        ({"cells__0__failures": 4}, "cells.0.failures", "must be at most vehicles, 3, not 4"),
        ({"cells__0__failures": -1}, "cells.0.failures", "must be at least 0, not -1"),
        ({"cells__0__start_spacing_m": 1}, "cells.0.start_spacing_m", "needs start_m"),
        (
            {"cells__1__start_spacing_m": 11},
            "cells.1.start_m",
            "a robot of 0.6 m does not fit at (10.0, 2.0)",
        ),
        ({"cells__0__body_m": 25}, "cells.0.world", "a robot of 25 m does not fit anywhere"),
        ({"cells__0__world": "gone.yaml"}, "cells.0.world", "there is no world file"),
        ({"cells__0__world": 7}, "cells.0.world", "must be the path of a file, not 7"),
        (
            {"cells__0__world": str(WORLD.with_name("small_office_map.yaml"))},
            "cells.0.world",
            "the batch engine knows no maps",
        ),
        (
            {"cells__0__world": str(WORLD.with_name("rubble.yaml"))},
            "cells.0.world",
            "the batch engine knows only boxes and walls along x and y",
        ),
        ({"cells__1__planner": {"kind": "ant"}}, "cells.1.planner.kind", "not 'ant'"),
        ({"defaults__planner": {"kind": "ant"}}, "defaults.planner.kind", "not 'ant'"),
        ({"defaults": 3}, "defaults", "must be a block of keys, not 3"),
    ],
)
def test_a_bad_file_gets_one_clear_sentence(
    write: Write, changes: dict[str, Any], key: str, reason: str
) -> None:
    path = write(**changes)
    with pytest.raises(MissionError) as caught:
        run_experiment(path, out=path.parent / "out")
    assert caught.value.key == key
    assert reason in caught.value.reason
    assert "\n" not in str(caught.value)
    assert not (path.parent / "out").exists()


@pytest.mark.parametrize("text", ["", "cells: [", "trials: 1\ntrials: 2\n", "[1, 2]"])
def test_a_file_that_is_no_experiment_gets_a_sentence_too(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(MissionError) as caught:
        run_experiment(path, out=tmp_path / "out")
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_zero_workers_are_refused(write: Write, tmp_path: Path) -> None:
    with pytest.raises(MissionError, match="there is no such file"):
        run_experiment(tmp_path / "gone.yaml")
    with pytest.raises(MissionError, match="must be at least 1, not 0"):
        run_experiment(write(), workers=0, out=tmp_path / "out")


def test_results_are_written_and_shown_beside_the_paper(write: Write, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    result = run_experiment(
        write(), workers=1, out=tmp_path / "out",
        progress=lambda done, total, _name: seen.append((done, total)),
    )  # fmt: skip
    assert seen == [(2, 10), (4, 10), (5, 10), (7, 10), (9, 10), (10, 10)]
    lines = (tmp_path / "out" / "trials.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("cell,trial,coverage_percent,victims_found,collisions")
    assert len(lines) == 11
    assert lines[6].startswith('"LF, (10, 2)",0,')
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    mean = sum(float(line.split(",")[2]) for line in lines[1:6]) / 5
    assert summary["cells"][0]["coverage_percent"]["mean"] == pytest.approx(mean)
    text = shown(result)
    assert f"{mean:.2f} ± " in text
    assert f"{mean - 5.0:+.2f}" in text
    assert "Fig. 3" in text


def test_one_worker_or_two_in_whatever_order_write_the_same_bytes(
    write: Write, tmp_path: Path
) -> None:
    def backwards(jobs: Sequence[Job]) -> Iterator[tuple[Job, list[Row]]]:
        return locally(1)(jobs[::-1])

    path = write()
    run_experiment(path, workers=1, out=tmp_path / "one")
    run_experiment(path, workers=2, out=tmp_path / "two")
    run_experiment(path, compute=backwards, out=tmp_path / "back")
    for name in ("trials.csv", "cells.csv", "summary.json"):
        expected = (tmp_path / "one" / name).read_bytes()
        assert (tmp_path / "two" / name).read_bytes() == expected
        assert (tmp_path / "back" / name).read_bytes() == expected


def test_chunks_have_no_influence(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write()
    run_experiment(path, workers=1, out=tmp_path / "small")
    monkeypatch.setattr(sweep, "CHUNK", 50)
    run_experiment(path, workers=1, out=tmp_path / "large")
    small, large = ((tmp_path / n / "trials.csv").read_bytes() for n in ("small", "large"))
    assert small == large


def test_an_interrupted_experiment_keeps_what_was_done_and_resumes(
    write: Write, tmp_path: Path
) -> None:
    computed: list[str] = []

    def until(limit: int) -> sweep.Compute:
        def compute(jobs: Sequence[Job]) -> Iterator[tuple[Job, list[Row]]]:
            for count, job in enumerate(jobs):
                if count == limit:
                    raise KeyboardInterrupt
                computed.append(job.file_name)
                yield from locally(1)([job])

        return compute

    path, out = write(), tmp_path / "out"
    first = run_experiment(path, compute=until(2), out=out)
    assert first.is_interrupted
    assert [cell.trials for cell in first.cells] == [4]
    assert "the same command continues" in shown(first)
    assert not (out / "trials.csv").exists()
    second = run_experiment(path, compute=until(99), out=out)
    assert not second.is_interrupted
    assert [cell.trials for cell in second.cells] == [5, 5]
    assert len(computed) == len(set(computed)) == 6
    run_experiment(path, workers=1, out=tmp_path / "at once")
    expected = (tmp_path / "at once" / "trials.csv").read_bytes()
    assert (out / "trials.csv").read_bytes() == expected


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"seed": 2}, "seed"),
        ({"trials": 6}, "trials"),
        ({"cells__0__planner": {"social": 1.0}}, "cells.0.planner.social"),
        ({"defaults__world": str(FILES / "worlds" / "low_complexity.yaml")}, "cells.0.world"),
    ],
)
def test_a_folder_of_another_experiment_is_refused(
    write: Write, tmp_path: Path, changes: dict[str, Any], key: str
) -> None:
    run_experiment(write(), workers=1, out=tmp_path / "out")
    before = (tmp_path / "out" / "trials.csv").read_bytes()
    with pytest.raises(MissionError, match="holds another experiment") as caught:
        run_experiment(write(**changes), workers=1, out=tmp_path / "out")
    assert f"its {key} differs" in caught.value.reason
    assert (tmp_path / "out" / "trials.csv").read_bytes() == before


def test_the_worlds_text_belongs_to_the_experiment(write: Write, tmp_path: Path) -> None:
    world = tmp_path / "own.yaml"
    world.write_text(WORLD.read_text(encoding="utf-8"), encoding="utf-8")
    path = write(defaults__world="own.yaml")
    run_experiment(path, workers=1, out=tmp_path / "out")
    world.write_text(world.read_text(encoding="utf-8").replace("20, 20", "18, 20"), "utf-8")
    with pytest.raises(MissionError, match="holds another experiment"):
        run_experiment(path, workers=1, out=tmp_path / "out")


def test_a_later_word_of_the_paper_does_not_need_a_new_run(write: Write, tmp_path: Path) -> None:
    run_experiment(write(), workers=1, out=tmp_path / "out")

    def nothing(jobs: Sequence[Job]) -> Iterator[tuple[Job, list[Row]]]:
        assert not jobs
        return iter(())

    path = write(cells__0__paper={"coverage_percent": 6.0}, cells__0__quote="Fig. 3 shows")
    again = run_experiment(path, compute=nothing, out=tmp_path / "out")
    assert again.cells[0].paper("coverage_percent") == 6.0


def test_pictures_show_the_typical_trial(write: Write, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    result = run_experiment(write(pictures=True), workers=1, out=tmp_path / "out")
    assert result.notes == ()
    names = {path.name for path in (tmp_path / "out").glob("*.png")}
    assert names == {"paths-hybrid.png", "paths-lf-10-2.png"}


def test_the_table_fits_a_narrow_terminal(write: Write, tmp_path: Path) -> None:
    paper = {"coverage_percent": 76, "victims_found": 0, "collisions": 2, "energy_kwh": 5.4}
    path = write(cells__0__name="a scenario of some length", cells__0__paper=paper)
    text = shown(run_experiment(path, workers=1, out=tmp_path / "out"), width=80)
    assert "…" not in text
    assert all(word in text for word in ("explored, %", "collisions", "energy, kWh", "5.4"))


def test_energy_is_what_a_ground_robot_draws() -> None:
    assert Energy().kwh(10, 600.0, 0.0) * 3.6e6 == pytest.approx(10 * 600 * 20)
    assert Energy().kwh(0, 0.0, 100.0) * 3.6e6 == pytest.approx(2000.0)


@pytest.mark.parametrize(
    ("freedom", "quantile"), [(1, 12.7062), (4, 2.7764), (6, 2.4469), (19, 2.0930), (199, 1.9720)]
)
def test_intervals_are_students(freedom: int, quantile: float) -> None:
    assert student95(freedom) == pytest.approx(quantile, abs=2e-3)


def test_a_statistic_leaves_out_what_was_not_reached() -> None:
    mean, ci95, sd, count = statistic([1.0, None, 3.0, 2.0])
    assert (mean, count) == (2.0, 3)
    assert sd == pytest.approx(1.0)
    assert ci95 == pytest.approx(4.3027 / math.sqrt(3))
    assert statistic([None]) == (None, None, None, 0)
    assert statistic([4.0]) == (4.0, None, None, 1)


def shown(result: ExperimentResult, width: int = 200) -> str:
    console = Console(width=width)
    with console.capture() as capture:
        console.print(result_lines(result))
    return capture.get()
