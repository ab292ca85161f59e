import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.agent.beacon import Beacon, decode, encode, mission_tag
from swarm_ctl.agent.budget import Budget
from swarm_ctl.agent.frame import Place, Shift
from swarm_ctl.agent.peer import (
    AGREE_M,
    LATENCY_S,
    LISTED_S,
    MOST_DOUBT_M,
    MOST_NAMED,
    WARY_S,
    ZONE_M,
    ZONE_S,
)
from swarm_ctl.agent.peers import PeerTable
from swarm_ctl.agent.phases import Phase
from swarm_ctl.autopilot.telemetry import PeerFix
from swarm_ctl.frames import Geodetic
from swarm_ctl.model import ZERO, Vec3

TAG = mission_tag("test")


def beacon(velocity: Vec3 = ZERO, heard: tuple[int, ...] = ()) -> Beacon:
    return Beacon(TAG, Phase.EXPLORING, velocity, Vec3(1.0, -2.0, -1.5), None, heard)


def told_at(place: Vec3, velocity: Vec3 = ZERO) -> Beacon:
    return Beacon(TAG, Phase.EXPLORING, velocity, place, None, ())


def test_a_beacon_comes_back_as_it_was() -> None:
    sent = beacon(Vec3(1.25, -0.5, 0.07), (2, 300, 70_000))
    assert decode(encode(sent)) == sent


def test_a_beacon_tells_its_target_when_it_has_one() -> None:
    sent = Beacon(TAG, Phase.AVOIDING, ZERO, Vec3(-400.0, 3.25, 0.0), Vec3(0.0, 12.5, -3.0), ())
    assert decode(encode(sent)) == sent


@pytest.mark.parametrize(
    "start",
    [Vec3(12.5, -3.25, 0.07), Geodetic(-54.8019123, -68.3029511, -12.5), Geodetic(0.0, 179.9, 0.0)],
)
def test_a_beacon_tells_where_its_frame_begins(start: Place) -> None:
    sent = Beacon(TAG, Phase.EXPLORING, ZERO, ZERO, None, (), start)
    received = decode(encode(sent))
    assert received is not None
    assert type(received.start) is type(start)
    assert received.start == pytest.approx(start, abs=1e-9)


def test_a_beacon_of_another_build_is_none() -> None:
    payload = encode(beacon())
    assert decode(payload) is not None
    assert decode(bytes([payload[0] - 1]) + payload[1:]) is None


def test_a_beacon_from_nowhere_near_is_none() -> None:
    payload = bytearray(encode(beacon()))
    struct.pack_into("<i", payload, 12, 2_000_000_000)  # 20,000 km north, in cm
    assert decode(bytes(payload)) is None


def test_a_start_that_is_not_on_the_globe_is_none() -> None:
    sent = Beacon(TAG, Phase.EXPLORING, ZERO, ZERO, None, (), Geodetic(90.0, 0.0, 0.0))
    payload = bytearray(encode(sent))
    at = len(payload) - 13
    assert struct.unpack_from("<i", payload, at) == (900_000_000,)
    struct.pack_into("<i", payload, at, 900_000_001)
    received = decode(bytes(payload))
    assert received is not None
    assert received.start is None


def test_a_beacon_fits_a_tunnel_however_many_peers_there_are() -> None:
    payload = encode(beacon(heard=tuple(range(1, 200))))
    assert len(payload) <= 128
    received = decode(payload)
    assert received is not None
    assert received.heard == tuple(range(1, len(received.heard) + 1))


@given(st.binary(max_size=128))
def test_a_broken_beacon_is_none(payload: bytes) -> None:
    received = decode(payload)
    assert received is None or isinstance(received.phase, Phase)


def test_a_peer_is_where_the_radio_measured_it() -> None:
    table = PeerTable()
    table.fix([PeerFix(7, Vec3(2.0, 0.0, -1.0), 1.0)], Vec3(10.0, 5.0, -2.0), ZERO, now=1.0)
    assert table.heard(1.0) == (7,)
    (peer,) = table.near(Vec3(11.0, 5.0, -2.0), 1.0)
    assert peer.offset_ned_m == pytest.approx((1.0, 0.0, -1.0))
    assert peer.velocity_ned_m_s == ZERO


