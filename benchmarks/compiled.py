"""Compile what is hot with mypyc into a folder of its own: `python benchmarks/compiled.py --help`.

The folder holds both packages, the hot modules as machine code; the sources here stay as they are.
`PYTHONPATH=FOLDER python -m swarm_ctl ...` flies it: the same frames, for two thirds of the CPU.
Wants a C compiler, and takes some minutes.
"""

from __future__ import annotations

import argparse
import os
import shutil
from pathlib import Path

from mypyc.build import mypycify
from setuptools import Distribution

ROOT = Path(__file__).parent.parent
PACKAGES = ("swarm_ctl", "mock_vehicle")
HOT = {
    "swarm_ctl": "controller frames model signing",
    "swarm_ctl/agent": "agent beacon blind budget duties endurance failsafe geofence homing peer "
    "peers phases regain sender sharing talk track victims watch",
    "swarm_ctl/autopilot": "ardupilot base command px4 setpoints status streams telemetry timesync",
    "swarm_ctl/explore": "avoidance chance company contacts explorer frontier levy logbook memory "
    "pieces pso repulsion safety swath trails",
    "swarm_ctl/wire": "parser tally",
    "mock_vehicle": "vehicle",
    "mock_vehicle/autopilot": "ardupilot ardupilot_failsafe ardupilot_telemetry base clock fences "
    "gnss goto link manoeuvres navigation personality px4 px4_failsafe px4_setpoints "
    "px4_telemetry ranging routing streams",
}
"""Where a tenth of a percent of a flight's time or more is spent, but for what numba compiles,
what is generated at import, and what is built on pydantic."""


def sources() -> list[str]:
    """Name the files to compile, from the root of the project."""
    return [f"{folder}/{name}.py" for folder, names in HOT.items() for name in names.split()]


def build(folder: Path) -> None:
    """Copy both packages into a folder that is not there yet, and compile there."""
    folder.mkdir(parents=True)
    for package in PACKAGES:
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, folder / package, ignore=ignore)
    shutil.copy(ROOT / "pyproject.toml", folder / "mypy.toml")
    os.chdir(folder)
    modules = mypycify(
        ["--config-file", "mypy.toml", *sources()], opt_level="2", debug_level="0", verbose=False
    )
    # not setup(), which would read pyproject.toml
    whole = Distribution({"ext_modules": modules, "packages": []})  # type: ignore[no-untyped-call]
    command = whole.get_command_obj("build_ext")
    command.build_lib, command.build_temp = ".", "objects"
    command.ensure_finalized()
    command.run()
    for rest in ("objects", "build"):
        shutil.rmtree(rest, ignore_errors=True)


def main() -> None:
    """Build into the folder that is named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "build" / "compiled")
    folder = parser.parse_args().folder.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    build(folder)
    print(f"PYTHONPATH={folder} python -m swarm_ctl run ... flies it")


if __name__ == "__main__":
    main()
