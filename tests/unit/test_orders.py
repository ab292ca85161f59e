"""What an operator may order in which phase, and who may order it over MAVLink."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl.agent.agent import Agent, Orders
from swarm_ctl.agent.duties import wait_for_start
from swarm_ctl.agent.orders import MOST_PER_TICK, ORDERS, is_ground_station, obey
from swarm_ctl.agent.params import FlightParams, Limits
from swarm_ctl.agent.phases import STEERING, Phase
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.model import Operator

NAN = math.nan
ACCEPTED, REJECTED, DENIED, UNSUPPORTED = range(4)
RTL, LAND, PAUSE_CONTINUE, GOTO, START = 20, 21, 193, 252, 300
DO_SET_MODE, TERMINATE, ARM = 176, 185, 400
SYSID, COMPANION = 3, 191


def an_agent(phase: Phase = Phase.EXPLORING, *, armed: bool = True) -> Agent:
    orders = Orders("hall", 60.0, PlannerParams(kind="levy"), FlightParams(), Limits(), seed=1)
    agent = Agent(SYSID, orders)
    agent.phase = phase
    agent.telemetry.armed = armed
    agent.telemetry.heard_s = agent.telemetry.heartbeat_s = agent.telemetry.mode_s = 1.0
    return agent


class Station:
    """A ground station with a wire to one agent."""

    def __init__(self, agent: Agent, sysid: int = 255, compid: int = 190) -> None:
        self.agent = agent
        self.codec = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
        self.oracle = mavlink.MAVLink(None)

    def say(
        self,
        command: int,
        *params: float,
        target: tuple[int, int] = (SYSID, COMPANION),
        copy: int = 0,
    ) -> None:
        seven = (*params, *(0.0,) * 7)[:7]
        self.send(mavlink.MAVLink_command_long_message(*target, command, copy, *seven))

    def say_int(self, command: int, first: float) -> None:
        rest = (0.0, 0.0, 0.0, 0, 0, 0.0)
        values = (SYSID, COMPANION, 0, command, 0, 0, first, *rest)
        self.send(mavlink.MAVLink_command_int_message(*values))

    def send(self, message: Any) -> None:
        self.agent.receive(bytes(message.pack(self.codec)), self.agent.now)

    def answers(self, now: float) -> list[tuple[int, int]]:
        """Let the agent's next tick come, and give the acknowledgements that are ours."""
        heard: list[Any] = self.oracle.parse_buffer(self.agent.tick(now)) or []
        own = (self.codec.srcSystem, self.codec.srcComponent)
        return [
            (message.command, message.result)
            for message in heard
            if message.get_type() == "COMMAND_ACK"
            and (message.get_srcSystem(), message.get_srcComponent()) == (SYSID, COMPANION)
            and (message.target_system, message.target_component) == own
        ]


def ordered(agent: Agent) -> list[str]:
    return [e.data["order"] for e in agent.drain_events() if e.name == "OperatorOrder"]


# -- what makes sense when -----------------------------------------------------------------------


@pytest.mark.parametrize("operator", Operator)
@pytest.mark.parametrize("phase", Phase)
@pytest.mark.parametrize("armed", [True, False])
def test_whatever_is_ordered_is_done_or_refused_and_never_breaks_the_table(
    operator: Operator, phase: Phase, armed: bool
) -> None:
    agent = an_agent(phase, armed=armed)
    is_done = obey(agent, operator)
    refused = [e.data for e in agent.drain_events() if e.name == "OrderRefused"]
    if is_done:
        assert not refused
        again = operator is Operator.RETURN and agent.phase is Phase.LANDING
        assert obey(agent, operator) or again or operator is Operator.RESUME, "done already"
    else:
        assert agent.phase is phase
        assert agent.is_ended or refused == [{"order": operator.value, "phase": phase.value}]


@pytest.mark.parametrize("operator", Operator)
def test_nothing_but_resume_moves_a_vehicle_that_a_pilot_flies(operator: Operator) -> None:
    agent = an_agent(Phase.YIELDED)
    assert obey(agent, operator) == (operator is Operator.RESUME)
    assert agent.phase is (Phase.ARMING if operator is Operator.RESUME else Phase.YIELDED)


@pytest.mark.parametrize("phase", sorted(STEERING | {Phase.TAKEOFF, Phase.LOST}))
@pytest.mark.parametrize("operator", [Operator.LAND, Operator.ABORT])
def test_who_flies_can_be_landed(operator: Operator, phase: Phase) -> None:
    agent = an_agent(phase)
    assert obey(agent, operator)
    assert agent.phase is Phase.LANDING