def test_between_two_fixes_a_peer_moves_as_it_said() -> None:
    table = PeerTable()
    table.fix([PeerFix(7, Vec3(2.0, 0.0, 0.0), 1.0)], ZERO, ZERO, now=1.0)
    table.beacon(7, beacon(Vec3(0.0, 1.0, 0.0)), now=1.0)
    (peer,) = table.near(ZERO, 1.5)
    assert peer.offset_ned_m == pytest.approx((2.0, 0.5, 0.0), abs=0.02)


def test_a_peer_silent_for_a_second_is_out_of_range() -> None:
    table = PeerTable()
    table.fix([PeerFix(7, Vec3(2.0, 0.0, 0.0), 1.0)], ZERO, ZERO, now=1.0)
    assert table.contacts(1.5) == ([7], [])
    assert table.contacts(1.9) == ([], [])
    assert table.contacts(2.1) == ([], [7])
    assert table.near(ZERO, 2.1) == []


def test_a_beacon_heard_before_the_first_fix_is_not_lost() -> None:
    table = PeerTable()
    table.beacon(7, beacon(Vec3(1.0, 0.0, 0.0), heard=(9,)), now=1.0)
    assert table.heard(1.0) == ()
    table.fix([PeerFix(7, Vec3(2.0, 0.0, 0.0), 1.1)], ZERO, ZERO, now=1.1)
    (peer,) = table.near(ZERO, 1.6)
    assert peer.offset_ned_m == pytest.approx((2.5, 0.0, 0.0), abs=0.02)


# -- in a shared frame -----------------------------------------------------------------------------

NORTH_10 = Shift(Vec3(10.0, 0.0, 0.0))


def test_in_a_shared_frame_a_peer_is_where_it_says() -> None:
    table = PeerTable()
    table.beacon(7, told_at(Vec3(1.0, 2.0, -1.5), Vec3(0.0, 1.0, 0.0)), 1.0, NORTH_10)
    assert table.heard(1.5) == (7,)
    (peer,) = table.near(Vec3(0.0, 0.0, -1.0), 1.5)
    assert peer.offset_ned_m == pytest.approx((11.0, 2.5 + LATENCY_S, -0.5))
    assert peer.velocity_ned_m_s == (0.0, 1.0, 0.0)
    assert table.contacts(1.9) == ([7], [])
    assert table.contacts(2.1) == ([], [7])


def test_a_peer_that_shares_no_frame_is_heard_and_not_located() -> None:
    table = PeerTable()
    table.beacon(7, told_at(Vec3(1.0, 2.0, -1.5)), 1.0, None)
    assert table.is_ours(7)
    assert table.near(ZERO, 1.0) == []


def test_a_peer_that_tells_no_start_any_more_is_no_longer_located() -> None:
    table = PeerTable()
    table.beacon(7, told_at(ZERO), 1.0, NORTH_10)
    table.beacon(7, told_at(ZERO), 1.2, None)
    assert table.near(ZERO, 1.2) == []


def test_what_the_radio_measures_wins_over_what_a_peer_says() -> None:
    table = PeerTable()
    table.beacon(7, told_at(ZERO), 1.0, NORTH_10)
    table.fix([PeerFix(7, Vec3(9.0, 0.0, 0.0), 1.0)], ZERO, ZERO, now=1.0)
    (peer,) = table.near(ZERO, 1.0)
    assert peer.offset_ned_m == pytest.approx((9.0, 0.0, 0.0))
    assert table.doubts(ZERO, 1.0) == []


@pytest.mark.parametrize("measured_m", [4.0, 16.0])
def test_when_measured_and_told_are_at_odds_the_nearer_one_counts(measured_m: float) -> None:
    table = PeerTable()
    table.beacon(7, told_at(ZERO), 1.0, NORTH_10)
    table.fix([PeerFix(7, Vec3(measured_m, 0.0, 0.0), 1.0)], ZERO, ZERO, now=1.0)
    (peer,) = table.near(ZERO, 1.0)
    assert peer.offset_ned_m.x == pytest.approx(min(10.0, measured_m))
    ((sysid, apart_m),) = table.doubts(ZERO, 1.0)
    assert (sysid, apart_m) == pytest.approx((7, 6.0))
    assert table.doubts(ZERO, 1.1) == []


