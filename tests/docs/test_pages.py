"""Every block of every page: commands are typed, Python is run, YAML and JSON are read.

Flights are made short and virtual by options behind those of the page; a block that cannot be run
here says why in a comment before it, and its commands are held to the options that exist.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from pages import PAGES, ROOT, Block, blocks

import mock_vehicle.cli
import swarm_ctl.cli
from mock_vehicle.world import load_world, read_faults
from mock_vehicle.world.spec import WorldSpec
from swarm_ctl.experiment.specs import load_experiment
from swarm_ctl.mission import Mission, load_mission

LANGUAGES = {"sh", "python", "yaml", "json", "text"}
BRIEF = {
    "run": ["--virtual", "--duration", "1"],
    "experiment": ["--trials", "1", "--workers", "1"],
    "tune": ["--trials", "1", "--workers", "1"],
    "soak": ["--seeds", "2..2"],
}
"""Options that make a command short; the last one of its kind counts."""
FEW = ["--vehicles", "4"]
TYPED: set[tuple[str, ...]] = set()
"""Commands of our own, and Python, that other pages had, too."""
SHELL = {"source", "export", "cd"}
"""Words of the shell that change nothing here."""
MAKE = (ROOT / "Makefile").read_text(encoding="utf-8")
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "optional-dependencies"
]

Type = Callable[[Sequence[str]], None]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Sit down where a reader does: missions at hand, and a mission of one's own."""
    for folder in ("missions", "benchmarks"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__*"))
    own = yaml.safe_load((tmp_path / "missions/open_3d.yaml").read_text(encoding="utf-8"))
    own["world"] = f"missions/{own['world']}"
    (tmp_path / "mission.yaml").write_text(yaml.safe_dump(own), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv(
        "PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    )
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setitem(sys.modules, "matplotlib", None)  # half of the time; drawn elsewhere
    return tmp_path


@pytest.fixture
def type_in(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    """Type a command of ours, in this process."""

    def type_in(words: Sequence[str]) -> None:
        main = swarm_ctl.cli.main if words[0] == "swarm-ctl" else mock_vehicle.cli.main
        monkeypatch.setattr(sys, "argv", [*words])
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code, capsys.readouterr().err

    return type_in


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_does_what_it_says(page: Path, desk: Path, type_in: Type) -> None:
    found = list(blocks(page))
    for block in reversed(found):  # a file may be shown after the command that reads it
        if block.title:
            (desk / block.title).write_text(block.text, encoding="utf-8")
    for block in found:
        assert block.language in LANGUAGES, f"line {block.line}: `text` is for what is no code"
        if block.title:  # another one of this name is the file as it has become
            (desk / block.title).write_text(block.text, encoding="utf-8")
        use(block, desk, type_in)
    run_tests([block.text for block in found if is_test(block)], desk)


def is_test(block: Block) -> bool:
    return block.language == "python" and "def test_" in block.text and not block.why_not


def use(block: Block, desk: Path, type_in: Type) -> None:
    """Do with a block what its language is for."""
    if block.language == "sh":
        for words in block.commands:
            held_to_what_exists(words)
            if not block.why_not:
                run(words, type_in)
    elif block.language == "python" and not is_test(block) and not block.why_not:
        exec(compile(block.text, f"line {block.line}", "exec"), {})  # noqa: S102 - our own page
    elif block.language == "yaml":
        read_yaml(block, desk)
    elif block.language == "json":
        json.loads(block.text)


def run(words: Sequence[str], type_in: Type) -> None:
    """Run a command shortly."""
    if tuple(words) in TYPED and "--out" not in words:
        return
    TYPED.add(tuple(words))
    match words[0]:
        case "swarm-ctl":
            few = FEW if words[1] == "run" and "--vehicles" not in words else []
            type_in([*words, *BRIEF.get(words[1], []), *few])
        case "mock-vehicle":
            ports = [] if {"--port", "--ports"} & {*words} else ["--port", "0"]
            type_in([*words, "--duration", "0.1", *ports])
        case "make" | "pip" | "python":
            pass  # what can be known of these without an hour or a network is known by now
        case name:
            assert name in SHELL, f"{name}: who runs this?"


def held_to_what_exists(words: Sequence[str]) -> None:
    """Look whether a command, its options, targets, files and extras exist."""
    match words:
        case ["swarm-ctl", command, *rest]:
            commands = typer.main.get_command(swarm_ctl.cli.app).commands  # type: ignore[attr-defined]
            commands[command].make_context(command, rest)
        case ["mock-vehicle", *rest] if not {"--list-faults", "--schema"} & {*rest}:
            alone = typer.Typer()
            alone.command()(mock_vehicle.cli.run)
            typer.main.get_command(alone).make_context("mock-vehicle", rest)
        case ["make", *targets]:
            for target in targets:
                assert re.search(rf"^{target}:.*##", MAKE, re.MULTILINE), f"make {target}?"
        case ["python", script, *rest] if script.endswith(".py"):
            text = (ROOT / script).read_text(encoding="utf-8")
            assert all(word in text for word in rest if word.startswith("--"))
        case ["pip" | "/opt/swarm-ctl/bin/pip", "install", *wanted]:
            extras = {one for word in wanted for one in re.findall(r"\[(.*)\]", word)}
            assert extras <= EXTRAS.keys()


def run_tests(texts: Sequence[str], desk: Path) -> None:
    """Run the tests of a page that no other page had, all in one process."""
    new = [text for text in texts if (text,) not in TYPED]
    TYPED.update((text,) for text in new)
    files = [desk / f"test_of_page_{number}.py" for number in range(len(new))]
    for file, text in zip(files, new, strict=True):
        file.write_text(text, encoding="utf-8")
    if files:
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *map(str, files)]
        done = subprocess.run(command, cwd=desk, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def read_yaml(block: Block, desk: Path) -> None:
    """Read a block as what its keys make it: faults, an experiment, a world or a mission."""
    said: Any = yaml.safe_load(block.text)
    if isinstance(said, list):
        read_faults(written(desk, {"faults": said}))
    elif {"cells", "tune"} & said.keys():
        figures = yaml.safe_load((desk / "missions/experiments/tune_lf_pso.yaml").read_text())
        folder = desk if block.title else desk / "missions/experiments"
        load_experiment(written(folder, {**figures, **said}))
    elif said.keys() <= WorldSpec.model_fields.keys():
        load_world(written(desk, {"name": "part", "size_m": [20, 20], **said}))
    else:
        assert said.keys() <= Mission.model_fields.keys()
        part = {"duration_s": 10, "vehicles": 2, **said}
        load_mission(written(desk, part), is_simulated="world" in said)


def written(folder: Path, keys: dict[str, Any]) -> Path:
    """Write keys to a file, and give its path."""
    file = folder / "part.yaml"
    file.write_text(yaml.safe_dump(keys), encoding="utf-8")
    return file
