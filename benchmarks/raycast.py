"""Time ray casts and map loading: `python benchmarks/raycast.py [--json FILE] [--maps FOLDER]`."""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import machine
import numpy as np
from numpy.typing import NDArray

from mock_vehicle.maps import load_map
from mock_vehicle.world import World, load_world
from mock_vehicle.world.shapes import Prism, Shapes
from mock_vehicle.world.spec import WorldSpec

Floats = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
RAYS = 220
RANGE_M = 8.0
TARGETS_MS = {"60 shapes": 0.5, "gdc_3ne": 1.5, "load gdc_3": 1000.0}
"""Medians to stay below."""


def median_ms(call: Callable[[], object], repeats: int) -> float:
    """Measure the median of `repeats` calls after one to warm up, ms."""
    call()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return 1e3 * statistics.median(times)


def random_rays(world: World, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Draw rays from free places 1.5 m above the floor in all directions, (220, 3) each."""
    low, high = world.low_ned_m[:2], world.high_ned_m[:2]
    places = np.column_stack([rng.uniform(low, high, (40 * RAYS, 2)), np.full(40 * RAYS, -1.5)])
    free = places[~world.occupied(places)][:RAYS]
    directions = rng.normal(size=free.shape) * [1.0, 1.0, 0.2]
    return free, directions / np.linalg.norm(directions, axis=1)[:, None]


def boxes(count: int, rng: np.random.Generator) -> World:
    """Scatter turned boxes and some cylinders over 40 m x 40 m."""
    prisms = [
        Prism((n, e), (a, b), 0.0, 2.8, yaw, round=index % 6 == 5)
        for index, (n, e, a, b, yaw) in enumerate(
            rng.uniform([0.0, 0.0, 0.2, 0.2, 0.0], [40.0, 40.0, 1.0, 1.0, 3.1], (count, 5)).tolist()
        )
    ]
    spec = WorldSpec(name="bench", size_m=(40.0, 40.0), ceiling_m=2.8)
    return World(Path("bench"), spec, Shapes(prisms), None)


def measure(maps: Path) -> dict[str, float]:
    """Measure every case, ms."""
    rng = np.random.default_rng(1)
    worlds = {f"{count} shapes": boxes(count, rng) for count in (10, 60, 200)}
    worlds["office"] = load_world(ROOT / "missions/worlds/office.yaml")
    worlds["small_office_map"] = load_world(ROOT / "missions/worlds/small_office_map.yaml")
    figures = {}
    for path in sorted(maps.glob("*.yaml")):
        chart = load_map(path, 2.8)
        spec = WorldSpec(name=path.stem, ceiling_m=2.8)
        worlds[path.stem] = World(path, spec, Shapes([]), chart)
        figures[f"load {path.stem}"] = median_ms(partial(load_map, path, 2.8), 5)
    for name, world in worlds.items():
        origins, directions = random_rays(world, rng)
        figures[name] = median_ms(partial(world.cast, origins, directions, RANGE_M), 200)
    return figures


def main() -> None:
    """Print the table, and write it as JSON if told."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the figures to this file, ms")
    parser.add_argument("--maps", type=Path, default=ROOT.parent / "shared/data/maps")
    options = parser.parse_args()
    figures = measure(options.maps)
    print(f"{RAYS} rays, {RANGE_M:g} m; medians\n{'case':24} {'ms':>8} {'target':>8}")
    for name, value in figures.items():
        print(f"{name:24} {value:8.3f} {TARGETS_MS.get(name, ''):>8}")
    machine.write(options.json, figures)


if __name__ == "__main__":
    main()
