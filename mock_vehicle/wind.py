"""The wind: a mean everywhere, gusts everywhere, and gusts that strike one vehicle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mock_vehicle.world.spec import WindSpec

FLOATS = NDArray[np.float64]

GUST_S = 3.0
"""Correlation time of gusts."""


def blowing_from(from_deg: float, speed_m_s: float) -> FLOATS:
    """Give the velocity, NED m/s, of a wind from degrees counter-clockwise from east."""
    from_rad = math.radians(from_deg)
    towards_ned = -np.array([math.sin(from_rad), math.cos(from_rad), 0.0])
    return speed_m_s * towards_ned


class Wind:
    """Mean wind and first-order Gauss-Markov gusts, the same everywhere but for `local`."""

    def __init__(self, spec: WindSpec, n: int, rng: np.random.Generator) -> None:
        self._mean_ned_m_s = blowing_from(spec.from_deg, spec.speed_m_s)
        self._gust_m_s, self._rng = spec.gust_m_s, rng
        self._gust_ned_m_s = np.zeros(3)
        self._velocity_ned_m_s = self._mean_ned_m_s
        self._blows = bool(spec.speed_m_s or spec.gust_m_s)
        self._local_ned_m_s = np.zeros((n, 3))
        self._is_local = False
        self._over: FLOATS = self._local_ned_m_s
        self._grounded: bytes | None = None
        """Who was on the ground when `_over` was worked out; None when the wind has changed."""

    def over(self, on_ground: NDArray[np.bool_]) -> FLOATS:
        """Give the wind for each vehicle, (n, 3) or (3,); the parked are not blown away."""
        if not self._blows and not self._is_local:
            return self._velocity_ned_m_s
        grounded = on_ground.tobytes()
        if grounded != self._grounded:
            wind = self._velocity_ned_m_s + self._local_ned_m_s
            self._over, self._grounded = np.where(on_ground[:, None], 0.0, wind), grounded
        return self._over

    def strike(self, index: int, gust_ned_m_s: FLOATS) -> None:
        """Let a gust blow at one vehicle from now on; zero ends it."""
        self._local_ned_m_s[index] = gust_ned_m_s
        self._is_local = bool(self._local_ned_m_s.any())
        self._grounded = None

    def blow(self, dt: float) -> None:
        """Let the gusts change."""
        if self._gust_m_s > 0.0:
            kept = math.exp(-dt / GUST_S)
            fresh = self._gust_m_s * math.sqrt(1.0 - kept**2)
            draw = self._rng.normal(0.0, fresh, 3) * (1.0, 1.0, 0.3)  # gusts are flat
            self._gust_ned_m_s = kept * self._gust_ned_m_s + draw
            self._velocity_ned_m_s = self._mean_ned_m_s + self._gust_ned_m_s
            self._grounded = None
