import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.agent.beacon import Beacon, decode, encode, mission_tag
from swarm_ctl.agent.peers import PeerTable
from swarm_ctl.agent.phases import Phase
from swarm_ctl.autopilot.telemetry import PeerFix
from swarm_ctl.model import ZERO, Vec3

TAG = mission_tag("test")


def beacon(velocity: Vec3 = ZERO, heard: tuple[int, ...] = ()) -> Beacon:
    return Beacon(TAG, Phase.EXPLORING, velocity, Vec3(1.0, -2.0, -1.5), None, heard)


def test_a_beacon_comes_back_as_it_was() -> None:
    sent = beacon(Vec3(1.25, -0.5, 0.07), (2, 300, 70_000))
    assert decode(encode(sent)) == sent


def test_a_beacon_tells_its_target_when_it_has_one() -> None:
    sent = Beacon(TAG, Phase.AVOIDING, ZERO, Vec3(-400.0, 3.25, 0.0), Vec3(0.0, 12.5, -3.0), ())
    assert decode(encode(sent)) == sent


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
    table.fix([PeerFix(7, Vec3(2.0, 0.0, -1.0))], Vec3(10.0, 5.0, -2.0), now=1.0)
    assert table.heard(1.0) == (7,)
    (peer,) = table.near(Vec3(11.0, 5.0, -2.0), 1.0)
    assert peer.offset_ned_m == pytest.approx((1.0, 0.0, -1.0))
    assert peer.velocity_ned_m_s == ZERO


def test_between_two_fixes_a_peer_moves_as_it_said() -> None:
    table = PeerTable()
    table.fix([PeerFix(7, Vec3(2.0, 0.0, 0.0))], ZERO, now=1.0)
    table.beacon(7, beacon(Vec3(0.0, 1.0, 0.0)), now=1.0)
    (peer,) = table.near(ZERO, 1.5)
    assert peer.offset_ned_m == pytest.approx((2.0, 0.5, 0.0))


def test_a_peer_silent_for_a_second_is_out_of_range() -> None:
    table = PeerTable()
    table.fix([PeerFix(7, Vec3(2.0, 0.0, 0.0))], ZERO, now=1.0)
    assert table.contacts(1.5) == ([7], [])
    assert table.contacts(1.9) == ([], [])
    assert table.contacts(2.1) == ([], [7])
    assert table.near(ZERO, 2.1) == []


def test_a_beacon_heard_before_the_first_fix_is_not_lost() -> None:
    table = PeerTable()
    table.beacon(7, beacon(Vec3(1.0, 0.0, 0.0), heard=(9,)), now=1.0)
    assert table.heard(1.0) == ()
    table.fix([PeerFix(7, Vec3(2.0, 0.0, 0.0))], ZERO, now=1.1)
    (peer,) = table.near(ZERO, 1.6)
    assert peer.offset_ned_m == pytest.approx((2.5, 0.0, 0.0))
