"""The files that install a controller on a companion computer keep up with its command line."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from swarm_ctl.cli import app

DEPLOY = Path(__file__).parents[2] / "docs" / "deploy"
UNIT, DOCKERFILE = DEPLOY / "swarm-ctl.service", DEPLOY / "Dockerfile"
INSTRUCTIONS = {
    *("ARG", "FROM", "WORKDIR", "COPY", "RUN", "USER", "VOLUME", "STOPSIGNAL", "ENTRYPOINT", "CMD")
}


def words_of_fly() -> set[str]:
    command = typer.main.get_command(app)
    fly = command.commands["fly"]  # type: ignore[attr-defined]  # a group, of which click tells not
    return {word for parameter in fly.params for word in parameter.opts}


def commands(file: Path) -> Iterator[str]:
    """Give every command line with `fly` in a file, continued lines joined."""
    text = file.read_text().replace("\\\n", " ")
    return (line for line in text.splitlines() if re.search(r"swarm-ctl fly ", line))


@pytest.mark.parametrize("file", [UNIT, DEPLOY / "README.md"], ids=lambda file: file.name)
def test_every_option_that_is_deployed_exists(file: Path) -> None:
    lines = list(commands(file))
    assert lines
    for line in lines:
        options = re.findall(r"--[a-z-]+", line.split("swarm-ctl fly ")[1])
        assert "--connect" in options
        assert set(options) <= words_of_fly()


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd here")
def test_systemd_understands_the_unit(tmp_path: Path) -> None:
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/opt/swarm-ctl/bin/swarm-ctl", sys.executable))
    verdict = subprocess.run(
        ["systemd-analyze", "verify", unit],  # noqa: S607 - wherever the system keeps it
        capture_output=True,
        text=True,
        check=False,
    )
    assert (verdict.returncode, verdict.stderr) == (0, "")


def test_a_mission_that_has_ended_is_not_flown_again() -> None:
    unit = UNIT.read_text()
    assert "Restart=always" in unit
    (line,) = re.findall(r"^RestartPreventExitStatus=(.*)$", unit, re.MULTILINE)
    assert set(map(int, line.split())) == {0, 1, 2, 130}, "all exit codes of fly"
    assert "[Install]" not in re.sub(r"#.*", "", unit), "nothing takes off at power-up"


def test_the_container_file_is_made_of_instructions_and_runs_without_root() -> None:
    text = re.sub(r"^#.*\n", "", DOCKERFILE.read_text(), flags=re.MULTILINE)
    lines = [line for line in text.replace("\\\n", " ").splitlines() if line]
    assert {line.split()[0] for line in lines} == INSTRUCTIONS
    assert lines.index("USER swarm") < lines.index('ENTRYPOINT ["swarm-ctl"]')
    assert "STOPSIGNAL SIGTERM" in lines, "stopping lands"
    sources = [line.split()[1] for line in lines if line.startswith("COPY")]
    assert sources == ["."]
