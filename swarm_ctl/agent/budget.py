"""How much a vehicle may tell its peers within a second: safety first, trails with what is left."""

from __future__ import annotations

LIMIT_BYTES = 2000
"""In any second, whatever carries it."""
HEADERS_BYTES = 7 * 71
"""What MQTT, TCP and IP add, to five datagrams with a beacon and two without; UDP adds less."""
SPARE_BYTES = 100
"""Left to what comes at any time and never waits: a beacon that grew, a victim just found."""
_SECOND_S = 1.0 - 1e-6  # ticks are a tenth of a second apart, or nearly


class Budget:
    """What was told within the last second, in frames.

    Heartbeats, beacons and victims are always told: 0.6 to 0.9 kB/s with ten neighbours, signed.
    Trails and their summaries get what is left, and else wait for the next beacon.
    """

    def __init__(self) -> None:
        self._spent: list[tuple[float, int]] = []
        self._bytes = 0

    def spend(self, frames: list[bytes], now: float) -> None:
        """Count frames that are told now."""
        if frames:
            self._forget(now)
            count = sum(map(len, frames))
            self._spent.append((now, count))
            self._bytes += count

    def room(self, now: float) -> int:
        """Give the bytes that may be told besides now."""
        self._forget(now)
        return LIMIT_BYTES - HEADERS_BYTES - SPARE_BYTES - self._bytes

    def _forget(self, now: float) -> None:
        """Drop what was told longer ago, also while nobody asks for room."""
        while self._spent and now - self._spent[0][0] >= _SECOND_S:
            self._bytes -= self._spent.pop(0)[1]
