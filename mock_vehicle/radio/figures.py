"""What became of every frame on every link."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.radio.air import Received

INDICES = NDArray[np.intp]
COUNTS = NDArray[np.int32]
"""Of frames: a link has some a second."""
FATES = NDArray[np.int8]
FLOATS = NDArray[np.float64]


class Fate(enum.IntEnum):
    """What becomes of a frame on its way to one hearer, also of all frames at the moment."""

    HEARD = 0
    OFF_AIR = 1
    """One of the two has no power or no radio."""
    RANGE = 2
    """Too far away."""
    WALLS = 3
    """In range, but for the walls between them."""
    FADING = 4
    """In range, but for the shadowing of this link at this time."""
    PARTITION = 5
    """The swarm has fallen apart between them."""
    QUEUE = 6
    """The sender had too many waiting."""
    COLLISION = 7
    """Another was sending at the same time, near enough to be heard."""
    LOSS = 8
    """Lost by chance."""


OUT_OF_REACH = (Fate.OFF_AIR, Fate.RANGE)
SETTLE_FRAMES = 512
"""So many frames are counted together: numpy's calls cost more than what they do."""


@dataclass
class Totals:
    """Counts per directed link, (n, n) each: from the sender (row) to the hearer (column)."""

    sent: COUNTS
    """Frames of each sender, (n,)."""
    fates: COUNTS
    """Frames by what became of them, (fates, n, n)."""
    delivered: COUNTS
    duplicates: COUNTS
    """Second copies, not among the delivered."""
    delivered_bytes: NDArray[np.int64]
    delay_s: FLOATS
    """Sum of the delays of all delivered."""
    delay_max_s: FLOATS

    @classmethod
    def blank(cls, n: int) -> Totals:
        """Count nothing yet."""
        links, frames = (n, n), np.int32
        return cls(
            np.zeros(n, frames),
            np.zeros((len(Fate), *links), frames),
            np.zeros(links, frames),
            np.zeros(links, frames),
            np.zeros(links, np.int64),
            np.zeros(links),
            np.zeros(links),
        )


class Figures:
    """Counts what becomes of all frames."""

    def __init__(self, sysids: Sequence[int]) -> None:
        self._sysids = list(sysids)
        self._totals = Totals.blank(len(self._sysids))
        self._met: list[tuple[INDICES, FATES]] = []
        self._delivered: list[tuple[Received, float]] = []
        self._frames = 0

    def meet(self, senders: INDICES, fates: FATES) -> None:
        """Note what becomes of k frames at all n hearers: (k,) indices, (k, n) fates."""
        self._met.append((senders, fates))
        self._frames += len(senders)
        if self._frames >= SETTLE_FRAMES:
            self.totals()

    def deliver(self, received: Received, now: float) -> None:
        """Note what hearers have now."""
        self._delivered.append((received, now))

    def repeat(self, sender: int, hearer: int) -> None:
        """Note a second copy that a hearer has."""
        self._totals.duplicates[sender, hearer] += 1

    def totals(self) -> Totals:
        """Count all that was noted."""
        if self._met:
            self._settle_fates()
        if self._delivered:
            self._settle_deliveries()
        self._frames = 0
        return self._totals

    def _settle_fates(self) -> None:
        senders = np.concatenate([one for one, _ in self._met])
        fates = np.concatenate([one for _, one in self._met])
        n, totals = len(self._sysids), self._totals
        totals.sent += np.bincount(senders, minlength=n)
        at = (fates.astype(np.intp) * n + senders[:, None]) * n + np.arange(n)
        totals.fates += np.bincount(at.ravel(), minlength=totals.fates.size).reshape(-1, n, n)
        self._met = []

    def _settle_deliveries(self) -> None:
        batches, totals = self._delivered, self._totals
        self._delivered = []
        begins = np.cumsum([0] + [len(received.transmissions) for received, _ in batches])
        rows = np.concatenate(
            [r.rows + begin for (r, _), begin in zip(batches, begins, strict=False)]
        )
        about = [
            (one.sender, len(one.frame), now - one.sent_s)
            for received, now in batches
            for one in received.transmissions
        ]
        senders, sizes, delays_s = np.array(about).T[:, rows]
        n = len(self._sysids)
        link = senders.astype(np.intp) * n + np.concatenate([r.hearers for r, _ in batches])
        totals.delivered += _sums(link, None, n)
        totals.delivered_bytes += _sums(link, sizes, n).astype(np.int64)
        totals.delay_s += _sums(link, delays_s, n)
        np.maximum.at(totals.delay_max_s.reshape(-1), link, delays_s)

    def report(self) -> dict[str, Any]:
        """Collect the figures of every link that was ever in reach, in JSON values."""
        totals = self.totals()
        within = totals.fates.sum(axis=0) > totals.fates[list(OUT_OF_REACH)].sum(axis=0)
        rows, columns = np.nonzero(within)
        return {
            "vehicles": [
                {"sysid": sysid, "sent": sent}
                for sysid, sent in zip(self._sysids, totals.sent.tolist(), strict=True)
            ],
            "links": [
                {"from": self._sysids[sender], "to": self._sysids[hearer]}
                | _link(totals, sender, hearer)
                for sender, hearer in zip(rows.tolist(), columns.tolist(), strict=True)
            ],
        }


def _sums(link: INDICES, values: FLOATS | None, n: int) -> NDArray[Any]:
    """Add up values, or ones, by link (sender * n + hearer); (n, n)."""
    sums: NDArray[Any] = np.bincount(link, values, n * n).reshape(n, n)
    return sums


def _link(totals: Totals, sender: int, hearer: int) -> dict[str, Any]:
    fates = totals.fates[:, sender, hearer].tolist()
    delivered = int(totals.delivered[sender, hearer])
    return {
        "sent": sum(fates),
        "delivered": delivered,
        "lost": {fate.name.lower(): fates[fate] for fate in Fate if fate and fates[fate]},
        "duplicates": int(totals.duplicates[sender, hearer]),
        "bytes": int(totals.delivered_bytes[sender, hearer]),
        "delay_mean_s": _rounded(totals.delay_s[sender, hearer] / max(delivered, 1)),
        "delay_max_s": _rounded(totals.delay_max_s[sender, hearer]),
    }


def _rounded(seconds: float) -> float:
    return round(float(seconds), 6)
