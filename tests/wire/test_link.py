"""One non-blocking UDP socket of a controller, on the loopback."""

from __future__ import annotations

import asyncio
import select
import socket
from collections.abc import Callable, Iterator

import pytest

from swarm_ctl.errors import SwarmError
from swarm_ctl.link.udp import DATAGRAM_BYTES, UdpLink

pytestmark = pytest.mark.wire

PATIENCE_S = 30.0
FLOOD = 100


@pytest.fixture
def link() -> Iterator[Callable[[str], UdpLink]]:
    opened: list[UdpLink] = []

    def begin(url: str) -> UdpLink:
        opened.append(UdpLink(url))
        return opened[-1]

    yield begin
    for one in opened:
        one.close()


@pytest.fixture
def vehicle() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        opened.settimeout(PATIENCE_S)
        yield opened


Open = Callable[[str], UdpLink]


def port_of(link: UdpLink) -> int:
    return int(link._socket.getsockname()[1])


def arrived(link: UdpLink) -> list[bytes]:
    assert select.select([link], [], [], PATIENCE_S)[0], "nothing came"
    return [data for data, _ in iter(link.receive, None)]


def test_udpout_speaks_first_and_hears_the_answer(link: Open, vehicle: socket.socket) -> None:
    controller = link(f"udpout://localhost:{vehicle.getsockname()[1]}")
    assert controller.send(b"setpoint")
    data, sender = vehicle.recvfrom(100)
    assert data == b"setpoint"
    vehicle.sendto(b"telemetry", sender)
    assert arrived(controller) == [b"telemetry"]
    assert controller.receive() is None


def test_udpin_learns_its_peer_and_answers_who_spoke_last(
    link: Open, vehicle: socket.socket
) -> None:
    controller = link("udpin://127.0.0.1:0")
    assert not controller.send(b"to nobody")
    address = ("127.0.0.1", port_of(controller))
    vehicle.sendto(b"here I am", address)
    assert arrived(controller) == [b"here I am"]
    assert controller.send(b"hello")
    assert vehicle.recv(100) == b"hello"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as restarted:
        restarted.settimeout(PATIENCE_S)
        restarted.sendto(b"here I am again", address)
        assert arrived(controller) == [b"here I am again"]
        controller.send(b"welcome back")
        assert restarted.recv(100) == b"welcome back"


def test_a_closed_port_and_too_large_a_datagram_are_only_lost(
    link: Open, vehicle: socket.socket
) -> None:
    controller = link(f"udpout://127.0.0.1:{vehicle.getsockname()[1]}")
    vehicle.close()
    for _ in range(5):
        controller.send(b"anybody there?")
        assert controller.receive() is None
    assert not controller.send(bytes(70_000))


def test_a_datagram_larger_than_any_vehicle_sends_is_cut(
    link: Open, vehicle: socket.socket
) -> None:
    controller = link("udpin://127.0.0.1:0")
    vehicle.sendto(bytes(9000), ("127.0.0.1", port_of(controller)))
    vehicle.sendto(b"", ("127.0.0.1", port_of(controller)))
    assert [len(data) for data in arrived(controller)] == [DATAGRAM_BYTES, 0]


async def test_a_flood_leaves_the_others_their_turn(link: Open, vehicle: socket.socket) -> None:
    flooded, other = link("udpin://127.0.0.1:0"), link("udpin://127.0.0.1:0")
    heard: list[bytes] = []
    came = asyncio.Event()

    def hear(data: bytes, _: object) -> None:
        heard.append(data)
        came.set()

    for _ in range(FLOOD):
        vehicle.sendto(b"flood", ("127.0.0.1", port_of(flooded)))
    vehicle.sendto(b"word", ("127.0.0.1", port_of(other)))
    for one in (flooded, other):
        one.watch(hear)
    async with asyncio.timeout(PATIENCE_S):
        while len(heard) <= FLOOD:
            await came.wait()
            came.clear()
    assert heard.index(b"word") <= 2


@pytest.mark.parametrize(
    "url",
    [
        "",
        "14540",
        "127.0.0.1:14540",
        "tcp://127.0.0.1:14540",
        "udpin://",
        "udpin://127.0.0.1",
        "udpin://127.0.0.1:",
        "udpin://127.0.0.1:port",
        "udpin://127.0.0.1:70000",
        "udpin://127.0.0.1:-1",
        "udpin://:14540",
        "udpin://[::1:14540",
        "udpin://127.0.0.1:14540/path",
        "udpin://203.0.113.1:14540",
        "udpin://no.such.host.invalid:14540",
        f"udpin://{'a' * 70}.invalid:14540",
        "udpout://no.such.host.invalid:14540",
        "udpout://127.0.0.1:0",
    ],
)
def test_a_mistake_in_an_address_is_one_sentence_that_names_it(url: str) -> None:
    with pytest.raises(SwarmError) as caught:
        UdpLink(url)
    assert str(caught.value).startswith(f"{url}: ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) > len(url) + 5


def test_a_taken_port_is_named(link: Open) -> None:
    port = port_of(link("udpin://127.0.0.1:0"))
    with pytest.raises(SwarmError, match=f"{port}: another program listens there"):
        UdpLink(f"udpin://127.0.0.1:{port}")
