"""Do the same thousands of times on several cores, above all fly, and keep what came of it."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

import yaml

from swarm_ctl.experiment.arena import Arena
from swarm_ctl.experiment.source import code_hash
from swarm_ctl.mission import load_mission
from swarm_ctl.record.unrecorded import Unrecorded

MISSIONS = Path(__file__).resolve().parents[1] / "missions"
HALL = MISSIONS / "open_3d.yaml"
LATE_S = 200.0
"""Mission time beyond the exploration after which a flight is cut off."""

Row = dict[str, Any]
"""JSON values."""


class Job(Protocol):
    """Something to do once, in whatever process."""

    def name(self) -> str:
        """Name it among others of one file."""

    def do(self) -> Row:
        """Do it; what came of it."""


@dataclass(frozen=True)
class Hall:
    """One flight of `missions/open_3d.yaml`, changed as asked for."""

    seed: int
    vehicles: int = 10
    planner: str = "explore"
    duration_s: float = 300.0
    world: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Blocks of the world file, laid over its own key by key."""
    mission: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Blocks of the mission file, likewise."""

    def name(self) -> str:
        """Name this flight among others of one file."""
        return json.dumps(asdict(self), sort_keys=True)

    def do(self) -> Row:
        """Fly until nobody explores any more; what the referee saw, and the CPU time it took, s."""
        began = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            world = MISSIONS / "worlds" / "open_3d.yaml"
            mission = load_mission(
                changed(HALL, self.mission, Path(folder) / "mission.yaml"),
                world=changed(world, self.world, Path(folder) / "world.yaml"),
                vehicles=self.vehicles,
                planner=self.planner,
                duration_s=self.duration_s,
                seed=self.seed,
            )
            arena = Arena(mission, Unrecorded())
        agents = [controller.agent for controller in arena.controllers]
        while arena.now < self.duration_s + LATE_S and not arena.is_over:
            arena.fly(until_s=arena.now + 1.0)
            if all(agent.explored_to_s is not None for agent in agents):
                break
        referee = arena.fleet.referee
        return {
            "vehicle_s": self.vehicles * arena.now,
            "explored_s": sum(
                (agent.explored_to_s or arena.now) - agent.explored_from_s
                for agent in agents
                if agent.explored_from_s is not None
            ),
            "coverage": referee.coverage.fraction,
            "contacts": referee.collisions,
            "closest_m": referee.min_separation_m,
            "troubles": [f"{agent.sysid}: {agent.trouble}" for agent in agents if agent.trouble],
            "cpu_s": time.process_time() - began,
        }


def pursue(
    jobs: Iterable[Job],
    file: Path | None,
    workers: int,
    is_enough: Callable[[list[Row]], bool] = lambda _: False,
) -> Iterator[Row]:
    """Do what the file does not hold yet, until it is enough; give each row, old ones first.

    Every job is a line of the file as soon as it is done: a killed benchmark goes on from there.
    What other code did, which the lines name, is done again.
    """
    lines = file.read_text("utf-8").splitlines() if file and file.exists() else []
    told: list[Row] = [json.loads(line) for line in lines if line.endswith("}")]
    rows = [row for row in told if row.get("code") == code_hash()]
    yield from rows
    done = {row["job"] for row in rows}
    todo = (job for job in jobs if job.name() not in done)
    with ProcessPoolExecutor(workers) as pool:
        under_way: set[Future[Row]] = set()
        while True:
            if not is_enough(rows):
                free = range(workers - len(under_way))
                under_way |= {pool.submit(_do, job) for _, job in zip(free, todo, strict=False)}
            if not under_way:
                return
            finished, under_way = wait(under_way, return_when=FIRST_COMPLETED)
            for row in (future.result() for future in finished):
                rows.append(row)
                if file:
                    with file.open("a", encoding="utf-8") as log:
                        log.write(json.dumps(row) + "\n")
                yield row


def changed(file: Path, changes: Mapping[str, Any], copy: Path) -> Path:
    """Write a copy of a YAML file with some keys of its blocks changed, and lists replaced."""
    content = yaml.safe_load(file.read_text("utf-8"))
    for block, keys in changes.items():
        is_block = isinstance(keys, Mapping)
        content[block] = {**content.get(block, {}), **keys} if is_block else keys
    copy.write_text(yaml.safe_dump(content), "utf-8")
    return copy


def _do(job: Job) -> Row:
    return {"job": job.name(), "code": code_hash(), **job.do()}
