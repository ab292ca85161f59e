"""The frame that vehicles share: who stands where, whatever their estimators call it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pymap3d
import pytest
from halls import write_hall
from hypothesis import assume, given
from hypothesis import strategies as st

from swarm_ctl import wire
from swarm_ctl.agent import beacon as beacons
from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.frame import (
    ASK_TIMES,
    GNSS_HEIGHT_DOUBT_M,
    FrameParams,
    SharedFrame,
    shift_between,
)
from swarm_ctl.agent.phases import Phase
from swarm_ctl.agent.sender import Sender
from swarm_ctl.autopilot.telemetry import SUBSCRIBED, Telemetry
from swarm_ctl.errors import MissionError
from swarm_ctl.flight import orders_of
from swarm_ctl.frames import Geodetic, ned_to_geodetic, turn
from swarm_ctl.mission import load_mission
from swarm_ctl.model import ZERO, Setpoint, Vec3

YAW = st.floats(-math.pi, math.pi)
SPEEDS = st.builds(Vec3, *[st.floats(-5.0, 5.0)] * 3)
NEARBY = st.builds(Vec3, st.floats(-300, 300), st.floats(-300, 300), st.floats(-30, 30))
LATITUDES, LONGITUDES = st.floats(-70.0, 70.0), st.floats(-180.0, 180.0)
ZURICH = Geodetic(47.3977418, 8.5455939, 489.4)


def hear(telemetry: Telemetry, name: str, *values: object) -> None:
    """Let a vehicle's autopilot say something."""
    message = wire.message(name)
    (frame,) = wire.Parser((name,)).feed(message.pack(0, telemetry.sysid, 1, *values))
    telemetry.receive(frame, 1.0)


def hear_origin(telemetry: Telemetry, place: Geodetic) -> None:
    degrees = (round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7))
    hear(telemetry, "GPS_GLOBAL_ORIGIN", *degrees, round(place.altitude_m * 1e3))


def hear_position(telemetry: Telemetry, place: Vec3, velocity: Vec3 = ZERO) -> None:
    hear(telemetry, "LOCAL_POSITION_NED", 0, *place, *velocity)


def local_ned_m(place: Geodetic, origin: Geodetic) -> Vec3:
    """Tell where an autopilot says it is: its heights follow the curved Earth."""
    north, east, _ = pymap3d.geodetic2ned(*place, *origin)
    return Vec3(north, east, origin.altitude_m - place.altitude_m)


# -- where starts lie ------------------------------------------------------------------------------


def test_surveyed_starts_are_written_as_in_world_files() -> None:
    params = FrameParams(shared="surveyed", starts_m={1: (0.0, 0.0, 0.0), 2: (3.0, 4.0, 0.5)})
    one, two = (SharedFrame(params, sysid).start(Telemetry(sysid)) for sysid in (1, 2))
    shift = shift_between(one, two)
    assert shift is not None
    assert shift.offset_m == (4.0, 3.0, -0.5)  # y north, x east, z up
    assert shift.height_doubt_m == 0.0


def test_vehicles_of_a_mission_without_a_shared_frame_have_nothing_in_common() -> None:
    frame, telemetry = SharedFrame(FrameParams(), 1), Telemetry(1)
    hear_origin(telemetry, ZURICH)
    assert frame.start(telemetry) is None
    assert shift_between(None, None) is None
    assert shift_between(Vec3(1.0, 2.0, 3.0), ZURICH) is None
    assert shift_between(Vec3(1.0, 2.0, 3.0), None) is None


def test_a_peer_beyond_the_horizon_is_not_taken_to_be_lower() -> None:
    """Autopilots count heights along the curved Earth; a tangent plane is 2 m off at 5 km."""
    north, east, _ = pymap3d.geodetic2ned(47.4, 8.612, 500.0, 47.4, 8.546, 500.0)
    shift = shift_between(Geodetic(47.4, 8.546, 500.0), Geodetic(47.4, 8.612, 510.0))
    assert shift is not None
    assert shift.offset_m == pytest.approx((north, east, -10.0), abs=0.02)
    assert east == pytest.approx(5000.0, abs=50.0)


def test_who_is_on_another_continent_is_no_peer() -> None:
    assert shift_between(ZURICH, Geodetic(-54.8, -68.3, 20.0)) is None
    assert shift_between(ZERO, Vec3(2e5, 0.0, 0.0)) is None