def test_a_difference_in_height_alone_is_a_barometer_and_no_doubt() -> None:
    table = PeerTable()
    table.beacon(7, told_at(Vec3(0.0, 0.0, -2.0 * AGREE_M)), 1.0, NORTH_10)
    table.fix([PeerFix(7, Vec3(10.0, 0.0, 0.0), 1.0)], ZERO, ZERO, now=1.0)
    assert table.doubts(ZERO, 1.0) == []


@pytest.mark.parametrize(("told_m", "taken_m"), [(-3.0, 0.0), (3.0, 0.0), (-8.0, -3.0), (8.0, 3.0)])
def test_a_doubtful_height_is_taken_for_as_near_as_it_may_be(told_m: float, taken_m: float) -> None:
    table = PeerTable()
    table.beacon(7, told_at(Vec3(0.0, 0.0, told_m)), 1.0, Shift(ZERO, height_doubt_m=5.0))
    (peer,) = table.near(Vec3(4.0, 0.0, 0.0), 1.0)
    assert peer.offset_ned_m == pytest.approx((-4.0, 0.0, taken_m))


def test_a_meeting_is_one_place_in_two_frames() -> None:
    table = PeerTable()
    table.beacon(7, told_at(Vec3(1.0, 2.0, 0.0), Vec3(1.0, 0.0, 0.0)), 1.0, NORTH_10)
    table.beacon(8, told_at(ZERO), 1.0, None)
    (told,) = table.met(1.2)
    assert told.sysid == 7
    assert told.there_ned_m == pytest.approx((1.2 + LATENCY_S, 2.0, 0.0))
    assert told.here_ned_m == pytest.approx((11.2 + LATENCY_S, 2.0, 0.0))
    table.fix([PeerFix(7, Vec3(11.0, 0.0, 0.0), 1.2)], ZERO, ZERO, now=1.2)
    (measured,) = table.met(1.2)
    assert measured.there_ned_m == pytest.approx(told.there_ned_m)
    assert measured.here_ned_m == (11.0, 0.0, 0.0)
    assert table.met(1.5) == []


# -- doubt -------------------------------------------------------------------------------------


def followed(until_s: float = 3.0) -> PeerTable:
    """Give a table that has measured and heard a peer at rest, 2 m north, for a while."""
    table = PeerTable()
    for tick in range(1, round(until_s * 10) + 1):
        table.fix([PeerFix(7, Vec3(2.0, 0.0, 0.0), tick * 0.1)], ZERO, ZERO, now=tick * 0.1)
        table.beacon(7, told_at(ZERO), tick * 0.1)
    return table


def test_a_peer_measured_all_the_time_is_in_no_doubt() -> None:
    (peer,) = followed().near(ZERO, 3.0)
    assert peer.doubt_m == 0.0


def test_the_longer_a_peer_is_not_measured_the_greater_the_doubt_but_not_for_ever() -> None:
    table = followed()
    doubts = [table.near(ZERO, 3.0 + age_s)[0].doubt_m for age_s in (0.2, 0.5, 0.7, 1.0)]
    assert doubts == sorted(doubts)
    assert doubts[0] < 0.1 < doubts[1]
    assert doubts[-1] == MOST_DOUBT_M


def test_a_peer_that_tells_its_place_is_doubted_as_it_grows_old() -> None:
    table = PeerTable()
    table.beacon(7, told_at(ZERO), 1.0, NORTH_10)
    assert table.near(ZERO, 1.2)[0].doubt_m == 0.0
    assert table.near(ZERO, 1.7)[0].doubt_m == pytest.approx(0.29)


def test_a_fix_that_came_late_counts_from_where_the_vehicle_was_then() -> None:
    table = PeerTable()
    table.fix([PeerFix(7, Vec3(2.0, 0.0, 0.0), 0.8)], Vec3(1.0, 0.0, 0.0), Vec3(1, 0, 0), now=1.0)
    (peer,) = table.near(ZERO, 1.0)
    assert peer.offset_ned_m.x == pytest.approx(2.8)


