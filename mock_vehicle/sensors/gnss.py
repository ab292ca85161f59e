"""Satellite receivers: how well each vehicle receives, and how far off its fixes are."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NOISE_NED_M = np.array([3.0, 3.0, 6.0])
"""Standard deviation of a degraded fix; height is worse, as with real receivers."""
CORRELATION_S = 30.0
"""How long a degraded fix stays off to the same side."""


class Reception(IntEnum):
    """What a receiver makes of the sky."""

    DENIED = 0
    DEGRADED = 1
    PRESENT = 2


class Fix(NamedTuple):
    """What a receiver says of the quality of its fix, as in GPS_RAW_INT."""

    fix_type: int
    eph: int
    """Horizontal dilution of precision, in hundredths."""
    epv: int
    satellites: int
    h_acc_mm: int
    v_acc_mm: int
    vel_acc_mm_s: int


UNKNOWN = 0xFFFF
NO_RECEIVER = Fix(0, UNKNOWN, UNKNOWN, 0, 0, 0, 0)
LOST_FIX = Fix(1, UNKNOWN, UNKNOWN, 3, 0, 0, 0)
DEGRADED_FIX = Fix(2, 480, 900, 5, 5000, 12000, 1000)


class Gnss:
    """The receivers of the fleet."""

    def __init__(self, n: int, reception: Reception, rng: np.random.Generator) -> None:
        self._usual = reception
        self.reception: NDArray[np.int8] = np.full(n, reception, dtype=np.int8)
        """Shape (n,): `Reception` of each vehicle."""
        self.glitch_ned_m: Floats = np.zeros((n, 3))
        """Shape (n, 3): what a spoofer or a reflection adds to the fix."""
        self._noise_ned_m: Floats = np.zeros((n, 3))
        self._rng = rng

    def spoil(self, index: int, *, lost: bool, glitch_ned_m: Floats) -> None:
        """Let the receiver of one vehicle be like this from now on."""
        self.reception[index] = Reception.DENIED if lost else self._usual
        self.glitch_ned_m[index] = glitch_ned_m

    def measure(self, dt: float) -> Floats:
        """Give the error of each fix, fix - truth, of shape (n, 3); `dt` s after the last one."""
        degraded = self.reception == Reception.DEGRADED
        if not degraded.any():
            return self.glitch_ned_m
        kept = math.exp(-dt / CORRELATION_S)
        fresh = self._rng.normal(0.0, 1.0, self._noise_ned_m.shape) * NOISE_NED_M
        self._noise_ned_m = kept * self._noise_ned_m + math.sqrt(1.0 - kept**2) * fresh
        error: Floats = self.glitch_ned_m + self._noise_ned_m * degraded[:, None]
        return error
