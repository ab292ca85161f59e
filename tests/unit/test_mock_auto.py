from __future__ import annotations

import math
from typing import Any

import pytest
from mock_client import ACCEPTED, AP_GUIDED, DENIED, FAILED, NAN, PX4_LOITER, REJECTED, both
from mock_planner import GLOBAL, LAND, NO_PLACE, RETURN, TAKEOFF, Item, Planner, waypoint
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.vehicle import Personality

PX4_MISSION, PX4_RTL, AP_AUTO = 4 << 16 | 4 << 24, 4 << 16 | 5 << 24, 3
NOT_STARTED, ACTIVE, PAUSED, COMPLETE = 2, 3, 4, 5


def place(north_m: float, east_m: float, height_m: float, **changes: Any) -> Item:
    """A waypoint so far from home."""
    origin = Planner("px4").client.vehicle.autopilot.origin
    there = origin.to_global(north_m, east_m, 0.0)
    x, y = round(there.latitude_deg * 1e7), round(there.longitude_deg * 1e7)
    return waypoint(x=x, y=y, z=height_m, **changes)


def no_place(command: int, *p: float, frame: int = NO_PLACE) -> Item:
    four = (*p, 0.0, 0.0, 0.0, 0.0)[:4]
    return waypoint(command=command, frame=frame, x=0, y=0, z=0.0, p=four)


def commands(planner: Planner, *items: Item) -> None:
    """Upload a mission, home first where it belongs."""
    is_px4 = planner.client.vehicle.personality == "px4"
    planner.upload(items if is_px4 else [place(0.0, 0.0, 0.0, frame=GLOBAL), *items])


def begin(planner: Planner) -> None:
    """Start the mission from the ground as each autopilot wants it."""
    client = planner.client
    client.fly(1.5)
    client.command(511, 42, 200_000)
    client.gcs_heartbeat()
    if client.vehicle.personality == "px4":
        client.set_mode(PX4_MISSION)
        assert client.command(400, 1) == [(400, ACCEPTED)]
    else:
        client.set_mode(AP_GUIDED)
        assert client.command(400, 1) == [(400, ACCEPTED)]
        assert client.set_mode(AP_AUTO) == [(176, ACCEPTED)]
        assert client.command(300) == [(300, ACCEPTED)]


def reached(planner: Planner) -> list[int]:
    """The items reached, each once."""
    heard = [m.seq for _, m in planner.client.heard if m.get_type() == "MISSION_ITEM_REACHED"]
    return list(dict.fromkeys(heard))


def fly_until_reached(planner: Planner, sequence: int, within_s: float = 60.0) -> float:
    return planner.client.fly_until(lambda: sequence in reached(planner), within_s)


def state(planner: Planner) -> tuple[int, int]:
    """MISSION_CURRENT's seq and mission_state."""
    current = planner.client.last("MISSION_CURRENT")
    return current.seq, current.mission_state


def local(planner: Planner) -> list[float]:
    """North, east and height from home."""
    s = planner.client.vehicle.autopilot.state
    return [s.north_m, s.east_m, -s.down_m]


# The recorded missions.


def test_px4_flies_the_recorded_mission_in_the_recorded_time() -> None:
    planner = Planner("px4")
    square = [place(15.0, 0.0, 8.0), place(15.0, 15.0, 12.0), place(0.0, 15.0, 8.0)]
    commands(planner, place(0, 0, 8, command=TAKEOFF), *square, place(0, 0, 0, command=LAND))
    begin(planner)
    planner.client.before_tick = planner.client.gcs_heartbeat
    took_s = [fly_until_reached(planner, sequence) for sequence in range(5)]
    assert took_s[0] == pytest.approx(11.4, abs=1.5)
    assert took_s[1:] == pytest.approx([6.2, 5.8, 6.3, 7.4], abs=1.5)
    assert local(planner) == pytest.approx([0.0, 0.0, 8.0], abs=2.2)
    planner.client.fly_until(lambda: not planner.client.vehicle.armed)
    planner.client.fly(1.0)
    assert planner.client.vehicle.mode == PX4_MISSION
    assert state(planner) == (4, COMPLETE)
    assert planner.client.texts[:4] == [
        "Armed by external command\t",
        "Executing Mission\t",
        "Climb to 8.0 meters above home\t",
        "Takeoff detected\t",
    ]
    assert planner.client.texts[-3:] == [
        "Landing detected\t",
        "Mission finished, landed\t",
        "Disarmed by landing\t",
    ]


