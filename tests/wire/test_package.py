"""The package as its users install it: built, and alone in a project of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.wire

ROOT = Path(__file__).parents[2]
OFFLINE = ("--quiet", "--disable-pip-version-check", "--no-deps", "--no-index")


def ten_lines() -> str:
    """Give the test that the README shows."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(import pytest\n.*?)```", text, re.DOTALL)
    return str(block)


def pip(*arguments: object) -> None:
    subprocess.run([sys.executable, "-m", "pip", *map(str, arguments)], check=True)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a wheel and install it into a folder: what is not in the wheel is not there."""
    folder = tmp_path_factory.mktemp("package")
    pip("wheel", *OFFLINE, "--no-build-isolation", "--wheel-dir", folder, ROOT)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_ten_lines_of_the_readme_pass_in_an_empty_project(installed: Path, tmp_path: Path) -> None:
    lines = ten_lines()
    assert len([line for line in lines.splitlines() if line.strip()]) <= 12
    where = "\nimport mock_vehicle as package\n\ndef test_where():\n    print(package.__file__)\n"
    (tmp_path / "test_mine.py").write_text(lines + where)
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "--strict-markers", "-rA", "-p", "no:cacheprovider"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "2 passed" in run.stdout, run.stdout + run.stderr
    assert str(installed) in run.stdout


def test_the_wheel_brings_the_data(installed: Path) -> None:
    data = {path.name for path in installed.glob("mock_vehicle/autopilot/data/*")}
    assert data >= {"px4.param", "ardupilot.param"}
    assert (installed / "mock_vehicle/py.typed").exists()
    web = {path.name for path in (ROOT / "swarm_ctl/console/web").iterdir()}
    assert {path.name for path in installed.glob("swarm_ctl/console/web/*")} == web
