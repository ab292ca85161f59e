"""A mesh of companions on the loopback: who hears whom, and what is not carried."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest
from halls import write_hall
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl import wire
from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.beacon import BEACON_TYPE, Beacon, encode, mission_tag
from swarm_ctl.agent.phases import Phase
from swarm_ctl.agent.sender import Sender
from swarm_ctl.autopilot.command import command
from swarm_ctl.bus.mqtt import Broker
from swarm_ctl.bus.peers import PeersOverMqtt
from swarm_ctl.errors import SwarmError
from swarm_ctl.flight import orders_of
from swarm_ctl.link.base import MESH, STREAM, Heard, Source
from swarm_ctl.link.broadcast import Broadcast
from swarm_ctl.link.mesh import Mesh, Transport, _broadcasts
from swarm_ctl.link.url import Network, parse_peers
from swarm_ctl.mission import load_mission
from swarm_ctl.model import ZERO, Setpoint, Vec3
from swarm_ctl.signing import Verdict, key_of

pytestmark = pytest.mark.wire

PATIENCE_S = 30.0
QUIET_S = 0.1
KEY, BEGAN = key_of("swarm"), 1 << 45
TUNNEL = wire.message("TUNNEL")


Process = Callable[[], Awaitable[Mesh]]


class Cable:
    """A vehicle's own link whose far end is in a test's hand."""

    url = "udpout://localhost:14580"

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.is_open = True

    def watch(self, heard: Heard) -> None:
        self.arrive = heard

    def send(self, data: bytes, to: Source | None = None) -> bool:  # noqa: ARG002
        self.sent.append(data)
        return True

    def reach(self, _to: Source | None = None) -> str:
        return ""

    def close(self) -> None:
        self.is_open = False


class Companion:
    """A vehicle's companion on a mesh, and all that it has heard there."""

    def __init__(self, mesh: Mesh, sysid: int) -> None:
        self.cable = Cable()
        self.sender = Sender(sysid)
        self.heard: list[tuple[bytes, Source]] = []
        self.link = mesh.join(self.cable, sysid)
        self.link.watch(self._hear)
        self._has_heard = asyncio.Event()

    def _hear(self, data: bytes, source: Source) -> None:
        self.heard.append((data, source))
        self._has_heard.set()

    async def hears(self, count: int) -> list[bytes]:
        """Wait for so many datagrams, and a moment longer for one too many."""
        async with asyncio.timeout(PATIENCE_S):
            while len(self.heard) < count:
                self._has_heard.clear()
                await self._has_heard.wait()
        await asyncio.sleep(QUIET_S)
        assert {source for _, source in self.heard} <= {MESH}
        return [data for data, _ in self.heard]


@pytest.fixture
async def process(peers_url: str) -> AsyncIterator[Process]:
    """Give a function that opens a mesh as one more process of this machine would."""
    async with contextlib.AsyncExitStack() as stack:
        tasks = await stack.enter_async_context(asyncio.TaskGroup())

        async def begin() -> Mesh:
            carrier = transport(peers_url)
            mesh = Mesh(carrier)
            stack.callback(mesh.close)
            stack.callback(tasks.create_task(mesh.run()).cancel)
            if isinstance(carrier, PeersOverMqtt):
                await until(lambda: carrier.sessions > 0)
            return mesh

        yield begin


def transport(url: str) -> Transport:
    match parse_peers(url):
        case Network() as network:
            return Broadcast(network)
        case _:
            return PeersOverMqtt(Broker.parse(url, {}), "hall")


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not is_so():  # noqa: ASYNC110 - another process is waited for
            await asyncio.sleep(0.01)


async def test_all_hear_one_another_in_one_process_and_in_several(process: Process) -> None:
    here, there = await process(), await process()
    one, two, three = Companion(here, 1), Companion(here, 2), Companion(there, 3)
    told = one.sender.broadcast(BEACON_TYPE, b"here I am")
    assert one.link.send(told)
    assert await two.hears(1) == [told]
    assert await three.hears(1) == [told]
    assert one.heard == []
    assert one.cable.sent == [told]


