"""How old what an autopilot tells is: TIMESYNC, there and back.

https://mavlink.io/en/services/timesync.html
"""

from __future__ import annotations

import math
from collections import deque

PERIOD_S = 0.5
MOST_WAITING = 8
VALID_S = 3.0
"""A round trip measured longer ago says nothing of now."""


class Timesync:
    """Requests on their way, and how long the last one took to be answered."""

    def __init__(self) -> None:
        self._waiting: deque[int] = deque(maxlen=MOST_WAITING)
        self._next_s = -math.inf
        self._round_trip_s = 0.0
        self._answered_s = -math.inf

    def request(self, now: float) -> int | None:
        """Give the stamp to ask with now, in nanoseconds; None while it is too early."""
        if now < self._next_s:
            return None
        self._next_s = now + PERIOD_S
        self._waiting.append(round(now * 1e9))
        return self._waiting[-1]

    def answered(self, stamp: int, now: float) -> None:
        """Take a stamp that came back; one that is not ours is somebody else's."""
        if stamp in self._waiting:
            self._waiting.remove(stamp)
            self._round_trip_s, self._answered_s = now - stamp / 1e9, now

    def round_trip_s(self, now: float) -> float:
        """Give the last measurement; 0 when none is fresh, as with autopilots that never answer."""
        return self._round_trip_s if now - self._answered_s <= VALID_S else 0.0
