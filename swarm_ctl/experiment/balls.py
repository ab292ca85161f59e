"""Voxels within a sphere around each vehicle, as runs along the height; see `hot.py`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore.chance import Floats


def runs(
    place_m: Floats, origin_m: tuple[float, ...], cell: float, radius: float, size: tuple[int, ...]
) -> tuple[Floats, Floats, Floats]:
    """Give the row (m, k) of each run in spheres around (m, 3) places, its begin and its end.

    Row n * size[1] + e is the column of voxels at n north and e east; empty runs end before they
    begin, or there.
    """
    at = place_m - origin_m
    around = np.arange(math.ceil(2.0 * radius / cell) + 1)
    north, east = (np.ceil((at[:, axis, None] - radius) / cell - 0.5) + around for axis in (0, 1))
    north, east = north[:, :, None], east[:, None, :]
    beside_n = (north + 0.5) * cell - at[:, 0, None, None]
    beside_e = (east + 0.5) * cell - at[:, 1, None, None]
    left = radius * radius - (beside_n * beside_n + beside_e * beside_e)
    inside = (left >= 0.0) & (north >= 0) & (north < size[0]) & (east >= 0) & (east < size[1])
    reach = np.sqrt(np.maximum(left, 0.0))
    down = at[:, 2, None, None]
    begin = np.maximum(np.ceil((down - reach) / cell - 0.5), 0.0)
    end = np.minimum(np.floor((down + reach) / cell - 0.5) + 1.0, size[2])
    row = np.where(inside, north * size[1] + east, 0.0)
    flat = (len(place_m), -1)
    return row.reshape(flat), begin.reshape(flat), np.where(inside, end, 0.0).reshape(flat)


def mark(
    place_m: Floats,
    origin_m: tuple[float, float, float],
    cell: float,
    radius: float,
    size: tuple[int, int, int],
    bits: NDArray[np.uint64],
) -> None:
    """Do what `runs` does as a loop for numba, and set the bits (trials, rows, words) at once."""
    every = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
    for trial in range(place_m.shape[0]):
        for i in range(place_m.shape[1]):
            at_n = place_m[trial, i, 0] - origin_m[0]
            at_e = place_m[trial, i, 1] - origin_m[1]
            down = place_m[trial, i, 2] - origin_m[2]
            first_n = max(math.ceil((at_n - radius) / cell - 0.5), 0)
            first_e = max(math.ceil((at_e - radius) / cell - 0.5), 0)
            for north in range(first_n, size[0]):
                beside_n = (north + 0.5) * cell - at_n
                if beside_n > radius:
                    break
                for east in range(first_e, size[1]):
                    beside_e = (east + 0.5) * cell - at_e
                    if beside_e > radius:
                        break
                    left = radius * radius - (beside_n * beside_n + beside_e * beside_e)
                    if left < 0.0:
                        continue
                    reach = math.sqrt(left)
                    begin = max(math.ceil((down - reach) / cell - 0.5), 0)
                    end = min(math.floor((down + reach) / cell - 0.5) + 1, size[2])
                    if begin >= end:
                        continue
                    for word in range(begin >> 6, ((end - 1) >> 6) + 1):
                        low, high = max(begin - (word << 6), 0), min(end - (word << 6), 64)
                        run = (every >> np.uint64(64 - high + low)) << np.uint64(low)
                        bits[trial, north * size[1] + east, word] |= run
