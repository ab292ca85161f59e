"""Both autopilots' rules, in the air: streams that stop, and words for what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from flight_log import Flight
from mock_client import PX4_RTL

from mock_vehicle.faults import Fault
from swarm_ctl import wire
from swarm_ctl.agent.phases import Phase
from swarm_ctl.record.journal import read_journal

Launch = Callable[..., Flight]
EXPLORES = {Phase.EXPLORING, Phase.AVOIDING}
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


def tell(flight: Flight, command: int, *parameters: float) -> None:
    """Let a ground station ask vehicle 1 for something."""
    seven = (*parameters, *(0.0,) * 7)[:7]
    frame = wire.message("COMMAND_LONG").pack(0, 255, 190, 1, 1, command, 0, *seven)
    flight.arena.fleet.receive(0, frame, flight.arena.now)


def facts(flight: Flight, name: str) -> list[dict[str, Any]]:
    """Give what the record says under a name."""
    journal = read_journal(flight.folder.path / "events.jsonl")
    return [entry["data"] for entry in journal if entry["event"] == name]


@BOTH
def test_a_stream_that_somebody_switches_off_is_asked_for_again(
    launch: Launch, autopilot: str
) -> None:
    flight = launch(autopilot=autopilot, duration_s=300.0)
    agent = flight.agent(1)
    flight.fly_until(lambda: agent.phase in EXPLORES)
    flight.fly(5)
    for name in ("LOCAL_POSITION_NED", "DISTANCE_SENSOR"):
        tell(flight, 511, float(wire.message(name).id), -1.0)
    flight.fly_until(lambda: agent.phase is Phase.HOLDING, within_s=1.5)
    flight.fly_until(lambda: agent.phase in EXPLORES, within_s=3.0)
    assert agent.telemetry.streams.missing(flight.arena.now) == []


@BOTH
def test_a_vehicle_without_a_position_says_that_it_needs_one(
    launch: Launch, autopilot: str
) -> None:
    flight = launch(
        autopilot=autopilot, faults=("gnss-loss:1@0",), flight={"ready_timeout_s": 20.0}
    )
    agent = flight.agent(1)
    flight.fly_until(lambda: agent.phase is Phase.FAILED, within_s=21)
    words = {"px4": "no valid position estimate", "ardupilot": "Need Position Estimate"}
    assert agent.trouble.startswith("not ready after 20 s: no local position (")
    assert words[autopilot] in agent.trouble


def test_px4_that_wants_a_ground_station_says_so(launch: Launch) -> None:
    flight = launch(flight={"ready_timeout_s": 20.0})
    flight.arena.fleet.vehicles[0].autopilot.set_parameter("NAV_DLL_ACT", 2.0)
    agent = flight.agent(1)
    flight.fly_until(lambda: agent.phase is Phase.FAILED, within_s=21)
    assert agent.trouble == "not ready after 20 s: no readiness to arm (no ground station)"


def test_px4_in_a_mode_that_cannot_arm_is_ready_all_the_same(launch: Launch) -> None:
    flight = launch()
    flight.arena.fleet.vehicles[0].autopilot.enter(PX4_RTL, 0.0)
    agent = flight.agent(1)
    flight.fly_until(lambda: agent.phase in EXPLORES, within_s=30)


@BOTH
def test_arming_that_is_refused_for_a_while_is_asked_for_again(
    launch: Launch, autopilot: str
) -> None:
    flight = launch(autopilot=autopilot)
    agent = flight.agent(1)
    nack = Fault(0.0, 1, "nack", 5.0, {"command": 400.0, "result": "temporarily-rejected"})
    flight.fly_until(lambda: agent.phase is Phase.ARMING)
    flight.arena.fleet.strike(nack, flight.arena.now)
    flight.fly_until(lambda: agent.phase in EXPLORES, within_s=30)
    refused = facts(flight, "CommandRefused")
    assert len(refused) >= 2
    assert refused[0]["reason"] == "temporarily rejected"
