"""Fly one hall thousands of times in virtual time, on several cores, and keep what came of it."""

from __future__ import annotations

import json
import math
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

import yaml

from swarm_ctl.experiment.arena import Arena
from swarm_ctl.mission import load_mission
from swarm_ctl.record.unrecorded import Unrecorded

MISSIONS = Path(__file__).resolve().parents[1] / "missions"
HALL = MISSIONS / "open_3d.yaml"
LATE_S = 200.0
"""Mission time beyond the exploration after which a flight is cut off."""

Row = dict[str, Any]
"""JSON values: the flight, and what came of it."""


@dataclass(frozen=True)
class Hall:
    """One flight of `missions/open_3d.yaml`, changed as asked for."""

    seed: int
    vehicles: int = 10
    planner: str = "explore"
    duration_s: float = 300.0
    world: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Blocks of the world file, laid over its own key by key."""

    def name(self) -> str:
        """Name this flight among others of one file."""
        return json.dumps(asdict(self), sort_keys=True)


def fly(hall: Hall) -> Row:
    """Fly until nobody explores any more; what the referee saw, and the CPU time it took, s."""
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        world = yaml.safe_load((MISSIONS / "worlds" / "open_3d.yaml").read_text("utf-8"))
        for block, keys in hall.world.items():
            world[block] = {**world.get(block, {}), **keys}
        file = Path(folder) / "world.yaml"
        file.write_text(yaml.safe_dump(world), "utf-8")
        mission = load_mission(
            HALL,
            world=file,
            vehicles=hall.vehicles,
            planner=hall.planner,
            duration_s=hall.duration_s,
            seed=hall.seed,
        )
        arena = Arena(mission, Unrecorded())
    agents = [controller.agent for controller in arena.controllers]
    while arena.now < hall.duration_s + LATE_S and not arena.is_over:
        arena.fly(until_s=arena.now + 1.0)
        if all(agent.explored_to_s is not None for agent in agents):
            break
    referee = arena.fleet.referee
    return {
        "flight": hall.name(),
        "vehicle_s": hall.vehicles * arena.now,
        "explored_s": sum(
            (agent.explored_to_s or arena.now) - agent.explored_from_s
            for agent in agents
            if agent.explored_from_s is not None
        ),
        "coverage": referee.coverage.fraction,
        "contacts": referee.snapshot()["collisions"],
        "closest_m": referee.min_separation_m if hall.vehicles > 1 else math.inf,
        "troubles": [f"{agent.sysid}: {agent.trouble}" for agent in agents if agent.trouble],
        "cpu_s": time.process_time() - began,
    }


def fly_all(
    halls: Iterable[Hall], file: Path | None, workers: int, is_enough: Callable[[list[Row]], bool]
) -> Iterator[Row]:
    """Fly what the file does not hold yet, until it is enough; give each row, old ones first.

    Every flight is a line of the file as soon as it is over: a killed benchmark goes on from there.
    """
    lines = file.read_text("utf-8").splitlines() if file and file.exists() else []
    rows = [json.loads(line) for line in lines if line.endswith("}")]
    yield from rows
    done = {row["flight"] for row in rows}
    todo = (hall for hall in halls if hall.name() not in done)
    with ProcessPoolExecutor(workers) as pool:
        flying: set[Future[Row]] = set()
        while True:
            if not is_enough(rows):
                free = range(workers - len(flying))
                flying |= {pool.submit(fly, hall) for _, hall in zip(free, todo, strict=False)}
            if not flying:
                return
            landed, flying = wait(flying, return_when=FIRST_COMPLETED)
            for row in (future.result() for future in landed):
                rows.append(row)
                if file:
                    with file.open("a", encoding="utf-8") as log:
                        log.write(json.dumps(row) + "\n")
                yield row


def mean_and_half_width(values: list[float]) -> tuple[float, float]:
    """Give a mean and half the width of its 95 % interval; 0 for a single value."""
    spread = stdev(values) if len(values) > 1 else 0.0
    return fmean(values), 1.96 * spread / math.sqrt(len(values))
