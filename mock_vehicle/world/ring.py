"""Level rays all around, evenly spaced: in their plane a column is a disc and a wall a rectangle.

A shape is met only by the few rays that point at it, which its angle of view tells.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_NO_SLOPE = 1e-18
"""In place of 0, by which nothing can be divided."""
_MARGIN_RAYS = 1e-6
"""How far beside a shape's angle of view, in rays, rays are still tried."""
_CORNERS = np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0]])[..., None]
"""Corners of a rectangle in halves of its edges, (2, 4, 1)."""


class Ring:
    """`count` level rays for each of n origins, and how far each ray has come."""

    def __init__(self, origins_m: Floats, first_rad: Floats, count: int) -> None:
        """Point them: origins are (n, 3) NED, m; the first azimuth (n,), the rest clockwise."""
        self.origins_m = origins_m
        self.count = count
        self._spacing_rad = 2.0 * math.pi / count
        self._first_rad = first_rad
        azimuth = first_rad[:, None] + np.arange(count) * self._spacing_rad
        self.north, self.east = np.cos(azimuth), np.sin(azimuth)
        for slope in (self.north, self.east):
            slope[slope == 0.0] = _NO_SLOPE
        self.ranges_m: Floats = np.full((len(origins_m), count), np.inf)
        """(n, count) distances to what was met so far; inf is nothing."""

    def directions(self) -> Floats:
        """Give all rays as (n * count, 3) unit vectors, NED."""
        level = np.zeros(self.north.size)
        return np.column_stack((self.north.ravel(), self.east.ravel(), level))

    def meet(self, ranges_m: Floats) -> None:
        """Stop the rays at (n, count) distances."""
        np.minimum(self.ranges_m, ranges_m, out=self.ranges_m)

    def meet_room(self, low_ne_m: Floats, high_ne_m: Floats) -> None:
        """Stop the rays at the four walls around everything; 0 for who is beyond them."""
        for axis, slope in enumerate((self.north, self.east)):
            here = self.origins_m[:, axis, None]
            inverse = 1.0 / slope
            reach = (high_ne_m[axis] - here) * inverse
            inverse *= low_ne_m[axis] - here
            self.meet(np.maximum(reach, inverse, out=reach))
        np.maximum(self.ranges_m, 0.0, out=self.ranges_m)

    def meet_discs(self, owner: Indices, toward_ne_m: Floats, radius_m: Floats) -> None:
        """Stop the rays of origins (q,) at discs (q, 2) away from them; 0 inside."""
        north_m, east_m = toward_ne_m.T
        away_m = np.maximum(np.sqrt(north_m * north_m + east_m * east_m), 1e-9)
        half_rad = np.where(
            away_m > radius_m, np.arcsin(np.minimum(radius_m / away_m, 1.0)), math.pi
        )
        azimuth = np.arctan2(east_m, north_m)
        which, ray = self._rays(owner, azimuth - half_rad, azimuth + half_rad)
        north, east = self.north.take(ray), self.east.take(ray)
        north_m, east_m = north_m[which], east_m[which]
        along, aside = north * north_m + east * east_m, north * east_m - east * north_m
        square = radius_m[which] ** 2 - aside * aside
        root = np.sqrt(np.maximum(square, 0.0))
        missed = (square <= 0.0) | (along + root <= 0.0)
        self._stop(ray, along - root, missed)

    def meet_spheres(
        self,
        upright_m: Floats,
        owner: Indices,
        other: Indices,
        radius_m: float,
        bodies_m: Floats | None = None,
    ) -> None:
        """Stop the rays of origins (q,), and their beams up and down (n, 2), at others.

        Those are other origins, or rows of `bodies_m`, of which the origins come first.
        """
        bodies_m = self.origins_m if bodies_m is None else bodies_m
        toward_m = bodies_m[other] - self.origins_m[owner]
        square = radius_m**2 - toward_m[:, 2] ** 2
        (beside,) = np.nonzero(square > 0.0)
        self.meet_discs(owner[beside], toward_m[beside, :2], np.sqrt(square[beside]))
        square = radius_m**2 - np.einsum("pc,pc->p", toward_m[:, :2], toward_m[:, :2])
        for pair in np.nonzero(square > 0.0)[0].tolist():
            down_m = toward_m[pair, 2]
            row, column = owner[pair], int(down_m > 0.0)
            reach = max(abs(down_m) - math.sqrt(square[pair]), 0.0)
            upright_m[row, column] = min(upright_m[row, column], reach)

    def meet_boxes(
        self, owner: Indices, place_m: Floats, half_m: Floats, axes_ne: tuple[Floats, Floats]
    ) -> None:
        """Stop the rays of origins (q,) at turned rectangles; 0 inside.

        `place_m` is where the origin is along the rectangle's own x and y axes, (2, q), `half_m`
        are half its edges, (2, q), and `axes_ne` its axes, (2, q) each.
        """
        (x, y), axis_x = place_m, axes_ne[0]
        corner_x, corner_y = _CORNERS * half_m[:, None] - place_m[:, None]
        # angles from the way to the middle, where none is near the jump at half a turn
        turn = np.arctan2(corner_y * x - corner_x * y, -corner_x * x - corner_y * y)
        inside = (np.abs(place_m) < half_m).all(axis=0)
        # x and y run counter-clockwise, azimuths clockwise
        middle = np.arctan2(axis_x[1], axis_x[0]) + np.arctan2(y, -x)
        low = np.where(inside, -math.pi, turn.min(axis=0))
        high = np.where(inside, math.pi, turn.max(axis=0))
        which, ray = self._rays(owner, middle + low, middle + high)
        north, east = self.north.take(ray), self.east.take(ray)
        near, far = np.full(len(ray), -np.inf), np.full(len(ray), np.inf)
        for offset, half, (to_north, to_east) in zip(place_m, half_m, axes_ne, strict=True):
            slope = north * to_north[which] + east * to_east[which]
            slope[slope == 0.0] = _NO_SLOPE
            inverse = 1.0 / slope
            crossing = offset[which] * -inverse
            reach = np.abs(inverse, out=inverse) * half[which]
            np.maximum(near, crossing - reach, out=near)
            np.minimum(far, crossing + reach, out=far)
        self._stop(ray, near, (near >= far) | (far <= 0.0))

    def _rays(self, owner: Indices, low_rad: Floats, high_rad: Floats) -> tuple[Indices, Indices]:
        """Name the rays between two azimuths of each pair: (r,) which pair, (r,) which ray."""
        start = self._first_rad[owner]
        first = np.ceil((low_rad - start) / self._spacing_rad - _MARGIN_RAYS).astype(np.intp)
        last = np.floor((high_rad - start) / self._spacing_rad + _MARGIN_RAYS).astype(np.intp)
        counts = np.clip(last - first + 1, 0, self.count)
        ends = counts.cumsum()
        which = np.repeat(np.arange(len(owner)), counts)
        number = np.arange(len(which)) + (first - (ends - counts))[which]
        number %= self.count
        number += owner[which] * self.count
        return which, number

    def _stop(self, ray: Indices, near_m: Floats, missed: NDArray[np.bool_]) -> None:
        """Stop rays at the distances that they do not miss."""
        np.maximum(near_m, 0.0, out=near_m)
        near_m[missed] = np.inf
        np.minimum.at(self.ranges_m.reshape(-1), ray, near_m)
