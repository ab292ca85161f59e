"""Look for contacts in thousands of robot-hours: `python benchmarks/robot_hours.py --help`.

Ten and thirty vehicles at 1 m/s in a hall of 20 m x 20 m x 6 m, 300 s each, starts anywhere, 5 cm
of noise on what the radio measures, 0.2 s of delay, 30 % of everything lost: the set-up of
ALGORITHM 3.4, but through controllers, MAVLink, autopilots and radio. A contact is a pair closer
than 0.6 m, or a vehicle that touches a wall.
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Iterator
from pathlib import Path

from many import Hall, Row, pursue

RANGING = {"range_noise_m": 0.05, "bearing_noise_deg": 1.5, "delay_s": 0.2}
"""At 2 m a bearing that is 1.5 degrees off is 5 cm off."""
WORLD = {"radio": {"delay_s": 0.2, "loss_fraction": 0.3, "ranging": RANGING}}
SWARMS = [("lf-pso", 10), ("explore", 10), ("lf-pso", 30), ("explore", 30)]
"""Planner and vehicles; in turns."""
FLIGHT = {"climb_m_s": 0.5}
"""1 m/s along a way that climbs by 30 degrees, as in the study; 1 m/s of climb beside 1 m/s on the
level would be 1.4 m/s."""


def halls(duration_s: float, first_seed: int = 1) -> Iterator[Hall]:
    """Give flights without end."""
    for seed in itertools.count(first_seed):
        for planner, vehicles in SWARMS:
            yield Hall(seed, vehicles, planner, duration_s, WORLD, {"flight": FLIGHT})


def upper_bound(contacts: int, hours: float) -> float:
    """Give the 95 % upper bound of contacts per hour, by Poisson's law."""
    low, high = 0.0, 10.0 + 3.0 * contacts
    for _ in range(60):
        mean = (low + high) / 2.0
        few = sum(mean**k / math.factorial(k) for k in range(contacts + 1)) * math.exp(-mean)
        low, high = (mean, high) if few > 0.05 else (low, mean)
    return low / hours


def summary(rows: list[Row]) -> str:
    """Say in a line what all flights came to."""
    hours, cpu_s = (
        sum(row["explored_s"] for row in rows) / 3600.0,
        sum(row["cpu_s"] for row in rows),
    )
    contacts = sum(row["contacts"] for row in rows)
    rate = sum(row["vehicle_s"] for row in rows) / cpu_s
    return (
        f"{len(rows)} flights, {hours:.1f} robot-hours, {contacts} contacts "
        f"(at most {upper_bound(contacts, hours):.4f} per robot-hour), "
        f"closest {min(row['closest_m'] for row in rows):.3f} m, "
        f"{rate:.0f} vehicle-seconds per CPU-second"
    )


def main() -> None:
    """Read the command line, fly, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=1000.0, help="robot-hours wanted")
    parser.add_argument("--seconds", type=float, default=math.inf, help="stop after, by the clock")
    parser.add_argument("--duration", type=float, default=300.0, help="exploration, s")
    parser.add_argument("--first-seed", type=int, default=1, help="to share out over machines")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--file", type=Path, help="JSON lines: a flight each, to go on from")
    options = parser.parse_args()
    end_s = time.monotonic() + options.seconds

    def is_enough(rows: list[Row]) -> bool:
        flown_s: float = sum(row["explored_s"] for row in rows)
        return flown_s >= 3600.0 * options.hours or bool(time.monotonic() >= end_s)

    rows: list[Row] = []
    for row in pursue(
        halls(options.duration, options.first_seed), options.file, options.workers, is_enough
    ):
        rows.append(row)
        if row["contacts"] or row["troubles"]:
            print(f"{row['job']}: {row['contacts']} contacts, {row['troubles']}", flush=True)
        if len(rows) % 20 == 0:
            print(summary(rows), flush=True)
    print(summary(rows))


if __name__ == "__main__":
    main()
