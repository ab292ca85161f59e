"""Times in which a swarm falls apart."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.world.radio import DividerSpec, PartitionSpec

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]


class Partition:
    """One time, and who does not hear whom in it."""

    def __init__(self, spec: PartitionSpec, sysids: Sequence[int]) -> None:
        self._from_s = spec.from_s
        self._until_s = math.inf if spec.until_s is None else spec.until_s
        self._line = spec.line
        groups = {sysid: 1 + k for k, group in enumerate(spec.groups) for sysid in group}
        self._groups = np.array([groups.get(sysid, 0) for sysid in sysids])

    def lasts(self, now: float) -> bool:
        """Tell whether it is that time."""
        return self._from_s <= now < self._until_s

    def parts(self, position_ned_m: FLOATS) -> BOOLS:
        """Tell who is kept apart, (n, n), with all at (n, 3) NED in the world, m."""
        sides = self._groups if self._line is None else _left_of(self._line, position_ned_m)
        apart: BOOLS = sides[:, None] != sides[None, :]
        return apart


def _left_of(line: DividerSpec, position_ned_m: FLOATS) -> BOOLS:
    """Tell which of (n, 3) points lie left of a line of the plan."""
    (x0, y0), (x1, y1) = line.from_m, line.to_m
    north, east = position_ned_m[:, 0], position_ned_m[:, 1]
    left: BOOLS = (x1 - x0) * (north - y0) > (y1 - y0) * (east - x0)
    return left
