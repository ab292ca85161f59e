"""A run in virtual time with all that it leaves behind: what tests of records begin with."""

from pathlib import Path
from typing import Any

from halls import write_hall

from swarm_ctl.experiment.arena import Arena
from swarm_ctl.flight import Faults, finish
from swarm_ctl.mission import Mission, load_mission
from swarm_ctl.record.folder import RunFolder


def fly(folder: Path, *, world: dict[str, Any] | None = None, **changes: Any) -> Path:
    """Fly the hall mission, changed as asked for; give the run folder."""
    return fly_mission(load_mission(write_hall(folder, changes, world)), folder / "run")


def fly_mission(mission: Mission, run: Path) -> Path:
    """Fly a mission into a new run folder."""
    record = RunFolder.create(run, mission.name, mission.dump(), seed=1, mode="virtual")
    arena = Arena(mission, record, Faults())
    arena.fly(lambda _: None)
    arena.write_truth(run)
    finish(
        mission,
        record,
        arena.controllers,
        mode="virtual",
        time_s=arena.now,
        wall_s=1.0,
        interrupted=False,
    )
    return run
