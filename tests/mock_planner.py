"""A ground station that sends plans to a mock vehicle and fetches them, in virtual time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mock_client import Client
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.autopilot.traits import Rates
from mock_vehicle.vehicle import Personality

HOME_E7 = (473977418, 85455939)
WAYPOINT, LAND, TAKEOFF, RETURN = 16, 21, 22, 20
MISSION, FENCE, RALLY = 0, 1, 2
REL, REL_INT, GLOBAL, GLOBAL_INT, LOCAL, NO_PLACE = 3, 6, 0, 5, 1, 2
OK, ERROR, BAD_FRAME, BAD_COMMAND, NO_SPACE, BAD_SEQUENCE, CANCELLED = 0, 1, 2, 3, 4, 13, 15
NO_ALTITUDE, BAD_LATITUDE = 12, 10
INT_MAX = 2**31 - 1

Item = dict[str, Any]


def waypoint(**changes: Any) -> Item:
    """An item some metres north of home, 8 m above it."""
    x, y = HOME_E7[0] + 1000, HOME_E7[1]
    base = {"frame": REL_INT, "command": WAYPOINT, "x": x, "y": y, "z": 8.0, "current": 0}
    return base | {"p": (0.0, 0.0, 0.0, 0.0)} | changes


class Planner:
    """A ground station that sends and fetches plans by hand."""

    def __init__(self, personality: Personality, *, rates: Rates = "lean") -> None:
        self.client = Client(personality, rates=rates)
        self.client.mav.srcSystem, self.client.mav.srcComponent = 255, 190

    def ask(self, message: Any) -> list[Any]:
        """Send, and give what comes back at once."""
        self.client.send(message)
        answers: list[Any] = []
        for frame in self.client.vehicle.take():
            answers += self.client.oracle.parse_buffer(frame) or []
        self.client.heard += [(self.client.now, answer) for answer in answers]
        return answers

    def count(self, n: int, kind: int = MISSION) -> list[Any]:
        return self.ask(mavlink.MAVLink_mission_count_message(7, 1, n, kind))

    def item(
        self, sequence: int, item: Item, kind: int = MISSION, *, floats: bool = False
    ) -> list[Any]:
        make: Any = mavlink.MAVLink_mission_item_int_message
        place = (item["x"], item["y"])
        if floats:
            make = mavlink.MAVLink_mission_item_message
            place = (item["x"] * 1e-7, item["y"] * 1e-7)
        head = (7, 1, sequence, item["frame"], item["command"], item["current"], 1)
        return self.ask(make(*head, *item["p"], *place, item["z"], kind))

    def upload(self, items: Sequence[Item], kind: int = MISSION) -> list[tuple[str, int]]:
        """Answer every request in turn; give all that came as (kind, seq or result)."""
        said: list[tuple[str, int]] = []
        answers = self.count(len(items), kind)
        while answers:
            said += summary(answers)
            requests = [m.seq for m in answers if "REQUEST" in m.get_type()]
            answers = self.item(requests[-1], items[requests[-1]], kind) if requests else []
        return said

    def length(self, kind: int = MISSION) -> int:
        answers = self.ask(mavlink.MAVLink_mission_request_list_message(7, 1, kind))
        return int(answers[0].count)

    def request(self, sequence: int, kind: int = MISSION, *, floats: bool = False) -> list[Any]:
        make: Any = mavlink.MAVLink_mission_request_int_message
        if floats:
            make = mavlink.MAVLink_mission_request_message
        return self.ask(make(7, 1, sequence, kind))

    def done(self, result: int = OK, kind: int = MISSION) -> list[Any]:
        return self.ask(mavlink.MAVLink_mission_ack_message(7, 1, result, kind))

    def download(self, kind: int = MISSION) -> list[Any]:
        items = [self.request(sequence, kind)[0] for sequence in range(self.length(kind))]
        self.done(kind=kind)
        return items

    def wait(self, seconds: float) -> list[tuple[float, str, int]]:
        """Let time pass; give what the protocol said by itself, with the time since the start."""
        start, before = self.client.now, len(self.client.heard)
        self.client.fly(seconds)
        new = [(at, m) for at, m in self.client.heard[before:] if is_protocol(m)]
        return [(round(at - start, 2), *summary([m])[0]) for at, m in new]


def is_protocol(message: Any) -> bool:
    kind = message.get_type()
    return "MISSION_REQUEST" in kind or kind in {"MISSION_ACK", "MISSION_COUNT"}


def summary(messages: list[Any]) -> list[tuple[str, int]]:
    """(REQUEST, seq), (ACK, result), (COUNT, n); STATUSTEXT and the rest left out."""
    said = []
    for m in messages:
        match m.get_type():
            case "MISSION_REQUEST" | "MISSION_REQUEST_INT":
                said.append((m.get_type().removeprefix("MISSION_"), m.seq))
            case "MISSION_ACK":
                said.append(("ACK", m.type))
            case "MISSION_COUNT":
                said.append(("COUNT", m.count))
    return said
