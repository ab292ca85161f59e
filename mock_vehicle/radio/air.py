"""Frames in the air, and what is received of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

INDICES = NDArray[np.intp]


class Transmission(NamedTuple):
    """A frame in the air."""

    due_s: float
    """When it arrives, mission time."""
    sender: int
    """Index of who sent it."""
    frame: bytes
    sent_s: float
    """When it was handed over to the radio."""
    spoilt: tuple[int, ...] = ()
    """Indices of those who could not make it out, if they were in reach."""


class Received(NamedTuple):
    """Which of some transmissions are received, by whom: one row per reception."""

    transmissions: list[Transmission]
    rows: INDICES
    """Indices of transmissions, (k,)."""
    hearers: INDICES
    """Indices of vehicles, (k,)."""

    def pairs(self) -> list[tuple[int, Transmission]]:
        """List them as (hearer, transmission)."""
        rows = zip(self.hearers.tolist(), self.rows.tolist(), strict=True)
        return [(hearer, self.transmissions[row]) for hearer, row in rows]


NOTHING = Received([], np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp))
