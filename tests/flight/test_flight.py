"""One mission from power-up to landing, and what goes wrong on the way."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from flight_log import Flight

from swarm_ctl.agent.phases import Phase
from swarm_ctl.model import Operator

Launch = Callable[..., Flight]
EXPLORES = ("exploring", "avoiding")


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_vehicle_takes_off_explores_comes_home_and_lands(launch: Launch, autopilot: str) -> None:
    flight = launch(autopilot=autopilot)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    flight.fly(20)
    assert flight.truth()["coverage_fraction"] > 0.1
    flight.fly_to_the_end()
    assert flight.all_in("done")
    for controller in flight.arena.controllers:
        assert controller.agent.trouble == ""
        home = controller.agent.telemetry.position_ned_m
        assert math.hypot(home.x, home.y) < 1.0
        assert not flight.arena.fleet.vehicles[controller.index].armed
    assert flight.truth()["collisions"] == 0


def test_a_swarm_of_both_autopilots_flies_together(launch: Launch) -> None:
    flight = launch(autopilot="mixed", vehicles=4, duration_s=20.0)
    flight.fly_to_the_end()
    names = [c.agent.telemetry.autopilot.name for c in flight.arena.controllers]  # type: ignore[union-attr]
    assert names == ["px4", "ardupilot", "px4", "ardupilot"]
    assert flight.all_in("done")


def test_three_dimensions_use_the_height(launch: Launch) -> None:
    flight = launch(planner={"dimensions": 3}, flight={"climb_m_s": 1.0}, duration_s=100.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    heights = []
    for _ in range(60):
        flight.fly(1)
        heights.append(flight.agent(1).telemetry.height_m)
    assert max(heights) - min(heights) > 0.8
    assert min(heights) > 0.3
    assert max(heights) < 3.6


def test_vehicles_that_meet_hear_each_other_and_keep_apart(launch: Launch) -> None:
    flight = launch(vehicles=5, duration_s=60.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    assert flight.agent(1).peers.heard(flight.arena.now)
    flight.fly_to_the_end()
    assert flight.truth()["min_separation_m"] > 0.75
    assert flight.truth()["collisions"] == 0


def test_a_vehicle_hears_only_the_peers_in_radius(launch: Launch) -> None:
    flight = launch(vehicles=2, world={"radio": {"radius_m": 1.5}})
    flight.fly(15)
    assert flight.agent(1).peers.heard(flight.arena.now) == ()  # starts are 2 m apart


def test_a_victim_is_reported_where_it_lies(launch: Launch) -> None:
    flight = launch(vehicles=3, duration_s=200.0)
    flight.fly_until(
        lambda: any(c.agent.victims.seen for c in flight.arena.controllers), within_s=230.0
    )
    finder = next(c for c in flight.arena.controllers if c.agent.victims.seen)
    (place,) = finder.agent.victims.seen.values()
    start = flight.arena.fleet.starts_ned_m[finder.index]
    assert place.x + start[0] == pytest.approx(4.0, abs=0.3)
    assert place.y + start[1] == pytest.approx(4.0, abs=0.3)


def test_a_pilot_who_takes_the_mode_is_obeyed(launch: Launch) -> None:
    flight = launch(vehicles=2)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    agent, vehicle = flight.agent(1), flight.arena.fleet.vehicles[0]
    flight.fly(5)
    flight.arena.fleet.receive(0, pilot_chooses_loiter(), flight.arena.now)
    flight.fly_until(lambda: agent.phase is Phase.YIELDED, within_s=5)
    before = len(vehicle.setpoint_times)
    flight.fly(5)
    assert len(vehicle.setpoint_times) == before
    assert flight.agent(2).phase.value in EXPLORES
    assert "pilot" in agent.trouble
    agent.order(Operator.RESUME, flight.arena.now)
    flight.fly_until(lambda: agent.phase.value in EXPLORES, within_s=30)


def pilot_chooses_loiter() -> bytes:
    from pymavlink.dialects.v20 import ardupilotmega as mavlink  # noqa: PLC0415

    pilot = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    auto_loiter = (1.0, 4.0, 3.0, 0.0, 0.0, 0.0, 0.0)
    return bytes(pilot.command_long_encode(1, 1, 176, 0, *auto_loiter).pack(pilot))


@pytest.mark.parametrize("order", [Operator.LAND, Operator.ABORT, Operator.RETURN])
def test_an_operator_brings_everybody_down(launch: Launch, order: Operator) -> None:
    flight = launch(duration_s=500.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    flight.fly(10)
    flight.arena.order(order)
    flight.fly_to_the_end()
    assert flight.all_in("done")
    assert order.value in flight.agent(1).trouble


def test_an_order_before_take_off_keeps_everybody_on_the_ground(launch: Launch) -> None:
    flight = launch()
    flight.fly(0.5)
    flight.arena.order(Operator.LAND)
    flight.fly_to_the_end()
    assert flight.all_in("done")
    assert not any(vehicle.armed for vehicle in flight.arena.fleet.vehicles)


def test_a_paused_vehicle_stays_and_goes_on_when_told(launch: Launch) -> None:
    flight = launch(duration_s=300.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    flight.fly(5)
    agent = flight.agent(1)
    agent.order(Operator.PAUSE, flight.arena.now)
    flight.fly(2)
    held = agent.telemetry.position_ned_m
    flight.fly(20)
    assert math.dist(held, agent.telemetry.position_ned_m) < 0.5
    agent.order(Operator.RESUME, flight.arena.now)
    flight.fly(1)
    assert agent.phase.value in EXPLORES


def test_one_vehicle_that_dies_does_not_stop_the_others(launch: Launch) -> None:
    flight = launch(vehicles=3, faults=("dead:2@25",))
    flight.fly_to_the_end()
    assert [c.agent.phase for c in flight.arena.controllers] == [
        Phase.DONE,
        Phase.FAILED,
        Phase.DONE,
    ]
    assert "nothing heard from its autopilot" in flight.agent(2).trouble


def test_the_vehicle_of_a_dead_controller_lands_by_its_own_failsafe(launch: Launch) -> None:
    flight = launch(vehicles=3, faults=("controller:2@25",))
    flight.fly_to_the_end()
    assert flight.agent(2).phase is Phase.FAILED
    assert flight.agent(2).trouble == "its controller was killed"
    assert flight.agent(1).phase is Phase.DONE
    assert not flight.arena.fleet.vehicles[1].armed


def test_the_mission_ends_by_itself_when_the_whole_fleet_dies(launch: Launch) -> None:
    flight = launch(faults=("fleet@25",))
    flight.fly_to_the_end()
    assert flight.all_in("failed")
    assert 29 < flight.arena.now < 35
    assert flight.arena.notes


def test_a_low_battery_sends_the_vehicle_home(launch: Launch) -> None:
    flight = launch(duration_s=500.0, faults=("battery:1@25",), limits={"battery_critical": 0.05})
    agent = flight.agent(1)
    flight.fly_until(lambda: agent.phase is Phase.RETURNING)
    assert "battery low" in agent.trouble
    assert flight.agent(2).phase.value in EXPLORES


def test_without_rangefinders_a_vehicle_holds_and_lands(launch: Launch) -> None:
    flight = launch(duration_s=500.0, faults=("rangefinder:1@25",))
    agent = flight.agent(1)
    flight.fly_until(lambda: agent.phase is Phase.HOLDING)
    flight.fly_until(lambda: agent.phase is Phase.DONE, within_s=60)
    assert "held for" in agent.trouble


def test_a_silent_autopilot_that_comes_back_is_flown_on(launch: Launch) -> None:
    flight = launch(duration_s=500.0, limits={"link_lost_s": 20.0}, faults=("freeze:1@25",))
    agent = flight.agent(1)
    flight.fly_until(lambda: agent.phase is Phase.HOLDING)
    flight.fly_until(lambda: agent.phase.value in EXPLORES, within_s=20)


def test_a_planner_that_breaks_makes_the_vehicle_hold_and_land(
    launch: Launch, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = launch(duration_s=500.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))

    def broken(*_: Any) -> None:
        raise ValueError("no idea")

    agent = flight.agent(1)
    monkeypatch.setattr(agent, "_ask", broken)
    flight.fly_until(lambda: agent.phase is Phase.HOLDING, within_s=5)
    flight.fly_until(lambda: agent.phase is Phase.DONE, within_s=60)
    assert flight.agent(2).phase.value in EXPLORES


@pytest.mark.parametrize("part", ["tick", "receive"])
def test_a_controller_that_breaks_stops_no_other_one(
    launch: Launch, monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    flight = launch(vehicles=3, duration_s=15.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))

    def broken(*_: Any) -> None:
        raise TypeError("no idea")

    monkeypatch.setattr(flight.agent(2), part, broken)
    flight.fly_to_the_end()
    phases = [controller.agent.phase for controller in flight.arena.controllers]
    assert phases == [Phase.DONE, Phase.FAILED, Phase.DONE]
    assert flight.agent(2).trouble == "its controller broke: TypeError: no idea"


def test_the_same_seed_repeats_a_run_bit_for_bit(launch: Launch) -> None:
    hashes = []
    for seed in (7, 7, 8):
        flight = launch(seed=seed, vehicles=3, duration_s=10.0)
        flight.fly_to_the_end()
        hashes.append(flight.folder.hash.hexdigest())
    assert hashes[0] == hashes[1]
    assert hashes[0] != hashes[2]
