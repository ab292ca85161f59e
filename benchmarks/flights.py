"""Fly a mission with many seeds in virtual time: `python benchmarks/flights.py --help`.

Prints a line per seed, then the mean of what was explored with its 95 % interval, and all contacts.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from swarm_ctl.experiment.arena import Arena
from swarm_ctl.flight import TRUTH
from swarm_ctl.mission import load_mission
from swarm_ctl.record.folder import RunFolder

HALL = Path(__file__).parents[1] / "missions" / "open_3d.yaml"
MOST_S = 3600.0
"""Mission time after which a flight that has not ended is cut off."""


def fly(seed: int, path: Path) -> dict[str, Any]:
    """Fly once; what the mock's referee saw, and the CPU time it took."""
    mission = load_mission(path, seed=seed)
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        run = RunFolder.create(
            Path(folder) / "run", mission.name, mission.dump(), seed=seed, mode="virtual"
        )
        arena = Arena(mission, run)
        arena.fly(until_s=MOST_S)
        arena.write_truth(run.path)
        truth = json.loads((run.path / TRUTH / "truth.json").read_text(encoding="utf-8"))
    keys = ("coverage_fraction", "victims_found", "collisions", "min_separation_m", "path_length_m")
    return {key: truth[key] for key in keys} | {"cpu_s": time.process_time() - began}


def main() -> None:
    """Read the command line, fly, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mission", type=Path, nargs="?", default=HALL)
    parser.add_argument("--seeds", type=int, default=4, help="flights, of seeds 1 to this")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    rows = []
    with ProcessPoolExecutor(options.workers) as pool:
        flights = pool.map(partial(fly, path=options.mission), range(1, options.seeds + 1))
        for seed, row in enumerate(flights, start=1):
            rows.append(row)
            told = ", ".join(f"{key} {value:.4g}" for key, value in row.items())
            print(f"seed {seed}: {told}", flush=True)
    shares = [100.0 * row["coverage_fraction"] for row in rows]
    spread = statistics.stdev(shares) if len(shares) > 1 else 0.0
    print(
        f"{options.mission.stem}, {len(rows)} seeds: {statistics.mean(shares):.2f} "
        f"± {1.96 * spread / math.sqrt(len(rows)):.2f} % explored, "
        f"least {min(shares):.2f} %, standard deviation {spread:.2f}; "
        f"victims {min(row['victims_found'] for row in rows)} or more; "
        f"{sum(row['collisions'] for row in rows)} contacts, "
        f"closest {min(row['min_separation_m'] for row in rows):.2f} m"
    )


if __name__ == "__main__":
    main()
