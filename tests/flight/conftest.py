import contextlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from flight_log import Flight
from halls import MISSION, write_hall

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
            blocks = {
                block: {**MISSION[block], **changes.get(block, {})}
                for block in ("planner", "flight", "limits")
            }
            loaded = load_mission(write_hall(tmp_path, {**changes, **blocks}, world))
            run = Path(tempfile.mkdtemp(dir=tmp_path))
            folder = RunFolder.create(
                run, loaded.name, loaded.dump(), seed=loaded.seed, mode="virtual"
            )
            runs.enter_context(folder)
            return Flight(Arena(loaded, folder, Faults.parse(faults, loaded.vehicles)), folder)

        yield start
