"""What flows from one autopilot, and what must be asked for, or asked for again."""

from __future__ import annotations

import math
from collections.abc import Mapping

from swarm_ctl import wire
from swarm_ctl.autopilot.command import SET_MESSAGE_INTERVAL, Command, command

STALE_S, STALE_PERIODS = 2.0, 3.0
"""A stream has stopped when it was not heard for so long, or for so many of its periods."""
REFUSED_S = 30.0
"""How long a message that was refused is not asked for; ArduPilot complains of each request."""
AGAIN_S = 2.0
"""Between two requests; autopilots answer within milliseconds, slow links take their time."""


class Streams:
    """The messages that one controller wants from its autopilot."""

    def __init__(self) -> None:
        self._rates_hz: dict[str, float] = {}
        self._patience_s: dict[int, float] = {}
        """By id: when a message that has not come is missing."""
        self._flowing_until_s = -math.inf
        """Until then nothing that flows now can be missing."""
        self.heard_s: dict[int, float] = {}
        """When a message was heard last, by its id; who hears one writes it here."""
        self._asked: set[str] = set()
        self._refused_s: dict[str, float] = {}
        self._next_s = -math.inf

    def want(self, rates_hz: Mapping[str, float]) -> None:
        """Add messages by name."""
        self._rates_hz |= rates_hz
        self._patience_s = {
            wire.message(name).id: max(STALE_S, STALE_PERIODS / rate_hz)
            for name, rate_hz in self._rates_hz.items()
        }
        self._flowing_until_s = -math.inf

    def refused(self, wanted: Command, now: float) -> None:
        """Note that a request was refused: the autopilot does not know the message, or not yet."""
        self._refused_s[wire.message(int(wanted.parameters[0])).name] = now

    def missing(self, now: float) -> list[str]:
        """Name the wanted messages that do not flow, or no longer."""
        if now < self._flowing_until_s:
            return []
        last_s = [self.heard_s.get(number, -math.inf) for number in self._patience_s]
        waits = list(zip(self._rates_hz, last_s, self._patience_s.values(), strict=True))
        self._flowing_until_s = min((last + wait for _, last, wait in waits), default=-math.inf)
        return [name for name, last, wait in waits if now - last > wait]

    def due(self, now: float, *, starts: bool) -> list[Command]:
        """Give the requests to make now: for all that is missing, in flight as well.

        At the start each is asked for once though it may flow already, at another rate.
        """
        if now < self._next_s or (now < self._flowing_until_s and not starts):
            return []
        fresh = [name for name in self._rates_hz if name not in self._asked] if starts else ()
        asks = dict.fromkeys([*fresh, *self.missing(now)])
        names = [name for name in asks if self._may_ask(name, now)]
        if names:
            self._next_s = now + AGAIN_S
        self._asked.update(names)
        return [self._request(name) for name in names]

    def _may_ask(self, name: str, now: float) -> bool:
        return now - self._refused_s.get(name, -math.inf) > REFUSED_S

    def _request(self, name: str) -> Command:
        interval_us = 1e6 / self._rates_hz[name]
        return command(SET_MESSAGE_INTERVAL, float(wire.message(name).id), interval_us)
