from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

WORLD: dict[str, Any] = {
    "name": "hall",
    "size_m": [16, 16],
    "ceiling_m": 4.0,
    "victims": [{"name": "v1", "position_m": [4.0, 4.0, 0.3]}],
    "starts": {"grid": {"origin_m": [6, 6], "spacing_m": 2.0, "columns": 3}},
    "coverage": {"footprint": "disc", "radius_m": 1.0, "cell_m": 0.25, "line_of_sight": True},
    "radio": {"radius_m": 3.0},
}
MISSION: dict[str, Any] = {
    "world": "world.yaml",
    "vehicles": 2,
    "duration_s": 5.0,
    "planner": {"kind": "lf-pso", "levy_min_m": 2.0, "avoid_distance_m": 0.7},
    "flight": {"height_m": 1.5, "climb_m_s": 1.0},
    "limits": {"ceiling_m": 3.5, "radius_m": 50.0},
}


@pytest.fixture
def hall(tmp_path: Path) -> Callable[..., Path]:
    """Give a function that writes a mission in a hall, changed as asked for."""

    def write(*, world: dict[str, Any] | None = None, **changes: Any) -> Path:
        (tmp_path / "world.yaml").write_text(yaml.safe_dump({**WORLD, **(world or {})}))
        mission = tmp_path / "hall.yaml"
        mission.write_text(yaml.safe_dump({**MISSION, **changes}))
        return mission

    return write


@pytest.fixture
def processes(tmp_path: Path) -> Callable[[str], list[int]]:
    """Give a function that finds the live processes of this test that run a module."""

    def find(module: str) -> list[int]:
        return [pid for pid, words in _alive(tmp_path) if module in words]

    return find


@pytest.fixture(autouse=True)
def _nothing_is_left_running(tmp_path: Path) -> Iterator[None]:
    yield
    left = list(_alive(tmp_path))
    for pid, _ in left:
        os.kill(pid, signal.SIGKILL)
    assert left == []


def _alive(tmp_path: Path) -> Iterator[tuple[int, list[str]]]:
    """Give those that have a file of this test on their command line; the dead have none."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            line = (entry / "cmdline").read_bytes().decode(errors="replace")
        except OSError:
            continue
        if f"{tmp_path}/" in line:
            yield int(entry.name), line.split("\0")
