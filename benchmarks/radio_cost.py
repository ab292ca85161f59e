"""CPU time of the radio of a fleet: `python benchmarks/radio_cost.py`."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from mock_vehicle.radio import Radio
from mock_vehicle.world.radio import RadioSpec

TICKS = 100
TICK_S, STEPS = 0.1, 5
KINDS: dict[str, dict[str, Any]] = {
    "disc of 4 m": {"radius_m": 4.0},
    "disc of 12 m": {"radius_m": 12.0},
    "12 m, shadowing": {"radius_m": 12.0, "path_loss": {"shadowing_db": 4.0}},
    "12 m, a channel": {"radius_m": 12.0, "channel": {"bit_rate_bit_s": 1e6}},
    "12 m, jitter": {"radius_m": 12.0, "jitter_s": 0.05},
}


def cost_us(n: int, keys: dict[str, Any]) -> float:
    """Time a tick of n vehicles in 40 m x 40 m that each broadcast once in it, microseconds."""
    rng = np.random.default_rng(1)
    air = Radio(range(1, n + 1), RadioSpec.model_validate(keys), rng)
    at = rng.uniform(0.0, 1.0, (n, 3)) * (40.0, 40.0, 4.0)
    gaps, alive = np.linalg.norm(at[None] - at[:, None], axis=2), np.ones(n, dtype=bool)
    begin_ns = time.process_time_ns()
    for tick in range(TICKS):
        now = tick * TICK_S
        air.update(gaps, alive, at, now)
        air.fixes(at, (np.zeros(n), np.zeros(n), np.zeros(n)), now)
        for sender in range(n):
            air.send(sender, bytes(60), now)
        for step in range(STEPS):
            air.carry(now + step * TICK_S / STEPS)
    return (time.process_time_ns() - begin_ns) / TICKS / 1e3


def main() -> None:
    """Print the best of five for ten and a hundred vehicles."""
    for n in (10, 100):
        for kind, keys in KINDS.items():
            best_us = min(cost_us(n, keys) for _ in range(5))
            print(f"{n:4d} vehicles, {kind:16s} {best_us:8.0f} us per tick of {TICK_S} s")


if __name__ == "__main__":
    main()
