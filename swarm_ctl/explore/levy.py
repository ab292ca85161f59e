"""The local best: steps of a Levy flight and how far each vehicle is along its own (Eqs. 1, 2)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from swarm_ctl.explore.chance import Bools, Chance, Floats, Rows


def levy_length(chance: Floats, shortest_m: float, longest_m: float, beta: float) -> Floats:
    """Turn numbers in [0, 1) into lengths with P(s > x) = (shortest / x)^beta, cut at longest.

    The tail of a Levy stable law with index beta; at beta = 1 the tail of the ratio of two normal
    variates that Mantegna's method draws. A draw beyond `longest_m` is that long exactly.
    """
    lengths: Floats = np.minimum(shortest_m * (1.0 - chance) ** (-1.0 / beta), longest_m)
    return lengths


def even_length(chance: Floats, longest_m: float) -> Floats:
    """Turn numbers in [0, 1) into lengths spread evenly up to `longest_m`: PSO without Levy."""
    return chance * longest_m


def direction(chance: Floats, steepest_sine: float) -> Floats:
    """Turn numbers in [0, 1), shape (m, d-1), into unit vectors (m, d) in local NED.

    The first number is the heading, even over the circle. The second, in 3-D, is the sine of the
    climb angle, even within +-`steepest_sine`: 1 spreads the directions evenly over the sphere.
    """
    heading = 2.0 * np.pi * chance[:, 0]
    unit = np.empty((len(chance), chance.shape[1] + 1), order="F")
    np.cos(heading, out=unit[:, 0])
    np.sin(heading, out=unit[:, 1])
    if chance.shape[1] == 2:
        sine = steepest_sine * (2.0 * chance[:, 1] - 1.0)
        unit[:, :2] *= np.sqrt(1.0 - sine * sine)[:, None]
        unit[:, 2] = -sine
    return unit


def travel(last_m: Floats, position_m: Floats, suspended: Bools) -> tuple[Floats, Floats]:
    """Measure the paths (n,) between (n, d), and as much of them as Eq. 6 has flown."""
    moved = position_m - last_m
    moved_m = np.sqrt(np.einsum("nd,nd->n", moved, moved))
    return moved_m, np.where(suspended, 0.0, moved_m)


def put(vector_m: Floats, rows: Rows, length_m: Floats, unit: Floats) -> None:
    """Set `rows` of (n, d) to vectors as long as (m,) along (m, d)."""
    vector_m[rows] = length_m[:, None] * unit


class Walk:
    """One step per vehicle, replaced when the vehicle "has traversed a distance equal" to it.

    `vector_m` (n, d) is P_lb - x in local NED. It stays constant during a step: the local best
    travels ahead of the vehicle until the path flown is as long as the step.
    """

    def __init__(
        self,
        chance: Chance,
        rows: Rows,
        dimensions: int,
        length_m: Callable[[Floats], Floats],
        steepest_sine: float,
        put: Callable[..., None] = put,
    ) -> None:
        self._chance = chance
        self._put = put
        self._draw_length = length_m
        self._steepest_sine = steepest_sine
        self._length_m = np.zeros(len(rows))
        self._travelled_m = np.zeros(len(rows))
        self.vector_m: Floats = np.zeros((len(rows), dimensions))
        self.is_new = np.ones(len(rows), dtype=np.bool_)
        """Whose step was drawn or turned since the caller last cleared this."""
        self._draw(rows)

    def advance(self, moved_m: Floats) -> None:
        """Count the path (n,) flown by Eq. 6 and draw new steps for those that are done."""
        self._travelled_m += moved_m
        done = (self._travelled_m >= self._length_m).nonzero()[0]
        if done.size:
            self._draw(done)

    def face(self, rows: Rows, heading_rad: Floats) -> None:
        """Turn the steps of `rows` to headings (m,); lengths and travelled paths are kept."""
        self.is_new[rows] = True
        north_m, east_m = self.vector_m[:, 0], self.vector_m[:, 1]
        level_m = np.hypot(north_m[rows], east_m[rows])
        north_m[rows] = level_m * np.cos(heading_rad)
        east_m[rows] = level_m * np.sin(heading_rad)

    def bounce(self, rows: Rows, down: Floats) -> None:
        """Reflect the climb of the steps of `rows` (3-D): `down` (m,) is -1 for up, 1 for down."""
        self.vector_m[rows, 2] = down * np.abs(self.vector_m[rows, 2])

    def leave(self, rows: Rows, blocked: Floats) -> None:
        """Draw new steps into the half space away from the directions `blocked` (m, d)."""
        self._draw(rows)
        into = (self.vector_m[rows] * blocked).sum(axis=1) > 0.0
        self.vector_m[rows[into]] *= -1.0

    def _draw(self, rows: Rows) -> None:
        chance = self._chance.uniform(rows, self.vector_m.shape[1])
        length_m = self._draw_length(chance[:, 0])
        self._length_m[rows] = length_m
        self._travelled_m[rows] = 0.0
        self.is_new[rows] = True
        self._put(self.vector_m, rows, length_m, direction(chance[:, 1:], self._steepest_sine))
