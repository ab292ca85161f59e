"""A thermal camera that sees victims in the line of sight."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.sensors.readings import VictimFix

if TYPE_CHECKING:
    from mock_vehicle.world import World

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]


def ned_to_body(vectors: FLOATS, roll_rad: FLOATS, pitch_rad: FLOATS, yaw_rad: FLOATS) -> FLOATS:
    """Turn (m, 3) vectors from NED into body FRD, one attitude (intrinsic z-y-x) per vector."""
    north, east, down = vectors.T
    cy, sy = np.cos(yaw_rad), np.sin(yaw_rad)
    forward, right = cy * north + sy * east, cy * east - sy * north
    cp, sp = np.cos(pitch_rad), np.sin(pitch_rad)
    forward, down = cp * forward - sp * down, sp * forward + cp * down
    cr, sr = np.cos(roll_rad), np.sin(roll_rad)
    right, down = cr * right + sr * down, cr * down - sr * right
    return np.stack((forward, right, down), axis=1)


class Infrared:
    """The thermal cameras of a whole fleet."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._range_m = world.spec.infrared.range_m
        positions = [victim.position_ned_m for victim in world.victims]
        self._victims_ned_m = np.array(positions, dtype=np.float64).reshape(-1, 3)

    def see(self, position_ned_m: FLOATS, airborne: BOOLS) -> tuple[NDArray[np.intp], ...]:
        """Find who sees whom: (vehicle indices, victim indices), ordered by vehicle."""
        gap = self._victims_ned_m[None, :, :] - position_ned_m[:, None, :]
        near = np.einsum("ijk,ijk->ij", gap, gap) <= self._range_m**2
        vehicle, victim = np.nonzero(near & airborne[:, None])
        if len(vehicle):
            seen = self._world.line_of_sight(position_ned_m[vehicle], self._victims_ned_m[victim])
            vehicle, victim = vehicle[seen], victim[seen]
        return vehicle, victim

    def fixes(
        self,
        sightings: tuple[NDArray[np.intp], ...],
        position_ned_m: FLOATS,
        attitude_rad: tuple[FLOATS, FLOATS, FLOATS],
    ) -> list[list[VictimFix]]:
        """Turn sightings into what each camera reports in its own body frame."""
        found: list[list[VictimFix]] = [[] for _ in position_ned_m]
        vehicle, victim = sightings
        if len(vehicle):
            roll, pitch, yaw = (angle[vehicle] for angle in attitude_rad)
            gap = self._victims_ned_m[victim] - position_ned_m[vehicle]
            body = ned_to_body(gap, roll, pitch, yaw).tolist()
            for hearer, number, (x, y, z) in zip(
                vehicle.tolist(), victim.tolist(), body, strict=True
            ):
                found[hearer].append(VictimFix(number, x, y, z))
        return found
