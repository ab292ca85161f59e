"""Radios for tests, and vehicles that stand around them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.radio import Radio
from mock_vehicle.world.radio import RadioSpec

Floats = NDArray[np.float64]


def radio(n: int, *, seed: int = 1, **keys: Any) -> Radio:
    spec = RadioSpec.model_validate({"radius_m": 2.0, **keys})
    return Radio(range(1, n + 1), spec, np.random.default_rng(seed))


def listen(air: Radio, positions: list[tuple[float, float, float]], now: float = 0.0) -> Floats:
    """Update the links for vehicles that stand there, all alive."""
    at = np.array(positions)
    gaps = np.linalg.norm(at[None] - at[:, None], axis=2)
    air.update(gaps, np.ones(len(at), dtype=bool), at, now)
    return at


def attitude(
    n: int, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0
) -> tuple[Floats, Floats, Floats]:
    return np.full(n, roll), np.full(n, pitch), np.full(n, yaw)
