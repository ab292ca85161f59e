"""Uniform numbers for a batch of vehicles, each from its own seeded generator."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Seed = int | Sequence[int] | np.random.SeedSequence

BLOCK = 256


class Chance:
    """Deal numbers in [0, 1) row by row; what a row gets depends on its seed and its draws only.

    Numbers are made in blocks, one generator per row, so that a draw for thousands of rows is one
    gather. A row that has too few left for a draw drops them and starts a new block.
    """

    def __init__(self, seeds: Sequence[Seed]) -> None:
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        self._numbers = np.empty((len(seeds), BLOCK))
        self._flat = self._numbers.reshape(-1)
        self._cursor = np.full(len(seeds), BLOCK, dtype=np.intp)
        self._ahead = np.arange(BLOCK, dtype=np.intp)

    def uniform(self, rows: Rows, count: int) -> Floats:
        """Draw `count` numbers for each of `rows` (no row twice): shape (len(rows), count)."""
        if not 0 < count <= BLOCK:
            raise ValueError(f"a draw takes 1 to {BLOCK} numbers, not {count}")
        cursor = self._cursor[rows]
        short = cursor > BLOCK - count
        if short.any():
            self._refill(rows[short])
            cursor[short] = 0
        self._cursor[rows] = cursor + count
        return self._flat.take((rows * BLOCK + cursor)[:, None] + self._ahead[:count])

    def _refill(self, rows: Rows) -> None:
        for row in rows:
            self._generators[row].random(out=self._numbers[row])
