"""The global best: a pull away from the peers of the own cluster (Eqs. 3 to 5)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from swarm_ctl.explore.chance import Bools, Floats, Rows

Hear = Callable[[Floats, float, float], tuple[Rows, Floats, Floats]]
NEAREST_M = 0.1
"""Peers closer than this push as if they were this far away, which bounds 1/d."""
FEW = 7
"""Up to so many peers numpy adds up one after the other, as `repel` does."""


def repulsion(
    peers_m: Floats, vertical: float = 1.0, longest_m: float | None = None
) -> tuple[Floats, Bools]:
    """Give P_gb - x (n, d) in local NED, and who hears anybody (n,); zero for those who do not.

    `peers_m` (n, k, d) holds the offsets peer minus own of the other members of the cluster,
    padded with NaN. The length is D = sum of 1/d (Eq. 3), at most `longest_m`. The direction is
    away from the centroid of the members in 2-D, and in 3-D along the sum of -offset / d^2, whose
    down component counts `vertical` times. Peers all around that balance give no direction: zero.
    """
    vector_m = np.zeros((len(peers_m), peers_m.shape[2]))
    rows, inverse, away = hear(peers_m, NEAREST_M, vertical)
    vector_m[rows] = _push(inverse, away, longest_m)
    hears = np.zeros(len(peers_m), dtype=np.bool_)
    hears[rows] = True
    return vector_m, hears


def repel(
    peers_m: Sequence[Sequence[float]], vertical: float, longest_m: float | None
) -> list[float]:
    """Give what `repulsion` gives for one vehicle and one peer at least; sooner for FEW."""
    if len(peers_m) > FEW:
        vector: list[float] = repulsion(np.array([peers_m]), vertical, longest_m)[0][0].tolist()
        return vector
    d, length_m = len(peers_m[0]), 0.0
    away = [0.0, 0.0, 0.0]
    for offset in peers_m:
        x, y, z = offset if d == 3 else (*offset, 0.0)
        if math.isnan(x):
            continue
        inverse = 1.0 / max(math.sqrt(x * x + z * z + y * y), NEAREST_M)  # the order of einsum
        weight = inverse * inverse if d == 3 else 1.0
        length_m += inverse
        away[0] += x * weight
        away[1] += y * weight
        away[2] += z * weight
    x, y, z = -away[0], -away[1], -away[2] * vertical
    if longest_m is not None:
        length_m = min(length_m, longest_m)
    scale = length_m / max(math.sqrt(x * x + z * z + y * y), 1e-9)
    return [x * scale, y * scale, z * scale][:d]


def hear(peers_m: Floats, nearest_m: float, vertical: float) -> tuple[Rows, Floats, Floats]:
    """Find who of (n, k, d) hears anybody (m,), the 1/d of each (m, k), and the way off (m, d)."""
    present = ~np.isnan(peers_m[:, :, 0])
    rows = np.flatnonzero(present.any(axis=1))
    present = present[rows]
    offset_m = np.where(present[:, :, None], peers_m[rows], 0.0)
    inverse = present / np.maximum(np.sqrt(np.einsum("nkd,nkd->nk", offset_m, offset_m)), nearest_m)
    if peers_m.shape[2] == 3:
        offset_m *= (inverse * inverse)[:, :, None]
    away = -np.einsum("nkd->nd", offset_m)
    if peers_m.shape[2] == 3:
        away[:, 2] *= vertical
    return rows, inverse, away


def _push(inverse: Floats, away: Floats, longest_m: float | None) -> Floats:
    length_m = inverse.sum(axis=1)
    if longest_m is not None:
        length_m = np.minimum(length_m, longest_m)
    size = np.sqrt(np.einsum("nd,nd->n", away, away))
    away *= (length_m / np.maximum(size, 1e-9))[:, None]
    return away


class Repulsion:
    """The repulsion of each vehicle, "updated when a robot approaches other robots"."""

    def __init__(
        self,
        vehicles: int,
        dimensions: int,
        *,
        kept: bool,
        vertical: float,
        longest_m: float | None,
        hear: Hear = hear,
    ) -> None:
        self._kept = kept
        self._vertical = vertical
        self._longest_m = longest_m
        self._hear = hear
        self.vector_m: Floats = np.zeros((vehicles, dimensions))

    def update(self, peers_m: Floats) -> None:
        """Take the peers (n, k, d) heard now; who hears nobody keeps the last vector, or none."""
        if not self._kept:
            self.vector_m[:] = 0.0
        if peers_m.shape[1] == 0:
            return
        if len(peers_m) == 1 and peers_m.shape[1] <= FEW:
            heard = [offset for offset in peers_m[0].tolist() if not math.isnan(offset[0])]
            if heard:
                self.vector_m[0] = repel(heard, self._vertical, self._longest_m)
            return
        rows, inverse, away = self._hear(peers_m, NEAREST_M, self._vertical)
        if rows.size:
            self.vector_m[rows] = _push(inverse, away, self._longest_m)

    def release(self, rows: Rows, blocked: Floats) -> None:
        """Forget the vectors of `rows` that point along the directions `blocked` (m, d)."""
        into = (self.vector_m[rows] * blocked).sum(axis=1) > 0.0
        self.vector_m[rows[into]] = 0.0
