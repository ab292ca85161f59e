"""Every row of the table in docs/safety.md, provoked in virtual time; what it took is printed."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flight_log import Flight, choose_mode, strike

from swarm_ctl import wire
from swarm_ctl.agent.phases import Phase
from swarm_ctl.model import Operator

Launch = Callable[..., Flight]
Detect = Callable[..., float]
EXPLORES = {Phase.EXPLORING, Phase.AVOIDING}
BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
LONG = 500.0
TICK_S = 0.1
COMMANDING = {"SET_POSITION_TARGET_LOCAL_NED", "COMMAND_LONG"}
SENT = ("HEARTBEAT", "TUNNEL", *COMMANDING)
PAGE = Path(__file__).parents[2] / "docs" / "safety.md"


@pytest.fixture
def detect(record_property: Callable[[str, object], None]) -> Detect:
    """Give a function that flies on until something has happened and reports how long it took."""

    def fly_until(flight: Flight, row: str, seen: Callable[[], bool], within_s: float) -> float:
        began_s = flight.arena.now
        while not seen():
            passed_s = flight.arena.now - began_s
            assert passed_s <= within_s + 2 * TICK_S, f"{row}: not seen after {passed_s:.2f} s"
            flight.arena.step()
        passed_s = flight.arena.now - began_s
        record_property("detected", (row, round(passed_s, 2), within_s))
        return passed_s

    return fly_until


def exploring(launch: Launch, seconds: float = 8.0, **changes: Any) -> Flight:
    """Launch and fly until everybody has explored for a while."""
    flight = launch(duration_s=LONG, **changes)
    flight.fly_until(lambda: all(c.agent.phase in EXPLORES for c in flight.arena.controllers))
    flight.fly(seconds)
    return flight


def sent_by(flight: Flight, sysid: int, seconds: float) -> set[str]:
    """Fly on; give the names of what one controller sends meanwhile."""
    parser, names, receive = wire.Parser(SENT), set[str](), flight.arena.fleet.receive

    def listen(index: int, data: bytes, now: float, link: int = 0) -> None:
        if index == sysid - 1:
            names.update(wire.message(frame.id).name for frame in parser.feed(data))
        receive(index, data, now, link)

    flight.arena.fleet.receive = listen  # type: ignore[method-assign]
    flight.fly(seconds)
    flight.arena.fleet.receive = receive  # type: ignore[method-assign]
    return names


def lose_ground_station(flight: Flight, autopilot: str) -> None:
    """Let vehicle 1 miss a ground station until it has left our mode by itself."""
    vehicle = flight.arena.fleet.vehicles[0]
    vehicle.autopilot.set_parameter(
        *{"px4": ("NAV_DLL_ACT", 2.0), "ardupilot": ("FS_GCS_ENABLE", 1.0)}[autopilot]
    )
    beat = wire.message("HEARTBEAT").pack(0, 255, 190, 6, 8, 0, 0, 4, 3)
    for _ in range(30):
        flight.arena.fleet.receive(0, beat, flight.arena.now)
        flight.fly(0.1)
    ours = vehicle.mode
    flight.fly_until(lambda: vehicle.mode != ours, within_s=25)


# -- the autopilot and its link ------------------------------------------------------------------


@BOTH
def test_a_silent_autopilot_makes_the_vehicle_hold(
    launch: Launch, detect: Detect, autopilot: str
) -> None:
    flight = exploring(launch, autopilot=autopilot)
    agent = flight.agent(1)
    strike(flight, "link-loss", 3.0)
    detect(flight, "autopilot silent", lambda: agent.phase is Phase.HOLDING, 1.0)
    flight.fly_until(lambda: agent.phase in EXPLORES, within_s=20)


@BOTH
def test_a_lost_link_ends_the_stream_and_a_regained_one_is_flown_on(
    launch: Launch, detect: Detect, autopilot: str
) -> None:
    flight = exploring(launch, autopilot=autopilot)
    agent = flight.agent(1)
    if autopilot == "px4":
        flight.arena.fleet.vehicles[0].autopilot.set_parameter("COM_OBL_RC_ACT", 5.0)  # hold
    strike(flight, "link-loss", 8.0)
    detect(flight, "link lost", lambda: agent.phase is Phase.LOST, 5.0)
    assert not sent_by(flight, 1, 2.0) & COMMANDING
    flight.fly_until(lambda: agent.phase in EXPLORES, within_s=20)
    assert flight.truth()["collisions"] == 0


def test_a_vehicle_that_landed_while_its_link_was_lost_is_done(launch: Launch) -> None:
    flight = exploring(launch)
    agent = flight.agent(1)
    strike(flight, "link-loss", 20.0)  # PX4's default without a stick: it sinks and lands
    flight.fly_until(lambda: agent.phase is Phase.DONE, within_s=25)
    assert "on the ground when it was heard again" in agent.trouble


def test_a_vehicle_never_heard_again_is_given_up(launch: Launch, detect: Detect) -> None:
    flight = exploring(launch)
    agent = flight.agent(1)
    strike(flight, "dead")
    detect(flight, "autopilot gone", lambda: agent.phase is Phase.FAILED, 60.0)
    assert "nothing heard from its autopilot" in agent.trouble
    assert flight.agent(2).phase in EXPLORES


@BOTH
def test_behind_a_slow_link_a_vehicle_holds_and_lands(
    launch: Launch, detect: Detect, autopilot: str
) -> None:
    flight = exploring(launch, autopilot=autopilot, vehicles=3)
    agent = flight.agent(1)
    strike(flight, "link-delay", delay_s=0.4)
    detect(flight, "link slow", lambda: agent.phase is Phase.HOLDING, 1.5)
    assert "link slow: 0." in agent.reason
    flight.fly_until(lambda: agent.phase is Phase.DONE, within_s=40)
    assert flight.truth()["collisions"] == 0


def test_a_link_that_was_slow_for_a_while_is_flown_on(launch: Launch) -> None:
    flight = exploring(launch)
    agent = flight.agent(1)
    strike(flight, "link-delay", 4.0, delay_s=0.4)
    flight.fly_until(lambda: agent.phase is Phase.HOLDING, within_s=2)
    flight.fly_until(lambda: agent.phase in EXPLORES, within_s=10)


def test_a_vehicle_that_was_on_its_way_home_goes_on_home_when_it_is_heard_again(
    launch: Launch,
) -> None:
    flight = exploring(launch, seconds=20)
    agent = flight.agent(1)
    flight.arena.fleet.vehicles[0].autopilot.set_parameter("COM_OBL_RC_ACT", 5.0)  # hold
    agent.order(Operator.RETURN, flight.arena.now)
    flight.fly(1)
    strike(flight, "link-loss", 7.0)
    flight.fly_until(lambda: agent.phase is Phase.LOST, within_s=8)
    flight.fly_until(lambda: agent.phase in {Phase.RETURNING, Phase.LANDING}, within_s=8)
    assert agent.explored_to_s is not None


@BOTH
def test_a_vehicle_that_disarms_in_flight_has_failed(
    launch: Launch, detect: Detect, autopilot: str
) -> None:
    flight = exploring(launch, autopilot=autopilot)
    agent = flight.agent(1)
    forced = (1, 1, 400, 0, 0.0, 21196.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    flight.arena.fleet.receive(
        0, wire.message("COMMAND_LONG").pack(0, 255, 190, *forced), flight.arena.now
    )
    detect(flight, "disarmed in flight", lambda: agent.phase is Phase.FAILED, 1.0)
    assert not sent_by(flight, 1, 2.0)


# -- who flies -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("autopilot", "mode"), [("px4", 3), ("px4", 5), ("ardupilot", 5)])
def test_a_pilot_who_takes_the_mode_is_not_fought(
    launch: Launch, detect: Detect, autopilot: str, mode: int
) -> None:
    flight = exploring(launch, autopilot=autopilot)
    agent = flight.agent(1)
    choose_mode(flight, autopilot, mode)
    detect(flight, "pilot takes the mode", lambda: agent.phase is Phase.YIELDED, 1.0)
    assert "the pilot chose" in agent.trouble
    assert not sent_by(flight, 1, 5.0) & COMMANDING


@pytest.mark.parametrize("phase", [Phase.TAKEOFF, Phase.HOLDING, Phase.RETURNING, Phase.LANDING])
@BOTH
def test_a_pilot_is_obeyed_in_every_phase(launch: Launch, autopilot: str, phase: Phase) -> None:
    flight = launch(autopilot=autopilot, duration_s=LONG)
    agent = flight.agent(1)
    orders = {
        Phase.HOLDING: Operator.PAUSE,
        Phase.RETURNING: Operator.RETURN,
        Phase.LANDING: Operator.LAND,
    }
    if phase in orders:
        flight.fly_until(lambda: agent.phase in EXPLORES)
        flight.fly(15)
        agent.order(orders[phase], flight.arena.now)
    flight.fly_until(lambda: agent.phase is phase)
    flight.fly(2.5)
    assert agent.phase is phase
    choose_mode(flight, autopilot, {"px4": 3, "ardupilot": 5}[autopilot])
    flight.fly_until(lambda: agent.phase is Phase.YIELDED, within_s=1.2)
    assert not sent_by(flight, 1, 5.0) & COMMANDING


@pytest.mark.parametrize(("autopilot", "within_s"), [("px4", 6.0), ("ardupilot", 1.0)])
def test_an_autopilots_own_failsafe_is_not_fought(
    launch: Launch, detect: Detect, autopilot: str, within_s: float
) -> None:
    flight = exploring(launch, autopilot=autopilot)
    agent = flight.agent(1)
    lose_ground_station(flight, autopilot)
    detect(flight, "autopilot's own failsafe", lambda: agent.phase is Phase.YIELDED, within_s)
    assert "its autopilot's own failsafe" in agent.trouble
    assert not sent_by(flight, 1, 5.0) & COMMANDING


@pytest.mark.parametrize("order", sorted(set(Operator) - {Operator.START}))  # it flies already
def test_an_order_is_followed_at_the_next_tick(
    launch: Launch, detect: Detect, order: Operator
) -> None:
    flight = exploring(launch, seconds=15)
    agent = flight.agent(1)
    if order is Operator.RESUME:
        agent.order(Operator.PAUSE, flight.arena.now)
        flight.fly(2)
    ends = {
        Operator.PAUSE: {Phase.HOLDING},
        Operator.RESUME: EXPLORES,
        Operator.RETURN: {Phase.RETURNING},
        Operator.LAND: {Phase.LANDING},
        Operator.ABORT: {Phase.LANDING},
    }
    agent.order(order, flight.arena.now)
    detect(flight, f"operator orders {order}", lambda: agent.phase in ends[order], TICK_S)


# -- sensors and estimates -----------------------------------------------------------------------


@BOTH
def test_a_position_that_stops_coming_makes_the_vehicle_hold_and_land(
    launch: Launch, detect: Detect, autopilot: str
) -> None:
    flight = exploring(launch, autopilot=autopilot)
    agent = flight.agent(1)
    strike(flight, "frozen-telemetry")
    detect(flight, "position stale", lambda: agent.phase is Phase.HOLDING, 1.0)
    detect(flight, "no recovery: land", lambda: agent.phase is Phase.LANDING, 10.0)
    flight.fly_until(lambda: not flight.arena.fleet.vehicles[0].armed, within_s=60)


@BOTH
def test_a_lost_position_estimate_brings_the_vehicle_down(
    launch: Launch, detect: Detect, autopilot: str
) -> None:
    flight = exploring(launch, autopilot=autopilot)
    agent = flight.agent(1)
    strike(flight, "gnss-loss")
    held = {Phase.HOLDING, Phase.YIELDED}
    detect(flight, "position estimate lost", lambda: agent.phase in held, 10.0)
    flight.fly_until(lambda: not flight.arena.fleet.vehicles[0].armed, within_s=90)


def test_a_position_that_jumps_makes_the_vehicle_wait(launch: Launch, detect: Detect) -> None:
    flight = exploring(launch)
    agent = flight.agent(1)
    strike(flight, "drift", fraction=0.0, jump_m=3.0)
    detect(flight, "position jumps", lambda: agent.phase is Phase.HOLDING, 2 * TICK_S)
    assert agent.telemetry.jump_m == pytest.approx(3.0, abs=0.3)
    assert "jumped by" in agent.reason
    flight.fly_until(lambda: agent.phase in EXPLORES, within_s=4)


def test_a_copter_whose_position_jumps_as_it_climbs_is_stopped_before_it_flies_there(
    launch: Launch,
) -> None:
    flight = launch(autopilot="ardupilot", duration_s=LONG)
    agent, body = flight.agent(1), flight.arena.fleet.dynamics
    flight.fly_until(lambda: agent.phase is Phase.TAKEOFF and agent.telemetry.height_m > 0.5)
    began_ned_m = body.position_ned_m[0].copy()
    strike(flight, "drift", fraction=0.0, jump_m=6.0)
    flight.fly(3.0)
    assert agent.phase not in {Phase.TAKEOFF, Phase.LANDING}
    assert np.linalg.norm((body.position_ned_m[0] - began_ned_m)[:2]) < 0.6


def test_rangefinders_that_fall_silent_make_the_vehicle_hold_and_land(
    launch: Launch, detect: Detect
) -> None:
    flight = exploring(launch)
    agent = flight.agent(1)
    strike(flight, "rangefinder")
    detect(flight, "rangefinder stale", lambda: agent.phase is Phase.HOLDING, 0.5)
    flight.fly_until(lambda: agent.phase is Phase.LANDING, within_s=11)


def test_without_rangefinders_nobody_takes_off(launch: Launch, detect: Detect) -> None:
    flight = launch(faults=("rangefinder:1@0",), flight={"ready_timeout_s": 10.0})
    agent = flight.agent(1)
    detect(flight, "rangefinders absent", lambda: agent.phase is Phase.FAILED, 10.0)
    assert "no rangefinders front, back, left and right" in agent.trouble
    assert not flight.arena.fleet.vehicles[0].armed


def test_in_open_air_a_vehicle_flies_without_rangefinders(launch: Launch) -> None:
    flight = launch(
        vehicles=1, faults=("rangefinder:1@0",), flight={"open_air": True}, limits={"radius_m": 4.0}
    )
    flight.fly_to_the_end()
    assert flight.all_in("done")
    assert flight.agent(1).trouble == ""
    assert flight.truth()["collisions"] == 0


# -- planner -------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["raises", "gives nothing"])
def test_a_planner_that_stalls_makes_the_vehicle_hold_and_land(
    launch: Launch, detect: Detect, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    flight = exploring(launch)
    agent = flight.agent(1)

    def broken(*_: Any) -> None:
        if how == "raises":
            raise ValueError("no idea")

    monkeypatch.setattr(agent, "_ask", broken)
    detect(flight, "planner stalled", lambda: agent.phase is Phase.HOLDING, 1.0)
    detect(flight, "no recovery: land", lambda: agent.phase is Phase.LANDING, 10.0)


# -- limits --------------------------------------------------------------------------------------


def test_a_vehicle_blown_over_its_fence_is_steered_back(launch: Launch, detect: Detect) -> None:
    flight = exploring(launch, limits={"radius_m": 3.0}, flight={"open_air": True})
    agent = flight.agent(1)
    strike(flight, "wind-gust", 2.0, speed_m_s=9.0)
    detect(flight, "outside the fence", lambda: agent.vigil.outside_s is not None, 4.0)
    flight.fly_until(lambda: agent.vigil.outside_s is None, within_s=10)
    assert agent.phase in EXPLORES


def test_a_vehicle_that_cannot_come_back_behind_its_fence_lands(
    launch: Launch, detect: Detect
) -> None:
    flight = exploring(launch, limits={"radius_m": 3.0}, flight={"open_air": True})
    agent = flight.agent(1)
    strike(flight, "drift", fraction=0.0, jump_m=20.0)
    detect(flight, "outside the fence: land", lambda: agent.phase is Phase.LANDING, 12.0)
    assert "outside its fence" in agent.trouble


def test_peers_much_too_close_are_pushed_apart(launch: Launch, detect: Detect) -> None:
    flight = exploring(launch, vehicles=2)
    agent = flight.agent(1)
    dynamics = flight.arena.fleet.dynamics
    dynamics.position_ned_m[1] = dynamics.position_ned_m[0] + np.array([0.4, 0.0, 0.0])
    detect(flight, "peer too close", lambda: agent.vigil.is_crowded, 0.4)
    flight.fly_until(lambda: not agent.vigil.is_crowded, within_s=6)
    assert flight.truth()["min_separation_m"] < 0.5


def test_the_battery_for_the_way_home_is_kept(launch: Launch, detect: Detect) -> None:
    flight = exploring(launch, seconds=0.0)
    agent = flight.agent(1)
    strike(flight, "battery-drain", power_w=700.0)
    detect(flight, "battery for the way home", lambda: agent.phase is Phase.RETURNING, 400.0)
    assert agent.telemetry.battery_fraction is not None
    assert agent.telemetry.battery_fraction > agent.orders.limits.battery_reserve
    flight.fly_until(lambda: agent.phase is Phase.DONE, within_s=120)
    assert agent.telemetry.battery_fraction > agent.orders.limits.battery_reserve - 0.02


def test_a_low_battery_sends_the_vehicle_home(launch: Launch, detect: Detect) -> None:
    flight = exploring(launch)
    agent = flight.agent(1)
    strike(flight, "battery", fraction=0.2)
    detect(flight, "battery low", lambda: agent.phase is Phase.RETURNING, 1.1)


def test_a_critical_battery_lands_the_vehicle_where_it_is(launch: Launch, detect: Detect) -> None:
    flight = exploring(launch)
    agent = flight.agent(1)
    strike(flight, "battery", fraction=0.1)
    detect(flight, "battery critical", lambda: agent.phase is Phase.LANDING, 1.1)


def test_nobody_flies_longer_than_the_longest_mission_time(launch: Launch, detect: Detect) -> None:
    flight = launch(duration_s=50.0, limits={"max_time_s": 51.0})
    flight.fly(49.0)
    detect(flight, "longest mission time", lambda: flight.all_in("landing", "done"), 2.2)


def test_who_is_not_home_in_time_lands_where_the_ground_is_free(
    launch: Launch, detect: Detect
) -> None:
    flight = exploring(launch, seconds=30.0, vehicles=1, flight={"return_timeout_s": 0.0})
    agent = flight.agent(1)
    agent.order(Operator.RETURN, flight.arena.now)
    detect(flight, "not home in time", lambda: agent.phase is Phase.LANDING, 5.0)
    assert "not home after" in agent.reason


# -- before take-off -----------------------------------------------------------------------------


@BOTH
def test_a_vehicle_that_is_armed_already_is_left_alone(
    launch: Launch, detect: Detect, autopilot: str
) -> None:
    flight = launch(autopilot=autopilot)
    agent, fleet = flight.agent(1), flight.arena.fleet
    while not fleet.vehicles[0].armed:
        fleet.step(flight.arena.now)
        flight.arena._step += 1
        flight.arena.now = flight.arena._step * 0.02
        arm = (1, 1, 400, 0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        fleet.receive(0, wire.message("COMMAND_LONG").pack(0, 255, 190, *arm), flight.arena.now)
    detect(flight, "armed already", lambda: agent.phase is Phase.FAILED, 1.2)
    assert "somebody else" in agent.trouble
    assert fleet.vehicles[0].armed


def test_a_vehicle_that_is_never_ready_says_what_is_missing(launch: Launch, detect: Detect) -> None:
    flight = launch(faults=("gnss-loss:1@0",), flight={"ready_timeout_s": 20.0})
    agent = flight.agent(1)
    detect(flight, "never ready", lambda: agent.phase is Phase.FAILED, 20.0)
    assert "not ready after 20 s: no " in agent.trouble


@BOTH
def test_a_vehicle_that_will_not_arm_says_why(
    launch: Launch, detect: Detect, autopilot: str
) -> None:
    flight = launch(autopilot=autopilot)
    agent = flight.agent(1)
    strike(flight, "nack", command=400.0, result="denied")
    flight.fly_until(lambda: agent.phase is Phase.ARMING)
    detect(flight, "will not arm", lambda: agent.phase is Phase.FAILED, 30.0)
    assert "did not arm within 30 s: arming was denied" in agent.trouble


def test_the_page_on_safety_names_tests_that_exist() -> None:
    tests = "".join(file.read_text() for file in Path(__file__).parents[1].rglob("test_*.py"))
    rows = re.findall(r"`(test_\w+)`", PAGE.read_text())
    assert len(rows) > 20
    assert [name for name in rows if f"def {name}(" not in tests] == []
