"""Missions drawn by seed keep every promise, and what is broken on purpose is found."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from sabotage import find

from swarm_ctl.cli import main
from swarm_ctl.experiment.soak.draw import draw
from swarm_ctl.experiment.soak.flight import fly
from swarm_ctl.experiment.soak.scenario import Scenario, read_scenario
from swarm_ctl.experiment.soak.seeds import soak
from swarm_ctl.experiment.soak.shrink import edits, shrink
from swarm_ctl.experiment.source import code_hash

SCENARIOS = Path(__file__).parents[1] / "scenarios"
"""Bad days that a soak has found, and what was mended since."""
Shell = Callable[..., tuple[int, str]]


@pytest.fixture
def shell(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Shell:
    """Type a command; give its exit status and all that it said."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def type_it(*words: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["swarm-ctl", "soak", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        said, complained = capsys.readouterr()
        return int(ended.value.code or 0), said + complained

    return type_it


def quiet_pair(**mission: object) -> Scenario:
    """Two vehicles on a quiet day, for two seconds of exploration."""
    return Scenario.model_validate(
        {
            "seed": 1,
            "mission": {
                "vehicles": 2,
                "duration_s": 2.0,
                "flight": {"return_home": False},
                "planner": {"avoid_distance_m": 0.7},
                **mission,
            },
            "world": {
                "name": "room",
                "size_m": [8, 6],
                "ceiling_m": 4.0,
                "starts": [{"position_m": [2.0, 3.0]}, {"position_m": [5.0, 3.0]}],
            },
        }
    )


@pytest.mark.parametrize("first", range(1, 41, 10))
def test_drawn_missions_keep_every_promise(first: int) -> None:
    outcomes, _ = soak(range(first, first + 10), workers=1)
    assert [one.violation for one in outcomes] == [None] * 10


@pytest.mark.parametrize(
    "bug", ["setpoints while yielded", "trails merged twice", "peers left out of the last word"]
)
def test_a_bug_put_in_on_purpose_is_found(bug: str) -> None:
    """Within 20 seeds here; `make soak-mutants` tells of each bug within 200."""
    assert find(bug, range(1, 21)) is not None


def test_a_seed_draws_the_same_scenario_every_time_and_a_file_of_it_is_the_same(
    tmp_path: Path,
) -> None:
    for seed in range(50):
        file = tmp_path / f"{seed}.json"
        file.write_text(draw(seed).text(), encoding="utf-8")
        assert read_scenario(file) == draw(seed)


def test_a_scenario_flies_the_same_bits_again() -> None:
    scenario = quiet_pair()
    first, again = fly(scenario, hashed=True), fly(scenario, hashed=True)
    assert first.violation is None
    assert first.run_sha256 == again.run_sha256 != ""


def test_a_broken_promise_is_found_shrunk_and_flown_again_from_its_file(
    monkeypatch: pytest.MonkeyPatch, shell: Shell, tmp_path: Path
) -> None:
    from swarm_ctl.agent.agent import Agent  # noqa: PLC0415

    def break_down(agent: Agent) -> None:
        if agent.sysid == 2:
            raise RuntimeError("out of order")

    monkeypatch.setattr("swarm_ctl.agent.agent.watch", break_down)
    scenario = quiet_pair()
    assert len(list(edits(scenario.keys()))) >= 2
    smaller, outcome = shrink(scenario, "nothing_raises")
    assert outcome.violation is not None
    assert "out of order" in outcome.violation.words
    file = tmp_path / "small.json"
    file.write_text(smaller.text(), encoding="utf-8")
    status, said = shell("--scenario", file, "--record", tmp_path / "run")
    assert status == 1
    assert "nothing_raises" in said
    assert (tmp_path / "run" / "tlogs" / "vehicle-002.tlog").stat().st_size > 0
    assert json.loads((tmp_path / "run" / "scenario.json").read_text())["seed"] == 1


def test_seeds_that_passed_are_not_flown_again_unless_the_code_has_changed(tmp_path: Path) -> None:
    out = tmp_path / "soak.jsonl"
    passed = {"vehicles": 2, "time_s": 9.9, "closest_m": 1.2, "cpu_s": 0.5, "run_sha256": ""}
    flown = ((1, code_hash()), (2, code_hash()), (3, "of another day"))
    lines = [
        json.dumps({"seed": seed, **passed, "code": code, "violation": None})
        for seed, code in flown
    ]
    out.write_text("\n".join([*lines, '{"seed": 4, "veh']), encoding="utf-8")
    outcomes, is_interrupted = soak(range(1, 4), workers=1, out=out)
    assert [one.time_s == 9.9 for one in outcomes] == [True, True, False]
    assert not is_interrupted


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "name either --seeds A..B or --scenario FILE"),
        (("--seeds", "9..1"), "--seeds 9..1: expected A..B"),
        (("--seeds", "1..2", "--record", "x"), "one flight is recorded"),
        (("--scenario", "none.json"), "none.json: there is no such file"),
    ],
)
def test_what_cannot_be_flown_is_said_in_a_sentence(
    shell: Shell, words: tuple[str, ...], sentence: str
) -> None:
    status, said = shell(*words)
    assert status == 2
    assert sentence in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("faults", ["dead:9@3"], "faults"),
        ("orders", [{"time_s": 1.0, "sysid": 5, "operator": "pause"}], "only 2 vehicles"),
        ("mission", {"duration_s": -1.0}, "mission.duration_s: must be more than 0"),
        ("odd", 1, "odd: unknown key"),
    ],
)
def test_a_scenario_that_cannot_be_is_refused_with_its_key(
    shell: Shell, tmp_path: Path, key: str, value: object, sentence: str
) -> None:
    file = tmp_path / "bad.json"
    file.write_text(json.dumps({**quiet_pair().keys(), key: value}), encoding="utf-8")
    status, said = shell("--scenario", file)
    assert status == 2
    assert sentence in said


def test_whoever_takes_off_is_given_way_to_by_those_who_fly_above() -> None:
    """Once vehicle 1 flew over the start of 3 as it climbed, and they came within 0.60 m."""
    outcome = fly(read_scenario(SCENARIOS / "take_off_below.json"))
    assert outcome.violation is None
    assert outcome.closest_m is not None
    assert outcome.closest_m > 1.0