def test_while_fixes_disagree_with_a_track_the_nearer_place_counts() -> None:
    table = followed()
    for now in (3.1, 3.2):
        table.fix([PeerFix(7, Vec3(0.0, 1.0, 0.0), now)], ZERO, ZERO, now)
    (peer,) = table.near(ZERO, 3.2)
    assert peer.offset_ned_m == pytest.approx((0.0, 1.0, 0.0), abs=0.01)


def test_a_peer_behind_a_blind_angle_is_known_as_long_as_it_tells_how_it_moves() -> None:
    table = followed()
    for tick in range(1, 11):
        table.beacon(7, told_at(Vec3(0.0, 0.2 * tick, 0.0), Vec3(0, 1, 0)), 3.0 + 0.2 * tick)
    assert table.heard(5.0) == (7,)
    (peer,) = table.near(ZERO, 5.0)
    assert peer.offset_ned_m == pytest.approx((2.0, 2.0, 0.0), abs=0.1)


# -- the silent and the frozen -------------------------------------------------------------------


def met_and_lost(
    velocity: Vec3 = ZERO, phase: Phase = Phase.EXPLORING, north_m: float = 1.2
) -> PeerTable:
    """Give a table that measured and heard a peer until 1.0 s, and nothing since then."""
    table = PeerTable()
    for tick in range(1, 11):
        now, place = tick * 0.1, Vec3(north_m + velocity.x * (tick * 0.1 - 1.0), 0.0, 0.0)
        table.fix([PeerFix(7, place, now)], ZERO, ZERO, now)
        table.beacon(7, Beacon(TAG, phase, velocity, place, None, ()), now)
        table.near(ZERO, now)
    return table


def test_one_that_falls_silent_nearby_keeps_a_zone_that_grows_and_ends() -> None:
    table = met_and_lost()
    assert table.zones(ZERO, 1.5, 1.5) == []  # it is still in contact
    zones = [table.zones(ZERO, 1.5, 1.0 + age_s) for age_s in (1.5, 2.0, 5.0)]
    assert [zone[0].offset_ned_m for zone in zones] == [pytest.approx((1.2, 0.0, 0.0))] * 3
    assert [zone[0].doubt_m for zone in zones] == [1.0, 1.0, 1.0]
    assert 0.0 < table.zones(ZERO, 1.5, 2.01)[0].doubt_m < 1.1
    assert table.zones(ZERO, 1.5, 1.0 + ZONE_S + 0.1) == []


def test_a_zone_grows_no_faster_than_a_peer_flies() -> None:
    table = met_and_lost()
    table.near(ZERO, 1.9)
    doubts = [table.zones(ZERO, 1.5, 1.9 + age_s)[0].doubt_m for age_s in (0.2, 0.5, 1.5)]
    assert doubts == pytest.approx([0.08, 0.5, ZONE_M])


def test_one_that_was_far_off_or_on_its_way_down_leaves_no_zone() -> None:
    assert met_and_lost(north_m=1.8).zones(ZERO, 1.5, 2.5) == []
    assert met_and_lost(phase=Phase.LANDING).zones(ZERO, 1.5, 2.5) == []
    assert met_and_lost(phase=Phase.HOLDING).zones(ZERO, 1.5, 2.5) != []


def test_one_that_was_back_for_a_moment_while_nobody_asked_leaves_a_zone_again() -> None:
    table = met_and_lost()
    assert table.zones(ZERO, 1.5, 1.0 + ZONE_S + 0.1) == []
    table.fix([PeerFix(7, Vec3(1.2, 0.0, 0.0), 10.0)], ZERO, ZERO, 10.0)
    assert len(table.near(ZERO, 10.0)) == 1
    assert len(table.zones(ZERO, 1.5, 11.5)) == 1