async def test_only_what_is_for_everybody_leaves_and_the_vehicle_gets_it_all(
    process: Process,
) -> None:
    one, two = Companion(await process(), 1), Companion(await process(), 2)
    sender = one.sender
    beat = sender.heartbeat()
    order = sender.command(command(400, 1.0), 0)
    setpoint = sender.setpoint(Setpoint(ZERO, 0.0), 1.0)
    beacon = sender.broadcast(BEACON_TYPE, b"beacon")
    private = TUNNEL.pack(9, 1, 191, 2, 0, BEACON_TYPE, 1, b"x")
    datagram = beat + order + setpoint + beacon + private
    one.link.send(order + setpoint)
    one.link.send(datagram)
    assert await two.hears(1) == [beat + beacon]
    assert one.cable.sent == [order + setpoint, datagram]


async def test_nothing_but_companions_is_taken_from_the_network(
    process: Process, peers_url: str
) -> None:
    mesh = await process()
    one, two = Companion(mesh, 1), Companion(await process(), 2)
    forged = wire.message("LOCAL_POSITION_NED").pack(0, 1, 1, 0, *[9.0] * 6)
    autopilot = wire.message("HEARTBEAT").pack(0, 2, 1, 2, 12, 29, 0, 3, 3)
    own = one.sender.broadcast(BEACON_TYPE, b"my own, come back")
    beacon = two.sender.broadcast(BEACON_TYPE, b"beacon")
    stranger = (await process())._transport
    for data in (forged, autopilot, own, b"\xfd" * 300, beacon[:-1], b"", forged + beacon):
        stranger.send(2, data)
    assert await one.hears(1) == [beacon]
    assert mesh.refused == (6 if peers_url.startswith("mqtt") else 5), "a topic has one sender"


async def test_who_has_left_hears_nothing_and_the_others_go_on(process: Process) -> None:
    mesh = await process()
    one, two, three = (Companion(mesh, sysid) for sysid in (1, 2, 3))
    two.link.close()
    assert not two.cable.is_open
    told = one.sender.heartbeat()
    one.link.send(told)
    assert await three.hears(1) == [told]
    assert two.heard == []


async def test_a_network_that_is_down_leaves_a_vehicle_its_own_link_and_its_neighbours(
    peers_url: str,
) -> None:
    mesh = Mesh(transport(peers_url))
    one, two = Companion(mesh, 1), Companion(mesh, 2)
    mesh.close()
    told = one.sender.heartbeat()
    assert one.link.send(told), "its own link is as good as before"
    assert await two.hears(1) == [told]
    (words,) = mesh.account()
    assert "1 datagrams did not leave" in words


async def test_the_vehicles_own_link_is_heard_as_before(process: Process) -> None:
    one = Companion(await process(), 1)
    one.cable.arrive(b"telemetry", STREAM)
    assert one.heard == [(b"telemetry", STREAM)]


@given(st.binary(max_size=300))
def test_no_bytes_from_the_network_can_do_harm(data: bytes) -> None:
    assert all(frame.compid == 191 for frame in _broadcasts(data))


def test_an_agent_takes_beacons_alone_from_the_mesh(tmp_path: Path) -> None:
    mission = load_mission(write_hall(tmp_path, {}))
    agent = Agent(1, orders_of(mission))
    beacon = Beacon(mission_tag(mission.name), Phase.EXPLORING, ZERO, ZERO, None, ())
    told = Sender(2).broadcast(BEACON_TYPE, encode(beacon))
    autopilot = wire.message("HEARTBEAT").pack(0, 1, 1, 2, 12, 29, 0, 3, 3)
    own = Sender(1).broadcast(BEACON_TYPE, encode(beacon))
    payload = wire.Parser(("TUNNEL",)).feed(told)[0].values
    camera = TUNNEL.pack(0, 3, 100, *payload)
    agent.overhear(autopilot + own + told + camera, 1.0)
    assert agent.telemetry.autopilot is None
    assert agent.peers.is_ours(2)
    assert not agent.peers.is_ours(1)
    assert not agent.peers.is_ours(3), "what is no companion flies no mission"


def beacon_frame(sender: Sender, x_m: float = 0.0) -> bytes:
    place = Vec3(x_m, 0.0, 0.0)
    beacon = Beacon(mission_tag("hall"), Phase.EXPLORING, ZERO, place, None, ())
    return sender.broadcast(BEACON_TYPE, encode(beacon))


def sender_with(sysid: int, key: bytes) -> Sender:
    sender = Sender(sysid)
    sender.gate.take_key(key, BEGAN)
    return sender