def test_ardupilot_flies_the_recorded_mission_in_the_recorded_time() -> None:
    planner = Planner("ardupilot")
    out = [place(22.3, 0.0, 10.0), place(22.3, 15.3, 10.0)]
    commands(planner, place(0, 0, 8, command=TAKEOFF), *out, no_place(RETURN))
    begin(planner)
    assert state(planner) == (1, ACTIVE)
    assert fly_until_reached(planner, 1) == pytest.approx(8.5, abs=2.0)
    assert fly_until_reached(planner, 2) == pytest.approx(7.7, abs=1.0)
    assert fly_until_reached(planner, 3) == pytest.approx(6.15, abs=1.5)
    fly_until_reached(planner, 4, 120.0)
    planner.client.fly_until(lambda: not planner.client.vehicle.armed)
    planner.client.fly(1.0)
    assert planner.client.vehicle.mode == AP_AUTO
    assert state(planner) == (0, COMPLETE)
    assert local(planner) == pytest.approx([0.0, 0.0, 0.0], abs=1.0)
    texts = planner.client.texts
    assert texts[texts.index("Mission: 1 Takeoff") :] == [
        "Mission: 1 Takeoff",
        "Mission: 2 WP",
        "Reached command #2",
        "Mission: 3 WP",
        "Reached command #3",
        "Mission: 4 RTL",
        "Disarming motors",
    ]


# Starting.


def test_px4_arms_in_a_mission_only_if_there_is_one() -> None:
    planner = Planner("px4")
    planner.client.fly(1.5)
    assert planner.client.command(300) == [(300, DENIED)]
    planner.client.set_mode(PX4_MISSION)
    assert planner.client.command(400, 1) == [(400, REJECTED)]
    commands(planner, place(0, 0, 5, command=TAKEOFF))
    assert planner.client.command(400, 1) == [(400, ACCEPTED)]


def test_mission_start_arms_px4() -> None:
    planner = Planner("px4")
    planner.client.fly(1.5)
    commands(planner, place(0, 0, 5, command=TAKEOFF), place(5, 0, 5))
    assert planner.client.command(300) == [(300, ACCEPTED)]
    assert planner.client.vehicle.armed
    fly_until_reached(planner, 1)


def test_px4_takes_off_by_itself_for_a_mission_of_places() -> None:
    planner = Planner("px4")
    commands(planner, place(5, 0, 6))
    begin(planner)
    fly_until_reached(planner, 0)
    planner.client.fly(10.0)
    assert local(planner) == pytest.approx([5.0, 0.0, 6.0], abs=0.3)
    assert state(planner) == (0, COMPLETE)


def test_ardupilot_wants_a_mission_a_takeoff_and_a_start() -> None:
    planner = Planner("ardupilot")
    client = planner.client
    client.fly(1.5)
    client.set_mode(AP_AUTO)
    assert client.command(400, 1) == [(400, FAILED)]
    assert client.texts == ["Arm: Mode requires mission"]
    commands(planner, place(5, 0, 5))
    assert client.command(400, 1) == [(400, FAILED)]
    assert client.texts[-1] == "Arm: AUTO mode not armable"
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    assert client.set_mode(AP_AUTO) == [(176, FAILED)]
    assert client.texts[-2:] == [
        "Auto: Missing Takeoff Cmd",
        "Mode change to AUTO failed: init failed",
    ]
    commands(planner, place(0, 0, 5, command=TAKEOFF), place(5, 0, 5))
    assert client.set_mode(AP_AUTO) == [(176, ACCEPTED)]
    client.fly(6.0)
    assert client.height_m == 0.0, "nobody has said MISSION_START"
    assert client.command(300) == [(300, ACCEPTED)]
    client.fly_until(lambda: client.height_m > 4.0)


