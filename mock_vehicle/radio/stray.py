"""Frames that come late, twice or out of order, to each hearer in its own way."""

from __future__ import annotations

import heapq
from typing import NamedTuple

import numpy as np

from mock_vehicle.radio.air import Received, Transmission
from mock_vehicle.world.radio import RadioSpec


class Parcel(NamedTuple):
    """A received frame before its hearer has it."""

    due_s: float
    order: int
    """Of parcels that are due at the same time, the lower comes first."""
    hearer: int
    transmission: Transmission
    is_copy: bool


class Stray:
    """What is held back of all that is received."""

    def __init__(self, spec: RadioSpec, rng: np.random.Generator) -> None:
        self._spec = spec
        self._rng = rng
        self._held: list[Parcel] = []
        """A heap."""
        self._parcels = 0
        self.is_needed = bool(spec.jitter_s or spec.duplicate_fraction or spec.reorder_fraction)
        """Whether anything is ever held back or doubled."""

    def hold(self, received: Received) -> None:
        """Hold back as much and as long as chance has it, and double some."""
        for hearer, transmission in received.pairs():
            self._hold(hearer, transmission, is_copy=False)
            if self._rng.random() < self._spec.duplicate_fraction:
                self._hold(hearer, transmission, is_copy=True)

    def _hold(self, hearer: int, transmission: Transmission, *, is_copy: bool) -> None:
        due_s = transmission.due_s + self._spec.jitter_s * self._rng.random()
        if self._rng.random() < self._spec.reorder_fraction:
            due_s += self._spec.reorder_hold_s
        self._parcels += 1
        heapq.heappush(self._held, Parcel(due_s, self._parcels, hearer, transmission, is_copy))

    def take(self, now: float) -> list[Parcel]:
        """Take what arrives by `now`, in the order of arrival."""
        taken = []
        while self._held and self._held[0].due_s <= now:
            taken.append(heapq.heappop(self._held))
        return taken
