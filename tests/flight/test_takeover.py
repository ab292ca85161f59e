"""A pilot takes the mode at every awkward moment: what leaves after the next report of the mode."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from flight_log import Flight, choose_mode, strike

from swarm_ctl import wire
from swarm_ctl.agent.phases import Phase
from swarm_ctl.model import Operator

Launch = Callable[..., Flight]
EXPLORES = {Phase.EXPLORING, Phase.AVOIDING}
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
LOITER = {"px4": (3, 4 << 16 | 3 << 24), "ardupilot": (5, 5)}
"""What a pilot asks for, and how it is told: AUTO.LOITER, LOITER."""
SENT = ("COMMAND_LONG", "SET_POSITION_TARGET_LOCAL_NED")


class Witness:
    """What the controller of vehicle 1 sends after it was told that a pilot flies."""

    def __init__(self, flight: Flight, mode: int) -> None:
        self.sent: list[str] = []
        self.is_told = False
        self._mode = mode
        self._told, self._up = wire.Parser(("HEARTBEAT", "CURRENT_MODE")), wire.Parser(SENT)
        fleet, controller = flight.arena.fleet, flight.arena.controllers[0]
        self._obey, self._hear = fleet.receive, controller.receive
        fleet.receive = self._witness  # type: ignore[method-assign]
        controller.receive = self._listen  # type: ignore[method-assign]

    def _witness(self, index: int, data: bytes, now: float, link: int = 0) -> None:
        if self.is_told and index == 0:
            self.sent += [wire.message(frame.id).name for frame in self._up.feed(data)]
        self._obey(index, data, now, link)

    def _listen(self, data: bytes, now: float) -> None:
        for frame in self._told.feed(data):
            is_autopilot = frame.sysid == frame.compid == 1
            self.is_told |= is_autopilot and frame.values.custom_mode == self._mode
        self._hear(data, now)


def take(flight: Flight, autopilot: str, watch_s: float = 8.0) -> Witness:
    """Let a pilot take vehicle 1; watch what leaves for a while."""
    number, mode = LOITER[autopilot]
    witness = Witness(flight, mode)
    choose_mode(flight, autopilot, number)
    flight.arena.fly(until_s=flight.arena.now + watch_s)
    assert witness.is_told
    return witness


def landing(launch: Launch, autopilot: str, *, are_acks_lost: bool) -> Flight:
    flight = launch(autopilot=autopilot, vehicles=1, duration_s=500.0)
    agent = flight.agent(1)
    flight.fly_until(lambda: agent.phase in EXPLORES)
    flight.fly(8)
    if are_acks_lost:
        strike(flight, "ack-lost")
    agent.order(Operator.LAND, flight.arena.now)
    flight.fly_until(lambda: agent.phase is Phase.LANDING)
    return flight


@pytest.mark.parametrize("are_acks_lost", [False, True])
@pytest.mark.parametrize("after_s", [0.02, 0.2, 0.5, 0.9, 1.3, 1.9, 2.3])
@BOTH
def test_a_pilot_who_takes_over_a_landing_is_not_landed(
    launch: Launch, autopilot: str, after_s: float, are_acks_lost: bool
) -> None:
    flight = landing(launch, autopilot, are_acks_lost=are_acks_lost)
    flight.fly(after_s)
    assert take(flight, autopilot).sent == []
    assert flight.agent(1).phase is Phase.YIELDED
    assert flight.arena.fleet.vehicles[0].armed


@pytest.mark.parametrize("are_acks_lost", [False, True])
@pytest.mark.parametrize("after_s", [0.3, 0.9, 1.3, 1.9, 2.3])
def test_a_mode_chosen_while_the_vehicle_is_to_be_armed_stays(
    launch: Launch, after_s: float, are_acks_lost: bool
) -> None:
    flight = launch(autopilot="ardupilot", vehicles=1)
    agent = flight.agent(1)
    if are_acks_lost:
        strike(flight, "ack-lost", 60.0, message="COMMAND_ACK")
    flight.fly_until(lambda: agent.phase is Phase.ARMING)
    flight.fly(after_s)
    assert take(flight, "ardupilot").sent == []
    assert agent.phase in {Phase.YIELDED, Phase.DONE}
    assert "the pilot chose LOITER" in agent.trouble


@BOTH
def test_who_arms_in_a_mode_of_his_own_keeps_it(launch: Launch, autopilot: str) -> None:
    flight = launch(autopilot=autopilot, vehicles=1)
    agent, fleet = flight.agent(1), flight.arena.fleet
    strike(flight, "nack", command=176.0, result="denied")
    flight.fly_until(lambda: agent.phase is Phase.ARMING)
    arm = (1, 1, 400, 0, 1.0, 21196.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    fleet.receive(0, wire.message("COMMAND_LONG").pack(0, 255, 190, *arm), flight.arena.now)
    flight.fly_until(lambda: agent.phase is Phase.YIELDED, within_s=1.5)
    assert "armed in" in agent.trouble


@pytest.mark.parametrize("after_s", [0.0, 0.1, 0.5, 1.0])
@BOTH
def test_a_pilot_who_takes_the_mode_again_after_he_gave_it_back_keeps_it(
    launch: Launch, autopilot: str, after_s: float
) -> None:
    flight = launch(autopilot=autopilot, vehicles=1, duration_s=500.0)
    agent, vehicle = flight.agent(1), flight.arena.fleet.vehicles[0]
    flight.fly_until(lambda: agent.phase in EXPLORES)
    flight.fly(8)
    ours = vehicle.mode
    assert take(flight, autopilot, 2.0).sent == []
    assert agent.order(Operator.RESUME, flight.arena.now)
    flight.fly_until(lambda: vehicle.mode == ours, within_s=3)
    flight.fly(after_s)
    take(flight, autopilot, 3.0)
    assert vehicle.mode != ours
    flight.fly_until(lambda: agent.phase is Phase.YIELDED, within_s=6)
    assert agent.order(Operator.RESUME, flight.arena.now)
    flight.fly_until(lambda: agent.phase in EXPLORES, within_s=10)


def test_who_gives_an_arducopter_back_low_in_the_air_sees_it_explore(launch: Launch) -> None:
    flight = launch(autopilot="ardupilot", vehicles=1, duration_s=500.0)
    agent, brake = flight.agent(1), 17
    flight.fly_until(lambda: agent.phase in EXPLORES)
    flight.fly(3.0)
    flight.arena.fleet.dynamics.position_ned_m[0, 2] = -0.9
    choose_mode(flight, "ardupilot", brake)
    flight.fly_until(lambda: agent.phase is Phase.YIELDED, within_s=2.0)
    flight.fly(3.0)
    assert 0.5 < agent.telemetry.height_m < 1.2
    assert agent.order(Operator.RESUME, flight.arena.now)
    flight.fly_until(lambda: agent.phase in EXPLORES, within_s=12.0)
