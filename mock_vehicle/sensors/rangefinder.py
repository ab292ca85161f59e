"""Six rangefinders per vehicle: four gimballed cones around, one beam up, one beam down."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.world.ring import Ring

if TYPE_CHECKING:
    from mock_vehicle.world import World

FLOATS = NDArray[np.float64]

RANGE_MIN_M = 0.1
BODY_RADIUS_M = 0.3
"""How large one vehicle looks to the rangefinders of another."""
CONE_DEG = 90.0
"""Width of each of the four level cones: together they see all around."""
RING = 72
"""Level rays of a vehicle, evenly spaced: 5 degrees, as in MAVLink's OBSTACLE_DISTANCE."""

_SPACING_DEG = 360.0 / RING
_SIDES_DEG = (0.0, 180.0, -90.0, 90.0)  # front, back, left, right, clockwise from the nose
_HALF = round(CONE_DEG / 2.0 / _SPACING_DEG)
_CONES = np.array(
    [np.arange(-_HALF, _HALF + 1) + round(side / _SPACING_DEG) for side in _SIDES_DEG]
)
_CONES %= RING
"""Rays of each cone, (4, 19) indices into the ring; the outermost are its neighbour's too."""


class Ranges(NamedTuple):
    """What the rangefinders of n vehicles read, m; `inf` is nothing within range."""

    sensors_m: FLOATS
    """(n, 6): front, back, left, right, up, down."""
    ring_m: FLOATS
    """(n, 72): every level ray, clockwise from the nose."""


class _Defect(NamedTuple):
    """What is wrong with the rangefinders of one vehicle."""

    lost: bool
    noise_m: float
    held: Ranges | None
    """What they repeat."""

    def spoil(self, ranges: Ranges, index: int) -> None:
        """Write what is reported in place of what was measured."""
        if self.held is not None:
            ranges.sensors_m[index], ranges.ring_m[index] = self.held
        if self.lost:
            ranges.sensors_m[index] = ranges.ring_m[index] = math.nan


def fold(ring_m: FLOATS) -> FLOATS:
    """Take the nearest return of each cone: (n, 72) to (n, 4)."""
    nearest: FLOATS = ring_m.T[_CONES].min(axis=1).T
    return nearest


class Rangefinders:
    """The rangefinders of a whole fleet, read together."""

    def __init__(self, *, range_max_m: float, noise_m: float, rng: np.random.Generator) -> None:
        self.range_max_m = range_max_m
        self._noise_m = noise_m
        self._rng = rng
        self._defects: dict[int, _Defect] = {}
        self._last: Ranges | None = None

    def spoil(self, index: int, *, lost: bool, stuck: bool, noise_m: float) -> None:
        """Let the rangefinders of one vehicle be like this from now on."""
        before = self._defects.pop(index, None)
        held = before.held if before else None
        if stuck and held is None and self._last is not None:
            held = Ranges(self._last.sensors_m[index].copy(), self._last.ring_m[index].copy())
        if lost or stuck or noise_m > 0.0:
            self._defects[index] = _Defect(lost, noise_m, held if stuck else None)

    def measure(
        self,
        world: World,
        position_ned_m: FLOATS,
        yaw_rad: FLOATS,
        near: tuple[NDArray[np.intp], NDArray[np.intp]],
        bodies_m: FLOATS | None = None,
    ) -> Ranges:
        """Read the ranges from the centres of all vehicles.

        `near` are the (hearer, other) index pairs close enough to be seen as obstacles; others
        beyond the vehicles are rows of `bodies_m`, of which the vehicles come first.
        """
        ring = Ring(position_ned_m, yaw_rad, RING)
        upright = world.look(ring, self.range_max_m, near, BODY_RADIUS_M, bodies_m)
        sensors = np.column_stack((fold(ring.ranges_m), upright))
        if self._noise_m > 0.0:
            sensors += self._rng.normal(0.0, self._noise_m, sensors.shape)
        for index, defect in self._defects.items():
            if defect.noise_m > 0.0:
                sensors[index] += self._rng.normal(0.0, defect.noise_m, sensors.shape[1:])
                ring.ranges_m[index] += self._rng.normal(0.0, defect.noise_m, RING)
        self._last = Ranges(self._reported(sensors), self._reported(ring.ranges_m))
        for index, defect in self._defects.items():
            defect.spoil(self._last, index)
        return self._last

    def _reported(self, measured_m: FLOATS) -> FLOATS:
        np.maximum(measured_m, RANGE_MIN_M, out=measured_m)
        measured_m[measured_m > self.range_max_m] = math.inf
        return measured_m
