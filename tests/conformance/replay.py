"""Fly a script again, in virtual time, with a mock vehicle instead of the recorded one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from transcript import CLIENT, Listener, Said, Script

from mock_vehicle.fleet import Fleet
from mock_vehicle.world import load_world
from swarm_ctl import wire

FIELD = Path(__file__).parent / "field.yaml"
REAL32 = 9
COMPANION = 0
"""The link over which the recordings were made."""


class Mock:
    """A mock vehicle as late and as talkative as the real one, and the client's end of its link."""

    def __init__(self, personality: str, link: int = COMPANION) -> None:
        self._link = link
        self._fleet = Fleet(load_world(FIELD), [personality], seed=1, boot_s=None, rates="full")
        self._parser = wire.Parser(None)
        self._steps = 0
        self._sent = 0

    def send(self, request: Said) -> list[Said]:
        """Deliver a request, and give what the vehicle says at once."""
        data = packed(request, self._sent & 0xFF)
        self._sent += 1
        return self.deliver(data, request.at_s)

    def deliver(self, data: bytes, at_s: float) -> list[Said]:
        """Deliver a datagram, and give what the vehicle says at once."""
        self._fleet.receive(0, data, at_s, self._link)
        return self._parsed(b"".join(self._fleet.answers(0, self._link)), at_s)

    def fly(self, until_s: float) -> list[Said]:
        """Let time pass, and give what the vehicle says meanwhile."""
        heard: list[Said] = []
        while (self._steps + 1) * self._fleet.step_s <= until_s:
            self._steps += 1
            now = self._steps * self._fleet.step_s
            to_companion = [data for _, data in self._fleet.step(now)]
            there = to_companion if self._link == COMPANION else self._fleet.answers(0, self._link)
            heard += self._parsed(b"".join(there), now)
        return heard

    def _parsed(self, data: bytes, now: float) -> list[Said]:
        return [
            Said(now, wire.message(frame.id).name, frame.values._asdict())
            for frame in self._parser.feed(data)
        ]


def packed(request: Said, sequence: int) -> bytes:
    """Make the frame of a request."""
    message = wire.message(request.name)
    values: Any = message.unpack(b"")._replace(**request.fields)
    return message.pack(sequence, *CLIENT, *values)


def replay(script: Script) -> list[Said]:
    """Give the answers of the mock to the requests of a script, each sent at its recorded time."""
    mock = Mock(script.personality)
    for name, value in script.setup.items():
        fields = {"target_system": 1, "param_id": name, "param_value": value, "param_type": REAL32}
        mock.send(Said(0.0, "PARAM_SET", fields))
    listener = Listener(script.personality)
    answers: list[Said] = []

    def listen(heard: list[Said]) -> None:
        found = (said for said in heard if listener.hear(*said))
        answers.extend(said for said in found if not script.heard or said.name in script.heard)

    for request in script.requests:
        listen(mock.fly(request.at_s))
        listener.ask(request)
        listen(mock.send(request))
    listen(mock.fly(script.end_s + 1.0))
    return answers
