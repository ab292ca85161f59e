"""Who touches a wall or another vehicle, and what pushes back."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.pairs import pairs
from mock_vehicle.referee import PARTED_M
from mock_vehicle.sensors.rangefinder import BODY_RADIUS_M
from mock_vehicle.shards.abroad import Strangers

if TYPE_CHECKING:
    from mock_vehicle.dynamics import Dynamics
    from mock_vehicle.referee import Referee
    from mock_vehicle.world import World

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]
INDICES = NDArray[np.intp]

REACH_S = 0.15
"""Whoever cannot touch anything within this time at twice its speed is not checked each step."""
TOP = -0.7
"""The downward part of the normal of what can be stood on."""
NO_GAPS_M, NOBODY = np.empty(0), np.empty(0, dtype=bool)
PROBES_M = 0.01 * np.eye(3)
"""Steps of the finite differences that tell where a wall pushes."""


class Touch:
    """The contacts of a fleet: with walls, with one another, with vehicles of other shards."""

    def __init__(self, world: World, dynamics: Dynamics, referee: Referee) -> None:
        self._world, self._dynamics, self._referee = world, dynamics, referee
        n = self._n = len(dynamics.on_ground)
        self._near_walls: INDICES = np.arange(n)
        self._counted = np.ones(n, dtype=bool)
        self._above_diagonal = np.triu(np.ones((n, n), dtype=bool), 1)
        first, second = self._above_diagonal.nonzero()
        self._near_pairs: tuple[INDICES, INDICES] = (first, second)

    def find_near(self, distances: FLOATS, strangers: Strangers) -> None:
        """Note who could touch something before the next tick; only they are checked each step.

        Distances are from the fleet to itself and behind it to the strangers, (n, n + q).
        """
        reach = _reach_m(self._dynamics.velocity_ned_m_s)
        clearance = self._world.clearance(self._dynamics.position_ned_m)
        (self._near_walls,) = (clearance < BODY_RADIUS_M + reach).nonzero()
        theirs = reach
        if len(strangers.vehicles):
            theirs = np.concatenate((reach, _reach_m(strangers.velocity_ned_m_s)))
        meet = distances < 2.0 * BODY_RADIUS_M + reach[:, None] + theirs
        meet[:, : self._n] &= self._above_diagonal
        self._near_pairs = pairs(meet)

    def walls(self) -> None:
        """Stop at the surface whoever is pressed into a wall; it slides along."""
        near, airborne = self._near_walls, ~self._dynamics.on_ground
        can_touch = np.count_nonzero(airborne[near]) > 0
        if not can_touch and not self._referee.is_wall_touched:
            return
        clearance = np.full(self._n, math.inf)
        if can_touch:
            clearance[near] = self._world.clearance(self._dynamics.position_ned_m[near])
        self._referee.observe_walls(clearance, airborne)
        (pressed,) = np.nonzero((clearance < BODY_RADIUS_M) & airborne)
        if len(pressed):
            self._push_out(pressed, clearance[pressed])

    def _push_out(self, pressed: INDICES, clearance: FLOATS) -> None:
        body = self._dynamics
        position = body.position_ned_m[pressed]
        probes = (position[:, None, :] + PROBES_M).reshape(-1, 3)
        normal = self._world.clearance(probes).reshape(-1, 3) - clearance[:, None]
        length = np.sqrt(np.einsum("ij,ij->i", normal, normal))
        normal /= np.maximum(length, 1e-9)[:, None]
        body.position_ned_m[pressed] += normal * (BODY_RADIUS_M - clearance)[:, None]
        body.stand(pressed[(normal[:, 2] < TOP) & body.sinks(pressed)])
        body.stop_along(pressed, normal)

    def one_another(self, strangers: Strangers) -> None:
        """Count who touches whom; the airborne of them are held apart."""
        first, second = self._near_pairs
        if not len(first):
            self._referee.observe_pairs([], NO_GAPS_M, NOBODY)
            return
        body, n = self._dynamics, self._n
        position, grounded, names, here = body.position_ned_m, body.on_ground, second, self._counted
        if len(strangers.vehicles):
            position = np.concatenate((position, strangers.position_ned_m))
            grounded = np.concatenate((grounded, strangers.grounded))
            names = np.concatenate((np.arange(n), n + strangers.vehicles))[second]
            here = np.concatenate((here, strangers.counts_here))
        gap = position[second] - position[first]
        distance = np.sqrt(np.einsum("ij,ij->i", gap, gap))
        counts = ~(grounded[first] & grounded[second])
        pairs = list(zip(first.tolist(), names.tolist(), strict=True))
        self._referee.observe_pairs(pairs, distance, counts & here[second])
        for pair in np.nonzero((distance < 2.0 * BODY_RADIUS_M) & counts)[0].tolist():
            away = gap[pair : pair + 1] / max(distance[pair], 1e-9)
            depth = 2.0 * BODY_RADIUS_M - distance[pair]
            for index, direction in ((first[pair], -away), (second[pair], away)):
                if index < n and not grounded[index]:
                    body.position_ned_m[index] += 0.5 * depth * direction[0]
                    body.stop_along(np.array([index]), direction)


def _reach_m(velocity_ned_m_s: FLOATS) -> FLOATS:
    """Tell how far from a body (n, 3) something may be and still be touched soon, (n,)."""
    speed = np.sqrt(np.einsum("ij,ij->i", velocity_ned_m_s, velocity_ned_m_s))
    reach: FLOATS = REACH_S * speed + PARTED_M + 0.01
    return reach
