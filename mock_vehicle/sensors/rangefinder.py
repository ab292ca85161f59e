"""Six rangefinders per vehicle: four gimballed cones around, one beam up, one beam down."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

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
_AZIMUTHS_RAD = np.radians(np.arange(RING) * _SPACING_DEG)
_SIDES_DEG = (0.0, 180.0, -90.0, 90.0)  # front, back, left, right, clockwise from the nose
_HALF = round(CONE_DEG / 2.0 / _SPACING_DEG)
_CONES = np.array(
    [np.arange(-_HALF, _HALF + 1) + round(side / _SPACING_DEG) for side in _SIDES_DEG]
)
_CONES %= RING
"""Rays of each cone, (4, 19) indices into the ring; the outermost are its neighbour's too."""
_RAYS = RING + 2


def directions(yaw_rad: FLOATS) -> FLOATS:
    """Point all beams, (n, 74, 3) in NED: the ring clockwise from the nose, then up, then down."""
    azimuth = yaw_rad[:, None] + _AZIMUTHS_RAD
    beams = np.zeros((len(yaw_rad), _RAYS, 3))
    np.cos(azimuth, out=beams[:, :-2, 0])
    np.sin(azimuth, out=beams[:, :-2, 1])
    beams[:, -2, 2] = -1.0
    beams[:, -1, 2] = 1.0
    return beams


def fold(ranges_m: FLOATS) -> FLOATS:
    """Take the nearest return of each cone: (n, 74) to (n, 6)."""
    folded = np.empty((len(ranges_m), 6))
    ranges_m[:, _CONES].min(axis=2, out=folded[:, :4])
    folded[:, 4:] = ranges_m[:, -2:]
    return folded


def sphere_ranges(beams: FLOATS, toward_m: FLOATS, radius_m: float = BODY_RADIUS_M) -> FLOATS:
    """Range along (p, k, 3) beams to spheres `toward_m` (p, 3) away; `inf` where they miss."""
    along = np.einsum("pkc,pc->pk", beams, toward_m)
    missed_squared = np.einsum("pc,pc->p", toward_m, toward_m)[:, None] - along**2
    half_chord_squared = radius_m**2 - missed_squared
    hit = (half_chord_squared >= 0.0) & (along > 0.0)
    near = along - np.sqrt(np.where(hit, half_chord_squared, 0.0))
    return np.where(hit, np.maximum(near, 0.0), math.inf)


class Rangefinders:
    """The rangefinders of a whole fleet, read with one cast."""

    def __init__(self, *, range_max_m: float, noise_m: float, rng: np.random.Generator) -> None:
        self.range_max_m = range_max_m
        self._noise_m = noise_m
        self._rng = rng

    def measure(
        self,
        world: World,
        position_ned_m: FLOATS,
        yaw_rad: FLOATS,
        near: tuple[NDArray[np.intp], NDArray[np.intp]],
    ) -> FLOATS:
        """Read (n, 6) ranges from the centres; `inf` is nothing within `range_max_m`.

        `near` are the (hearer, other) index pairs close enough to be seen as obstacles.
        """
        beams = directions(yaw_rad)
        n = len(beams)
        origins = np.repeat(position_ned_m, _RAYS, axis=0)
        ranges = world.cast(origins, beams.reshape(-1, 3), self.range_max_m).reshape(n, _RAYS)
        seer, seen = near
        if len(seer):
            toward = position_ned_m[seen] - position_ned_m[seer]
            np.minimum.at(ranges, seer, sphere_ranges(beams[seer], toward))
        measured = fold(ranges)
        if self._noise_m > 0.0:
            measured += self._rng.normal(0.0, self._noise_m, measured.shape)
        np.maximum(measured, RANGE_MIN_M, out=measured)
        measured[measured > self.range_max_m] = math.inf
        return measured
