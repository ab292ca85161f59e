"""Every answer that a real autopilot was recorded to give, given to a controller."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from airborne import TICK_S, agent_of, packed
from transcript import Said, Script, scripts

from swarm_ctl import wire
from swarm_ctl.agent.agent import Agent
from swarm_ctl.autopilot.base import COMPANION_COMPONENT
from swarm_ctl.autopilot.command import ASIDE, COMMAND_NAMES, command

SCRIPTS = {script.name: script for script in scripts()}
ASKED = ("COMMAND_LONG", "COMMAND_INT")
BELONGS_S = 0.6
"""An acknowledgement this soon after a command answers it; the slowest came after 527 ms."""
BURST_S = 0.05
"""Commands closer together are a burst, of which PX4 answers four in some order."""


class Exchange(NamedTuple):
    """A command and the results of its acknowledgements, in order."""

    autopilot: str
    command_id: int
    results: tuple[int, ...]


class Consequence(NamedTuple):
    """What a controller makes of results: how often it asks, and what it notes."""

    times: int
    reasons: tuple[str, ...]


ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
CONSEQUENCES = {
    (ACCEPTED,): Consequence(1, ()),
    (ACCEPTED, ACCEPTED): Consequence(1, ()),  # PX4: the link, and the commander
    (ACCEPTED, REJECTED): Consequence(4, ("temporarily rejected",) * 4),  # it thinks again
    (REJECTED,): Consequence(4, ("temporarily rejected",) * 4),
    (DENIED,): Consequence(1, ("denied",)),
    (UNSUPPORTED,): Consequence(1, ("unsupported",)),
    (FAILED,): Consequence(1, ("failed",)),
    (): Consequence(5, ("not answered",)),
}


def exchanges(script: Script) -> Iterator[Exchange]:
    """Find what answered each command."""
    acks = [said for said in script.answers if said.name == "COMMAND_ACK"]
    asked = [said for said in script.requests if said.name in ASKED]
    for request in asked:
        number = request.fields.get("command", 0)
        others_s = [other.at_s for other in asked if other.fields.get("command", 0) == number]
        if sum(abs(at_s - request.at_s) < BURST_S for at_s in others_s) > 1:
            continue
        until_s = min((at_s for at_s in others_s if at_s > request.at_s), default=math.inf)
        until_s = min(until_s, request.at_s + BELONGS_S)
        results = [
            ack.fields.get("result", 0)
            for ack in acks
            if ack.fields.get("command", 0) == number and request.at_s <= ack.at_s < until_s
        ]
        yield Exchange(script.personality, number, tuple(results))


EXCHANGES = sorted({found for script in SCRIPTS.values() for found in exchanges(script)})


class Conversation:
    """A controller that asks for one thing, and is answered each time as recorded."""

    def __init__(self, folder: Path, exchange: Exchange) -> None:
        self.agent = agent_of(folder)
        self.asked = 0
        self.confirmations: list[int] = []
        self._exchange = exchange
        self._sent = wire.Parser(["COMMAND_LONG"])
        self.agent.commands.request(command(exchange.command_id))
        for tick in range(60):
            self._listen(tick * TICK_S)

    def _listen(self, now: float) -> None:
        for frame in self._sent.feed(self.agent.tick(now)):
            if frame.values.command == self._exchange.command_id:
                self.asked += 1
                self.confirmations.append(frame.values.confirmation)
                self._answer(now)

    def _answer(self, now: float) -> None:
        whom = {"target_system": 1, "target_component": COMPANION_COMPONENT}
        for result in self._exchange.results:
            said = {"command": self._exchange.command_id, "result": result, **whom}
            self.agent.receive(packed("COMMAND_ACK", 0, **said), now + 0.01)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it was refused, as the record of the flight has it."""
        facts = (fact for fact in self.agent.drain_events() if fact.name == "CommandRefused")
        asked = self._exchange.command_id
        return tuple(fact.data["reason"] for fact in facts if fact.data["command"] == asked)


def test_the_record_has_every_command_that_a_controller_sends() -> None:
    for autopilot in ("px4", "ardupilot"):
        recorded = {found.command_id for found in EXCHANGES if found.autopilot == autopilot}
        assert set(COMMAND_NAMES) <= recorded
    assert {found.results for found in EXCHANGES} <= set(CONSEQUENCES)


@pytest.mark.parametrize("exchange", EXCHANGES, ids=lambda found: "-".join(map(str, found)))
def test_a_recorded_result_has_its_consequence(tmp_path: Path, exchange: Exchange) -> None:
    conversation, expected = Conversation(tmp_path, exchange), CONSEQUENCES[exchange.results]
    assert conversation.asked == expected.times
    is_anew = exchange.results != ()
    wanted = [0] * expected.times if is_anew else list(range(expected.times))
    assert conversation.confirmations == wanted
    if exchange.command_id in ASIDE:
        assert conversation.reasons == ()  # what is missing is asked for again anyway
    else:
        assert conversation.reasons == expected.reasons


# Everything else that was said.


def told(script: Script) -> list[tuple[float, bytes]]:
    """Make the frames of a script again."""
    return [(said.at_s, frame_of(k, said)) for k, said in enumerate(script.answers)]


def frame_of(number: int, said: Said) -> bytes:
    """Make the frame of an answer as vehicle 1 would send it to us."""
    fields: dict[str, Any] = dict(said.fields)
    if said.name == "COMMAND_ACK":
        fields |= {"target_system": 1, "target_component": COMPANION_COMPONENT}
    return packed(said.name, number, **fields)


def heard(agent: Agent, frames: list[tuple[float, bytes]]) -> list[str]:
    """Let a controller hear frames at their times and tick; give what it heard the vehicle say."""
    tick = 0
    texts: list[str] = []
    for at_s, frame in frames:
        while tick * TICK_S < at_s:
            agent.tick(tick * TICK_S)
            tick += 1
        agent.receive(frame, at_s)
        texts += [text.words for text in agent.telemetry.texts]
        agent.telemetry.texts.clear()
    return texts


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_recorded_answer_is_taken(tmp_path: Path, name: str) -> None:
    script, agent = SCRIPTS[name], agent_of(tmp_path, ready_timeout_s=3600.0)
    texts = heard(agent, told(script))
    stats = agent.parser.stats
    assert stats.frames == len(script.answers)
    assert (stats.bad_crc, stats.unknown, stats.skipped_bytes) == (0, 0, 0)
    told_texts = [said.fields["text"] for said in script.answers if said.name == "STATUSTEXT"]
    assert "".join("".join(texts).split()) == "".join("".join(told_texts).split())


def test_the_reasons_for_not_arming_are_ardupilots_own(tmp_path: Path) -> None:
    script, agent = SCRIPTS["ardupilot/notready"], agent_of(tmp_path, ready_timeout_s=3600.0)
    reasons: dict[str, float] = {}
    frames = told(script)
    for k in range(len(frames)):
        heard(agent, frames[k : k + 1])
        for reason in filter(None, agent.telemetry.why_not(frames[k][0]).split("; ")):
            reasons.setdefault(reason, frames[k][0])
    assert list(reasons) == [
        "System not initialised",
        "Need Alt Estimate",
        "Accels inconsistent",
        "EKF attitude is bad",
        "AHRS: waiting for home",
        "Mode requires mission",
        "Gyros inconsistent",
        "Need Position Estimate",
    ]
    assert agent.telemetry.why_not(frames[-1][0] + 10.0) == ""
