"""What a vehicle keeps in memory, and whether it grows: `python benchmarks/memory.py --help`.

Flies `open_3d` in virtual time with nothing recorded, batteries that never empty and a mission that
never ends, and tells the memory of the process as mission time goes by. What fleets of different
sizes take, each in a process of its own, tells what one more vehicle takes.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import machine
import yaml

from swarm_ctl.experiment.arena import Arena
from swarm_ctl.mission import Mission, load_mission
from swarm_ctl.record.unrecorded import Unrecorded

HALL = Path(__file__).parent.parent / "missions" / "open_3d.yaml"
FLEETS, FLOWN_S = (5, 30), 40.0
PAGE_KB = os.sysconf("SC_PAGE_SIZE") / 1000.0
LOOKS = 10


def resident_kb() -> float:
    """Give the memory of this process, without what is free and has not been given back."""
    gc.collect()
    libc = ctypes.CDLL(None)
    if hasattr(libc, "malloc_trim"):  # where there is none, nothing is held back for so long
        libc.malloc_trim(0)
    return int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1]) * PAGE_KB


def endless(vehicles: int, until_s: float) -> Mission:
    """Give the mission of the hall, longer than it may be."""
    content = yaml.safe_load(HALL.read_text(encoding="utf-8"))
    content["world"] = str(HALL.parent / content["world"])
    content["limits"]["max_time_s"] = 2.0 * until_s
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "mission.yaml")
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        return load_mission(path, vehicles=vehicles, planner="explore", duration_s=until_s)


def fly(vehicles: int, until_s: float, every_s: float) -> Iterator[tuple[float, float]]:
    """Fly, and give mission time, s, and memory, kB, at the beginning and ever so often."""
    arena = Arena(endless(vehicles, until_s), Unrecorded())
    yield 0.0, resident_kb()
    while arena.now < until_s - 1e-6:
        goal_s = min(arena.now + every_s, until_s)
        while arena.now < goal_s - 1e-6:
            arena.fly(until_s=min(arena.now + 1.0, goal_s))
            arena.fleet.batteries.fraction[:] = 1.0
        yield arena.now, resident_kb()


def last_kb(vehicles: int) -> float:
    """Give the memory of another process that has flown a fleet."""
    words = [sys.executable, __file__, "--vehicles", str(vehicles), "--alone"]
    return float(subprocess.check_output(words, text=True))  # noqa: S603 - our own


def per_vehicle_kb() -> float:
    """Give what one more vehicle takes, mock and controller, kB."""
    few, many = (last_kb(vehicles) for vehicles in FLEETS)
    return (many - few) / (FLEETS[1] - FLEETS[0])


def growth_kb_per_hour(rows: list[tuple[float, float]], vehicles: int) -> float:
    """Give how much a vehicle's memory grew in the second half of a flight, kB an hour."""
    (began_s, before_kb), (ended_s, after_kb) = rows[len(rows) // 2], rows[-1]
    return (after_kb - before_kb) / vehicles / (ended_s - began_s) * 3600.0


def main() -> None:
    """Print the memory over time, its growth and a vehicle's share; `--json FILE` writes it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicles", type=int, default=5)
    parser.add_argument("--minutes", type=float, default=10.0, help="mission time to fly")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.alone:
        *_, (_, kb) = fly(options.vehicles, FLOWN_S, FLOWN_S)
        print(kb)
        return
    figures: dict[str, Any] = {"per_vehicle_kb": per_vehicle_kb()}
    print(f"{figures['per_vehicle_kb']:.0f} kB per vehicle after {FLOWN_S:.0f} s of flight")
    until_s = 60.0 * options.minutes
    rows = []
    for now, kb in fly(options.vehicles, until_s, until_s / LOOKS):
        rows.append((now, kb))
        print(f"{now:7.0f} s  {kb / 1e3:7.1f} MB", flush=True)
    figures["vehicles"], figures["minutes"] = options.vehicles, options.minutes
    figures["memory_kb"] = [{"time_s": round(now, 1), "kb": kb} for now, kb in rows]
    figures["growth_kb_per_vehicle_hour"] = growth_kb_per_hour(rows, options.vehicles)
    print(f"{figures['growth_kb_per_vehicle_hour']:.0f} kB per vehicle and hour in the second half")
    machine.write(options.json, figures)


if __name__ == "__main__":
    main()
