"""Where robots believe they are, while they lose their way."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from swarm_ctl.explore.chance import Floats, Seed

_BLOCK = 256
_BIAS_RAD = 0.1
"""How far the direction of the bias turns in a metre, standard deviation, rad / sqrt(m)."""
_TURN_RAD = math.radians(1.0) * 100.0 / math.sqrt(10.0)
"""How far the heading turns in a metre per drift: "1.0 deg*x/sqrt(10 m)" for x percent."""


class Odometry:
    """The own frames of many robots: they begin where each starts, and lie along north.

    "Slowly turning bias of x % of the distance + heading random walk" (ALGORITHM 2.6); height is
    exact, and a drift of 0 is, too. Seed i decides on the errors of robot i.
    """

    def __init__(self, drift: float, dimensions: int, seeds: Sequence[Seed]) -> None:
        self._drift = drift
        self.position_m: Floats = np.zeros((len(seeds), dimensions))
        """(n, d) north, east, down."""
        if drift:
            self._chances = [np.random.default_rng(seed) for seed in seeds]
            bias = [chance.uniform(0.0, 2.0 * math.pi) for chance in self._chances]
            self._bias_rad: Floats = np.array(bias)
            self._turn_rad: Floats = np.zeros(len(seeds))
            self._moves = 0

    def move(self, motion_m: Floats) -> None:
        """Add true displacements (n, d) as the robots believe them."""
        self.position_m = self.position_m + (self._felt(motion_m) if self._drift else motion_m)

    def _felt(self, motion_m: Floats) -> Floats:
        if self._moves % _BLOCK == 0:
            drawn = [chance.standard_normal((_BLOCK, 2)) for chance in self._chances]
            self._normal = np.stack(drawn, axis=2)
        for_bias, for_turn = self._normal[self._moves % _BLOCK]
        self._moves += 1
        north, east = motion_m[:, 0], motion_m[:, 1]
        far_m = np.sqrt(north * north + east * east)
        self._bias_rad += _BIAS_RAD * np.sqrt(far_m) * for_bias
        self._turn_rad += _TURN_RAD * self._drift * np.sqrt(far_m) * for_turn
        cos, sin = np.cos(self._turn_rad), np.sin(self._turn_rad)
        felt_m = motion_m.copy()
        felt_m[:, 0] = cos * north - sin * east + self._drift * far_m * np.cos(self._bias_rad)
        felt_m[:, 1] = sin * north + cos * east + self._drift * far_m * np.sin(self._bias_rad)
        return felt_m