def test_ardupilot_goes_from_guided_to_auto_in_the_air() -> None:
    planner = Planner("ardupilot")
    commands(planner, place(0, 0, 5, command=TAKEOFF), place(12, 0, 5))
    planner.client.take_off(5.0)
    assert planner.client.set_mode(AP_AUTO) == [(176, ACCEPTED)]
    assert fly_until_reached(planner, 2) < 12.0
    planner.client.fly(5.0)
    assert local(planner) == pytest.approx([12.0, 0.0, 5.0], abs=0.3)
    assert planner.client.vehicle.mode == AP_AUTO


# On the way.


@both
def test_it_stays_at_a_place_as_long_as_it_says(personality: Personality) -> None:
    planner = Planner(personality)
    stay = place(10, 0, 6, p=(6.0, 0.0, 0.0, 0.0))
    commands(planner, place(0, 0, 6, command=TAKEOFF), stay, place(0, 0, 6))
    begin(planner)
    stay_s = fly_until_reached(planner, 1 if personality == "px4" else 2)
    assert local(planner) == pytest.approx([10.0, 0.0, 6.0], abs=0.3)
    assert stay_s > 6.0


@both
def test_a_jump_repeats_a_part_and_a_speed_holds_from_then_on(personality: Personality) -> None:
    planner = Planner(personality)
    first = 0 if personality == "px4" else 1
    commands(
        planner,
        place(0, 0, 6, command=TAKEOFF),
        no_place(178, 1.0, 1.0),
        place(8, 0, 6),
        place(0, 0, 6),
        no_place(177, first + 2, 1.0),
        place(0, 8, 6),
    )
    begin(planner)
    planner.client.fly_until(lambda: reached(planner)[-1:] == [first + 2])
    planner.client.fly(1.0)
    assert abs(planner.client.velocity[0]) <= 1.1
    fly_until_reached(planner, first + 5, 120.0)
    heard = [m.seq for _, m in planner.client.heard if m.get_type() == "MISSION_ITEM_REACHED"]
    changes = [s for i, s in enumerate(heard) if i == 0 or s != heard[i - 1]]
    assert changes == [first + n for n in (0, 2, 3, 2, 3, 5)]


def test_a_mission_of_nothing_but_jumps_ends() -> None:
    planner = Planner("ardupilot")
    commands(planner, place(0, 0, 4, command=TAKEOFF), no_place(177, 2, -1.0))
    begin(planner)
    planner.client.fly(15.0)
    assert state(planner)[1] == COMPLETE


def test_ardupilot_turns_its_nose_after_a_delay() -> None:
    planner = Planner("ardupilot")
    todo = (no_place(112, 3.0), no_place(115, 90.0))
    commands(planner, place(0, 0, 5, command=TAKEOFF), *todo, no_place(17))
    begin(planner)
    fly_until_reached(planner, 1)
    planner.client.fly(2.0)
    yaw_rad = planner.client.dynamics.yaw_rad[0]
    planner.client.fly(5.0)
    assert yaw_rad == pytest.approx(0.5, abs=0.05)
    assert planner.client.dynamics.yaw_rad[0] == pytest.approx(math.pi / 2, abs=0.05)


def test_ardupilot_circles_twice() -> None:
    planner = Planner("ardupilot")
    turns = place(0, 0, 6, command=18, p=(2.0, 0.0, 5.0, 0.0))
    commands(planner, place(0, 0, 6, command=TAKEOFF), turns, place(0, 0, 6))
    begin(planner)
    fly_until_reached(planner, 1)
    planner.client.fly(8.0)
    assert math.hypot(*local(planner)[:2]) == pytest.approx(5.0, abs=0.7)
    assert fly_until_reached(planner, 2) == pytest.approx(2 * 2 * math.pi * 5 / 3 - 6, abs=4.0)


