"""A fleet that tests look at: what arrived, and the truth, from any thread."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable
from typing import Any, NamedTuple

from mock_vehicle.faults import Fault
from mock_vehicle.fleet import Fleet
from mock_vehicle.testing.truth import Truth, look
from swarm_ctl import wire

KEPT = 100_000
"""Messages remembered per vehicle; older ones are forgotten."""


class Message(NamedTuple):
    """A MAVLink message that passed between the client and a vehicle."""

    time_s: float
    """Mission time."""
    name: str
    sysid: int
    """The sender's."""
    compid: int
    """The sender's."""
    values: Any
    """The message's fields, by name, as on the wire."""


class WatchedFleet(Fleet):
    """A fleet that notes what arrives, and that other threads may look at."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.now = 0.0
        """Mission time of the last step."""
        self.steps = 0
        """Steps so far."""
        self.stepped = threading.Condition()
        """Held while anything changes; notified after each step."""
        self._noted: list[deque[Message]] = [deque(maxlen=KEPT) for _ in range(self.n)]
        self._parsers = {place: wire.Parser(None) for place in self.places}

    def receive(self, index: int, data: bytes, now: float, link: int = 0) -> None:
        """Note the messages of a datagram, then take it."""
        with self.stepped:
            self._noted[index] += messages(self._parsers[index, link].feed(data), now)
            super().receive(index, data, now, link)

    def answers(self, index: int, link: int = 0) -> list[bytes]:
        """Take what is ready to leave."""
        with self.stepped:
            return super().answers(index, link)

    def step(self, now: float) -> list[tuple[int, bytes]]:
        """Advance, and wake who waits for it."""
        with self.stepped:
            self.now = now
            self.steps += 1
            leaving = super().step(now)
            self.stepped.notify_all()
        return leaving

    def received(self, index: int, name: str | None) -> list[Message]:
        """Give the messages that came, all or those of a name."""
        with self.stepped:
            return [m for m in self._noted[index] if name is None or m.name == name]

    def truth(self, index: int) -> Truth:
        """Look at one vehicle between two steps."""
        with self.stepped:
            return look(self, index, self.now)

    def strike(self, fault: Fault, now: float) -> None:
        """Let something go wrong at once."""
        with self.stepped:
            super().strike(fault, now)

    def heal(self, now: float, *, vehicle: int | None = None, kind: str | None = None) -> None:
        """Let it be right again."""
        with self.stepped:
            super().heal(now, vehicle=vehicle, kind=kind)


def messages(frames: Iterable[wire.Frame], now: float) -> list[Message]:
    """Name frames that came at a time."""
    return [
        Message(now, wire.message(frame.id).name, frame.sysid, frame.compid, frame.values)
        for frame in frames
    ]
