"""A hall to fly in, and a mission in it: what tests of every kind begin with."""

from pathlib import Path
from typing import Any

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
    "duration_s": 40.0,
    "planner": {"kind": "lf-pso", "levy_min_m": 2.0, "avoid_distance_m": 0.7},
    "flight": {"height_m": 1.5},
    "limits": {"ceiling_m": 3.5, "radius_m": 50.0},
}


def write_hall(folder: Path, mission: dict[str, Any], world: dict[str, Any] | None = None) -> Path:
    """Write a mission and its world, changed as asked for; give the mission's path."""
    (folder / "world.yaml").write_text(yaml.safe_dump({**WORLD, **(world or {})}))
    path = folder / "hall.yaml"
    path.write_text(yaml.safe_dump({**MISSION, **mission}))
    return path
