"""What it takes to start: `python benchmarks/start_up.py [--json FILE]`."""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import fleet
import machine

from swarm_ctl.experiment.arena import Arena
from swarm_ctl.mission import load_mission
from swarm_ctl.record.unrecorded import Unrecorded

HALL = Path(__file__).parent.parent / "missions" / "open_3d.yaml"
COMMANDS: dict[str, tuple[str, ...]] = {
    "swarm-ctl --version": ("swarm_ctl", "--version"),
    "swarm-ctl check": ("swarm_ctl", "check", str(HALL)),
    "mock-vehicle --help": ("mock_vehicle", "--help"),
    "mock-vehicle, 1 vehicle": ("mock_vehicle", "--json", "--port", "0", "--duration", "0.02"),
    "mock-vehicle, 100 vehicles": (
        *("mock_vehicle", "--json", "--port", "0", "--duration", "0.02", "--vehicles", "100"),
        *("--rates", "lean"),
    ),
}
FLEETS = (1, 10, 100, 250)
REPEATS = 3


def run(words: tuple[str, ...]) -> dict[str, float]:
    """Run a command to its end: CPU and wall time, s."""
    before, began_s = os.times(), time.perf_counter()
    subprocess.run(  # noqa: S603 - our own
        [sys.executable, "-m", *words], check=True, stdout=subprocess.DEVNULL
    )
    wall_s, after = time.perf_counter() - began_s, os.times()
    cpu_s = after.children_user + after.children_system
    return {
        "cpu_s": cpu_s - before.children_user - before.children_system,
        "wall_s": wall_s,
    }


def build(vehicles: int) -> dict[str, float]:
    """Build a mission of so many vehicles in memory, in a hall for them: CPU time, s."""
    with tempfile.TemporaryDirectory() as folder:
        mission = load_mission(fleet.write_mission(Path(folder), vehicles, 1, "explore"))
        began_s = time.process_time()
        Arena(mission, Unrecorded())
    return {"cpu_s": time.process_time() - began_s}


def median(rows: list[dict[str, float]]) -> dict[str, float]:
    """Take the median of every figure."""
    return {key: statistics.median(row[key] for row in rows) for key in rows[0]}


def main() -> None:
    """Print a line per case; `--json FILE` writes the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    figures = {}
    for name, words in COMMANDS.items():
        figures[name] = row = median([run(words) for _ in range(REPEATS)])
        print(f"{name:28} {row['cpu_s']:6.2f} s of CPU, {row['wall_s']:.2f} s", flush=True)
    for vehicles in FLEETS:
        name = f"a mission of {vehicles} in memory"
        figures[name] = row = median([build(vehicles) for _ in range(REPEATS)])
        print(f"{name:28} {row['cpu_s']:6.2f} s of CPU", flush=True)
    machine.write(options.json, figures)


if __name__ == "__main__":
    main()
