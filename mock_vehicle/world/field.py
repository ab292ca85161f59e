"""The world without a file: a meadow with nothing in the way."""

from __future__ import annotations

from pathlib import Path

from mock_vehicle.world import World
from mock_vehicle.world.plan import build_prisms
from mock_vehicle.world.shapes import Shapes
from mock_vehicle.world.spec import WorldSpec

FIELD = {
    "name": "open field",
    "size_m": [200.0, 200.0],
    "origin_m": [-100.0, -100.0],
    "closed": False,
    "starts": {"grid": {"origin_m": [0.0, 0.0], "spacing_m": 3.0, "columns": 10}},
    "coverage": {"radius_m": 2.0, "cell_m": 2.0, "line_of_sight": False},
    "radio": {"radius_m": 0.0},
}
"""As a world file would say it; without a radio the wire is that of a vehicle alone."""


def open_field() -> World:
    """Give 200 m x 200 m under open sky, no walls, with the vehicles in rows of ten."""
    path, spec = Path("open field"), WorldSpec.model_validate(FIELD)
    world = World(path, spec, Shapes(build_prisms(path, spec)), None)
    world.check()
    return world
