"""No phase is a trap: whatever an autopilot does or leaves, every vehicle is accounted for."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from flight_log import Flight, strike

from swarm_ctl import wire
from swarm_ctl.agent.phases import Phase
from swarm_ctl.model import Operator

Launch = Callable[..., Flight]
EXPLORES = {Phase.EXPLORING, Phase.AVOIDING}
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
MOST_S, LANDING_S, GONE_S = 60.0, 90.0, 60.0
"""Longest mission time, landing and silence; one may begin when the one before ends."""
ORDERS = {
    Phase.HOLDING: Operator.PAUSE,
    Phase.RETURNING: Operator.RETURN,
    Phase.LANDING: Operator.LAND,
}
PHASES = [Phase.CONNECTING, Phase.ARMING, Phase.TAKEOFF, Phase.EXPLORING, *ORDERS, Phase.LOST]


def in_phase(flight: Flight, phase: Phase) -> None:
    agent = flight.agent(1)
    if phase in ORDERS or phase is Phase.LOST:
        flight.fly_until(lambda: agent.phase in EXPLORES)
        flight.fly(8)
    if phase in ORDERS:
        agent.order(ORDERS[phase], flight.arena.now)
    if phase is Phase.LOST:
        strike(flight, "link-loss", 7.0)
    flight.fly_until(lambda: agent.phase is phase)


def lose_heartbeats(flight: Flight) -> None:
    """Let the controller of vehicle 1 hear everything but HEARTBEAT and CURRENT_MODE."""
    controller, modes = flight.arena.controllers[0], wire.Parser(("HEARTBEAT", "CURRENT_MODE"))
    hear = controller.receive

    def listen(data: bytes, now: float) -> None:
        if not list(modes.feed(data)):
            hear(data, now)

    controller.receive = listen  # type: ignore[method-assign]


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize(
    "trouble", ["refuses", "is deaf", "is silent", "tells no mode", "hangs", "comes and goes"]
)
@BOTH
def test_no_phase_is_a_trap(launch: Launch, autopilot: str, phase: Phase, trouble: str) -> None:
    limits = {"max_time_s": MOST_S, "ceiling_m": 3.5, "radius_m": 50.0}
    flight = launch(autopilot=autopilot, vehicles=1, duration_s=55.0, limits=limits)
    in_phase(flight, phase)
    match trouble:
        case "refuses":
            strike(flight, "nack", result="denied")
        case "is deaf":
            strike(flight, "link-loss", direction="uplink")
        case "is silent":
            strike(flight, "link-loss", direction="downlink")
        case "tells no mode":
            lose_heartbeats(flight)
        case "hangs":
            strike(flight, "frozen-telemetry")
        case "comes and goes":
            strike(flight, "link-burst", period_s=1.5, direction="downlink")
    flight.arena.fly(until_s=MOST_S + LANDING_S + GONE_S)
    assert flight.arena.is_over, flight.agent(1).phase
    if trouble != "hangs" or phase is not Phase.LOST:  # told that it stands, it climbs
        assert flight.truth()["collisions"] == 0


@BOTH
@pytest.mark.parametrize("after_s", [0.0, 1.0, 2.0])
def test_a_position_that_hangs_stops_a_climb(
    launch: Launch, autopilot: str, after_s: float
) -> None:
    flight = launch(autopilot=autopilot, vehicles=1, world={"ceiling_m": 60.0})
    agent, dynamics = flight.agent(1), flight.arena.fleet.dynamics
    flight.fly_until(lambda: agent.phase is Phase.TAKEOFF)
    flight.fly(after_s)
    strike(flight, "frozen-telemetry")
    highest_m = 0.0
    while not flight.arena.is_over:
        flight.arena.step()
        highest_m = max(highest_m, -float(dynamics.position_ned_m[0][2]))
    assert highest_m < agent.orders.flight.height_m + 2.0
    assert "did not " in agent.trouble or "held for" in agent.trouble


@BOTH
def test_a_hold_before_a_lost_link_does_not_count_after_it(launch: Launch, autopilot: str) -> None:
    flight = launch(autopilot=autopilot, vehicles=1, duration_s=500.0)
    agent = flight.agent(1)
    if autopilot == "px4":
        flight.arena.fleet.vehicles[0].autopilot.set_parameter("COM_OBL_RC_ACT", 5.0)  # hold
    in_phase(flight, Phase.EXPLORING)
    strike(flight, "link-loss", 15.0)
    flight.fly_until(lambda: agent.phase is Phase.LOST)
    flight.fly_until(lambda: agent.phase is not Phase.LOST)
    flight.fly(3)
    assert agent.phase in EXPLORES


@BOTH
def test_a_battery_that_is_empty_before_take_off_keeps_it_on_the_ground(
    launch: Launch, autopilot: str
) -> None:
    flight = launch(autopilot=autopilot, vehicles=1)
    agent, armed = flight.agent(1), False
    flight.fly_until(lambda: agent.phase is Phase.ARMING)
    strike(flight, "battery", fraction=0.05)
    while not flight.arena.is_over:
        flight.arena.step()
        armed |= flight.arena.fleet.vehicles[0].armed and agent.in_phase_s > 1.5
    assert agent.phase is Phase.DONE
    assert "battery critical" in agent.trouble
    assert not armed


@BOTH
def test_who_is_to_land_stops_though_the_landing_is_refused(launch: Launch, autopilot: str) -> None:
    flight = launch(autopilot=autopilot, vehicles=1, duration_s=500.0)
    agent, dynamics = flight.agent(1), flight.arena.fleet.dynamics
    in_phase(flight, Phase.EXPLORING)
    flight.fly_until(lambda: abs(agent.telemetry.velocity_ned_m_s.x) > 0.7)
    strike(flight, "nack", command=21.0, result="denied")
    agent.order(Operator.LAND, flight.arena.now)
    flight.fly(2.0)
    assert abs(dynamics.velocity_ned_m_s[0][:2]).max() < 0.1
