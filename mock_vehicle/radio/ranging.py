"""Ranges and bearings that a radio measures, and how wrong they are."""

from __future__ import annotations

import importlib.util
import math
from collections import deque
from collections.abc import Sequence
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.sensors.infrared import ned_to_body
from mock_vehicle.sensors.readings import PeerFix
from mock_vehicle.world.radio import RangingSpec, SectorSpec

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]
INDICES = NDArray[np.intp]
SOON_S = 1e-6
"""Times are sums of floats."""


class Ranging:
    """What the radios of a fleet measure of each other."""

    def __init__(self, spec: RangingSpec, sysids: Sequence[int], rng: np.random.Generator) -> None:
        """Draw the noise from `rng`, all else from generators of its own."""
        self._spec = spec
        self._sysids = list(sysids)
        self._rng = rng
        biases, self._outliers = rng.spawn(2)
        n = len(self._sysids)
        one_way = np.triu(biases.normal(0.0, spec.range_bias_m, (n, n)), 1)
        self._range_bias_m: FLOATS = one_way + one_way.T
        """Of a pair, the same for both."""
        self._bearing_bias: FLOATS = biases.normal(
            0.0, math.radians(spec.bearing_bias_deg), (n, n, 3)
        )
        """What a unit vector from hearer (row) to peer (column) is beside, body FRD."""
        self._loops: ModuleType | None = None
        self._untold: deque[tuple[float, list[list[PeerFix]]]] = deque()

    def compile(self) -> None:
        """Measure by loops that numba compiles, where it is installed."""
        if importlib.util.find_spec("numba") is not None:
            self._loops = importlib.import_module("mock_vehicle.world.loops")

    def measure(
        self,
        pairs: tuple[INDICES, INDICES],
        position_ned_m: FLOATS,
        attitude_rad: tuple[FLOATS, FLOATS, FLOATS],
        now: float,
    ) -> list[list[PeerFix]]:
        """Let hearers measure peers (indices) now; give what each tells now, by hearer."""
        fixes = self._fixes(pairs, position_ned_m, attitude_rad, now)
        if self._spec.delay_s <= 0.0:
            return fixes
        self._untold.append((now + self._spec.delay_s, fixes))
        is_due = self._untold[0][0] <= now + SOON_S
        return self._untold.popleft()[1] if is_due else [[] for _ in self._sysids]

    def _fixes(
        self,
        pairs: tuple[INDICES, INDICES],
        position_ned_m: FLOATS,
        attitude_rad: tuple[FLOATS, FLOATS, FLOATS],
        now: float,
    ) -> list[list[PeerFix]]:
        hearer, peer = pairs
        heard: list[list[PeerFix]] = [[] for _ in self._sysids]
        if not len(hearer):
            return heard
        ranges, body = self._gaze(pairs, position_ned_m, attitude_rad)
        if self._spec.blind:
            seen = ~_within(self._spec.blind, body)
            hearer, peer, ranges, body = hearer[seen], peer[seen], ranges[seen], body[seen]
        body = self._bearings(hearer, peer, body)
        ranges = self._ranges(hearer, peer, ranges)
        rows = zip(hearer.tolist(), peer.tolist(), ranges.tolist(), body.tolist(), strict=True)
        for listener, talker, range_m, (x, y, z) in rows:
            heard[listener].append(PeerFix(self._sysids[talker], range_m, (x, y, z), now))
        return heard

    def _gaze(
        self,
        pairs: tuple[INDICES, INDICES],
        position_ned_m: FLOATS,
        attitude_rad: tuple[FLOATS, FLOATS, FLOATS],
    ) -> tuple[FLOATS, FLOATS]:
        """Give the true ranges (k,) and directions in body FRD, (k, 3), of pairs."""
        hearer, peer = pairs
        if self._loops is not None:
            angles, k = np.stack(attitude_rad), len(hearer)
            measured = np.empty(k), np.empty((k, 3))
            self._loops.gaze(position_ned_m, *pairs, np.cos(angles), np.sin(angles), *measured)
            return measured
        gap = position_ned_m[peer] - position_ned_m[hearer]
        north, east, down = gap.T
        ranges = np.sqrt(north * north + down * down + east * east)
        roll, pitch, yaw = (angle[hearer] for angle in attitude_rad)
        return ranges, ned_to_body(gap / np.maximum(ranges, 1e-9)[:, None], roll, pitch, yaw)

    def _bearings(self, hearer: INDICES, peer: INDICES, body: FLOATS) -> FLOATS:
        """Mistake unit vectors in body FRD, (k, 3)."""
        spec = self._spec
        if spec.bearing_noise_deg <= 0.0 and spec.bearing_bias_deg <= 0.0:
            return body
        if spec.bearing_noise_deg > 0.0:
            body += self._rng.normal(0.0, math.radians(spec.bearing_noise_deg), body.shape)
        if spec.bearing_bias_deg > 0.0:
            body += self._bearing_bias[hearer, peer]
        body /= np.sqrt(np.einsum("ij,ij->i", body, body))[:, None]
        return body

    def _ranges(self, hearer: INDICES, peer: INDICES, ranges_m: FLOATS) -> FLOATS:
        """Mistake ranges, (k,); a detour only makes them longer."""
        spec = self._spec
        if spec.range_bias_m > 0.0:
            ranges_m = np.abs(ranges_m + self._range_bias_m[hearer, peer])
        if spec.range_noise_m > 0.0:
            ranges_m = np.abs(ranges_m + self._rng.normal(0.0, spec.range_noise_m, ranges_m.shape))
        if spec.outlier_fraction > 0.0:
            detour = self._outliers.exponential(spec.outlier_m, ranges_m.shape)
            is_outlier = self._outliers.random(ranges_m.shape) < spec.outlier_fraction
            ranges_m = ranges_m + np.where(is_outlier, detour, 0.0)
        return ranges_m


def _within(sectors: Sequence[SectorSpec], body: FLOATS) -> BOOLS:
    """Tell which of (k, 3) vectors in body FRD point into one of the sectors."""
    azimuth_deg = np.degrees(np.arctan2(body[:, 1], body[:, 0]))
    within = np.zeros(len(body), dtype=bool)
    for sector in sectors:
        within |= (azimuth_deg - sector.from_deg) % 360.0 <= (
            sector.to_deg - sector.from_deg
        ) % 360.0
    return within
