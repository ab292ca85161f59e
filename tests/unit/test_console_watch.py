"""A mission over the bus, as the console takes it: late, twice, in any order, from earlier runs."""

from __future__ import annotations

import itertools
from typing import Any

import pytest

from swarm_ctl.bus.messages import (
    Ack,
    Coverage,
    Event,
    Info,
    Order,
    State,
    Status,
    ack_topic,
    event_topic,
    info_topic,
    topic,
)
from swarm_ctl.bus.mqtt import Broker
from swarm_ctl.console.live import Live, View
from swarm_ctl.console.picture import Cursor
from swarm_ctl.console.watch import Watch
from swarm_ctl.model import Operator, Vec3

RUN, LATER = "2026-11-22T09:00:00+00:00", "2026-11-22T10:00:00+00:00"
MISSION = "search"


class Bus:
    """Tells a watch what vehicles would publish."""

    def __init__(self) -> None:
        self.watch = Watch(MISSION)
        self.now = 0.0
        self._ids = itertools.count(1)

    def say(self, where: str, payload: bytes) -> None:
        self.watch.hear(where, payload, self.now)

    def info(self, *sysids: int, run: str = RUN) -> None:
        plan = {"low": [0, 0, -3], "high": [9, 9, 0], "closed": True, "polygons": []}
        told = Info(run, MISSION, "udp", [*sysids], "explore", 2, 60.0, 7, "hall", plan)
        self.say(info_topic(MISSION), told.dump())

    def state(self, sysid: int, *, run: str = RUN, **changes: Any) -> None:
        said: dict[str, Any] = {
            "time_s": 10.0,
            "phase": "exploring",
            "words": "",
            "is_paused": False,
            "is_waiting": False,
            "position_ned_m": [1.0, 2.0, -1.5],
            "velocity_ned_m_s": [0.0, 0.0, 0.0],
            "yaw_rad": 0.5,
            "target_ned_m": None,
            "origin_ned_m": [10.0, 20.0, 0.0],
            "origin_geodetic": None,
            "battery": 0.8,
            "link_age_s": 0.1,
            "neighbours": [2],
            "ranges_m": [None] * 6,
            "victims": [],
            "seen_m2": 1.0,
            "autopilot": "PX4",
        }
        told = State(run=run, sysid=sysid, **{**said, **changes})
        self.say(topic(MISSION, sysid, "state"), told.dump())

    def event(self, sysid: int, name: str, words: str, *, run: str = RUN, **data: Any) -> bytes:
        number = next(self._ids)
        told = Event(run, sysid, number, 11.0, "phase", name, words, data).dump()
        self.say(event_topic(MISSION, sysid, number), told)
        return told

    def coverage(self, sysid: int, number: int, *rows: list[int], leaf: str = "coverage") -> None:
        told = Coverage(RUN, sysid, number, 11.0, 0.2, [*rows])
        self.say(topic(MISSION, sysid, leaf), told.dump())

    def words(self) -> list[str]:
        return [line[3] for line in self.watch.picture.frame(Cursor())["log"]]


@pytest.fixture
def bus() -> Bus:
    return Bus()


def test_a_vehicle_is_where_its_frame_begins_and_what_it_says_of_itself(bus: Bus) -> None:
    bus.state(3)
    vehicle = bus.watch.picture.vehicles[3]
    assert vehicle.place_ned_m == Vec3(11.0, 22.0, -1.5)
    assert (vehicle.phase, vehicle.battery_fraction, vehicle.peers) == ("exploring", 0.8, (2,))


def test_a_vehicle_that_nobody_can_place_is_in_the_table_alone(bus: Bus) -> None:
    bus.state(3, origin_ned_m=None)
    assert bus.watch.picture.vehicles[3].place_ned_m is None


def test_those_who_are_to_fly_are_known_before_they_speak(bus: Bus) -> None:
    bus.info(1, 2, 3)
    assert [*bus.watch.picture.vehicles] == [1, 2, 3]
    assert bus.watch.picture.head["seed"] == 7


def test_an_event_that_comes_again_is_written_once(bus: Bus) -> None:
    told = bus.event(1, "PhaseChanged", "landing: home")
    bus.say(event_topic(MISSION, 1, 1), told)
    assert bus.words() == ["landing: home"]
    assert bus.watch.picture.vehicles[1].note == "landing: home"