async def test_a_swarm_with_a_key_refuses_and_counts_who_has_none_and_what_is_played_again(
    process: Process, tmp_path: Path
) -> None:
    agent = Agent(1, orders_of(load_mission(write_hall(tmp_path, {}))))
    agent.sign_with(KEY, BEGAN)
    own = (await process()).join(Cable(), 1)
    own.watch(lambda data, _: agent.overhear(data, 1.0))
    others = (await process())._transport
    signed = beacon_frame(sender_with(2, KEY))
    forged = beacon_frame(sender_with(4, key_of("another")))
    for sysid, data in ((2, signed), (3, beacon_frame(Sender(3))), (4, forged), (2, signed)):
        assert others.send(sysid, data)
    await until(lambda: agent.sender.gate.refused.total() == 3)
    assert [agent.peers.is_ours(sysid) for sysid in (2, 3, 4)] == [True, False, False]
    assert agent.sender.gate.refused == {
        Verdict.UNSIGNED: 1,
        Verdict.FORGED: 1,
        Verdict.REPLAYED: 1,
    }


@pytest.mark.parametrize("is_signed", [False, True])
def test_what_comes_by_two_ways_counts_once_and_late_beacons_not_at_all(
    tmp_path: Path, is_signed: bool
) -> None:
    agent, sender = Agent(1, orders_of(load_mission(write_hall(tmp_path, {})))), Sender(2)
    if is_signed:
        agent.sign_with(KEY, BEGAN)
        sender = sender_with(2, KEY)
    old, new = beacon_frame(sender, 1.0), beacon_frame(sender, 2.0)
    agent.overhear(old + new, 1.0)
    agent.receive(old + new, 1.5)
    known = agent.peers._peers[2]
    assert known.beacon_s == 1.0, "what was heard again is as old as before"
    assert known.beacon is not None
    assert known.beacon.position_ned_m.x == 2.0
    agent.receive(beacon_frame(sender, 3.0), 1.6)
    assert known.beacon.position_ned_m.x == 3.0
    begun_anew = sender_with(2, KEY) if is_signed else Sender(2)
    begun_anew.gate.advance(9.0)
    agent.overhear(beacon_frame(begun_anew, 4.0), 9.0)
    assert known.beacon.position_ned_m.x == 4.0


@pytest.mark.parametrize(
    "url",
    [
        "udp://239.255.42.42",
        "udp://239.255.42.42:0",
        "udp://239.255.42.42:70000",
        "udp://239.255.42.421:14700",
        "udp://swarm.local:14700",
        "udp://239.255.42.42:14700/x",
        "udp://239.255.42.42:14700?interface=wlan0",
        "udp://239.255.42.42:14700?interfaces=127.0.0.1",
        "udp://192.168.1.255:14700?interface=192.168.1.7",
    ],
)
def test_what_is_no_network_is_refused_in_one_sentence(url: str) -> None:
    with pytest.raises(SwarmError, match="expected a multicast group and a port") as caught:
        parse_peers(url)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "url",
    [
        "mqtt://",
        "mqtt://ann:secret@broker",
        "mqtt://broker:70000",
        "mqtt://broker:0",
        "mqtt://broker/topic",
        "mqtts://broker?x=1",
        "mqtt://bro ker",
    ],
)
def test_what_is_no_broker_is_refused_and_no_password_repeated(url: str) -> None:
    with pytest.raises(SwarmError, match=r"^expected mqtt://\[USER@\]HOST\[:PORT\]") as caught:
        parse_peers(url)
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("url", ["udpin://239.255.42.42:14700", "radio", "Autopilot", ""])
def test_what_carries_nothing_is_refused_in_one_sentence(url: str) -> None:
    with pytest.raises(SwarmError, match=f"^{url}: expected autopilot, udp://GROUP:PORT"):
        parse_peers(url)


def test_autopilots_alone_carry_frames_when_nothing_else_is_asked_for() -> None:
    assert parse_peers("autopilot") is None


@pytest.mark.parametrize(
    "url",
    [
        "udp://239.255.42.42:14700?interface=192.0.2.7",
        "udp://127.0.0.1:14700",
        "udp://192.0.2.7:14700",
    ],
)
def test_a_network_that_this_machine_is_not_on_is_refused_in_one_sentence(url: str) -> None:
    with pytest.raises(SwarmError, match="expected a multicast group") as caught:
        transport(url)
    assert "\n" not in str(caught.value)