@given(LATITUDES, LONGITUDES, st.tuples(*[NEARBY] * 5))
def test_satellites_tell_where_a_peer_is_whatever_origins_and_starts_the_two_have(
    latitude: float, longitude: float, offsets: tuple[Vec3, ...]
) -> None:
    """Two estimators that began anywhere, two starts, and the peer flown on from its own."""
    assume(abs(latitude) + abs(longitude) > 0.01)  # what says 0, 0 knows of no satellites
    middle = Geodetic(latitude, longitude, 500.0)
    own_origin, peer_origin, own_start, peer_start, peer = (
        ned_to_geodetic(offset, middle) for offset in offsets
    )
    places = []
    for sysid, origin, start in ((1, own_origin, own_start), (2, peer_origin, peer_start)):
        telemetry = Telemetry(sysid)
        hear_origin(telemetry, origin)
        hear_position(telemetry, local_ned_m(start, origin))
        telemetry.start_here()
        places.append(SharedFrame(FrameParams(shared="gnss"), sysid).start(telemetry))
    hear_position(telemetry, local_ned_m(peer, peer_origin))
    shift = shift_between(*places)
    assert shift is not None
    assert shift.height_doubt_m == GNSS_HEIGHT_DOUBT_M
    seen = [t + s for t, s in zip(telemetry.position_ned_m, shift.offset_m, strict=True)]
    # degE7 are 11 mm; north is not the same everywhere: 0.6 km at 70 degrees turn it by 0.26 mrad
    assert seen == pytest.approx(local_ned_m(peer, own_start), abs=0.3)


@pytest.mark.parametrize("values", [(0, 0, 0), (900_000_001, 5, 0), (5, 1_800_000_001, 0)])
def test_an_origin_that_is_nowhere_is_none(values: tuple[int, int, int]) -> None:
    telemetry = Telemetry(1)
    hear(telemetry, "GPS_GLOBAL_ORIGIN", *values)
    assert telemetry.origin is None


def test_all_that_is_heard_of_the_globe_is_where_the_estimator_began() -> None:
    fields = {name: wire.message(name).fields for name in SUBSCRIBED}
    global_ones = {name for name, names in fields.items() if {"lat", "latitude"} & {*names}}
    assert global_ones == {"GPS_GLOBAL_ORIGIN"}


# -- estimators whose x axis is not north ----------------------------------------------------------


@given(YAW, NEARBY, SPEEDS, YAW)
def test_what_a_turned_estimator_says_is_turned_back_to_north(
    offset: float, place: Vec3, velocity: Vec3, yaw: float
) -> None:
    telemetry = Telemetry(1, offset)
    hear_position(telemetry, turn(place, -offset), turn(velocity, -offset))
    hear(telemetry, "ATTITUDE", 0, 0.1, -0.2, yaw - offset, 0.0, 0.0, 0.3)
    assert telemetry.position_ned_m == pytest.approx(place, abs=1e-3)
    assert telemetry.velocity_ned_m_s == pytest.approx(velocity, abs=1e-5)
    assert math.cos(telemetry.yaw_rad - yaw) == pytest.approx(1.0)
    assert -math.pi < telemetry.yaw_rad <= math.pi
    assert telemetry.attitude_rad[:2] == pytest.approx((0.1, -0.2))


@given(YAW, SPEEDS, YAW)
def test_what_a_turned_estimator_is_told_is_in_its_own_axes(
    offset: float, velocity: Vec3, yaw: float
) -> None:
    sent = Sender(1, offset).setpoint(Setpoint(velocity, yaw), 1.0)
    (frame,) = wire.Parser(None).feed(sent)
    told = Vec3(frame.values.vx, frame.values.vy, frame.values.vz)
    assert turn(told, offset) == pytest.approx(velocity, abs=1e-5)
    assert math.cos(frame.values.yaw + offset - yaw) == pytest.approx(1.0)


def test_ahead_of_an_estimator_that_began_facing_east_is_east() -> None:
    frame = SharedFrame(FrameParams(yaw_offset_deg={1: 90.0}), 1)
    telemetry = Telemetry(1, frame.yaw_offset_rad)
    hear_position(telemetry, Vec3(5.0, 0.0, -1.0))
    assert telemetry.position_ned_m == pytest.approx((0.0, 5.0, -1.0))


# -- origins that autopilots are told --------------------------------------------------------------


def told(frame: SharedFrame, telemetry: Telemetry) -> list[float]:
    """Give the moments at which an autopilot that waits for ten seconds is told an origin."""
    moments = (tenth / 10.0 for tenth in range(100))
    asked = [now for now in moments if frame.is_time_to_ask(telemetry, now)]
    return asked[ASK_TIMES - 1 :] if frame.origin_to_tell else []


def a_px4() -> Telemetry:
    telemetry = Telemetry(2)
    hear(telemetry, "HEARTBEAT", 2, 12, 29, 0, 3, 3)
    return telemetry


def test_an_autopilot_that_answers_with_no_origin_is_told_one_until_it_has_it() -> None:
    params = FrameParams(shared="surveyed", starts_m={2: (100.0, 0.0, 2.0)}, origin=ZURICH)
    frame, telemetry = SharedFrame(params, 2), a_px4()
    assert told(frame, telemetry) == [4.0, 6.0, 8.0]
    place = frame.origin_to_tell
    assert place is not None
    assert local_ned_m(place, ZURICH) == pytest.approx((0.0, 100.0, -2.0), abs=0.01)
    hear_origin(telemetry, ZURICH)
    assert not frame.is_time_to_ask(telemetry, 100.0)


