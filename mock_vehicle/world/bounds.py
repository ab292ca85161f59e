"""How small and how large a world may be."""

from __future__ import annotations

from pathlib import Path

from mock_vehicle.errors import WorldError
from mock_vehicle.world.spec import WorldSpec

SIDE_M = (1.0, 2000.0)
"""Shortest and longest side: a vehicle must fit in, and its cells in memory."""
CELLS_MAX = 2e7
"""Most cells for the referee to count; a few bytes and nanoseconds each, several times a second."""


def check_size(path: Path, spec: WorldSpec, size_m: tuple[float, float, float]) -> None:
    """Refuse a world (north, east, up) in which nobody fits, or that no memory holds."""
    north_m, east_m, height_m = size_m
    least_m, most_m = SIDE_M
    if not least_m <= min(north_m, east_m) <= max(north_m, east_m) <= most_m:
        key = "map.file" if spec.map else "size_m"
        reason = f"sides should be {least_m:g} to {most_m:g} m, not {east_m:g} and {north_m:g}"
        raise WorldError(path, key, reason)
    cell_m = spec.coverage.cell_m
    layers = height_m / cell_m if spec.coverage.footprint == "sphere" else 1.0
    cells = layers * north_m * east_m / cell_m**2
    if cells > CELLS_MAX:
        reason = f"{cell_m:g} m cuts this world into {cells:.2g} cells; {CELLS_MAX:.2g} is the most"
        raise WorldError(path, "coverage.cell_m", reason)
