"""The command line without sockets: checking, schema, help, virtual runs, mistakes."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from halls import write_hall
from rich.console import Console

import swarm_ctl
from swarm_ctl.cli import main
from swarm_ctl.mission import load_mission
from swarm_ctl.model import Snapshot, Vec3
from swarm_ctl.progress import header, score, table

SHARED = "MISSION --world --vehicles --planner --autopilot --duration --help"
"""Words in the help of every command that takes a mission."""
MISSIONS = sorted((Path(__file__).parents[2] / "missions").glob("*.yaml"))
SHORT: dict[str, Any] = {"duration_s": 8.0}


class Shell:
    """Types commands and reads what they say."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch = monkeypatch
        self._capsys = capsys

    def __call__(self, *words: object) -> tuple[int, str, str]:
        self._monkeypatch.setattr(sys, "argv", ["swarm-ctl", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        said, complained = self._capsys.readouterr()
        return int(ended.value.code or 0), said, complained


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Shell:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("NO_COLOR", "1")
    return Shell(monkeypatch, capsys)


@pytest.fixture
def hall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Give a function that writes a mission in a hall, changed as asked for."""
    monkeypatch.chdir(tmp_path)

    def write(*, place: dict[str, Any] | None = None, **changes: Any) -> Path:
        return write_hall(tmp_path, {**SHORT, **changes}, place)

    return write


Hall = Callable[..., Path]


def one_sentence(complaint: str) -> str:
    assert complaint.count("\n") == 1
    assert complaint.endswith("\n")
    assert "Traceback" not in complaint
    return complaint.strip()


# -- words about itself --------------------------------------------------------------------------


def test_the_version_is_that_of_the_package(shell: Shell) -> None:
    assert shell("--version") == (0, f"swarm-ctl {swarm_ctl.__version__}\n", "")


@pytest.mark.parametrize(
    ("command", "options"),
    [
        ((), "--version --help run check schema"),
        (
            ("run",),
            f"{SHARED} --seed --speed --virtual --out --fault",
        ),
        (("check",), SHARED),
        (("schema",), "--help"),
        (
            ("doctor",),
            "--connect --sysid --mission --open-air --fix --strict --json --speed --timeout --help",
        ),
    ],
)
def test_help_tells_every_option(shell: Shell, command: tuple[str, ...], options: str) -> None:
    code, said, _ = shell(*command, "--help")
    assert code == 0
    for option in options.split():
        assert re.search(rf"(?<![\w-]){option}(?![\w-])", said, re.IGNORECASE), option


def test_the_schema_is_json_and_knows_every_key(shell: Shell) -> None:
    code, said, _ = shell("schema")
    schema = json.loads(said)
    assert code == 0
    assert schema["$schema"].startswith("https://json-schema.org/")
    assert {"world", "vehicles", "planner", "limits", "seed"} <= schema["properties"].keys()
    assert schema["required"] == ["duration_s"]


# -- check ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("mission", MISSIONS, ids=lambda path: path.stem)
def test_every_mission_of_ours_is_fine(shell: Shell, mission: Path) -> None:
    code, said, complained = shell("check", mission)
    assert (code, complained) == (0, "")
    assert f"{mission.stem} is fine: " in said


def test_a_checked_mission_is_told_in_one_sentence(shell: Shell, hall: Hall) -> None:
    mission = hall()
    code, said, complained = shell("check", mission)
    assert (code, complained) == (0, "")
    assert said == (
        f"{mission}: hall is fine: 2 vehicles explore hall (16 m x 16 m) for 8 s with lf-pso "
        "in 2 dimensions; 1 victim to find\n"
    )
    _, said, _ = shell("check", mission, "--vehicles", 1, "--planner", "levy")
    assert "1 vehicle explores hall (16 m x 16 m) for 8 s with levy" in said


@pytest.mark.parametrize("command", [("check",), ("run", "--virtual", "--out", "run")])
@pytest.mark.parametrize(
    ("mission", "place", "options", "sentence"),
    [
        ({"vehicels": 3}, {}, (), "hall.yaml: vehicels: unknown key; did you mean vehicles?"),
        ({"vehicles": "many"}, {}, (), "hall.yaml: vehicles: must be a whole number"),
        ({"world": "none.yaml"}, {}, (), "hall.yaml: world: there is no world file"),
        ({}, {}, ("--vehicles", 0), "hall.yaml: --vehicles: must be at least 1, not 0"),
        ({}, {}, ("--vehicles", 251), "hall.yaml: --vehicles: must be at most 250, not 251"),
        ({}, {}, ("--planner", "magic"), "--planner: must be 'lf-pso', 'levy'"),
        ({}, {}, ("--autopilot", "apm"), "--autopilot: must be 'px4', 'ardupilot' or 'mixed'"),
        ({}, {}, ("--duration", "nan"), "--duration: must be"),
        ({}, {}, ("--duration", "-3"), "--duration: must be more than 0, not -3"),
        ({}, {}, ("--world", "none.yaml"), "--world: there is no world file"),
        ({}, {"radio": {"radus_m": 3}}, (), "world.yaml: radio.radus_m: unknown key"),
        ({}, {"starts": [{"position_m": [9, 99]}]}, (), "world.yaml: starts"),
    ],
)
def test_a_mistake_is_one_sentence_and_exit_2(
    shell: Shell,
    hall: Hall,
    command: tuple[object, ...],
    mission: dict[str, Any],
    place: dict[str, Any],
    options: tuple[object, ...],
    sentence: str,
) -> None:
    code, said, complained = shell(*command, hall(place=place, **mission), *options)
    assert (code, said) == (2, "")
    assert sentence in one_sentence(complained)
    assert not Path("run").exists(), "nothing flew, so there is no record"


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize("text", ["name: [", "", "- a\n- b\n", "a: 1\na: 2\n", "\xff\x00"])
def test_a_file_that_is_no_mission_is_one_sentence(
    shell: Shell, hall: Hall, command: str, text: str
) -> None:
    mission = hall()
    mission.write_bytes(text.encode("latin-1"))
    code, _, complained = shell(command, mission)
    assert code == 2
    assert one_sentence(complained).startswith(str(mission))
    assert not Path("runs").exists()


def test_a_mission_that_is_not_there_is_one_sentence(shell: Shell, hall: Hall) -> None:
    hall()
    for command in ("check", "run"):
        code, _, complained = shell(command, "none.yaml")
        assert (code, one_sentence(complained)) == (2, "none.yaml: there is no such file")


# -- virtual runs --------------------------------------------------------------------------------


def summary_of(run: str) -> dict[str, Any]:
    return dict(json.loads(Path(run, "summary.json").read_text()))


def test_the_same_seed_is_the_same_run(shell: Shell, hall: Hall) -> None:
    mission = hall()
    for out in ("a", "b"):
        code, said, _ = shell("run", mission, "--virtual", "--seed", 7, "--out", out)
        assert code == 0
        assert "hall flown" in said
    assert summary_of("a")["run_sha256"] == summary_of("b")["run_sha256"]
    logs = [Path(out, "tlogs", "vehicle-002.tlog").read_bytes() for out in ("a", "b")]
    assert logs[0] == logs[1]
    assert summary_of("a")["seed"] == 7


def test_one_vehicle_alone_flies_into_a_folder_named_by_mission_and_time(
    shell: Shell, hall: Hall
) -> None:
    code, _, _ = shell("run", hall(), "--virtual", "--vehicles", 1)
    assert code == 0
    (folder,) = Path("runs").iterdir()
    assert re.fullmatch(r"hall-\d{8}T\d{6}Z", folder.name)
    assert summary_of(str(folder))["per_vehicle"][0]["phase"] == "done"


def test_a_fleet_that_died_is_not_flown(shell: Shell, hall: Hall) -> None:
    code, said, _ = shell("run", hall(), "--virtual", "--fault", "fleet@12", "--out", "run")
    assert code == 1
    assert "the mock fleet died at 12.0 s" in said


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("nonsense", "--fault nonsense: expected KIND:SYSID@SECONDS"),
        ("", "--fault : expected KIND:SYSID@SECONDS"),
        ("daed:1@3", "did you mean 'dead'?"),
        ("dead:1", "expected KIND:SYSID@SECONDS"),
        ("dead:1@-3", "needs a time from 0 s on"),
        ("dead:x@3", "'x' is no sysid"),
        ("dead:3@3", "there is no vehicle 3; they are 1 to 2"),
        ("fleet:1@3", "'fleet' takes no vehicle"),
        ("controller:3@3", "there is no vehicle 3; they are 1 to 2"),
        ("controller@3", "expected controller:SYSID@SECONDS"),
    ],
)
def test_a_fault_that_cannot_be_is_one_sentence(
    shell: Shell, hall: Hall, fault: str, sentence: str
) -> None:
    code, said, complained = shell("run", hall(), "--virtual", "--fault", fault, "--out", "run")
    assert (code, said) == (2, "")
    assert sentence in one_sentence(complained)
    assert not Path("run").exists()


def test_a_folder_that_cannot_be_is_one_sentence(shell: Shell, hall: Hall) -> None:
    mission = hall()
    Path("full").mkdir()
    Path("full", "precious").write_text("mine")
    for out in ("full", "full/precious", "full/precious/run", "/proc/run"):
        code, _, complained = shell("run", mission, "--virtual", "--out", out)
        assert code == 2
        assert out in one_sentence(complained)
    assert Path("full", "precious").read_text() == "mine"


def test_an_empty_folder_of_the_users_is_empty_again_when_nothing_flew(
    shell: Shell, hall: Hall
) -> None:
    mission = hall()
    Path("mine").mkdir()
    code, _, _ = shell("run", mission, "--virtual", "--out", "mine", "--fault", "dead:9@3")
    assert code == 2
    assert list(Path("mine").iterdir()) == []


@pytest.mark.parametrize("options", [("--speed", "nan"), ("--speed", 0), ("--sped", 3)])
def test_an_option_that_cannot_be_is_exit_2(
    shell: Shell, hall: Hall, options: tuple[object, ...]
) -> None:
    code, _, complained = shell("run", hall(), "--out", "run", *options)
    assert code == 2
    assert "Traceback" not in complained
    assert not Path("run").exists()


def test_the_live_view_fits_into_80_columns(hall: Hall) -> None:
    note = "nothing heard from its autopilot for 5.1 s, and then this"
    swarm = [Snapshot(200, "connecting", Vec3(0.0, 0.0, -12.34), 1.0, (1,) * 12, 12, note)]
    referee = {
        "coverage_fraction": 1.0,
        "victims_found": 12,
        "victims_total": 12,
        "collisions": 10,
        "min_separation_m": 12.34,
    }
    console = Console(width=80, color_system=None)
    with console.capture() as capture:
        console.print(header(load_mission(hall()), 83.0, 4.0, score(referee)), table(swarm))
    lines = capture.get().splitlines()
    assert lines[1].endswith("nearest pair 12.34 m")
    names = "vehicle phase height battery hears victims note"
    assert lines[-2].split() == names.split(), "a long note takes the width of no other"
    assert re.match(r" +200 +connecting +12.3 m +100% +12 +12 +nothing heard.*…$", lines[-1])


# -- shards --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--shards", 0), "--shards 0: expected 2 to 99"),
        (("--shards", 1), "--shards 1: expected 2 to 99"),
        (("--shards", 2, "--virtual"), "--virtual: a flight in virtual time is one process"),
        (("--shards", 2, "--show"), "--show: shards have vehicles of one sysid"),
        (("--shards", 2, "--fault", "dead:1@3"), "--fault: every shard would break its own"),
        (("--shards", 2, "--mqtt", "embedded"), "--mqtt embedded: shards are several processes"),
        (("--shards", 3, "--vehicles", 100), "--shards: 300 vehicles are 2 groups"),
        (("--shards", "here", "--shard", 1), "--shards here: expected IP:PORT"),
        (("--shards", "10.0.0.1:1,10.0.0.2:1"), "--shard is missing: say which of the 2"),
        (("--shard", 1), "--shard 1: of which? --shards names their addresses"),
    ],
)
def test_shards_that_cannot_be_are_one_sentence(
    shell: Shell, hall: Hall, tmp_path: Path, options: tuple[object, ...], sentence: str
) -> None:
    code, said, complaint = shell("run", hall(), *options, "--out", "run")
    assert (code, said) == (2, "")
    assert sentence in one_sentence(complaint)
    assert not (tmp_path / "run").exists()
