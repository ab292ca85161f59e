"""Topics and payloads of the bus."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

from swarm_ctl.bus.payload import VERSION, Payload
from swarm_ctl.model import Operator

ROOT = "swarm"
ANY = "+"
"""Stands for every mission, sysid or number when a topic is subscribed to."""
MOST_BYTES = 1000
"""A longer payload is no order."""
MOST_ID = 100
"""Characters of an order's id."""
_OPERATORS = {operator.value: operator for operator in Operator}


def topic(mission: str, sysid: int | str, what: str) -> str:
    """Name where one vehicle tells `what`: state, status, coverage, coverage/all; ANY for all."""
    return f"{ROOT}/{mission}/{sysid}/{what}"


def info_topic(mission: str = ANY) -> str:
    """Name where a mission is introduced; without one, the filter that hears of all of them."""
    return f"{ROOT}/{mission}/info"


def event_topic(mission: str, sysid: int | str = ANY, number: int | str = ANY) -> str:
    """Name where one event of a vehicle is told."""
    return f"{ROOT}/{mission}/{sysid}/event/{number}"


def order_topic(mission: str, sysid: int | None = None) -> str:
    """Name where orders come: for one vehicle, or for all of a mission."""
    return f"{ROOT}/{mission}/order" if sysid is None else f"{ROOT}/{mission}/{sysid}/order"


def ack_topic(mission: str, sysid: int | None = None) -> str:
    """Name where a vehicle acknowledges; without a sysid, the filter that hears all of them."""
    return f"{ROOT}/{mission}/{ANY if sysid is None else sysid}/ack"


def peers_topic(mission: str, sysid: int | None = None) -> str:
    """Name where a vehicle tells its peers; without a sysid, the filter that hears all of them."""
    return f"{ROOT}/{mission}/{ANY if sysid is None else sysid}/peers"


@dataclass(frozen=True, slots=True)
class Info(Payload):
    """What is flown, from whoever launched it."""

    run: str
    """When it began, UTC (ISO 8601): tells one run of a mission from another."""
    mission: str
    mode: str
    """`udp` against mock vehicles, `fly` with real ones."""
    vehicles: list[int]
    """sysids that this process flies; another one may fly further vehicles of the mission."""
    planner: str
    """Its kind: explore, lf-pso, levy or pso."""
    dimensions: int
    duration_s: float
    """Exploration time of each vehicle."""
    seed: int
    world: str | None
    """Name of the simulated world; null with real vehicles."""
    plan: dict[str, Any] | None
    """Its outline, as `truth/world.json` of a run folder without the victims; null when nobody
    knows. It lies in the launch frame."""


@dataclass(frozen=True, slots=True)
class Status(Payload):
    """Whether a vehicle's controller is there."""

    run: str
    sysid: int
    status: str
    """`online`, `done` when its mission has ended, `offline` when it was lost (last will)."""


@dataclass(frozen=True, slots=True)
class State(Payload):
    """One vehicle now; positions are metres NED from its own start unless told otherwise."""

    run: str
    sysid: int
    time_s: float
    """Mission time."""
    phase: str
    words: str
    """Why it is in this phase, in words."""
    is_paused: bool
    """Held by the operator."""
    is_waiting: bool
    """Stands ready until `start` is ordered."""
    position_ned_m: list[float]
    velocity_ned_m_s: list[float]
    yaw_rad: float
    """Heading, clockwise from north."""
    target_ned_m: list[float] | None
    """Where it is heading for, while it explores."""
    origin_ned_m: list[float] | None
    """Where its own frame begins in the launch frame; null when nobody knows."""
    origin_geodetic: list[float] | None
    """Latitude and longitude in degrees and altitude in metres of the same; null when unknown."""
    battery: float | None
    """Charge, 0 to 1; null when the autopilot does not tell."""
    link_age_s: float | None
    """Since its autopilot was last heard; null when it never was."""
    neighbours: list[int]
    """sysids heard by its radio."""
    ranges_m: list[float | None]
    """Front, back, left, right, up, down; null is nothing within range, or no sensor."""
    victims: list[int]
    """Numbers of the victims that it has seen itself."""
    seen_m2: float
    """Ground that it has flown over within its footprint."""
    autopilot: str
    """`px4`, `ardupilot`, or empty when it has not been heard."""


