"""One telemetry link of an autopilot: its own sequence numbers, streams and listeners."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING

from swarm_ctl import wire
from swarm_ctl.signing import Gatekeeper, Verdict

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

Encoder = Callable[["Autopilot", float], None]
"""Sends a message, or several of one kind, of an autopilot at a time."""

AUTOPILOT_COMPID = 1
OUTBOX_FRAMES = 4096
"""The oldest of more are lost, as on a real link: nobody may listen at all."""
EARLY_S = 0.005
"""A message due this soon is sent now: ticks are sums of floats."""


class _Stream:
    __slots__ = ("due_s", "encode", "interval_s", "period_s")

    def __init__(self, encode: Encoder, interval_s: float, due_s: float, source_s: float) -> None:
        self.encode = encode
        self.interval_s = interval_s
        """What was asked for."""
        self.period_s = max(interval_s, source_s)
        """What the source can give."""
        self.due_s = due_s


class Streams:
    """The messages that flow by themselves over one link, each at its interval."""

    def __init__(
        self,
        table: Mapping[int, Encoder],
        defaults_s: Mapping[int, float],
        sources_s: Mapping[int, float],
        phase: float = 0.0,
    ) -> None:
        """Let the defaults of a table flow; sources are the intervals that none can undercut.

        `phase`, 0 to 1, tells vehicles that were started together apart: a fleet that speaks all
        at once overflows the receive buffer of a client.
        """
        self._table = table
        self._defaults_s = defaults_s
        self._sources_s = sources_s
        self._phase = phase
        self._active: dict[int, _Stream] = {}
        for number, interval_s in defaults_s.items():
            self.start(number, interval_s, -math.inf)

    def interval_s(self, number: int) -> float | None:
        """Tell the interval of a message, None when it does not flow."""
        stream = self._active.get(number)
        return stream.interval_s if stream else None

    def start(self, number: int, interval_s: float, now: float) -> None:
        """Let a message of the table flow."""
        source_s = self._sources_s.get(number, 0.0)
        self._active[number] = _Stream(self._table[number], interval_s, now, source_s)

    def stop(self, number: int) -> None:
        """Let it flow no more."""
        self._active.pop(number, None)

    def restore(self, number: int, now: float) -> None:
        """Give a message its default interval back."""
        default_s = self._defaults_s.get(number)
        if default_s is None:
            self.stop(number)
        else:
            self.start(number, default_s, now)

    def run(self, autopilot: Autopilot, now: float) -> None:
        """Send what is due."""
        soon = now + EARLY_S
        for stream in self._active.values():
            if stream.due_s <= soon:
                stream.encode(autopilot, now)
                stream.due_s += stream.period_s
                if stream.due_s <= now:
                    stream.due_s = now + stream.period_s * (1.0 - self._phase)


REFUSALS: Mapping[Verdict, str] = {
    Verdict.UNSIGNED: "Unsigned commands refused",
    Verdict.FORGED: "Commands with a wrong signature refused",
    Verdict.REPLAYED: "Replayed commands refused",
    Verdict.OLD: "Commands with an old signature refused",
}
"""What is said of them, once over each link."""


class Link:
    """Where one peer, or one network of peers, talks with an autopilot; sans I/O."""

    def __init__(
        self, number: int, subscribed: Collection[int], streams: Streams, gate: Gatekeeper
    ) -> None:
        self.number = number
        """Its id in signatures."""
        self.outbox: list[bytes] = []
        """Frames that leave next; `queue` adds to them."""
        self.dropped = 0
        """Frames that found the outbox full, each of which took the oldest one's place."""
        self.streams = streams
        self.parser = wire.Parser(subscribed)
        self.pings = 0
        """PINGs sent, which are numbered."""
        self.modes_told = (-1, -1)
        """Modes flown and chosen as CURRENT_MODE told them last."""
        self.modes_told_at = -math.inf
        self.gcs_seen_at = -math.inf
        """When a ground station's heartbeat last came in here."""
        self._refused: set[Verdict] = set()
        self._gate = gate
        self._sequences = bytearray(256)
        """The number of each component's next frame."""

    def refusal(self, frame: wire.Frame) -> str | None:
        """Say why a frame may not be obeyed: nothing for one that may, no words when told."""
        verdict = self._gate.refusal(frame)
        if verdict is None:
            return None
        is_news = verdict not in self._refused
        self._refused.add(verdict)
        return REFUSALS[verdict] if is_news else ""

    def sequence(self, compid: int = AUTOPILOT_COMPID) -> int:
        """Give the number of a component's next frame, which is to be posted."""
        sequence = self._sequences[compid]
        self._sequences[compid] = (sequence + 1) & 0xFF
        return sequence

    def post(self, frame: bytes) -> None:
        """Let an own frame leave next, signed if there is a key."""
        self.queue(self._gate.seal(frame, self.number))

    def queue(self, frame: bytes) -> None:
        """Let a frame leave next, as it is."""
        if len(self.outbox) == OUTBOX_FRAMES:
            self.dropped += 1
            del self.outbox[0]
        self.outbox.append(frame)

    def take(self) -> list[bytes]:
        """Empty the outbox."""
        frames, self.outbox = self.outbox, []
        return frames
