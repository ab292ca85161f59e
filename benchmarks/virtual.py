"""Vehicle-seconds per CPU-second of missions in virtual time, and where the time goes."""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import machine

from mock_vehicle.fleet import Fleet
from swarm_ctl.agent.agent import Agent
from swarm_ctl.controller import Controller
from swarm_ctl.experiment.arena import Arena
from swarm_ctl.mission import Mission, load_mission
from swarm_ctl.record.unrecorded import Unrecorded

MISSIONS = Path(__file__).parent.parent / "missions"
CASES = [
    ("open_3d.yaml", 3, "explore"),
    ("open_3d.yaml", 10, "explore"),
    ("open_3d.yaml", 10, "lf-pso"),
    ("usar_office.yaml", 10, "explore"),
    ("open_3d.yaml", 100, "explore"),
    ("open_3d.yaml", 100, "lf-pso"),
]
CLIMB_S, FLOWN_S = 20.0, 30.0
PARTS: dict[str, tuple[type, str]] = {
    "physics": (Fleet, "step"),
    "sensors": (Fleet, "_sample"),
    "mock speaks": (Fleet, "_tick"),
    "mock hears": (Fleet, "receive"),
    "hears": (Controller, "receive"),
    "plans": (Agent, "plan"),
    "decides": (Controller, "tick"),
}
"""Methods by what is done in them, but for what is done in others of them."""


class Split:
    """Shares out CPU time among the methods that run."""

    def __init__(self) -> None:
        self.spent_s: defaultdict[str, float] = defaultdict(float)
        self._running = ["rest"]
        self._since_s = time.process_time()

    def switch(self) -> None:
        """Book the time since the last switch on what runs."""
        now_s = time.process_time()
        self.spent_s[self._running[-1]] += now_s - self._since_s
        self._since_s = now_s

    def watch(self, part: str, owner: type, name: str) -> None:
        """Book what a method takes from now on."""
        plain: Callable[..., Any] = getattr(owner, name)

        @wraps(plain)
        def timed(*arguments: object, **options: object) -> object:
            self.switch()
            self._running.append(part)
            try:
                return plain(*arguments, **options)
            finally:
                self.switch()
                self._running.pop()

        setattr(owner, name, timed)

    def ranked(self) -> list[tuple[str, float]]:
        """Give parts and their time, s, the largest first."""
        return sorted(self.spent_s.items(), key=lambda item: -item[1])


def fly(mission: Mission, split: Split | None) -> tuple[float, float]:
    """Give ms to build it all, and vehicle-seconds per CPU-second after the climb."""
    began_s = time.process_time()
    arena = Arena(mission, Unrecorded())
    built_s = time.process_time()
    arena.fly(until_s=CLIMB_S)
    if split is not None:
        split.switch()
        split.spent_s.clear()
    flying_s = time.process_time()
    arena.fly(until_s=CLIMB_S + FLOWN_S)
    flown_s = time.process_time() - flying_s
    return (built_s - began_s) * 1e3, mission.vehicles * FLOWN_S / flown_s


def main() -> None:
    """Print a line per case; `--parts` says where the time goes, `--json FILE` writes the rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--parts", action="store_true", help="split the time; it takes longer so")
    parser.add_argument("--vehicles", type=int, help="only the cases of so many vehicles")
    arguments = parser.parse_args()
    split = Split() if arguments.parts else None
    if split is not None:
        for part, method in PARTS.items():
            split.watch(part, *method)
    figures = {}
    for file, vehicles, planner in CASES:
        if arguments.vehicles not in {None, vehicles}:
            continue
        mission = load_mission(MISSIONS / file, vehicles=vehicles, planner=planner)
        built_ms, rate = fly(mission, split)
        figures[f"{mission.name} {vehicles} {planner}"] = rate
        print(f"{mission.name:12} {vehicles:4} {planner:8} {rate:6.0f} vehicle-s per CPU-s", end="")
        print(f" ({rate / vehicles:.0f} times real time; {built_ms:.0f} ms to build, ", end="")
        print(f"calibration {1e3 * machine.calibrate_s():.1f} ms)", flush=True)
        for part, spent_s in split.ranked() if split else ():
            print(
                f"    {part:12} {spent_s * 1e6 / (vehicles * FLOWN_S):6.0f} us per vehicle-second"
            )
    machine.write(arguments.json, figures)


if __name__ == "__main__":
    main()
