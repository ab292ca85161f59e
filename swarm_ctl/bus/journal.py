"""Events on their way to a broker that may be away: bounded, in order, kept until told."""

from __future__ import annotations

import asyncio
from collections import deque

from swarm_ctl.bus.messages import Event

MOST_EVENTS = 1000
"""Of one vehicle that are kept, here and at the broker; a mission takes some fifty."""


class EventJournal:
    """One vehicle's events; a broker that was away may have forgotten all, and is told again."""

    def __init__(self, most: int = MOST_EVENTS) -> None:
        """Keep the latest `most`."""
        self.lost = 0
        """Events that no broker has ever taken, and that had to make room."""
        self._most = most
        self._waiting: deque[Event] = deque()
        self._taken: deque[Event] = deque()
        self._again: deque[Event] = deque()
        self._retired: deque[int] = deque()
        self._stirred = asyncio.Event()

    @property
    def waiting(self) -> int:
        """How many no broker has taken yet."""
        return len(self._waiting)

    def add(self, event: Event) -> None:
        """Take an event; the oldest one makes room."""
        self._waiting.append(event)
        self._stirred.set()
        if len(self._waiting) + len(self._taken) <= self._most:
            return
        if self._taken:
            oldest = self._taken.popleft()
            self._retired.append(oldest.id)
            if self._again and self._again[0] is oldest:
                self._again.popleft()
        else:
            self._waiting.popleft()
            self.lost += 1

    def begin(self) -> None:
        """Tell all again: this is another broker, or one that may have forgotten."""
        self._again = deque(self._taken)
        self._stirred.set()

    def due(self) -> Event | None:
        """Give the event to tell next: the oldest that is news, then what is told again."""
        return next(iter(self._waiting or self._again), None)

    def taken(self, event: Event) -> None:
        """Note that the broker has taken an event that was due."""
        if self._again and self._again[0] is event:
            self._again.popleft()
        elif self._waiting and self._waiting[0] is event:
            self._taken.append(self._waiting.popleft())

    def retire(self) -> int | None:
        """Give the id of an event that the broker is to forget, once."""
        return self._retired.popleft() if self._retired else None

    async def stir(self) -> None:
        """Wait for something to be due."""
        self._stirred.clear()
        if self.due() is None:
            await self._stirred.wait()
