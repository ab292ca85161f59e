"""How much of the battery the way home will take, from what the flight has taken so far."""

from __future__ import annotations

import math

SETTLE_S = 30.0
"""After take-off the voltage sags and gauges jump: what they say then tells nothing."""
WINDOW_S = 60.0
"""How far back the drain is measured; gauges tell whole percents."""
SAMPLE_S = 5.0
DETOUR = 1.5
"""A way home takes longer than its length at full speed: corners, peers, gusts."""
LANDING_S = 20.0


class Endurance:
    """The drain of one battery over the last minute, and what it makes of a way home."""

    def __init__(self) -> None:
        self._flying_s: float | None = None
        self._samples: list[tuple[float, float]] = []
        self._next_s = -math.inf
        self.way_home_s = 0.0
        """Time that the way home would take, landing included."""

    def is_due(self, now: float) -> bool:
        """Whether it is time for another sample."""
        return now >= self._next_s

    def sample(self, battery: float, way_home_m: float, speed_m_s: float, now: float) -> None:
        """Take the charge (0 to 1) and the length of the way home, in metres, while it flies."""
        self._next_s = now + SAMPLE_S
        if self._flying_s is None:
            self._flying_s = now
        self.way_home_s = DETOUR * way_home_m / speed_m_s + LANDING_S
        if now - self._flying_s >= SETTLE_S:
            self._samples.append((now, battery))
        while self._samples and now - self._samples[0][0] > WINDOW_S:
            del self._samples[0]

    @property
    def needed(self) -> float:
        """Charge (0 to 1) that the way home will take; 0 until a minute's drain is known."""
        if not self._samples:
            return 0.0
        (since_s, full), (now, left) = self._samples[0], self._samples[-1]
        if now - since_s < WINDOW_S - SAMPLE_S:
            return 0.0
        return max(0.0, (full - left) / (now - since_s)) * self.way_home_s