def test_what_an_earlier_run_has_left_on_the_broker_is_ignored(bus: Bus) -> None:
    bus.info(1, run=LATER)
    bus.state(1, phase="done", run=RUN)
    bus.event(1, "VictimFound", "victim 4 found", run=RUN, victim=4)
    assert bus.watch.picture.vehicles[1].phase == "connecting"
    assert (bus.words(), bus.watch.picture.victims) == ([], {})


def test_a_newer_run_begins_another_picture_whatever_comes_first(bus: Bus) -> None:
    bus.info(1, 2)
    bus.state(1)
    bus.coverage(1, 1, [0, 0, 5])
    bus.event(1, "VictimFound", "victim 4 found", victim=4)
    old = bus.watch.picture
    bus.event(1, "PhaseChanged", "ready: px4 ready", run=LATER)
    bus.info(1, 2, run=LATER)
    picture = bus.watch.picture
    assert picture is not old
    assert (picture.seen, picture.victims, bus.words()) == (0, {}, ["ready: px4 ready"])


def test_vehicles_of_another_process_join_the_same_picture(bus: Bus) -> None:
    bus.info(1)
    bus.state(1)
    bus.info(2, run=LATER)
    bus.state(2, run=LATER)
    assert {*bus.watch.picture.vehicles} == {1, 2}
    assert bus.watch.picture.vehicles[1].place_ned_m is not None


def test_ground_seen_by_two_is_counted_once_in_the_frame_of_the_picture(bus: Bus) -> None:
    bus.state(1, origin_ned_m=[0.0, 0.0, 0.0])
    bus.state(2, origin_ned_m=[0.0, 0.6, 0.0])
    bus.coverage(1, 1, [0, 0, 5])
    bus.coverage(2, 1, [0, 0, 5])
    assert bus.watch.picture.frame(Cursor())["cells"][1::2] == [*range(8)]


@pytest.mark.parametrize("start_m", [0.0, 0.1, 0.3, 3.1, 7.7, 10.5])
def test_no_rounding_leaves_a_gap_in_what_was_seen(bus: Bus, start_m: float) -> None:
    bus.state(1, origin_ned_m=[start_m, start_m, 0.0])
    bus.coverage(1, 1, *([row, -20, 40] for row in range(-20, 20)))
    assert bus.watch.picture.seen == 1600
    cells = bus.watch.picture.frame(Cursor())["cells"]
    assert len({*cells[::2]}) == len({*cells[1::2]}) == 40


def test_a_lost_piece_of_ground_is_filled_by_the_next_telling_of_all(bus: Bus) -> None:
    bus.state(1)
    bus.coverage(1, 1, [0, 0, 1])
    bus.coverage(1, 3, [0, 2, 1])  # the second one is lost
    bus.coverage(1, 3, [0, 0, 3], leaf="coverage/all")
    assert bus.watch.picture.seen == 3


def test_a_victim_has_the_place_that_its_finder_gives_it(bus: Bus) -> None:
    bus.event(2, "VictimHeard", "heard", victim=4, finder=1, position_ned_m=[0.0, 0.0, 0.0])
    assert bus.watch.picture.victims[4].place_ned_m is None  # nobody knows where 2 is
    bus.state(1)
    bus.event(1, "VictimFound", "victim 4 found", victim=4, position_ned_m=[1.0, 1.0, 0.0])
    victim = bus.watch.picture.victims[4]
    assert (victim.finder, victim.place_ned_m) == (1, Vec3(11.0, 21.0, 0.0))
    assert bus.words() == ["victim 4 found"]


def test_what_comes_before_a_vehicle_is_placed_is_drawn_when_it_is(bus: Bus) -> None:
    bus.coverage(1, 4, [0, 0, 3], leaf="coverage/all")
    bus.event(1, "VictimFound", "victim 4 found", victim=4, position_ned_m=[1.0, 1.0, 0.0])
    assert (bus.watch.picture.seen, bus.watch.picture.victims[4].place_ned_m) == (0, None)
    bus.state(1)
    assert bus.watch.picture.seen == 3
    assert bus.watch.picture.victims[4].place_ned_m == Vec3(11.0, 21.0, 0.0)