def test_who_takes_off_returns_by_landing() -> None:
    agent = an_agent(Phase.TAKEOFF)
    assert obey(agent, Operator.RETURN)
    assert agent.phase is Phase.LANDING


def test_who_is_down_has_done_what_brings_down() -> None:
    agent = an_agent(Phase.DONE, armed=False)
    assert [obey(agent, operator) for operator in Operator] == [False] * 3 + [True] * 3
    assert agent.drain_events() == []


def test_a_vehicle_that_awaits_its_start_takes_its_turn_when_it_is_ordered() -> None:
    agent = an_agent(Phase.READY, armed=False)
    agent.awaits_start, agent.start_delay_s = True, 5.0
    for now in (10.0, 1000.0):
        agent.telemetry.heard_s = agent.now = now
        wait_for_start(agent)
        assert agent.phase is Phase.READY
    assert obey(agent, Operator.START)
    for now, phase in ((1004.9, Phase.READY), (1005.0, Phase.ARMING)):
        agent.now = now
        wait_for_start(agent)
        assert agent.phase is phase, "its delay counts from the order"
    assert obey(agent, Operator.START), "already so"
    assert agent.began_s == 1000.0


@pytest.mark.parametrize("phase", [Phase.LANDING, Phase.LOST, Phase.YIELDED, Phase.DONE])
def test_start_moves_nobody_that_is_beyond_it(phase: Phase) -> None:
    agent = an_agent(phase)
    assert not obey(agent, Operator.START)
    assert agent.phase is phase


def test_a_ground_station_starts_what_waits_by_its_mission_start() -> None:
    agent = an_agent(Phase.READY, armed=False)
    agent.awaits_start = True
    station = Station(agent)
    station.say(START)
    assert station.answers(1.0) == [(START, ACCEPTED)]
    assert not agent.awaits_start


def test_a_vehicle_whose_link_is_lost_holds_when_it_is_back() -> None:
    agent = an_agent(Phase.LOST)
    assert obey(agent, Operator.PAUSE)
    assert agent.phase is Phase.LOST
    assert agent.is_paused


# -- over MAVLink --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "first", "operator"),
    [
        (RTL, 0.0, Operator.RETURN),
        (RTL, NAN, Operator.RETURN),
        (LAND, NAN, Operator.LAND),
        (PAUSE_CONTINUE, 0.0, Operator.PAUSE),
        (GOTO, 0.0, Operator.PAUSE),
        (PAUSE_CONTINUE, 1.0, Operator.RESUME),
        (GOTO, 1.0, Operator.RESUME),
        (START, 0.0, Operator.RESUME),
    ],
)
@pytest.mark.parametrize("kind", ["long", "int"])
def test_each_command_of_a_ground_station_is_an_order(
    command: int, first: float, operator: Operator, kind: str
) -> None:
    agent = an_agent()
    if operator is Operator.RESUME:
        obey(agent, Operator.PAUSE)
        agent.drain_events()
    station = Station(agent)
    (station.say if kind == "long" else station.say_int)(command, first)
    assert ordered(agent) == [], "nothing is done between two ticks"
    assert station.answers(1.1) == [(command, ACCEPTED)]
    assert ordered(agent) == [operator.value]


def test_the_table_is_what_the_manual_says() -> None:
    assert {(command, first) for command, first in ORDERS} == {
        *((RTL, None), (LAND, None), (START, None)),
        *((PAUSE_CONTINUE, 0.0), (PAUSE_CONTINUE, 1.0), (GOTO, 0.0), (GOTO, 1.0)),
    }


@pytest.mark.parametrize(
    ("command", "first", "result"),
    [
        (DO_SET_MODE, 1.0, UNSUPPORTED),
        (TERMINATE, 1.0, UNSUPPORTED),
        (ARM, 0.0, UNSUPPORTED),
        (65535, 0.0, UNSUPPORTED),
        (PAUSE_CONTINUE, 2.0, DENIED),
        (PAUSE_CONTINUE, NAN, DENIED),
        (GOTO, -math.inf, DENIED),
        (START, 0.0, REJECTED),
    ],
)
def test_what_is_no_order_is_answered_and_not_obeyed(
    command: int, first: float, result: int
) -> None:
    agent = an_agent()
    station = Station(agent)
    station.say(command, first)
    assert station.answers(1.1) == [(command, result)]
    assert ordered(agent) == (["resume"] if result == REJECTED else [])


