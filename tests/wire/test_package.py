"""The package as its users install it: built, and alone in a project of their own."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

import swarm_ctl

pytestmark = pytest.mark.wire

ROOT = Path(__file__).parents[2]
OFFLINE = ("--quiet", "--disable-pip-version-check", "--no-deps", "--no-index")


def ten_lines() -> str:
    """Give the test that the README shows."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(import pytest\n.*?)```", text, re.DOTALL)
    return str(block)


def pip(*arguments: object, **environment: str) -> None:
    command = [sys.executable, "-m", "pip", *map(str, arguments)]
    subprocess.run(command, env={**os.environ, **environment}, check=True)


def install(source: Path, folder: Path, **environment: str) -> str:
    """Build a wheel and install it into the folder `site`; its name."""
    options = [*OFFLINE, "--no-build-isolation", "--wheel-dir", folder]
    pip("wheel", *options, source, **environment)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return wheel.name


def version(*, installed: Path) -> str:
    """Ask a package that is installed into a folder."""
    return subprocess.run(
        [sys.executable, "-m", "swarm_ctl", "--version"],
        cwd=installed,
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install into a folder: what is not in the wheel is not there."""
    folder = tmp_path_factory.mktemp("package")
    install(ROOT, folder)
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


def test_unless_asked_for_there_is_no_machine_code(installed: Path) -> None:
    assert not list(installed.glob("**/*.so"))
    assert version(installed=installed) == f"swarm-ctl {swarm_ctl.__version__}\n"


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler here")
def test_who_asks_for_machine_code_gets_it_beside_the_sources(tmp_path: Path) -> None:
    source = tmp_path / "source"
    shutil.copytree(ROOT, source, ignore=shutil.ignore_patterns(".*", "build", "runs", "tests"))
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    one = re.sub(
        r"(custom\.modules\]\n).*?\n\n", r'\1swarm_ctl = ["model"]\n\n', project, flags=re.DOTALL
    )
    (source / "pyproject.toml").write_text(one, encoding="utf-8")
    name = install(source, tmp_path, HATCH_BUILD_HOOKS_ENABLE="1")
    assert name.endswith(sysconfig.get_platform().translate(str.maketrans("-.", "__")) + ".whl")
    site = tmp_path / "site"
    machine_code = f"model{sysconfig.get_config_var('EXT_SUFFIX')}"
    assert (site / "swarm_ctl" / machine_code).exists()
    assert (site / "swarm_ctl" / "model.py").exists()
    assert version(installed=site) == f"swarm-ctl {swarm_ctl.__version__} (compiled)\n"
    assert not list(source.glob("**/*.so")), "nothing is left among the sources"


def bases(file: Path) -> set[str]:
    """Name the modules from which a file takes classes to inherit from."""
    nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
    imports = [node for node in nodes if isinstance(node, ast.ImportFrom)]
    taken = {name.asname or name.name: str(node.module) for node in imports for name in node.names}
    parents = [base for node in nodes if isinstance(node, ast.ClassDef) for base in node.bases]
    return {taken.get(base.id, "") for base in parents if isinstance(base, ast.Name)}


def test_nothing_interpreted_inherits_from_machine_code() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    hook = project["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["custom"]
    hot = {f"{package}/{name}.py" for package, names in hook["modules"].items() for name in names}
    compiled = {
        name.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for name in hot
    }
    for package in ("swarm_ctl", "mock_vehicle"):
        for file in (ROOT / package).rglob("*.py"):
            name = file.relative_to(ROOT).as_posix()
            assert name in hot or not bases(file) & compiled, f"mypyc forbids it: {name}"
