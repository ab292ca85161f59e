"""How old what an autopilot tells is: TIMESYNC, there and back.

https://mavlink.io/en/services/timesync.html
"""

from __future__ import annotations

import math

PERIOD_S = 0.5
MOST_WAITING = 8
VALID_S = 3.0
"""A round trip measured longer ago says nothing of now."""


class Timesync:
    """Requests on their way, and how long the last ones took to be answered."""

    def __init__(self) -> None:
        self._waiting: list[int] = []
        self._next_s = -math.inf
        self._round_trip_s = 0.0
        self._answered_s = -math.inf
        self._slowest: list[tuple[float, float]] = []
        """Answers of the last `VALID_S`, each slower than all after it: when, how long, s."""

    def request(self, now: float) -> int | None:
        """Give the stamp to ask with now, in nanoseconds; None while it is too early."""
        if now < self._next_s:
            return None
        self._next_s = now + PERIOD_S
        self._waiting.append(round(now * 1e9))
        del self._waiting[:-MOST_WAITING]
        return self._waiting[-1]

    def answered(self, stamp: int, now: float) -> None:
        """Take a stamp that came back; one that is not ours is somebody else's."""
        if stamp in self._waiting:
            self._waiting.remove(stamp)
            taken_s = now - stamp / 1e9
            self._round_trip_s, self._answered_s = taken_s, now
            while self._slowest and self._slowest[-1][1] <= taken_s:
                self._slowest.pop()
            self._slowest.append((now, taken_s))

    def round_trip_s(self, now: float) -> float:
        """Give the last measurement; 0 when none is fresh, as with autopilots that never answer."""
        return self._round_trip_s if now - self._answered_s <= VALID_S else 0.0

    def slowest_s(self, now: float) -> float:
        """Give the longest of the fresh ones: a link that is slow now and then is slow."""
        while self._slowest and now - self._slowest[0][0] > VALID_S:
            del self._slowest[0]
        return self._slowest[0][1] if self._slowest else 0.0