def test_a_copy_of_an_order_is_acknowledged_and_not_done_again() -> None:
    agent = an_agent(Phase.YIELDED)
    station = Station(agent)
    station.say(START)
    station.say(START, copy=1)
    assert station.answers(1.1) == [(START, ACCEPTED)] * 2
    agent.phase = Phase.YIELDED  # the pilot takes it again
    station.say(START)
    station.say(START, NAN, copy=2)
    assert station.answers(1.9) == [(START, ACCEPTED)] * 2
    assert ordered(agent) == ["resume"]
    assert agent.phase is Phase.YIELDED, "a late copy does not fight the pilot"


def test_the_same_order_later_is_a_new_one() -> None:
    agent = an_agent(Phase.YIELDED)
    station = Station(agent)
    for now in (1.1, 2.2):
        agent.phase = Phase.YIELDED
        station.say(START)
        assert station.answers(now) == [(START, ACCEPTED)]
    assert ordered(agent) == ["resume", "resume"]


def test_an_order_between_two_copies_makes_the_second_a_new_one() -> None:
    agent = an_agent()
    station = Station(agent)
    station.say(PAUSE_CONTINUE, 0.0)
    station.answers(1.1)
    agent.order(Operator.RESUME, 1.2)
    station.say(PAUSE_CONTINUE, 0.0)
    assert station.answers(1.3) == [(PAUSE_CONTINUE, ACCEPTED)]
    assert ordered(agent) == ["pause", "resume", "pause"]


def test_an_order_that_was_refused_is_tried_again() -> None:
    agent = an_agent(Phase.LANDING)
    station = Station(agent)
    station.say(PAUSE_CONTINUE, 0.0)
    assert station.answers(1.1) == [(PAUSE_CONTINUE, REJECTED)]
    agent.phase = Phase.EXPLORING
    station.say(PAUSE_CONTINUE, 0.0, copy=1)
    assert station.answers(1.2) == [(PAUSE_CONTINUE, ACCEPTED)]
    assert agent.is_paused


@pytest.mark.parametrize("target", [(SYSID, 0), (0, 0), (0, COMPANION), (SYSID, 1), (4, COMPANION)])
def test_what_is_meant_for_others_is_left_to_them(target: tuple[int, int]) -> None:
    agent = an_agent()
    station = Station(agent)
    station.say(LAND, target=target)
    assert station.answers(1.1) == []
    assert ordered(agent) == []


@pytest.mark.parametrize(
    ("sysid", "compid", "may_order"),
    [
        (255, 190, True),  # QGroundControl, Mission Planner
        (245, 190, True),  # MAVSDK
        (255, 230, True),  # MAVProxy
        (255, 0, True),  # DroneKit
        (7, 190, True),
        (4, 1, False),
        (4, 191, False),
        (250, 1, False),
        (250, 191, False),
        (SYSID, 191, False),
        (4, 68, False),
    ],
)
def test_no_autopilot_and_no_companion_may_order(sysid: int, compid: int, may_order: bool) -> None:
    assert is_ground_station(sysid, compid) == may_order
    agent = an_agent()
    station = Station(agent, sysid, compid)
    station.say(LAND)
    assert station.answers(1.1) == ([(LAND, ACCEPTED)] if may_order else [])
    assert (agent.phase is Phase.LANDING) == may_order


def test_a_burst_is_answered_in_part_and_the_datagram_stays_small() -> None:
    agent = an_agent()
    station = Station(agent)
    for _ in range(1000):
        station.say(ARM)
    assert station.answers(1.1) == [(ARM, UNSUPPORTED)] * MOST_PER_TICK
    assert station.answers(1.2) == []


def test_the_answer_still_leaves_when_the_order_ends_the_mission() -> None:
    agent = an_agent(Phase.READY, armed=False)
    station = Station(agent)
    station.say(LAND)
    assert station.answers(1.1) == [(LAND, ACCEPTED)]
    assert agent.phase is Phase.DONE


def test_with_a_key_only_signed_orders_count() -> None:
    agent, key = an_agent(), bytes(range(32))
    agent.sign_with(key, 1000)
    station = Station(agent)
    station.say(LAND)
    agent.tick(1.1)
    assert ordered(agent) == []
    station.codec.signing.secret_key = key
    station.codec.signing.sign_outgoing = True
    station.codec.signing.timestamp = 10**12
    station.say(LAND)
    agent.tick(1.2)
    assert ordered(agent) == ["land"]
