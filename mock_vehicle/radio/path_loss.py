"""How much of a signal is left: log-distance law, walls, log-normal shadowing."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.radio.figures import Fate
from mock_vehicle.world.radio import PathLossSpec

FLOATS = NDArray[np.float64]
FATES = NDArray[np.int8]
Walls = Callable[[FLOATS, FLOATS], NDArray[np.intp]]
"""Counts the solids between (k, 3) pairs of points, NED in the world, m."""
HEARD, RANGE, WALLS, FADING = map(int, (Fate.HEARD, Fate.RANGE, Fate.WALLS, Fate.FADING))
"""For numpy, to which a member of an enumeration is no plain number."""
NEAREST_M = 1e-3
"""Nearer than this, two are as far apart as this: the law has no value at 0."""


class PathLoss:
    """Who of a fleet hears whom by what is left of the signal.

    The link margin of a pair at distance d, in dB: 10 n log10(radius / d) - walls * attenuation
    + shadowing. At 0 or more they hear each other. The shadowing is a Gaussian process whose
    correlation falls exponentially with the way of either end, and with time (Gudmundson 1991;
    Wang, Tameh and Nix 2008); docs/radio.md.
    """

    def __init__(
        self, spec: PathLossSpec, radius_m: float, n: int, walls: Walls, rng: np.random.Generator
    ) -> None:
        self._spec = spec
        self._radius_m = max(radius_m, NEAREST_M * 1e-3)
        self._walls = walls
        self._rng = rng
        self._pairs = np.triu_indices(n, 1)
        self._shadowing_db: FLOATS = rng.normal(0.0, spec.shadowing_db, len(self._pairs[0]))
        self._position_ned_m: FLOATS | None = None
        self._now = 0.0

    def fates(self, distances_m: FLOATS, position_ned_m: FLOATS, now: float) -> FATES:
        """Tell what becomes of frames between all, (n, n)."""
        self._wander(position_ned_m, now)
        first, second = self._pairs
        apart_m = np.maximum(distances_m[first, second], NEAREST_M)
        margin_db = 10.0 * self._spec.exponent * np.log10(self._radius_m / apart_m)
        (near,) = np.nonzero((margin_db >= 0.0) | (margin_db + self._shadowing_db >= 0.0))
        behind_db = margin_db.copy()
        if len(near):
            a_m, b_m = position_ned_m[first[near]], position_ned_m[second[near]]
            behind_db[near] -= self._spec.wall_db * self._walls(a_m, b_m)
        fate = np.where(
            behind_db + self._shadowing_db >= 0.0,
            HEARD,
            np.where(margin_db < 0.0, RANGE, np.where(behind_db < 0, WALLS, FADING)),
        )
        fates = np.full(distances_m.shape, RANGE, dtype=np.int8)
        fates[first, second] = fates[second, first] = fate
        return fates

    def _wander(self, position_ned_m: FLOATS, now: float) -> None:
        """Let the shadowing change with the way that the two ends have come, and with time."""
        spec, before = self._spec, self._position_ned_m
        if before is not None and spec.shadowing_db > 0.0:
            step = position_ned_m - before
            way_m = np.sqrt(np.einsum("ij,ij->i", step, step))
            first, second = self._pairs
            spent = (way_m[first] + way_m[second]) / spec.shadowing_m
            spent += (now - self._now) / (spec.shadowing_s or math.inf)
            kept = np.exp(-spent)
            fresh = self._rng.normal(0.0, spec.shadowing_db, len(kept))
            self._shadowing_db = kept * self._shadowing_db + np.sqrt(1.0 - kept * kept) * fresh
        self._position_ned_m, self._now = position_ned_m.copy(), now
