"""What client and vehicle said to each other, as recorded, and what in it is an answer."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from swarm_ctl import wire

HERE = Path(__file__).parent
CLIENT = (255, 190)
"""sysid and compid of who asked in the recordings."""
RATES = "rates"
"""The file of what flows unasked, beside the suites."""
MALFORMED = "malformed"
"""The file of what became of broken frames."""
FAILSAFES = HERE / "failsafes.json"
"""What was said while an autopilot took itself away from its client."""
PATIENCE_S = 0.5
"""A message that flows anyway answers a request for it within this time."""
REQUEST_MESSAGE, SET_MESSAGE_INTERVAL = 512, 511
ASKED_BY_COMMAND = {
    148: {520},
    244: {510},
    242: {179, 410},
    49: {179, 410},
    300: {519},
}
"""Commands other than REQUEST_MESSAGE that ask for a message, by its id."""

ONCE = frozenset({"PARAM_VALUE", "STATUSTEXT"})
"""Said when there is something to say."""
ARDUPILOT_ONCE = ONCE | {"GPS_GLOBAL_ORIGIN", "HOME_POSITION"}
"""These are streams of PX4."""

ANSWERS = frozenset(
    {
        "AUTOPILOT_VERSION",
        "COMMAND_ACK",
        "COMMAND_LONG",
        "COMPONENT_INFORMATION",
        "FILE_TRANSFER_PROTOCOL",
        "LOG_ENTRY",
        "MESSAGE_INTERVAL",
        "MISSION_ACK",
        "MISSION_COUNT",
        "MISSION_ITEM",
        "MISSION_ITEM_INT",
        "MISSION_REQUEST",
        "MISSION_REQUEST_INT",
        "PARAM_ERROR",
        "PARAM_VALUE",
        "PROTOCOL_VERSION",
        "STATUSTEXT",
    }
)
"""Said for a reason, never by the clock."""

STATES: Mapping[str, tuple[str, ...]] = {
    "EXTENDED_SYS_STATE": ("landed_state",),
    "GPS_GLOBAL_ORIGIN": (),
    "HEARTBEAT": ("base_mode", "custom_mode", "system_status"),
    "HOME_POSITION": (),
    "MISSION_CURRENT": ("seq", "total", "mission_state", "mission_mode"),
    "MISSION_ITEM_REACHED": ("seq",),
}
"""Repeated by the clock: the first one is told, and each one in which these fields changed."""


class Said(NamedTuple):
    """One message, at a time since boot."""

    at_s: float
    name: str
    fields: Mapping[str, Any]
    """Those that are not zero."""


@dataclass(frozen=True)
class Script:
    """One recorded suite."""

    personality: str
    suite: str
    requests: list[Said]
    answers: list[Said]
    setup: Mapping[str, float]
    """Parameters that were not at their defaults when the vehicle booted."""
    left_out: Mapping[str, int]
    """Frames of messages that pymavlink does not know, by name."""

    heard: frozenset[str]
    """The messages that the record tells of; none: all."""

    @property
    def name(self) -> str:
        """Personality and suite."""
        return f"{self.personality}/{self.suite}"

    @property
    def end_s(self) -> float:
        """Time of the last word."""
        return max(said.at_s for said in (*self.requests, *self.answers))


def scripts() -> list[Script]:
    """Read every recorded suite."""
    paths = sorted(HERE.glob("*/*.json"))
    return [read(path) for path in paths if path.stem not in {RATES, MALFORMED}]


def read(path: Path) -> Script:
    """Read one suite and spell its repetitions out."""
    data = json.loads(path.read_text("utf-8"))
    requests: list[Said] = []
    answers: list[Said] = []
    for at_s, direction, name, fields, *repetition in data["said"]:
        if direction == "<":
            answers.append(Said(at_s, name, fields))
        else:
            requests += _repeated(Said(at_s, name, fields), *repetition)
    requests.sort(key=lambda said: said.at_s)
    answers.sort(key=lambda said: said.at_s)
    return Script(
        path.parent.name,
        path.stem,
        requests,
        answers,
        data["setup"],
        data["left_out"],
        frozenset(data["heard"]),
    )


def _repeated(said: Said, times: int = 1, every_s: float = 0.0) -> Iterator[Said]:
    for k in range(times):
        yield said._replace(at_s=said.at_s + k * every_s)


class Listener:
    """Picks the answers out of everything a vehicle sends."""

    def __init__(self, personality: str) -> None:
        self._asked: dict[str, float] = {}
        self._states: dict[str, tuple[Any, ...]] = {}
        # ArduPilot tells these two when they are set, and streams them only when told to.
        self._events = set(once(personality) - ONCE)

    def ask(self, request: Said) -> None:
        """Note a request of the client."""
        for name in asked_for(request):
            self._asked[name] = request.at_s
        if request.fields.get("command") == SET_MESSAGE_INTERVAL:
            self._events.discard(_name(request.fields.get("param1", 0)))

    def hear(self, at_s: float, name: str, fields: Mapping[str, Any]) -> bool:
        """Tell whether a message of the vehicle is an answer."""
        asked_at_s = self._asked.pop(name, None)
        changed = self._changed(name, fields)
        if asked_at_s is not None and at_s - asked_at_s <= PATIENCE_S:
            return True
        if name == "TIMESYNC":
            return bool(fields.get("tc1"))
        if name == "PING":
            return fields.get("target_system") == CLIENT[0]
        return name in ANSWERS or name in self._events or changed

    def _changed(self, name: str, fields: Mapping[str, Any]) -> bool:
        if name not in STATES:
            return False
        state = tuple(fields.get(field, 0) for field in STATES[name])
        changed = self._states.get(name) != state
        self._states[name] = state
        return changed


def once(personality: str) -> frozenset[str]:
    """Name the messages that a personality says when there is something to say."""
    return ONCE if personality == "px4" else ARDUPILOT_ONCE


def asked_for(request: Said) -> list[str]:
    """Name the messages that a command asks for."""
    command = request.fields.get("command")
    if command == REQUEST_MESSAGE:
        return [_name(request.fields.get("param1", 0))]
    return [_name(number) for number, commands in ASKED_BY_COMMAND.items() if command in commands]


def _name(number: float) -> str:
    """Name a message by its id, which may be nonsense."""
    try:
        return wire.message(int(number)).name
    except ValueError:
        return str(number)
