"""Uniform numbers for a batch of vehicles, each from its own seeded generator."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Seed = int | Sequence[int] | np.random.SeedSequence

BLOCK = 256
_AHEAD: Rows = np.arange(BLOCK, dtype=np.intp)


def short(cursor: Rows, rows: Rows, most: int) -> Rows:
    """Find the `rows` that have drawn more than `most` numbers of their blocks."""
    return rows[cursor[rows] > most]


def deal(numbers: Floats, cursor: Rows, rows: Rows, count: int) -> Floats:
    """Take the next `count` of the `numbers` (n, BLOCK) of each of `rows`, (len(rows), count)."""
    at = cursor[rows]
    cursor[rows] = at + count
    return numbers.reshape(-1).take((rows * BLOCK + at)[:, None] + _AHEAD[:count])


class Chance:
    """Deal numbers in [0, 1) row by row; what a row gets depends on its seed and its draws only.

    Numbers are made in blocks, one generator per row, so that a draw for thousands of rows is one
    gather. A row that has too few left for a draw drops them and starts a new block.
    """

    def __init__(
        self,
        seeds: Sequence[Seed],
        short: Callable[[Rows, Rows, int], Rows] = short,
        deal: Callable[[Floats, Rows, Rows, int], Floats] = deal,
    ) -> None:
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        self._numbers = np.empty((len(seeds), BLOCK))
        self._cursor = np.full(len(seeds), BLOCK, dtype=np.intp)
        self._short, self._deal = short, deal

    def uniform(self, rows: Rows, count: int) -> Floats:
        """Draw `count` numbers for each of `rows` (no row twice): shape (len(rows), count)."""
        if not 0 < count <= BLOCK:
            raise ValueError(f"a draw takes 1 to {BLOCK} numbers, not {count}")
        if len(rows) == 1:
            return np.array([self.draw(int(rows[0]), count)])
        for row in self._short(self._cursor, rows, BLOCK - count).tolist():
            self._generators[row].random(out=self._numbers[row])
            self._cursor[row] = 0
        return self._deal(self._numbers, self._cursor, rows, count)

    def draw(self, row: int, count: int) -> list[float]:
        """Draw for one row: quicker than arrays of one."""
        at = int(self._cursor[row])
        if at > BLOCK - count:
            self._generators[row].random(out=self._numbers[row])
            at = 0
        self._cursor[row] = at + count
        drawn: list[float] = self._numbers[row, at : at + count].tolist()
        return drawn
