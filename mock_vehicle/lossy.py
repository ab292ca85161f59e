"""Links that lose, delay, hold, double and mix up what they carry: bytes and `now` in and out."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from mock_vehicle.faults import Trouble
from swarm_ctl import wire

Direction = Literal["uplink", "downlink"]
DIRECTIONS: tuple[Direction, ...] = ("uplink", "downlink")
LINKS: tuple[str, ...] = ("companion", "ground-station", "viewer")
"""What `link` of a fault calls them, in the order of an autopilot's links."""
HELD_MAX = 20_000
"""Frames that wait at most; what comes then is lost, as in a full buffer."""
SOON_S = 1e-6
"""Times are sums of floats."""

Effect = Callable[[Trouble, float, np.random.Generator], tuple[float, ...]]
"""(trouble, when a frame would arrive, dice) -> when its copies do; none is a loss."""


class Place(NamedTuple):
    """One direction of one link of a vehicle."""

    vehicle: int
    """Counted from 0."""
    link: int
    direction: Direction


def _lose(trouble: Trouble, due: float, dice: np.random.Generator) -> tuple[float, ...]:
    return () if dice.random() < trouble.fault["fraction"] else (due,)


def _delay(trouble: Trouble, due: float, dice: np.random.Generator) -> tuple[float, ...]:
    fault = trouble.fault
    return (due + fault["delay_s"] + fault["jitter_s"] * dice.random(),)


def _gather(trouble: Trouble, due: float, dice: np.random.Generator) -> tuple[float, ...]:  # noqa: ARG001
    period_s = trouble.fault["period_s"]
    if due == math.inf:  # held on a frozen link
        return (due,)
    return (math.ceil(due / period_s - SOON_S) * period_s,)


def _double(trouble: Trouble, due: float, dice: np.random.Generator) -> tuple[float, ...]:
    return (due, due) if dice.random() < trouble.fault["fraction"] else (due,)


def _hold_back(trouble: Trouble, due: float, dice: np.random.Generator) -> tuple[float, ...]:
    held = dice.random() < trouble.fault["fraction"]
    return (due + trouble.fault["hold_s"] if held else due,)


def _freeze(trouble: Trouble, due: float, dice: np.random.Generator) -> tuple[float, ...]:  # noqa: ARG001
    return (math.inf,)


def _come_late(trouble: Trouble, due: float, dice: np.random.Generator) -> tuple[float, ...]:  # noqa: ARG001
    return (due + trouble.fault["delay_s"],)


def _get_lost(trouble: Trouble, due: float, dice: np.random.Generator) -> tuple[float, ...]:  # noqa: ARG001
    return () if trouble.spend() else (due,)


EFFECTS: Mapping[str, Effect] = {
    "link-loss": _lose,
    "link-delay": _delay,
    "link-burst": _gather,
    "link-duplicate": _double,
    "link-reorder": _hold_back,
    "link-freeze": _freeze,
    "ack-late": _come_late,
    "ack-lost": _get_lost,
}
"""What each kind of fault does to a frame."""


def concerns(trouble: Trouble, place: Place) -> bool:
    """Tell whether a fault of the vehicle spoils this direction of this link."""
    fault = trouble.fault
    if "message" in fault.parameters:
        return place.direction == "downlink"
    is_there = fault["link"] in {"all", LINKS[place.link]}
    return is_there and fault["direction"] in {"both", place.direction}


def _message_id(frame: bytes) -> int:
    """Read the message id of a whole frame."""
    return int.from_bytes(frame[7:10], "little") if frame[:1] == b"\xfd" else frame[5]


class Channel:
    """What is under way on one direction of a spoilt link."""

    def __init__(self, dice: np.random.Generator) -> None:
        self.troubles: Sequence[Trouble] = ()
        self.held: list[tuple[float, int, bytes]] = []
        """A heap of (when it arrives, order of sending, frame)."""
        self.dropped = 0
        """Frames that found no room to wait."""
        self._dice = dice
        self._sent = 0

    def spoil(self, troubles: Sequence[Trouble], now: float) -> None:
        """Suffer from these from now on.

        With the last of them gone everything under way arrives at once, in the order of sending;
        with a freeze gone what it held goes on.
        """
        is_frozen = any(trouble.fault.kind == "link-freeze" for trouble in troubles)
        if not troubles:
            self.held = [(now, order, frame) for _, order, frame in self.held]
        elif not is_frozen:
            self.held = [(now if due == math.inf else due, n, frame) for due, n, frame in self.held]
        heapq.heapify(self.held)
        self.troubles = troubles

    def carry(self, frames: Sequence[bytes], now: float) -> list[bytes]:
        """Take what is sent now and give what arrives by now, in the order of arrival."""
        for frame in frames:
            for due in self._dues(frame, now):
                if len(self.held) < HELD_MAX:
                    self._sent += 1
                    heapq.heappush(self.held, (due, self._sent, frame))
                else:
                    self.dropped += 1
        arrived = []
        while self.held and self.held[0][0] <= now + SOON_S:
            arrived.append(heapq.heappop(self.held)[2])
        return arrived

    def _dues(self, frame: bytes, now: float) -> tuple[float, ...]:
        dues: tuple[float, ...] = (now,)
        for trouble in self.troubles:
            name = trouble.fault.parameters.get("message") and trouble.fault["message"]
            if name and _message_id(frame) != wire.message(name).id:
                continue
            effect = EFFECTS[trouble.fault.kind]
            dues = tuple(later for due in dues for later in effect(trouble, due, self._dice))
        return dues


class LossyLinks:
    """The spoilt links of a fleet; while all are sound, that costs one look."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._channels: dict[Place, Channel] = {}
        self._dropped = 0
        """On links that are sound again."""

    def spoil(self, index: int, links: int, troubles: Sequence[Trouble], now: float) -> None:
        """Let a vehicle's links suffer from these and nothing else from now on."""
        for link in range(links):
            for direction in DIRECTIONS:
                place = Place(index, link, direction)
                here = [trouble for trouble in troubles if concerns(trouble, place)]
                if here and place not in self._channels:
                    dice = [self._seed, index, link, DIRECTIONS.index(direction)]
                    self._channels[place] = Channel(np.random.default_rng(dice))
                if place in self._channels:
                    self._channels[place].spoil(here, now)

    def carry(
        self, vehicle: int, link: int, direction: Direction, frames: Sequence[bytes], now: float
    ) -> Sequence[bytes]:
        """Send frames over a direction of a link, and give those that arrive by now."""
        if not self._channels:
            return frames
        place = Place(vehicle, link, direction)
        channel = self._channels.get(place)
        if channel is None:
            return frames
        arrived = channel.carry(frames, now)
        if not channel.troubles and not channel.held:
            self._dropped += channel.dropped
            del self._channels[place]
        return arrived

    @property
    def dropped(self) -> int:
        """Frames that found too many others waiting."""
        return self._dropped + sum(channel.dropped for channel in self._channels.values())

    def __len__(self) -> int:
        return sum(len(channel.held) for channel in self._channels.values())

    def late(
        self, direction: Direction, now: float, links: Collection[int] = (0, 1)
    ) -> list[tuple[Place, bytes]]:
        """Give what was held until now and arrives, with nothing new sent."""
        if not self._channels:
            return []
        places = [p for p in self._channels if p.direction == direction and p.link in links]
        return [(place, frame) for place in places for frame in self.carry(*place, (), now)]
