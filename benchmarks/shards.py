"""Fly one mission from several shards over UDP: `python benchmarks/shards.py --help`.

A process per shard and one of controllers per group, on one machine in real time. Figures are those
of `fleet.py`, in the seconds after all have climbed, and what crosses between shards besides.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import machine
import yaml
from fleet import CLIMB_S, FLOWN_S, processes, usage, write_mission

from mock_vehicle.ports import free_udp_port


class Shard:
    """One `mock-vehicle`, and the last line that it said."""

    def __init__(self, words: list[str]) -> None:
        command = [sys.executable, "-m", "mock_vehicle", *words]
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)  # noqa: S603
        self.said: dict[str, Any] = {}

    def listen(self) -> dict[str, Any]:
        """Give its first line, and keep the last one from now on."""
        assert self.process.stdout is not None  # noqa: S101 - opened as a pipe above
        ready: dict[str, Any] = json.loads(self.process.stdout.readline())["ready"]
        threading.Thread(target=self._keep, daemon=True).start()
        return ready

    def _keep(self) -> None:
        assert self.process.stdout is not None  # noqa: S101 - opened as a pipe above
        for line in self.process.stdout:
            self.said = json.loads(line)


@contextlib.contextmanager
def begin(folder: Path, mission: Path, vehicles: int, count: int) -> Iterator[tuple[Any, Any]]:
    """Start so many shards, and controllers for all groups, as long as the context lasts."""
    addresses = ",".join(f"127.0.0.{k}:{free_udp_port()}" for k in range(1, count + 1))
    words = [str(mission.parent / "hall.yaml"), "--vehicles", str(vehicles), "--rates", "lean"]
    words += ["--port", "0", "--json", "--shards", addresses, "--shard"]
    shards = [Shard([*words, str(k)]) for k in range(1, count + 1)]
    links: dict[int, list[str]] = {}
    for ready in [shard.listen() for shard in shards]:
        for port, sysid in zip(ready["ports"], ready["sysids"], strict=True):
            url = f"udpout://{ready['host']}:{port}"
            links.setdefault(ready["group"], []).extend(("--connect", url, "--sysid", str(sysid)))
    fly = [sys.executable, "-m", "swarm_ctl", "fly", str(mission)]
    flights = [
        subprocess.Popen(  # noqa: S603 - our own
            [*fly, *words, "--out", str(folder / f"group{group}")], stdout=subprocess.DEVNULL
        )
        for group, words in links.items()
    ]
    try:
        yield shards, flights
    finally:
        for flight in flights:
            flight.terminate()
            flight.terminate()
        for flight in flights:
            flight.wait()
        for shard in shards:
            shard.process.terminate()
            shard.process.wait()


def fly(vehicles: int, count: int, planner: str) -> dict[str, Any]:
    """Fly once, and give the figures of the time in which all explore."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        mission = write_mission(folder, vehicles, 1, planner)
        each = yaml.safe_load(mission.read_text(encoding="utf-8")) | {"vehicles": 1}
        mission.write_text(yaml.safe_dump(each), encoding="utf-8")
        with begin(folder, mission, vehicles, count) as (shards, flights):
            time.sleep(CLIMB_S)  # noqa: TID251 - this is a process of its own
            theirs = [pid for flight in flights for pid in processes(flight.pid)]
            pids = [*theirs, *(shard.process.pid for shard in shards)]
            before, began_s = [usage(pid) for pid in pids], time.monotonic()
            told = [shard.said["border"]["sent_bytes"] for shard in shards]
            time.sleep(FLOWN_S)  # noqa: TID251 - the same
            after, took_s = [usage(pid) for pid in pids], time.monotonic() - began_s
            said = [shard.said for shard in shards]
        ends = [json.loads(path.read_text()) for path in folder.glob("group*/summary.json")]
    spent_s = [end[0] - start[0] for start, end in zip(before, after, strict=True)]
    crossed = sum(one["border"]["sent_bytes"] for one in said) - sum(told)
    return {
        "vehicles": vehicles,
        "shards": count,
        "airborne": sum(one["airborne"] for one in said),
        "controllers_ms_per_vehicle_s": 1e3 * sum(spent_s[: len(theirs)]) / took_s / vehicles,
        "mock_ms_per_vehicle_s": 1e3 * sum(spent_s[len(theirs) :]) / took_s / vehicles,
        "cores": sum(spent_s) / took_s,
        "memory_mb": sum(end[1] for end in after),
        "setpoint_late_fraction": max(one["setpoint_late_fraction"] for one in ends),
        "mock_late_fraction": max(one["mock_late_fraction"] for one in said),
        "border_bytes_per_vehicle_s": crossed / took_s / vehicles,
    }


def main() -> None:
    """Print the figures of one flight; `--json FILE` writes them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicles", type=int, default=500)
    parser.add_argument("--shards", type=int, default=2)
    parser.add_argument("--planner", default="explore")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    options = parser.parse_args()
    figures = fly(options.vehicles, options.shards, options.planner)
    for key, value in figures.items():
        print(f"{key:32} {value:.4g}")
    machine.write(options.json, figures)


if __name__ == "__main__":
    main()