def test_one_that_comes_back_is_heard_again_however_it_is_told_of() -> None:
    table = met_and_lost()
    assert table.heard(30.0) == ()
    assert table.met(30.0) == []
    table.beacon(7, beacon(), 31.0, Shift(ZERO))
    assert table.heard(31.0) == (7,)
    assert [met.sysid for met in table.met(31.0)] == [7]
    assert table.heard(40.0) == ()
    table.fix([PeerFix(7, Vec3(1.2, 0.0, 0.0), 41.0)], ZERO, ZERO, 41.0)
    assert table.heard(41.0) == (7,)


def test_a_zone_stays_where_the_peer_was_though_the_vehicle_flies_on() -> None:
    (zone,) = met_and_lost().zones(Vec3(0.0, 3.0, 0.0), 1.5, 2.5)
    assert zone.offset_ned_m == pytest.approx((1.2, -3.0, 0.0))


def test_one_that_is_heard_again_has_no_zone_any_more() -> None:
    table = met_and_lost()
    table.fix([PeerFix(7, Vec3(1.2, 0.0, 0.0), 3.0)], ZERO, ZERO, 3.0)
    assert table.zones(ZERO, 1.5, 3.0) == []


@pytest.mark.parametrize("phase", [Phase.EXPLORING, Phase.LANDING])
def test_one_that_is_measured_and_tells_nothing_is_doubted_most_unless_it_lands(
    phase: Phase,
) -> None:
    table = met_and_lost(phase=phase)
    for tick in range(11, 41):
        table.fix([PeerFix(7, Vec3(1.2, 0.0, 0.0), tick * 0.1)], ZERO, ZERO, tick * 0.1)
    (peer,) = table.near(ZERO, 4.0)
    assert peer.doubt_m == (0.0 if phase is Phase.LANDING else MOST_DOUBT_M)


def test_who_is_heard_and_not_measured_is_about_for_a_moment_and_after_a_silence_again() -> None:
    table = PeerTable()
    table.beacon(7, beacon(), 1.0)
    assert table.is_anybody_about(1.0)
    table.beacon(7, beacon(), 1.5)
    assert table.is_anybody_about(1.0 + WARY_S - 0.01)
    assert not table.is_anybody_about(1.0 + WARY_S + 0.01)
    table.beacon(7, beacon(), 3.0)
    assert table.is_anybody_about(3.0)
    table.fix([PeerFix(7, Vec3(1.5, 0.0, 0.0), 3.1)], ZERO, ZERO, 3.1)
    assert not table.is_anybody_about(3.1)


def test_who_tells_where_it_is_in_a_shared_frame_is_not_waited_for() -> None:
    table = PeerTable()
    table.beacon(7, beacon(), 1.0, NORTH_10)
    assert not table.is_anybody_about(1.0)


def test_whom_a_network_brings_may_be_far_away() -> None:
    table = PeerTable()
    table.beacon(7, beacon(), 1.0, is_near=False)
    assert not table.is_anybody_about(1.0)


def test_a_frozen_beacon_is_no_news() -> None:
    table = PeerTable()
    for tick in range(1, 20):
        table.beacon(7, told_at(ZERO, Vec3(1.0, 0.0, 0.0)), tick * 0.2, NORTH_10)
    assert table.heard(1.1) == (7,)
    assert table.heard(3.8) == ()


def test_one_that_hovers_tells_the_same_again_and_is_heard() -> None:
    table = PeerTable()
    for tick in range(1, 20):
        table.beacon(7, told_at(ZERO), tick * 0.2, NORTH_10)
    assert table.heard(3.8) == (7,)


def test_one_whose_fixes_contradict_what_it_tells_is_doubted_most() -> None:
    table = met_and_lost()
    for tick in range(11, 31):
        table.fix([PeerFix(7, Vec3(1.2, 0.0, 0.0), tick * 0.1)], ZERO, ZERO, tick * 0.1)
        if tick % 2:
            table.beacon(7, told_at(Vec3(0.0, 0.2 * tick, 0.0), Vec3(0.0, 2.0, 0.0)), tick * 0.1)
    (peer,) = table.near(ZERO, 3.0)
    assert peer.doubt_m == MOST_DOUBT_M
    assert peer.offset_ned_m == pytest.approx((1.2, 0.0, 0.0), abs=0.1)


# -- clusters ------------------------------------------------------------------------------------