# Interruptions.


@both
def test_another_mode_interrupts_a_mission_and_its_own_goes_on(personality: Personality) -> None:
    planner = Planner(personality)
    client, is_px4 = planner.client, personality == "px4"
    first = 0 if is_px4 else 1
    commands(planner, place(0, 0, 6, command=TAKEOFF), place(60, 0, 6), place(60, 9, 6))
    begin(planner)
    fly_until_reached(planner, first)
    client.fly(4.0)
    client.set_mode(PX4_LOITER if is_px4 else AP_GUIDED)
    client.fly(4.0)
    assert client.velocity == pytest.approx([0.0, 0.0, 0.0], abs=0.1)
    assert state(planner) == (first + 1, PAUSED if is_px4 else NOT_STARTED)
    client.set_mode(PX4_MISSION if is_px4 else AP_AUTO)
    client.fly(3.0)
    assert client.velocity[0] > 1.0
    assert state(planner) == (first + 1, ACTIVE)


def test_ardupilot_pauses_and_goes_on() -> None:
    planner = Planner("ardupilot")
    commands(planner, place(0, 0, 6, command=TAKEOFF), place(80, 0, 6))
    begin(planner)
    fly_until_reached(planner, 1)
    planner.client.fly(4.0)
    assert planner.client.command(193, 0) == [(193, ACCEPTED)]
    planner.client.fly(6.0)
    assert planner.client.velocity == pytest.approx([0.0, 0.0, 0.0], abs=0.1)
    assert planner.client.command(193, 1) == [(193, ACCEPTED)]
    planner.client.fly(3.0)
    assert planner.client.velocity[0] > 1.0


@both
def test_the_next_item_may_be_chosen_in_flight(personality: Personality) -> None:
    planner = Planner(personality)
    first = 0 if personality == "px4" else 1
    commands(planner, place(0, 0, 6, command=TAKEOFF), place(200, 0, 6), place(0, 6, 6))
    begin(planner)
    fly_until_reached(planner, first)
    planner.ask(mavlink.MAVLink_mission_set_current_message(7, 1, first + 2))
    fly_until_reached(planner, first + 2)
    assert reached(planner) == [first, first + 2]


def test_ardupilot_chooses_the_next_item_by_command() -> None:
    planner = Planner("ardupilot")
    assert planner.client.command(224, 3) == [(224, DENIED)]
    commands(planner, place(0, 0, 6, command=TAKEOFF), place(9, 0, 6), place(0, 6, 6))
    assert planner.client.command(224, 3) == [(224, ACCEPTED)]
    assert planner.client.command(224, 99) == [(224, DENIED)]
    assert planner.client.command(224, NAN) == [(224, DENIED)]


def test_px4_returns_by_mode_at_the_end_of_a_mission() -> None:
    planner = Planner("px4")
    commands(planner, place(0, 0, 6, command=TAKEOFF), place(9, 0, 6), no_place(RETURN))
    begin(planner)
    fly_until_reached(planner, 1)
    planner.client.fly(1.0)
    assert planner.client.vehicle.mode == PX4_RTL
    assert state(planner)[1] == COMPLETE


@both
def test_a_mission_is_flown_again_from_its_beginning(personality: Personality) -> None:
    planner = Planner(personality)
    commands(planner, place(0, 0, 4, command=TAKEOFF), place(0, 0, 0, command=LAND))
    for _ in range(2):
        planner.client.heard.clear()
        begin(planner)
        planner.client.fly_until(lambda: planner.client.height_m > 3.0)
        planner.client.fly_until(lambda: not planner.client.vehicle.armed)
        planner.client.fly(0.5)
        assert state(planner)[1] == COMPLETE
