"""A controller with a key hears only its own swarm."""

from __future__ import annotations

from pathlib import Path

import pytest
from halls import write_hall

from swarm_ctl import wire
from swarm_ctl.agent.agent import Agent
from swarm_ctl.flight import orders_of
from swarm_ctl.mission import load_mission
from swarm_ctl.signing import Signer, Verdict, key_of

KEY, NOW = key_of("swarm"), 1 << 45
HEARTBEAT = wire.message("HEARTBEAT")


@pytest.fixture
def agent(tmp_path: Path) -> Agent:
    mission = load_mission(write_hall(tmp_path, {}, None))
    return Agent(1, orders_of(mission))


def beat(seq: int = 0) -> bytes:
    return HEARTBEAT.pack(seq, 1, 1, 2, 12, 29, 0, 3, 3)


def test_who_has_no_key_or_another_is_not_heard(agent: Agent) -> None:
    agent.sign_with(KEY, NOW)
    agent.receive(beat(), 0.0)
    agent.receive(Signer(key_of("other"), NOW).sign(beat()), 0.0)
    assert agent.telemetry.autopilot is None
    assert agent.sender.gate.refused.total() == 2


def test_the_vehicle_is_heard_once_and_not_in_a_replay(agent: Agent) -> None:
    agent.sign_with(KEY, NOW)
    signed = Signer(KEY, NOW).sign(beat())
    for _ in range(3):
        agent.receive(signed, 0.0)
    assert agent.telemetry.autopilot is not None
    assert agent.sender.gate.refused.total() == 2


def test_all_it_says_is_signed(agent: Agent) -> None:
    agent.sign_with(KEY, NOW)
    judge = Signer(KEY, NOW)
    said = [frame for tick in range(50) for frame in wire.split(agent.tick(tick / 10.0))]
    assert said
    assert {judge.verify(frame) for frame in said} == {Verdict.ACCEPTED}


def test_without_a_key_everybody_is_heard_and_nothing_is_signed(agent: Agent) -> None:
    agent.receive(beat(), 0.0)
    assert agent.telemetry.autopilot is not None
    assert not any(frame[2] for frame in wire.split(agent.tick(0.0)))