@dataclass(frozen=True, slots=True)
class Event(Payload):
    """A fact that is kept for latecomers."""

    run: str
    sysid: int
    id: int
    """Rises within a run and vehicle, not always by one; the topic's last level."""
    time_s: float
    """Mission time."""
    kind: str
    """`phase`, `done`, `victim`, `contact`, `fault` or `order`."""
    name: str
    """As in the run folder's `events.jsonl`: `PhaseChanged`, `VictimFound`, …"""
    words: str
    """The same as a short sentence."""
    data: dict[str, Any]
    """As in `events.jsonl`."""


@dataclass(frozen=True, slots=True)
class Coverage(Payload):
    """Ground that a vehicle has newly seen, or all so far; squares of its own frame."""

    run: str
    sysid: int
    number: int
    """Counts the deltas from 1; of all so far, the last delta in it. A gap is a delta that was
    lost: the next telling of all fills it."""
    time_s: float
    """Mission time."""
    cell_m: float
    """Edge of a square."""
    rows: list[list[int]]
    """Runs of squares [i, j, n]: n of them to the east, the first one from i to i + 1 edges north
    and j to j + 1 edges east of the start."""


class Order(NamedTuple):
    """An order as it came, or what is wrong with it."""

    operator: Operator | None
    """None when it could not be read."""
    id: str = ""
    """Chosen by who orders, to know the acknowledgements by; may be empty."""
    error: str = ""
    """What is wrong, in words; empty when nothing is."""

    def dump(self) -> bytes:
        """Write the payload of an order."""
        return json.dumps({"v": VERSION, "order": self.operator, "id": self.id}).encode()

    @classmethod
    def load(cls, payload: bytes) -> Self:
        """Read a payload: JSON, or the bare word."""
        if len(payload) > MOST_BYTES:
            return cls(None, error=f"longer than {MOST_BYTES} bytes")
        try:
            text = payload.decode().strip()
            said = json.loads(text) if text.startswith("{") else {"order": text}
        except (ValueError, RecursionError):
            return cls(None, error="neither JSON nor a word")
        return cls._read(said)

    @classmethod
    def _read(cls, said: dict[str, Any]) -> Self:
        name, word = said.get("id", ""), said.get("order")
        if not isinstance(name, str) or len(name) > MOST_ID:
            return cls(None, error=f"its id is no text of at most {MOST_ID} characters")
        operator = _OPERATORS.get(word) if isinstance(word, str) else None
        if operator is None:
            return cls(None, name, f"its order is none of {', '.join(_OPERATORS)}")
        return cls(operator, name)


class Ack(NamedTuple):
    """What one vehicle answers to an order."""

    id: str
    """The order's."""
    order: str
    """Empty when it could not be read."""
    accepted: bool
    """Whether it was done, or is so already; else it makes no sense now, or is no order."""
    phase: str
    """What the vehicle does now."""
    time_s: float
    """Mission time."""
    error: str = ""
    """What is wrong with the order, in words; empty when nothing is."""

    def dump(self) -> bytes:
        """Write the payload of an acknowledgement."""
        return json.dumps({"v": VERSION, **self._asdict()}).encode()

    @classmethod
    def load(cls, payload: bytes) -> Self | None:
        """Read a payload; None when it is no acknowledgement."""
        try:
            said = json.loads(payload)
            return cls(**{name: said[name] for name in cls._fields})
        except (ValueError, RecursionError, KeyError, TypeError):
            return None


Told = Info | Status | State | Event | Coverage
"""What a subscriber may hear besides orders and acknowledgements."""
_BY_LEAF: dict[str, type[Status | State | Coverage]] = {
    "status": Status,
    "state": State,
    "coverage": Coverage,
    "coverage/all": Coverage,
}


def read(topic: str, payload: bytes) -> Told | None:
    """Read what was told on a topic; None when it is nothing of that, or broken."""
    match topic.split("/", 3):
        case [_, _, "info"]:
            return Info.load(payload)
        case [_, _, _, leaf] if leaf.startswith("event/"):
            return Event.load(payload)
        case [_, _, _, leaf] if leaf in _BY_LEAF:
            return _BY_LEAF[leaf].load(payload)
    return None