def test_a_cluster_reaches_whom_a_peer_hears_and_ends_with_what_it_says() -> None:
    table = PeerTable(sysid=1)
    table.beacon(2, beacon(heard=(1, 3)), 1.0, NORTH_10)
    table.beacon(3, beacon(heard=(2, 4)), 0.5, None)  # heard itself once, but not located
    assert table.heard(1.0) == (2,)
    assert table.cluster(1.0) == (2, 3, 4)
    table.beacon(2, beacon(heard=(1,)), 2.0, NORTH_10)
    assert table.cluster(2.6) == (2, 3)  # 3 named 4 more than two seconds ago, 2 named 3 later
    assert table.cluster(3.1) == ()


def test_whom_a_peer_hears_no_more_is_forgotten() -> None:
    table = PeerTable(sysid=1)
    for tick in range(240):
        now = 0.1 * tick
        table.beacon(2, beacon(heard=(1, 3, 10 + tick)), now, NORTH_10)
        named = [10 + before for before in range(tick + 1) if now - 0.1 * before <= LISTED_S]
        assert table.cluster(now) == (2, 3, *named)
    assert len(table._peers[2].heard_s) <= MOST_NAMED


def test_more_neighbours_than_fit_into_a_beacon_are_told_in_turns() -> None:
    table, told = PeerTable(sysid=1), PeerTable(sysid=99)
    everybody = tuple(range(2, 48))
    for sysid in everybody:
        table.beacon(sysid, told_at(ZERO), 1.0, NORTH_10)
    for tick in range(5):
        received = decode(encode(beacon(heard=table.announced(1.0 + 0.2 * tick))))
        assert received is not None
        told.beacon(1, received, 1.0 + 0.2 * tick, NORTH_10)
    assert table.announced(1.0) != everybody
    assert told.cluster(1.8) == (1, *everybody)


# -- nonsense ------------------------------------------------------------------------------------

far = st.floats(-650.0, 650.0)
vectors = st.builds(Vec3, far, far, far)
sysids = st.integers(1, 4)
phases = st.sampled_from(list(Phase))
told = st.builds(
    Beacon, st.just(TAG), phases, vectors, vectors, st.none(), st.lists(sysids).map(tuple)
)
shifts = st.none() | st.builds(Shift, vectors, st.floats(0.0, 5.0))
measures = st.builds(PeerFix, sysids, vectors, st.floats(-1.0, 0.0))
happenings = st.tuples(st.lists(measures, max_size=3), sysids, st.none() | told, shifts)


@given(st.lists(st.tuples(happenings, st.floats(0.0, 3.0)), max_size=25))
def test_no_story_of_fixes_and_beacons_leads_nowhere(
    story: list[tuple[tuple[list[PeerFix], int, Beacon | None, Shift | None], float]],
) -> None:
    table, now, own = PeerTable(sysid=1), 0.0, Vec3(1.0, 2.0, -1.5)
    for (fixes, sysid, beacon_or_none, shift), later_s in story:
        now += later_s
        table.fix([fix._replace(measured_s=now + fix.measured_s) for fix in fixes], own, ZERO, now)
        if beacon_or_none is not None:
            table.beacon(sysid, beacon_or_none, now, shift)
        near, zones = table.near(own, now), table.zones(own, 2.0, now)
        assert len(near) == len(table.heard(now))
        assert set(table.heard(now)) - {1} <= set(table.cluster(now))
        for peer in near + zones:
            assert all(map(math.isfinite, (*peer.offset_ned_m, *peer.velocity_ned_m_s)))
            assert 0.0 <= peer.doubt_m <= max(MOST_DOUBT_M, ZONE_M)
        table.met(now), table.contacts(now), table.doubts(own, now)


def test_what_was_told_is_remembered_for_a_second_also_while_nobody_asks_for_room() -> None:
    budget = Budget()
    for tick in range(100):
        budget.spend([bytes(50), bytes(10)], tick / 10.0)
    assert len(budget._spent) == 10
    assert budget.room(9.9) == Budget().room(9.9) - 600
    assert budget.room(10.9) == Budget().room(10.9)
