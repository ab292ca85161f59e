"""Several vehicles behind one link: who gets what, and who is answered where."""

from __future__ import annotations

from typing import Any

import pytest

from swarm_ctl import wire
from swarm_ctl.link.base import STREAM, Source
from swarm_ctl.link.shared import MOST_SOURCES, MOVED_S, Member, SharedLink

HEARTBEAT, ATTITUDE = wire.message("HEARTBEAT"), wire.message("ATTITUDE")
TUNNEL = wire.message("TUNNEL")
NORTH, SOUTH = ("10.0.0.1", 14580), ("10.0.0.2", 14580)


class Wire:
    """The far end of a link, in a test's hand."""

    def __init__(self, url: str = "udpin://0.0.0.0:14550") -> None:
        self.url = url
        self.sent: list[tuple[bytes, Source | None]] = []
        self.now_s = 100.0
        self.shared = SharedLink(self, lambda: self.now_s)
        self.got: dict[int, bytes] = {}

    def member(self, sysid: int) -> Member:
        member = self.shared.member(sysid)
        self.got[sysid] = b""

        def hear(data: bytes, _: Source) -> None:
            self.got[sysid] += data

        member.watch(hear)
        return member

    def watch(self, heard: Any) -> None:
        self.arrive = heard

    def send(self, data: bytes, to: Source | None = None) -> bool:
        self.sent.append((data, to))
        return True

    def reach(self, _to: Source | None = None) -> str:
        return ""

    def close(self) -> None: ...


def heartbeat(sysid: int, autopilot: int = 3, compid: int = 1) -> bytes:
    return HEARTBEAT.pack(0, sysid, compid, 2, autopilot, 81, 0, 3, 3)


def attitude(sysid: int) -> bytes:
    return ATTITUDE.pack(0, sysid, 1, 0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)


def beacon(sysid: int) -> bytes:
    return TUNNEL.pack(0, sysid, 191, 0, 0, 40417, 3, b"abc")


def test_each_vehicle_gets_what_comes_from_its_address_and_is_answered_there() -> None:
    port = Wire()
    one, two = port.member(1), port.member(2)
    port.arrive(heartbeat(1), NORTH)
    port.arrive(heartbeat(2), SOUTH)
    port.arrive(attitude(1), NORTH)
    port.arrive(beacon(1), SOUTH)
    assert port.got == {1: heartbeat(1) + attitude(1), 2: heartbeat(2) + beacon(1)}
    assert one.send(b"up")
    assert two.send(b"down")
    assert port.sent == [(b"up", NORTH), (b"down", SOUTH)]


def test_nobody_is_spoken_to_before_the_own_vehicle_was_heard() -> None:
    port = Wire()
    member = port.member(7)
    port.arrive(heartbeat(1), NORTH)
    assert not member.send(b"who are you?")
    assert (port.sent, port.got) == ([], {7: b""})
    assert list(port.shared.autopilots) == [1]


def test_where_the_address_leads_to_a_vehicle_the_first_word_is_ours() -> None:
    port = Wire("udpout://10.0.0.1:14580")
    assert port.member(7).send(b"hello")
    assert port.sent == [(b"hello", None)]


@pytest.mark.parametrize("chop", [1, 5, 1000])
def test_behind_a_router_each_gets_its_own_frames_and_those_of_the_others_companions(
    chop: int,
) -> None:
    port = Wire("tcpout://router:5760")
    port.member(1)
    port.member(2)
    port.arrive(heartbeat(1) + heartbeat(2), STREAM)
    port.got = {1: b"", 2: b""}
    stream = attitude(1) + b"noise" + beacon(2) + attitude(3) + attitude(2)
    for at in range(0, len(stream), chop):
        port.arrive(stream[at : at + chop], STREAM)
    assert port.got == {1: attitude(1) + beacon(2), 2: beacon(2) + attitude(2)}


def test_ground_stations_and_companions_are_no_vehicles() -> None:
    port = Wire()
    member = port.member(1)
    port.arrive(heartbeat(1, autopilot=8), NORTH)
    port.arrive(heartbeat(1, compid=191), NORTH)
    assert (member.source, port.shared.autopilots) == (None, {})


def test_an_address_speaks_for_a_vehicle_as_long_as_it_speaks() -> None:
    port = Wire()
    member = port.member(1)
    port.arrive(heartbeat(1), NORTH)
    port.now_s += MOVED_S - 0.1
    port.arrive(heartbeat(1), SOUTH)
    assert member.source == NORTH
    port.now_s += 0.2
    port.arrive(heartbeat(1), SOUTH)
    assert member.source == SOUTH, "it came back with another port"
    port.arrive(attitude(1), NORTH)
    assert port.got[1] == heartbeat(1) + heartbeat(1)


def test_a_flood_from_made_up_addresses_takes_nothing_from_a_known_vehicle() -> None:
    port = Wire()
    port.member(1)
    port.arrive(heartbeat(1), NORTH)
    for number in range(2 * MOST_SOURCES):
        port.arrive(heartbeat(1), ("10.9.9.9", number))
    port.arrive(attitude(1), NORTH)
    assert port.got[1] == heartbeat(1) + attitude(1)
    assert len(port.shared._behind) == MOST_SOURCES