def test_an_autopilot_that_knows_its_origin_or_flies_is_told_nothing() -> None:
    knowing, flying = a_px4(), a_px4()
    hear_origin(knowing, ZURICH)
    flying.armed = True
    for telemetry in (knowing, flying, Telemetry(2)):
        assert told(SharedFrame(FrameParams(origin=ZURICH), 2), telemetry) == []


def test_satellites_are_asked_for_an_origin_and_never_told_one() -> None:
    frame = SharedFrame(FrameParams(shared="gnss"), 2)
    assert frame.is_time_to_ask(a_px4(), 0.0)
    assert told(frame, a_px4()) == []
    assert not SharedFrame(FrameParams(), 2).is_time_to_ask(a_px4(), 0.0)


# -- a mission's section ---------------------------------------------------------------------------


def refusal(folder: Path, frame: dict[str, Any]) -> MissionError:
    with pytest.raises(MissionError) as caught:
        load_mission(write_hall(folder, {"frame": frame}))
    assert "\n" not in str(caught.value)
    return caught.value


STARTS = {1: [0.0, 0.0, 0.0], 2: [2.0, 0.0, 0.0]}


def test_a_mission_says_which_frame_is_shared(tmp_path: Path) -> None:
    frame = {"shared": "surveyed", "starts_m": STARTS, "yaw_offset_deg": {2: 90}}
    path = write_hall(tmp_path, {"frame": {**frame, "origin": [47.4, 8.5, 488]}})
    mission = load_mission(path)
    assert mission.frame.starts_m[2] == (2.0, 0.0, 0.0)
    assert mission.frame.origin == (47.4, 8.5, 488.0)
    assert FrameParams.model_validate(mission.dump()["frame"]) == mission.frame  # keys are texts
    assert load_mission(write_hall(tmp_path, {})).frame.shared == "none"


@pytest.mark.parametrize(
    ("frame", "key", "words"),
    [
        ({"shared": "surveyed"}, "frame.starts_m", "is missing"),
        ({"shared": "surveyed", "starts_m": {1: [0, 0, 0]}}, "frame.starts_m", "lacks vehicle 2"),
        (
            {"shared": "surveyed", "starts_m": {1: [0, 0, 0], 2: [0, 0, 0]}},
            "frame.starts_m",
            "two vehicles at one place",
        ),
        ({"starts_m": STARTS}, "frame.starts_m", "needs `shared: surveyed`"),
        ({"shared": "gnss", "yaw_offset_deg": {1: 5.0}}, "frame.yaw_offset_deg", "all axes lie"),
        ({"shared": "gnss", "origin": [47.4, 8.5, 488]}, "frame.origin", "every vehicle"),
        ({"origin": [8.5, 470.4, 0]}, "frame.origin", "a latitude, a longitude and an altitude"),
        ({"shared": "gps"}, "frame.shared", "'none', 'surveyed' or 'gnss'"),
        ({"share": "gnss"}, "frame.share", "did you mean frame.shared?"),
        ({"shared": "surveyed", "starts_m": {1: [0, 0]}}, "frame.starts_m.1.2", "is missing"),
        ({"starts_m": {1: [0, 0, 0, 0]}}, "frame.starts_m.1", "at most 3"),
        ({"starts_m": {0: [0, 0, 0]}}, "frame.starts_m.0", "at least 1"),
        ({"starts_m": {1: [0, 0, math.nan]}}, "frame.starts_m.1.2", "a finite number"),
        ({"starts_m": [1, 2]}, "frame.starts_m", "a block of keys"),
    ],
)
def test_a_frame_that_cannot_be_shared_is_refused(
    tmp_path: Path, frame: dict[str, Any], key: str, words: str
) -> None:
    error = refusal(tmp_path, frame)
    assert error.key == key
    assert words in str(error)


# -- an agent --------------------------------------------------------------------------------------


def agent(folder: Path, sysid: int, frame: dict[str, Any]) -> Agent:
    mission = load_mission(write_hall(folder, {"frame": frame}))
    return Agent(sysid, orders_of(mission))


def test_who_has_lost_his_place_says_no_more_where_his_frame_begins(tmp_path: Path) -> None:
    one = agent(tmp_path, 1, {"shared": "surveyed", "starts_m": STARTS})
    one.now = 1.0
    hear_position(one.telemetry, Vec3(3.0, 0.0, 0.0))
    assert one.talk.beacon().start is None, "it is not known yet whether the position is any good"
    one.phase = Phase.EXPLORING
    assert one.talk.beacon().start == (0.0, 0.0, 0.0)
    one.now += one.orders.limits.link_hold_s + 0.1
    assert one.talk.beacon().start is None


def test_beacons_of_another_build_are_counted_and_change_nothing(tmp_path: Path) -> None:
    one = agent(tmp_path, 1, {})
    payload = beacons.encode(one.talk.beacon())
    for version in (1, beacons.VERSION):
        told = bytes([version]) + payload[1:]
        one.receive(Sender(2).broadcast(beacons.BEACON_TYPE, told), 0.0)
    assert one.peers.unread == 1
    assert one.peers.is_ours(2)
