"""Odometry that loses a fraction of the way flown, in a direction that turns slowly."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FLOATS = NDArray[np.float64]

DRIFT_TURN_RAD_SQRT_S = 0.06
"""Random walk of the direction in which odometry drifts."""


class Odometry:
    """The position estimates of a whole fleet, off the truth by a growing drift."""

    def __init__(self, start_ned_m: FLOATS, fraction: float, rng: np.random.Generator) -> None:
        n = len(start_ned_m)
        self._usual_fraction = fraction
        self._fraction = np.full(n, fraction)
        self._rng = rng
        self._last_ned_m = start_ned_m.copy()
        self._heading_rad = rng.uniform(-math.pi, math.pi, n)
        self._drift_ned_m = np.zeros((n, 3))

    def add_drift(self, index: int, fraction: float) -> None:
        """Let a vehicle lose so much more of its way, from now on."""
        self._fraction[index] = self._usual_fraction + fraction

    def jump(self, index: int, jump_ned_m: FLOATS) -> None:
        """Lose a vehicle's place at once."""
        self._drift_ned_m[index] += jump_ned_m

    def move(self, position_ned_m: FLOATS, dt: float) -> FLOATS:
        """Add the drift of the way since the last time, horizontally: height has a barometer."""
        if self._fraction.any():
            way = position_ned_m - self._last_ned_m
            lost = self._fraction * np.sqrt(np.einsum("ij,ij->i", way, way))
            self._drift_ned_m[:, 0] += lost * np.cos(self._heading_rad)
            self._drift_ned_m[:, 1] += lost * np.sin(self._heading_rad)
            turn = DRIFT_TURN_RAD_SQRT_S * math.sqrt(dt)
            self._heading_rad += self._rng.normal(0.0, turn, len(lost))
        self._last_ned_m[:] = position_ned_m
        return self._drift_ned_m