def test_a_vehicle_that_fell_silent_grows_old(bus: Bus) -> None:
    bus.state(1, link_age_s=0.2)
    bus.now = 1.0
    assert bus.watch.look(bus.now).vehicles[1].silent_s == pytest.approx(0.2)
    bus.now = 30.0
    assert bus.watch.look(bus.now).vehicles[1].silent_s == pytest.approx(30.2)


def test_a_lost_controller_is_offline(bus: Bus) -> None:
    bus.state(1)
    bus.say(topic(MISSION, 1, "status"), Status(RUN, 1, "offline").dump())
    assert bus.watch.picture.vehicles[1].status == "offline"


def test_it_is_told_who_obeys_who_refuses_and_who_says_nothing(bus: Bus) -> None:
    bus.info(1, 2, 3)
    bus.watch.give(Order(Operator.LAND, "a7"), None)
    for sysid, accepted, name in ((1, True, "a7"), (2, False, "a7"), (3, True, "another")):
        ack = Ack(name, "land", accepted, "landing", 12.0)
        bus.say(ack_topic(MISSION, sysid), ack.dump())
    assert bus.watch.answer == {
        "order": "land",
        "sysid": None,
        "obeyed": 1,
        "refused": [2],
        "silent": [3],
    }


@pytest.mark.parametrize(
    "leaf", ["state", "status", "event/1", "coverage", "coverage/all", "ack", "peers", "x/y/z"]
)
@pytest.mark.parametrize("payload", [b"", b"[]", b"{}", b"\xff", b'{"v": 1}', b"null"])
def test_what_cannot_be_read_is_left_alone(bus: Bus, leaf: str, payload: bytes) -> None:
    bus.say(f"swarm/{MISSION}/1/{leaf}", payload)
    assert bus.watch.picture.vehicles == {}


def test_without_a_broker_no_order_leaves_and_none_is_kept() -> None:
    live = Live(Broker.parse("mqtt://127.0.0.1:9", {}), MISSION, lambda: 0.0)
    live.watches[MISSION].picture.vehicle(1)
    view = View(live)
    view.order({"mission": MISSION, "order": "land", "sysid": None})
    assert view.state()["answer"] is None
    assert "mqtt://127.0.0.1:9 is away" in view.state()["warning"]


@pytest.mark.parametrize(
    "changed",
    [
        {"order": "fly"},
        {"order": ["land"]},
        {"sysid": 9},
        {"sysid": [1]},
        {"mission": "another"},
        {"mission": None},
    ],
)
def test_no_nonsense_from_a_browser_becomes_an_order(changed: dict[str, object]) -> None:
    live = Live(Broker.parse("mqtt://127.0.0.1:9", {}), MISSION, lambda: 0.0)
    live._is_there = True
    live.watches[MISSION].picture.vehicle(1)
    view, asked = View(live), {"mission": MISSION, "order": "land", "sysid": 1}
    for nonsense in (None, "land", {}, {**asked, **changed}):
        view.order(nonsense)
    assert live.watches[MISSION].answer is None
    view.order(asked)
    assert live.watches[MISSION].answer is not None


def test_an_order_goes_to_the_mission_that_was_on_the_page() -> None:
    live = Live(Broker.parse("mqtt://127.0.0.1:9", {}), None, lambda: 0.0)
    live._is_there = True
    for name, run in (("first", RUN), ("second", LATER)):
        told = Info(run, name, "udp", [1], "explore", 2, 60.0, 7, None, None)
        live.hear(info_topic(name), told.dump())
    View(live).order({"mission": "first", "order": "land", "sysid": None})
    assert live.watches["first"].answer is not None
    assert live.watches["second"].answer is None


def test_of_several_missions_the_one_that_began_last_is_shown_until_one_is_chosen() -> None:
    live = Live(Broker.parse("mqtt://127.0.0.1:9", {}), None, lambda: 0.0)
    view = View(live)
    assert view.picture().head["mission"] == ""
    for name, run in (("late", LATER), ("early", RUN)):
        told = Info(run, name, "udp", [1], "explore", 2, 60.0, 7, None, None)
        live.hear(info_topic(name), told.dump())
    assert view.picture().head["mission"] == "late"
    view.choose("early")
    view.choose("nowhere")
    assert view.picture().head["mission"] == "early"
    assert view.state()["missions"] == ["early", "late"]
