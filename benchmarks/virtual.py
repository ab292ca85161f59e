"""Vehicle-seconds per CPU-second of whole missions in virtual time."""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

from swarm_ctl.experiment.arena import Arena
from swarm_ctl.mission import load_mission
from swarm_ctl.record.folder import RunFolder

MISSIONS = Path(__file__).parent.parent / "missions"
CASES = [("usar_office.yaml", 10), ("open_3d.yaml", 1), ("open_3d.yaml", 10), ("open_3d.yaml", 50)]
FLOWN_S = 60.0


def measure(mission: str, vehicles: int) -> float:
    """Fly a minute after take-off; give vehicle-seconds per CPU-second."""
    loaded = load_mission(MISSIONS / mission, vehicles=vehicles)
    with (
        tempfile.TemporaryDirectory() as scratch,
        RunFolder.create(
            Path(scratch), loaded.name, loaded.dump(), seed=1, mode="virtual"
        ) as folder,
    ):
        arena = Arena(loaded, folder)
        arena.fly(until_s=20.0)
        began = time.process_time()
        arena.fly(until_s=20.0 + FLOWN_S)
        return vehicles * FLOWN_S / (time.process_time() - began)


def main() -> None:
    """Print a line per case; `--json FILE` writes them, too."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    figures = {}
    for mission, vehicles in CASES:
        rate = measure(mission, vehicles)
        figures[f"{mission} {vehicles}"] = rate
        print(f"{mission:20} {vehicles:4} vehicles {rate:7.0f} vehicle-s per CPU-s", end="")
        print(f"  ({rate / vehicles:.0f} times real time)")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
