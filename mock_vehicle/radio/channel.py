"""One frequency that all share: carrier sense, back-off, collisions, queues."""

from __future__ import annotations

import heapq
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.radio.air import Transmission
from mock_vehicle.world.radio import ChannelSpec

BOOLS = NDArray[np.bool_]
HAND_OVER_S = 0.02
"""Frames that companions send in the same step of mission time come this far apart in truth."""

SOON_S = 1e-9
"""Times are sums of floats."""


class Burst(NamedTuple):
    """A radio that sends."""

    start_s: float
    end_s: float
    sender: int


class Channel:
    """Carrier sense multiple access of a fleet.

    As broadcasts of IEEE 802.11: no acknowledgement, no repetition, a window that never grows. Who
    has a frame listens. Silence: it sends. Else it waits for the end of what it hears, and
    then for a random number of slots, and listens again. Hearers lose what another whom they hear,
    or they themselves, send at the same time: somebody who started in the same slot, or whom the
    sender does not hear (a hidden node). A weaker signal is not drowned: there is no capture.
    """

    def __init__(self, spec: ChannelSpec, n: int, rng: np.random.Generator) -> None:
        self._spec = spec
        self._rng = rng
        self._queues: list[deque[tuple[bytes, float]]] = [deque() for _ in range(n)]
        """Frames that wait, with the times of their handing over; the first may be on the air."""
        self._events: list[tuple[float, bool, int]] = []
        """A heap of (time, whether sending begins, sender); ends come before beginnings."""
        self._bursts: list[Burst] = []
        """What is on the air, and what has ended since the oldest of that began."""

    def send(self, sender: int, frame: bytes, now: float) -> bool:
        """Let a frame wait for its turn; tell whether there was room."""
        queue = self._queues[sender]
        if len(queue) >= self._spec.queue_frames:
            return False
        queue.append((frame, now))
        if len(queue) == 1:
            self._try(sender, now + HAND_OVER_S * self._rng.random())
        return True

    def run(self, now: float, linked: BOOLS) -> list[Transmission]:
        """Let time pass until `now`; give what has been sent, `spoilt` for some hearers."""
        sent: list[Transmission] = []
        while self._events and self._events[0][0] <= now:
            time, begins, sender = heapq.heappop(self._events)
            if begins:
                self._begin(sender, time, linked)
            else:
                sent.append(self._end(sender, time, linked))
        return sent

    def _try(self, sender: int, time: float) -> None:
        heapq.heappush(self._events, (time, True, sender))

    def _back_off(self, sender: int, since_s: float) -> None:
        slots = int(self._rng.integers(self._spec.window_slots))
        self._try(sender, since_s + slots * self._spec.slot_s)

    def _begin(self, sender: int, now: float, linked: BOOLS) -> None:
        heard_s = now - self._spec.slot_s + SOON_S
        busy_s = max(
            (
                burst.end_s
                for burst in self._bursts
                if burst.start_s <= heard_s and linked[sender, burst.sender]
            ),
            default=0.0,
        )
        if busy_s > now:
            self._back_off(sender, busy_s)
            return
        frame, _ = self._queues[sender][0]
        end_s = now + 8.0 * len(frame) / self._spec.bit_rate_bit_s
        self._bursts.append(Burst(now, end_s, sender))
        heapq.heappush(self._events, (end_s, False, sender))

    def _end(self, sender: int, now: float, linked: BOOLS) -> Transmission:
        frame, sent_s = self._queues[sender].popleft()
        own = next(b for b in reversed(self._bursts) if b.sender == sender)
        others = [b.sender for b in self._bursts if b.end_s > own.start_s and b is not own]
        spoilt: BOOLS = np.any(linked[others], axis=0)
        spoilt[others] = True
        if self._queues[sender]:
            self._back_off(sender, now)
        going_on = [b.start_s for b in self._bursts if b.end_s >= now and b is not own]
        oldest_s = min(going_on, default=now)
        self._bursts = [b for b in self._bursts if b.end_s > oldest_s]
        return Transmission(now, sender, frame, sent_s, tuple(np.nonzero(spoilt)[0].tolist()))
