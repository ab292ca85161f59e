"""Peers over a real broker that dies, comes back, and is late."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator

import aiomqtt
import pytest
from mosquitto import Mosquitto

from swarm_ctl.agent.beacon import BEACON_TYPE
from swarm_ctl.agent.sender import Sender
from swarm_ctl.bus import mqtt
from swarm_ctl.bus.mqtt import Broker
from swarm_ctl.bus.peers import FORGOTTEN_S, LATE_S, Echo, PeersOverMqtt

pytestmark = pytest.mark.wire

PATIENCE_S = 20.0


class Vehicle:
    """A process with one vehicle that tells everybody ten times a second what time it is."""

    def __init__(self, broker: Mosquitto, sysid: int) -> None:
        self.transport = PeersOverMqtt(Broker.parse(broker.url, {}), "hall")
        self.ages_s: list[float] = []
        """How old it was what it has heard."""
        self._sender = Sender(sysid)

    async def talk(self) -> None:
        now = asyncio.get_running_loop().time
        while True:
            frame = self._sender.broadcast(BEACON_TYPE, f"{now():020.9f}".encode())
            self.transport.send(self._sender.sysid, frame)
            await asyncio.sleep(0.1)

    def hear(self, data: bytes, _sysid: int | None) -> None:
        told_s = float(data[-22:-2])
        self.ages_s.append(asyncio.get_running_loop().time() - told_s)

    async def hears(self, more: int = 3) -> None:
        before = len(self.ages_s)
        async with asyncio.timeout(PATIENCE_S):
            while len(self.ages_s) < before + more:  # noqa: ASYNC110 - another process is waited for
                await asyncio.sleep(0.01)


@contextlib.asynccontextmanager
async def on_air(*vehicles: Vehicle) -> AsyncIterator[None]:
    async with asyncio.TaskGroup() as tasks:
        works = [work for one in vehicles for work in (one.transport.carry(one.hear), one.talk())]
        begun = [tasks.create_task(work) for work in works]
        yield
        for task in begun:
            task.cancel()


@pytest.fixture(autouse=True)
def _brisk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mqtt, "RETRY_S", 0.05)


async def test_peers_are_heard_again_when_a_dead_broker_is_back(
    broker: Mosquitto, caplog: pytest.LogCaptureFixture
) -> None:
    one, two = Vehicle(broker, 1), Vehicle(broker, 2)
    async with on_air(one, two):
        await one.hears()
        broker.kill()
        await asyncio.sleep(0.5)
        assert len(caplog.messages) == 2, "each process says once that it is gone"
        broker.start()
        await one.hears()
        await two.hears()
    ends = [line.rsplit(": ")[-1].rsplit("; ")[-1] for line in caplog.messages]
    assert ends == 2 * ["flying on without peers over it"] + 2 * ["connected again"]
    (words,) = one.transport.account()
    assert "datagrams did not leave" in words


async def test_what_a_slow_broker_held_back_is_no_news(broker: Mosquitto) -> None:
    one, two = Vehicle(broker, 1), Vehicle(broker, 2)
    async with on_air(one, two):
        await one.hears()
        await two.hears()
        before = one.transport.unsent
        broker.freeze()
        await asyncio.sleep(4 * LATE_S)
        broker.thaw()
        await one.hears()
        await two.hears()
    assert max(*one.ages_s, *two.ages_s) < 2 * LATE_S
    assert one.transport.late > 0
    assert one.transport.unsent > before + 5, (
        "who is late says nothing that would be old when it arrives"
    )


async def test_a_broker_that_keeps_frames_gives_nobody_old_ones(broker: Mosquitto) -> None:
    one, two = Vehicle(broker, 1), Vehicle(broker, 2)
    old = Sender(3).broadcast(BEACON_TYPE, b"%020d" % 0)
    async with aiomqtt.Client("127.0.0.1", broker.port) as stranger:
        await stranger.publish("swarm/hall/3/peers", old, qos=1, retain=True)
        async with on_air(one, two):
            await stranger.publish("swarm/hall/x/peers", old, qos=1)
            await stranger.publish("swarm/hall/3/peers", b"x" * 3000, qos=1)
            await one.hears()
    assert max(one.ages_s) < PATIENCE_S
    assert one.transport.refused >= 1
    assert "were no peer's" in one.transport.account()[0]


def test_a_broker_is_as_late_as_what_comes_back() -> None:
    echo = Echo()
    assert echo.late_s(0.0) == 0.0
    for tick in range(5):
        echo.say(b"%d" % tick, 0.1 * tick)
    echo.hear(b"1", 0.3)
    assert echo.late_s(0.3) == pytest.approx(0.2)
    assert echo.late_s(0.5) == pytest.approx(0.3), "the oldest that is out, though not back yet"
    assert not echo.may_say(0.2 + LATE_S + 0.1)
    echo.hear(b"never said", 0.8)
    echo.hear(b"4", 1.4)
    assert echo.late_s(1.4) == pytest.approx(1.0)
    assert echo.may_say(1.4), "one, to try whether it is quicker now"
    echo.say(b"5", 1.5)
    assert not echo.may_say(1.6)
    echo.hear(b"5", 1.6)
    assert echo.may_say(1.7)


def test_what_is_lost_on_its_way_does_not_silence_a_vehicle_for_good() -> None:
    echo = Echo()
    echo.say(b"lost", 0.0)
    assert not echo.may_say(FORGOTTEN_S - 0.1)
    assert echo.may_say(FORGOTTEN_S + 0.1)
    assert echo.late_s(FORGOTTEN_S + 0.1) > LATE_S, "it is not believed before one is back"
