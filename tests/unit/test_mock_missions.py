from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mock_client import NAN, both
from mock_planner import (
    BAD_COMMAND,
    BAD_FRAME,
    BAD_LATITUDE,
    BAD_SEQUENCE,
    CANCELLED,
    ERROR,
    FENCE,
    GLOBAL,
    GLOBAL_INT,
    HOME_E7,
    INT_MAX,
    LOCAL,
    MISSION,
    NO_ALTITUDE,
    NO_PLACE,
    NO_SPACE,
    OK,
    RALLY,
    REL,
    REL_INT,
    RETURN,
    WAYPOINT,
    Item,
    Planner,
    summary,
    waypoint,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.vehicle import Personality

REQUEST = {"px4": "REQUEST_INT", "ardupilot": "REQUEST"}


# Uploads.


@both
def test_an_upload_asks_for_every_item_and_is_acknowledged(personality: Personality) -> None:
    planner = Planner(personality)
    requests = [(REQUEST[personality], sequence) for sequence in range(5)]
    assert planner.upload([waypoint()] * 5) == [*requests, ("ACK", OK)]
    assert planner.length() == 5
    ack = planner.client.last("MISSION_ACK")
    assert (ack.target_system, ack.target_component, ack.mission_type) == (255, 190, MISSION)
    assert planner.client.texts == ([] if personality == "px4" else ["Flight plan received"])


REFUSALS = [
    ({"command": 31999}, BAD_COMMAND, BAD_COMMAND),
    ({"frame": 12}, BAD_FRAME, BAD_FRAME),
    ({"frame": 99}, BAD_FRAME, BAD_FRAME),
    ({"frame": LOCAL, "x": 10, "y": 10}, BAD_FRAME, BAD_FRAME),
    ({"x": 990000000}, OK, BAD_LATITUDE),
    ({"x": INT_MAX, "y": INT_MAX}, OK, BAD_LATITUDE),
    ({"y": 1900000000}, OK, 11),
    ({"z": NAN}, OK, NO_ALTITUDE),
    ({"p": (NAN, 0.0, 0.0, 0.0)}, OK, 6),
    ({"p": (0.0, 0.0, 0.0, NAN)}, OK, OK),
    ({"command": RETURN}, BAD_COMMAND, OK),
    ({"command": RETURN, "frame": NO_PLACE, "x": 0, "y": 0, "z": 0.0}, OK, OK),
]


@pytest.mark.parametrize(("changes", "by_px4", "by_ardupilot"), REFUSALS)
@both
def test_an_item_is_refused_as_each_autopilot_does(
    personality: Personality, changes: Item, by_px4: int, by_ardupilot: int
) -> None:
    planner = Planner(personality)
    planner.count(3)
    planner.item(0, waypoint())
    planner.item(1, waypoint())
    expected = by_px4 if personality == "px4" else by_ardupilot
    assert summary(planner.item(2, waypoint(**changes))) == [("ACK", expected)]
    assert not planner.wait(9.0), "it is over"


@pytest.mark.parametrize(
    ("count", "kind", "by_px4", "by_ardupilot"),
    [
        (60000, MISSION, NO_SPACE, NO_SPACE),
        (5000, MISSION, None, NO_SPACE),
        (0, MISSION, OK, OK),
        (0, FENCE, OK, OK),
        (5, 7, BAD_COMMAND, BAD_COMMAND),
    ],
)
@both
def test_a_count_is_judged_before_any_item(
    personality: Personality, count: int, kind: int, by_px4: int | None, by_ardupilot: int
) -> None:
    planner = Planner(personality)
    planner.upload([waypoint()] * 2)
    expected = by_px4 if personality == "px4" else by_ardupilot
    said = summary(planner.count(count, kind))
    assert said == ([(REQUEST[personality], 0)] if expected is None else [("ACK", expected)])
    if personality == "ardupilot" and count > 650:
        assert planner.client.texts[-1] == "Only 650 items are supported"
    planner.done(CANCELLED, kind)
    assert planner.length() == (0 if (count, kind) == (0, MISSION) else 2)


def test_px4_asks_a_silent_client_for_5_s_and_says_nothing() -> None:
    planner = Planner("px4")
    planner.upload([waypoint()] * 2)
    planner.count(5)
    planner.item(0, waypoint())
    said = planner.wait(9.0)
    assert {(kind, sequence) for _, kind, sequence in said} == {("REQUEST_INT", 1)}
    assert said[0][0] == pytest.approx(0.3)
    assert said[-1][0] == pytest.approx(5.0, abs=0.3)
    assert 16 <= len(said) <= 19
    assert planner.length() == 2, "the old plan is whole"


def test_ardupilot_asks_every_second_and_cancels_after_8_s() -> None:
    planner = Planner("ardupilot")
    planner.count(5)
    planner.item(0, waypoint())
    planner.item(1, waypoint())
    asked = [(float(at), "REQUEST", 2) for at in range(1, 8)]
    assert planner.wait(12.0) == [*asked, (8.0, "ACK", CANCELLED)]
    assert planner.client.texts == ["Mission upload timeout"]


@pytest.mark.parametrize(("before", "count", "sent", "left"), [(5, 3, 1, 3), (5, 8, 6, 6)])
def test_ardupilot_keeps_what_an_interrupted_upload_has_brought(
    before: int, count: int, sent: int, left: int
) -> None:
    planner = Planner("ardupilot")
    planner.upload([waypoint()] * before)
    planner.count(count)
    for sequence in range(sent):
        planner.item(sequence, waypoint(z=33.0))
    planner.wait(9.0)
    assert planner.length() == left
    heights = [planner.request(sequence)[0].z for sequence in range(1, left)]
    assert heights == [33.0 if sequence < sent else 8.0 for sequence in range(1, left)]


def test_ardupilot_refuses_an_item_out_of_turn_and_goes_on() -> None:
    planner = Planner("ardupilot")
    planner.count(2)
    assert summary(planner.item(1, waypoint())) == [("ACK", BAD_SEQUENCE)]
    assert summary(planner.item(0, waypoint())) == [("REQUEST", 1)]
    assert summary(planner.item(1, waypoint())) == [("ACK", OK)]


def test_px4_waits_longer_for_whom_sends_an_item_out_of_turn() -> None:
    planner = Planner("px4")
    planner.count(2)
    planner.item(0, waypoint())
    planner.wait(4.0)
    assert not planner.item(0, waypoint()), "the right one is asked for when that is due"
    planner.wait(4.0)
    assert summary(planner.count(5)) == [("ACK", ERROR)], "it is still busy"
    assert summary(planner.item(1, waypoint())) == [("ACK", OK)]


def test_a_second_count_restarts_ardupilot_and_finds_px4_waiting_for_the_first() -> None:
    px4, ardupilot = Planner("px4"), Planner("ardupilot")
    for planner in (px4, ardupilot):
        planner.count(5)
        assert summary(planner.count(3))[0][1] == 0
        planner.item(0, waypoint())
    assert summary(px4.count(3)) == [("ACK", ERROR)]
    assert summary(ardupilot.count(3)) == [("REQUEST", 0)]
    ardupilot.client.mav.srcSystem = 254
    assert summary(ardupilot.count(3)) == [("ACK", 14)]


@both
def test_a_client_may_cancel(personality: Personality) -> None:
    planner = Planner(personality)
    planner.count(5)
    assert not planner.done(CANCELLED)
    assert not planner.wait(9.0)
    assert planner.upload([waypoint()])[-1] == ("ACK", OK)


def test_an_item_that_nobody_asked_for_is_an_error_on_ardupilot_alone() -> None:
    assert summary(Planner("ardupilot").item(1, waypoint())) == [("ACK", ERROR)]
    assert not Planner("px4").item(1, waypoint())


@both
def test_items_in_degrees_of_32_bits_are_taken(personality: Personality) -> None:
    planner = Planner(personality)
    planner.upload([waypoint()])
    planner.client.heard.clear()
    planner.count(2)
    planner.item(0, waypoint(frame=REL), floats=True)
    planner.item(1, waypoint(frame=REL), floats=True)
    item = planner.download()[1]
    assert (item.x, item.y) == pytest.approx((HOME_E7[0] + 1000, HOME_E7[1]), abs=40)
    complaint = "got MISSION_ITEM; GCS should send MISSION_ITEM_INT"
    assert (complaint in planner.client.texts) == (personality == "ardupilot")


def test_a_part_of_an_ardupilot_mission_is_overwritten() -> None:
    planner = Planner("ardupilot")
    planner.upload([waypoint()] * 5)
    make = mavlink.MAVLink_mission_write_partial_list_message
    assert summary(planner.ask(make(7, 1, 2, 3, MISSION))) == [("REQUEST", 2)]
    assert summary(planner.item(2, waypoint(z=21.0))) == [("REQUEST", 3)]
    assert summary(planner.item(3, waypoint(z=31.0))) == [("ACK", OK)]
    assert [item.z for item in planner.download()[1:]] == [8.0, 21.0, 31.0, 8.0]
    assert summary(planner.ask(make(7, 1, 4, 9, MISSION))) == [("ACK", ERROR)]


# Downloads.


def test_ardupilot_puts_home_first_and_gives_back_its_own_frames() -> None:
    planner = Planner("ardupilot")
    items = [
        waypoint(frame=GLOBAL, z=3.0),
        waypoint(p=(1.0, 2.0, 3.0, NAN)),
        waypoint(frame=GLOBAL_INT, z=500.0),
        waypoint(command=RETURN),
    ]
    planner.upload(items)
    home, near, high, back = planner.download()
    origin = planner.client.vehicle.autopilot.origin
    assert (home.frame, home.command) == (GLOBAL, WAYPOINT)
    assert home.x == pytest.approx(origin.latitude_deg * 1e7, abs=1)
    assert home.z == pytest.approx(origin.amsl_m, abs=0.01)
    assert (near.frame, near.x, near.z, near.param1, near.param4) == (REL, items[1]["x"], 8.0, 1, 0)
    assert (high.frame, high.z) == (GLOBAL, 500.0)
    assert (back.frame, back.x, back.y, back.z) == (GLOBAL, 0, 0, 0.0)
    assert planner.request(77, floats=True)[0].get_type() == "MISSION_COUNT"
    assert summary(planner.request(77)) == [("COUNT", 4), ("ACK", BAD_SEQUENCE)]


def test_px4_gives_back_what_it_was_given() -> None:
    planner = Planner("px4")
    planner.upload([waypoint(p=(0.0, 0.0, 0.0, NAN), current=1), waypoint(frame=GLOBAL)])
    first, second = planner.download()
    assert (first.frame, first.current, second.frame, second.current) == (REL_INT, 1, GLOBAL_INT, 0)
    assert first.param4 != first.param4
    planner.length()
    assert planner.request(0, floats=True)[0].frame == REL
    planner.request(1, floats=True)
    planner.done()
    assert summary(planner.count(1)) == [("REQUEST", 0)], "it remembers who cannot read integers"


def test_px4_is_busy_until_a_download_is_acknowledged() -> None:
    planner = Planner("px4")
    assert not planner.request(0)
    planner.upload([waypoint()] * 3)
    assert planner.length() == 3
    planner.request(0)
    assert not planner.request(2), "out of turn"
    assert planner.request(0), "the answer was lost"
    planner.request(1)
    planner.request(2)
    assert summary(planner.count(1)) == [("ACK", ERROR)]
    planner.done()
    assert summary(planner.count(1)) == [("REQUEST_INT", 0)]


@pytest.mark.parametrize("kind", [MISSION, 255])
def test_a_download_is_over_when_its_plan_is_cleared(kind: int) -> None:
    planner = Planner("px4")
    planner.upload([waypoint()] * 3)
    assert planner.length() == 3
    planner.ask(mavlink.MAVLink_mission_clear_all_message(7, 1, kind))
    assert not planner.request(0)
    assert summary(planner.count(1)) == [("REQUEST_INT", 0)]


def test_ardupilot_refuses_to_be_read_while_it_is_written() -> None:
    planner = Planner("ardupilot")
    planner.upload([waypoint()] * 3)
    planner.count(3)
    request_list = mavlink.MAVLink_mission_request_list_message(7, 1, MISSION)
    assert summary(planner.ask(request_list)) == [("ACK", 14)]
    assert summary(planner.request(1)) == [("ACK", 14)]


def test_ardupilot_complains_once_of_an_outdated_request() -> None:
    planner = Planner("ardupilot")
    planner.upload([waypoint()] * 2)
    item, text = planner.request(1, floats=True)
    assert (item.get_type(), item.frame) == ("MISSION_ITEM", REL)
    assert item.x == pytest.approx((HOME_E7[0] + 1000) * 1e-7, abs=1e-5)
    assert text.text == "got MISSION_REQUEST; use MISSION_REQUEST_INT!"
    assert len(planner.request(1, floats=True)) == 1


# Kinds.


@both
def test_mission_fence_and_rally_are_kept_apart(personality: Personality) -> None:
    planner = Planner(personality)
    corner = waypoint(frame=GLOBAL, command=5001, p=(4.0, 0.0, 0.0, 0.0), z=0.0)
    planner.upload([waypoint()] * 3)
    planner.upload([corner] * 4, FENCE)
    planner.upload([waypoint(command=5100)], RALLY)
    assert [planner.length(kind) for kind in (MISSION, FENCE, RALLY)][:1] == [3]
    planner.done()
    frames = [item.frame for item in planner.download(FENCE)]
    assert frames == [GLOBAL_INT if personality == "px4" else GLOBAL] * 4
    assert [item.command for item in planner.download(RALLY)] == [5100]
    assert planner.upload([waypoint()], FENCE)[-1] == ("ACK", BAD_COMMAND)
    planner.ask(mavlink.MAVLink_mission_clear_all_message(7, 1, FENCE))
    assert [len(planner.download(kind)) for kind in (MISSION, FENCE, RALLY)] == [3, 0, 1]
    said = planner.ask(mavlink.MAVLink_mission_clear_all_message(7, 1, 255))
    assert (said[0].type, said[0].mission_type) == (OK, 255)
    assert [len(planner.download(kind)) for kind in (MISSION, FENCE, RALLY)] == [0, 0, 0]


@both
def test_plans_survive_a_reboot(personality: Personality) -> None:
    planner = Planner(personality)
    planner.upload([waypoint()] * 2)
    planner.client.vehicle.autopilot.reboot(planner.client.now)
    assert planner.length() == 2


@both
def test_plans_for_others_are_ignored(personality: Personality) -> None:
    planner = Planner(personality)
    assert not planner.ask(mavlink.MAVLink_mission_count_message(8, 1, 3, MISSION))
    assert not planner.ask(mavlink.MAVLink_mission_request_list_message(8, 1, MISSION))
    assert not planner.ask(mavlink.MAVLink_mission_clear_all_message(8, 1, MISSION))


# MISSION_CURRENT.


def current(planner: Planner) -> tuple[int, int, int, int]:
    planner.client.command(512, 42)
    m = planner.client.last("MISSION_CURRENT")
    return m.seq, m.total, m.mission_state, m.mission_mode


@pytest.mark.parametrize(
    ("personality", "idle", "planned", "chosen"),
    [
        ("px4", (0, 65535, 1, 2), (0, 5, 2, 2), (3, 5, 2, 2)),
        ("ardupilot", (0, 0, 1, 0), (0, 4, 2, 0), (3, 4, 2, 0)),
    ],
)
def test_mission_current_tells_what_was_recorded(
    personality: Personality, idle: Any, planned: Any, chosen: Any
) -> None:
    planner = Planner(personality)
    choose = mavlink.MAVLink_mission_set_current_message(7, 1, 3)
    assert not planner.ask(choose), "there is no mission"
    assert current(planner) == idle
    planner.upload([waypoint()] * 5)
    assert current(planner) == planned
    (answer,) = planner.ask(choose)
    assert answer.get_type() == "MISSION_CURRENT"
    assert current(planner) == chosen
    assert not planner.ask(mavlink.MAVLink_mission_set_current_message(7, 1, 999))
    assert current(planner) == chosen


# Whatever comes.


FLOATS = st.floats(width=32) | st.sampled_from([0.0, 1.0, -1.0, math.nan, math.inf])
COMMANDS = st.sampled_from([16, 17, 18, 19, 20, 21, 22, 31, 82, 93, 112, 115, 177, 178, 5001, 5003])
FRAMES = st.sampled_from([0, 1, 2, 3, 5, 6, 10, 11, 99])
E7 = st.integers(-(2**31), INT_MAX) | st.sampled_from([0, INT_MAX, *HOME_E7])
ITEMS = st.builds(
    waypoint,
    command=COMMANDS,
    frame=FRAMES,
    x=E7,
    y=E7,
    z=FLOATS,
    p=st.tuples(FLOATS, FLOATS, FLOATS, FLOATS),
    current=st.integers(0, 3),
)


@both
@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
@given(items=st.lists(ITEMS, max_size=6), floats=st.booleans())
def test_any_plan_is_stored_and_flown_without_harm(
    personality: Personality, items: list[Item], floats: bool
) -> None:
    planner = Planner(personality)
    client = planner.client
    client.take_off(5.0)
    takeoff = waypoint(command=22)
    for kind in (MISSION, FENCE, RALLY):
        plan = [waypoint(), takeoff, *(i for i in items if (i["command"] > 5000) == (kind > 0))]
        planner.count(len(plan), kind)
        for sequence, item in enumerate(plan):
            planner.item(sequence, item, kind, floats=floats)
        planner.done(CANCELLED, kind)
    client.set_mode(4 << 16 | 4 << 24 if personality == "px4" else 3)
    for sequence in range(2, 2 + len(items)):
        planner.ask(mavlink.MAVLink_mission_set_current_message(7, 1, sequence))
        client.fly(1.0)
    client.set_mode(4 << 16 | 5 << 24 if personality == "px4" else 6)
    client.fly(1.0)
    assert all(map(math.isfinite, client.dynamics.position_ned_m[0]))


def test_ardupilot_counts_its_items_in_parameters() -> None:
    planner = Planner("ardupilot", rates="full")
    client = planner.client
    client.fly(1.5)
    assert planner.length() == 1, "home"
    planner.upload([waypoint()] * 3)
    client.fly(0.1)
    corner = waypoint(frame=GLOBAL, command=5001, p=(4.0, 0.0, 0.0, 0.0), z=0.0)
    planner.upload([corner] * 4, FENCE)
    client.fly(0.1)
    planner.ask(mavlink.MAVLink_mission_clear_all_message(7, 1, MISSION))
    client.fly(0.1)
    told = [m for _, m in client.heard if m.get_type() == "PARAM_VALUE"]
    totals = [(m.param_id, m.param_value) for m in told if m.param_id.endswith("_TOTAL")]
    assert totals == [
        ("MIS_TOTAL", 1),
        ("MIS_TOTAL", 2),
        ("MIS_TOTAL", 3),
        ("FENCE_TOTAL", 6),
        ("MIS_TOTAL", 0),
    ]
