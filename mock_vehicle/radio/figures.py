"""What became of every frame on every link."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.radio.air import Received

INDICES = NDArray[np.intp]


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


class Figures:
    """Counts per directed link, (n, n) each: from the sender (row) to the hearer (column)."""

    def __init__(self, sysids: Sequence[int]) -> None:
        self._sysids = list(sysids)
        n = len(self._sysids)
        self._everyone = np.arange(n)
        self.sent = np.zeros(n, dtype=np.int64)
        """Frames of each sender, (n,)."""
        self.fates = np.zeros((len(Fate), n, n), dtype=np.int64)
        """Frames by what became of them."""
        self.delivered = np.zeros((n, n), dtype=np.int64)
        self.duplicates = np.zeros((n, n), dtype=np.int64)
        self.delivered_bytes = np.zeros((n, n), dtype=np.int64)
        self.delay_s = np.zeros((n, n))
        """Sum of all delays; those of duplicates do not count."""
        self.delay_max_s = np.zeros((n, n))

    def meet(self, senders: INDICES, fates: NDArray[np.int8]) -> None:
        """Count what becomes of k frames at all n hearers: (k,) indices, (k, n) fates."""
        np.add.at(self.sent, senders, 1)
        np.add.at(self.fates, (fates, senders[:, None], self._everyone), 1)

    def deliver(self, received: Received, now: float) -> None:
        """Count what hearers have now."""
        every = received.transmissions
        if not every:
            return
        rows = received.rows
        link = np.array([one.sender for one in every])[rows], received.hearers
        delay_s = now - np.array([one.sent_s for one in every])[rows]
        np.add.at(self.delivered, link, 1)
        np.add.at(self.delivered_bytes, link, np.array([len(one.frame) for one in every])[rows])
        np.add.at(self.delay_s, link, delay_s)
        np.maximum.at(self.delay_max_s, link, delay_s)

    def report(self) -> dict[str, Any]:
        """Collect the figures of every link that was ever in reach, in JSON values."""
        within = self.fates.sum(axis=0) > self.fates[list(OUT_OF_REACH)].sum(axis=0)
        rows, columns = np.nonzero(within)
        return {
            "vehicles": [
                {"sysid": sysid, "sent": sent}
                for sysid, sent in zip(self._sysids, self.sent.tolist(), strict=True)
            ],
            "links": [
                self._link(*link) for link in zip(rows.tolist(), columns.tolist(), strict=True)
            ],
        }

    def _link(self, sender: int, hearer: int) -> dict[str, Any]:
        fates = self.fates[:, sender, hearer].tolist()
        delivered = int(self.delivered[sender, hearer])
        return {
            "from": self._sysids[sender],
            "to": self._sysids[hearer],
            "sent": sum(fates),
            "delivered": delivered,
            "lost": {fate.name.lower(): fates[fate] for fate in Fate if fate and fates[fate]},
            "duplicates": int(self.duplicates[sender, hearer]),
            "bytes": int(self.delivered_bytes[sender, hearer]),
            "delay_mean_s": _rounded(self.delay_s[sender, hearer] / max(delivered, 1)),
            "delay_max_s": _rounded(self.delay_max_s[sender, hearer]),
        }


def _rounded(seconds: float) -> float:
    return round(float(seconds), 6)
