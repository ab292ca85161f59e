import contextlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from flight_log import MISSION, WORLD, Flight

from swarm_ctl.experiment.arena import Arena
from swarm_ctl.flight import Faults
from swarm_ctl.mission import load_mission
from swarm_ctl.record.folder import RunFolder


@pytest.fixture
def launch(tmp_path: Path) -> Iterator[Callable[..., Flight]]:
    """Give a function that launches the hall mission, changed as asked for."""
    with contextlib.ExitStack() as runs:

        def start(
            *, faults: tuple[str, ...] = (), world: dict[str, Any] | None = None, **changes: Any
        ) -> Flight:
            mission: dict[str, Any] = {**MISSION, **changes}
            for block in ("planner", "flight", "limits"):
                mission[block] = {**MISSION[block], **changes.get(block, {})}
            (tmp_path / "world.yaml").write_text(yaml.safe_dump({**WORLD, **(world or {})}))
            (tmp_path / "hall.yaml").write_text(yaml.safe_dump(mission))
            loaded = load_mission(tmp_path / "hall.yaml")
            run = Path(tempfile.mkdtemp(dir=tmp_path))
            folder = RunFolder.create(
                run, loaded.name, loaded.dump(), seed=loaded.seed, mode="virtual"
            )
            runs.enter_context(folder)
            return Flight(Arena(loaded, folder, Faults.parse(faults, loaded.vehicles)), folder)

        yield start
