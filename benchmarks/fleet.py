"""Fly a fleet in real time over UDP, and say what it costs: `python benchmarks/fleet.py --help`.

Two processes, as `swarm-ctl run` has them: the mock fleet and the controllers; more than 250
vehicles, or `--shards`, are several such pairs in one world. CPU time is taken from the kernel's
books once all explore; the process that starts shards is not counted. A setpoint that is decided
more than 20 ms late, or not at all, has missed its deadline; so has a step of the mock that begins
more than a step late.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import machine
import yaml

from swarm_ctl.mission import VEHICLES_MAX

SQUARE_M2 = 12.0
"""Of the hall, for each vehicle."""
CLIMB_S, FLOWN_S = 20.0, 20.0
CASES = ((10, 1.0), (50, 1.0), (100, 1.0), (250, 1.0), (500, 1.0), (1000, 0.25))
"""Vehicles, and times real time."""
TICK_HZ = os.sysconf("SC_CLK_TCK")
PAGE_KB = os.sysconf("SC_PAGE_SIZE") / 1024.0


def write_mission(folder: Path, vehicles: int, shards: int, planner: str) -> Path:
    """Write a hall of equal density for any number of vehicles, and the mission to fly in it."""
    side_m = round(math.sqrt(SQUARE_M2 * vehicles) + 2.0, 1)
    world = {"name": "hall", "size_m": [side_m, side_m], "ceiling_m": 6.0}
    (folder / "hall.yaml").write_text(yaml.safe_dump(world), encoding="utf-8")
    mission = {
        "name": "fleet",
        "world": "hall.yaml",
        "vehicles": vehicles // shards,
        "duration_s": 2.0 * (CLIMB_S + FLOWN_S),
        "planner": {"kind": planner, "dimensions": 3},
        "flight": {"start_spacing_s": 0.0},
        "limits": {"ceiling_m": 5.6},
    }
    path = folder / "mission.yaml"
    path.write_text(yaml.safe_dump(mission), encoding="utf-8")
    return path


def children(root: int) -> list[int]:
    """Give what a process has started."""
    text = Path(f"/proc/{root}/task/{root}/children").read_text(encoding="utf-8")
    return [int(pid) for pid in text.split()]


def processes(root: int) -> list[int]:
    """Give a process and all that it has started, the controllers' first."""
    return [root, *(pid for child in children(root) for pid in processes(child))]


def usage(pid: int) -> tuple[float, float, float]:
    """Give CPU time, s, resident memory, MB, and time spent waiting for a core, s; 0 when gone."""
    if not Path(f"/proc/{pid}/stat").exists():
        return 0.0, 0.0, 0.0
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(") ")[2].split()
    waited_ns = Path(f"/proc/{pid}/schedstat").read_text(encoding="utf-8").split()[1]
    cpu_s = (int(fields[11]) + int(fields[12])) / TICK_HZ
    return cpu_s, int(fields[21]) * PAGE_KB / 1024.0, int(waited_ns) * 1e-9


@contextlib.contextmanager
def started(
    vehicles: int, shards: int, planner: str, speed: float
) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
    """Start a run, and end it; its folder is gone when this is left."""
    with tempfile.TemporaryDirectory() as name:
        mission = write_mission(Path(name), vehicles, shards, planner)
        command = [sys.executable, "-m", "swarm_ctl", "run", str(mission), "--out", f"{name}/run"]
        command += ["--shards", str(shards)] if shards > 1 else []
        command += ["--speed", str(speed)]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as run:  # noqa: S603 - our own
            yield run, Path(name, "run")


def fly(vehicles: int, planner: str, shards: int = 1, speed: float = 1.0) -> dict[str, Any]:
    """Fly once, in as many shards as sysids make necessary; the figures of when all explore."""
    shards = max(shards, math.ceil(vehicles / VEHICLES_MAX))
    vehicles -= vehicles % shards
    with started(vehicles, shards, planner, speed) as (run, folder):
        time.sleep(CLIMB_S / speed)  # noqa: TID251 - this is a process of its own
        roots = [run.pid] if shards == 1 else children(run.pid)
        pids = [processes(root) for root in roots]
        before, began_s = [[usage(pid) for pid in group] for group in pids], time.monotonic()
        time.sleep(FLOWN_S / speed)  # noqa: TID251 - the same
        after, took_s = (
            [[usage(pid) for pid in group] for group in pids],
            time.monotonic() - began_s,
        )
        run.terminate()
        time.sleep(0.5)  # noqa: TID251 - two signals at once are one
        run.terminate()
        run.wait()
        folders = [folder / f"shard{k}" for k in range(1, shards + 1)] if shards > 1 else [folder]
        summaries = [
            json.loads((one / "summary.json").read_text(encoding="utf-8")) for one in folders
        ]
    pairs = [tuple(zip(*both, strict=True)) for both in zip(before, after, strict=True)]
    spent_s = [[end[0] - start[0] for start, end in group] for group in pairs]
    waited_s = [end[2] - start[2] for group in pairs for start, end in group]
    flown_s = vehicles * took_s * speed
    return {
        "vehicles": vehicles,
        "shards": shards,
        "speed": speed,
        "planner": planner,
        "controllers_ms_per_vehicle_s": 1e3 * sum(own for own, *_ in spent_s) / flown_s,
        "mock_ms_per_vehicle_s": 1e3 * sum(sum(mock) for _, *mock in spent_s) / flown_s,
        "cores": sum(map(sum, spent_s)) / took_s,
        "memory_mb": sum(end[1] for group in after for end in group),
        "waited_fraction": max(waited_s) / took_s,
        "setpoint_jitter_p99_ms": max(one["setpoint_jitter_p99_ms"] for one in summaries),
        "setpoint_late_fraction": max(one["setpoint_late_fraction"] for one in summaries),
        "mock_late_fraction": max(one["mock_late_fraction"] for one in summaries),
        "dropped": sum(
            one["datagrams_unsent"] + one["datagrams_unheard"] + one["mock_dropped"]
            for one in summaries
        ),
        "lost": sum(one["messages_lost"] for one in summaries),
        "contacts": sum(one["collisions"] for one in summaries),
    }


def main() -> None:
    """Print a line per number of vehicles; `--json FILE` writes the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicles", type=int, nargs="*", help=f"unless said {CASES}")
    parser.add_argument("--shards", type=int, default=1, help="at least so many pairs of processes")
    parser.add_argument("--speed", type=float, default=1.0, help="times real time")
    parser.add_argument("--planner", default="explore")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    rows = []
    print("                 ms per vehicle-s       setpoints          mock")
    print("vehicles  cores  controllers  mock   p99 ms    late        late  lost  waited     MB")
    chosen = [(vehicles, options.speed) for vehicles in options.vehicles or ()]
    for vehicles, speed in chosen or CASES:
        rows.append(row := fly(vehicles, options.planner, options.shards, speed))
        print(
            f"{vehicles:8}  {row['cores']:5.2f}  {row['controllers_ms_per_vehicle_s']:11.2f}"
            f"  {row['mock_ms_per_vehicle_s']:4.2f}  {row['setpoint_jitter_p99_ms']:7.1f}"
            f"  {row['setpoint_late_fraction']:6.2%}  {row['mock_late_fraction']:10.2%}"
            f"  {row['lost']:4}  {row['waited_fraction']:6.0%}  {row['memory_mb']:5.0f}",
            flush=True,
        )
    machine.write(options.json, rows)


if __name__ == "__main__":
    main()
