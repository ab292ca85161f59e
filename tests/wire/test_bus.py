"""Orders over a real MQTT broker, and what becomes of them when it is absent, slow or dies."""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
import socket
import subprocess
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import aiomqtt
import pytest
from mosquitto import PASSWORDS, PROGRAM, Mosquitto, with_password
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.reasoncodes import ReasonCode
from session import Session

from mock_vehicle.testing import RealSwarm
from swarm_ctl.bus import mqtt
from swarm_ctl.bus.mqtt import PASSWORD_VARIABLE, Broker
from swarm_ctl.bus.orders import OrderDesk, Outcome
from swarm_ctl.cli import main
from swarm_ctl.model import Operator

pytestmark = [
    pytest.mark.wire,
    pytest.mark.skipif(PROGRAM is None or PASSWORDS is None, reason="mosquitto is not installed"),
]

PATIENCE_S = 30.0
Start = Callable[..., Mosquitto]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Give a function that starts a broker with some settings."""
    with contextlib.ExitStack() as brokers:

        def begin(*lines: str) -> Mosquitto:
            broker = Mosquitto(tmp_path, *lines)
            brokers.callback(broker.kill)
            broker.start()
            return broker

        yield begin


@pytest.fixture(autouse=True)
def _brisk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mqtt, "RETRY_S", 0.05)
    monkeypatch.delenv(PASSWORD_VARIABLE, raising=False)


class Crew:
    """Two vehicles that note what they are told, and the desk between them and a broker."""

    def __init__(self, url: str, environment: dict[str, str] | None = None) -> None:
        self.told: list[tuple[int, Operator]] = []
        self.answered = 0
        """Messages that were no order, and were looked at for each vehicle."""
        broker = Broker.parse(url, environment or {})
        self.desk = OrderDesk(broker, "hall", [1, 2], self._obey)

    def _obey(self, sysid: int, operator: Operator | None) -> Outcome:
        if operator is not None:
            self.told.append((sysid, operator))
        else:
            self.answered += 1
        return Outcome(operator not in {None, Operator.RESUME}, "exploring", 12.5)

    async def meet(self, sessions: int = 1) -> None:
        await until(lambda: self.desk.sessions >= sessions)

    @contextlib.asynccontextmanager
    async def on_duty(self, *, sessions: int = 1) -> AsyncIterator[None]:
        async with asyncio.TaskGroup() as tasks:
            serving = tasks.create_task(self.desk.run())
            await self.meet(sessions)
            yield
            serving.cancel()


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not is_so():  # noqa: ASYNC110 - another process is waited for
            await asyncio.sleep(0.01)


class Ear:
    """Somebody who speaks to a broker and hears the acknowledgements."""

    def __init__(self, client: aiomqtt.Client) -> None:
        self._client = client

    async def say(self, topic: str, payload: str | bytes, **options: Any) -> None:
        await self._client.publish(topic, payload, qos=1, **options)

    async def acks(self, count: int) -> list[tuple[str, dict[str, Any]]]:
        heard = []
        async with asyncio.timeout(PATIENCE_S):
            async for message in self._client.messages:
                heard.append((str(message.topic), json.loads(bytes(message.payload))))
                if len(heard) == count:
                    break
        return sorted(heard, key=lambda ack: ack[0])


@contextlib.asynccontextmanager
async def ear(broker: Mosquitto) -> AsyncIterator[Ear]:
    async with aiomqtt.Client("127.0.0.1", broker.port) as client:
        await client.subscribe("swarm/hall/+/ack", qos=1)
        yield Ear(client)


# -- orders and acknowledgements -----------------------------------------------------------------


async def test_an_order_to_one_reaches_it_alone(start: Start) -> None:
    broker = start()
    crew = Crew(broker.url)
    async with crew.on_duty(), ear(broker) as operator:
        await operator.say("swarm/hall/2/order", '{"order": "return", "id": "b7"}')
        answer = {"v": 1, "id": "b7", "order": "return", "accepted": True, "phase": "exploring"}
        assert await operator.acks(1) == [
            ("swarm/hall/2/ack", {**answer, "time_s": 12.5, "error": ""})
        ]
    assert crew.told == [(2, Operator.RETURN)]


async def test_an_order_to_all_reaches_all_of_the_mission(start: Start) -> None:
    broker = start()
    crew = Crew(broker.url)
    async with crew.on_duty(), ear(broker) as operator:
        await operator.say("swarm/another/order", "abort")
        await operator.say("swarm/hall/3/order", "abort")
        await operator.say("swarm/hall/order", "land")
        acks = await operator.acks(2)
    assert crew.told == [(1, Operator.LAND), (2, Operator.LAND)]
    assert [topic for topic, _ in acks] == ["swarm/hall/1/ack", "swarm/hall/2/ack"]
    assert all(ack["accepted"] for _, ack in acks)


async def test_an_order_that_makes_no_sense_is_refused(start: Start) -> None:
    broker = start()
    crew = Crew(broker.url)
    async with crew.on_duty(), ear(broker) as operator:
        await operator.say("swarm/hall/1/order", "resume")
        ((_, ack),) = await operator.acks(1)
    assert (ack["accepted"], ack["error"]) == (False, "")


async def test_what_is_no_order_is_counted_answered_and_harms_nothing(start: Start) -> None:
    broker = start()
    crew = Crew(broker.url)
    nonsense = [b"", b"\xff\xfe", b"explode", b'{"order":', b"{}", b"[" * 999, b"x" * 100_000]
    async with crew.on_duty(), ear(broker) as operator:
        for payload in nonsense:
            await operator.say("swarm/hall/1/order", payload)
        acks = await operator.acks(len(nonsense))
        assert not any(ack["accepted"] for _, ack in acks)
        assert all(ack["error"] and ack["phase"] == "exploring" for _, ack in acks)
        await operator.say("swarm/hall/1/order", "land")
        assert (await operator.acks(1))[0][1]["accepted"]
    assert crew.desk.bad == len(nonsense)
    assert crew.told == [(1, Operator.LAND)]


async def test_an_order_that_the_broker_kept_is_not_obeyed(
    start: Start, caplog: pytest.LogCaptureFixture
) -> None:
    broker = start()
    crew = Crew(broker.url)
    async with ear(broker) as operator:
        await operator.say("swarm/hall/order", "land", retain=True)
        await operator.say("swarm/hall/1/order", "land", retain=True)
        async with crew.on_duty():
            await until(lambda: crew.desk.retained == 2)
            await operator.say("swarm/hall/2/order", "return", retain=True)
            await operator.acks(1)
    assert crew.told == [(2, Operator.RETURN)], "who hears it when it is given obeys it"
    assert "a retained order on swarm/hall/order is ignored" in caplog.text


# -- brokers that are not as they should be ------------------------------------------------------


async def test_orders_are_heard_again_when_a_broker_that_died_is_back(
    start: Start, caplog: pytest.LogCaptureFixture
) -> None:
    broker = start()
    crew = Crew(broker.url)
    async with crew.on_duty():
        broker.kill()
        await until(lambda: bool(caplog.messages))
        await asyncio.sleep(0.5)  # attempts that fail
        assert len(caplog.messages) == 1, "an outage is one line"
        broker.start()
        await crew.meet(sessions=2)
        async with ear(broker) as operator:
            await operator.say("swarm/hall/1/order", "land")
            await operator.acks(1)
    assert crew.told == [(1, Operator.LAND)]
    assert [line.split(";")[-1].strip() for line in caplog.messages] == [
        "flying on without it",
        f"{broker.url}: connected again",
    ]


async def test_a_broker_that_comes_late_is_found(
    start: Start, caplog: pytest.LogCaptureFixture
) -> None:
    broker = start()
    broker.kill()
    crew = Crew(broker.url)
    async with crew.on_duty(sessions=0):
        await until(lambda: bool(caplog.messages))
        broker.start()
        await crew.meet()
    assert "Connection refused; flying on without it" in caplog.messages[0]


async def test_a_broker_whose_name_nobody_knows_is_one_line(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def unknown(*_: Any, **__: Any) -> None:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    async with Crew("mqtt://broker.invalid").on_duty(sessions=0):
        await until(lambda: bool(caplog.messages))
        await asyncio.sleep(0.3)
    (line,) = caplog.messages
    assert line.startswith("mqtt://broker.invalid:1883: ")
    assert line.endswith("Name or service not known; flying on without it")


async def test_waits_between_attempts_grow_up_to_the_longest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    waits: list[float] = []
    sleep = asyncio.sleep

    async def note(seconds: float) -> None:
        waits.append(seconds)
        await sleep(0)

    monkeypatch.setattr(mqtt, "RETRY_S", 1.0)
    monkeypatch.setattr(asyncio, "sleep", note)
    async with Crew("mqtt://127.0.0.1:1").on_duty(sessions=0):
        async with asyncio.timeout(PATIENCE_S):
            while len(waits) < 8:
                await sleep(0.01)
    assert waits[:8] == [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0]


async def test_a_wrong_password_is_one_line_and_the_right_one_enters(
    start: Start, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    broker = start(*with_password(tmp_path, "ann", "right"))
    url = broker.url.replace("//", "//ann@")
    async with Crew(url, {PASSWORD_VARIABLE: "wrong"}).on_duty(sessions=0):
        await until(lambda: bool(caplog.messages))
        await asyncio.sleep(0.3)
    (line,) = caplog.messages
    assert "Not authorized" in line
    assert "wrong" not in line
    async with Crew(url, {PASSWORD_VARIABLE: "right"}).on_duty():
        pass


async def test_a_broker_that_keeps_the_orders_to_itself_is_told_of(
    start: Start, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def forbid(*_: Any, **__: Any) -> list[ReasonCode]:
        return [ReasonCode(PacketTypes.SUBACK, "Not authorized")]  # mosquitto's file of rules never

    monkeypatch.setattr(aiomqtt.Client, "subscribe", forbid)
    async with Crew(start().url).on_duty(sessions=0):
        await until(lambda: bool(caplog.messages))
    assert "it does not let us hear the orders" in caplog.text


async def test_orders_come_before_the_echo_of_a_slow_broker(start: Start) -> None:
    broker = start()
    crew = Crew(broker.url)
    async with crew.on_duty(), ear(broker) as operator:
        broker.freeze()
        saying = [operator.say("swarm/hall/order", word) for word in ("pause", "resume", "land")]
        async with asyncio.TaskGroup() as tasks:
            for work in saying:
                tasks.create_task(work)
            await asyncio.sleep(0.2)
            broker.thaw()
        acks = await operator.acks(6)
    assert [word for sysid, word in crew.told if sysid == 1] == ["pause", "resume", "land"]
    assert {ack["order"] for _, ack in acks} == {"pause", "resume", "land"}


async def test_in_a_flood_orders_are_obeyed_and_the_echo_is_left_out(start: Start) -> None:
    broker = start()
    crew = Crew(broker.url)
    async with crew.on_duty(), ear(broker) as operator:
        for number in range(500):
            await operator.say("swarm/hall/order", f"garbage {number}")
        await operator.say("swarm/hall/order", "land")
        await until(lambda: len(crew.told) == 2)
    assert crew.desk.bad == 500
    assert crew.answered < 500, "two for each of the first twenty in a second"


async def test_whoever_serves_a_frozen_broker_can_still_be_ended(start: Start) -> None:
    broker = start()
    crew = Crew(broker.url)
    async with asyncio.timeout(PATIENCE_S):
        async with crew.on_duty():
            broker.freeze()
        broker.thaw()


async def test_an_error_while_a_client_is_closed_does_not_undo_its_cancelling(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    broker = start()
    leave, failures = aiomqtt.Client.__aexit__, [aiomqtt.MqttError("Operation timed out")]

    async def fail(client: aiomqtt.Client, *reason: Any) -> None:
        await leave(client, *reason)
        if failures:
            raise failures.pop()

    monkeypatch.setattr(aiomqtt.Client, "__aexit__", fail)
    crew = Crew(broker.url)
    async with asyncio.TaskGroup() as tasks:
        serving = tasks.create_task(crew.desk.run())
        await crew.meet()
        serving.cancel()
        ended, _ = await asyncio.wait({serving}, timeout=2.0)
        serving.cancel()
    assert ended
    assert not failures


async def test_orders_may_be_spoken_in_secret(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    key, certificate = tmp_path / "key.pem", tmp_path / "certificate.pem"
    request = f"openssl req -x509 -nodes -newkey rsa:2048 -days 1 -keyout {key} -out {certificate}"
    names = ("-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost")
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    await asyncio.to_thread(subprocess.run, [*request.split(), *names], capture_output=True)
    broker = start("allow_anonymous true", f"certfile {certificate}", f"keyfile {key}")
    url = f"mqtts://localhost:{broker.port}"
    monkeypatch.setenv("SSL_CERT_FILE", str(certificate))
    async with Crew(url).on_duty():
        pass


# -- as their users meet them --------------------------------------------------------------------


def order(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object
) -> tuple[int, str, str]:
    """Type `swarm-ctl order`; give exit status, what it said and what it complained about."""
    monkeypatch.setattr("sys.argv", ["swarm-ctl", "order", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0), *capsys.readouterr()


Type = Callable[..., tuple[int, str, str]]


@pytest.fixture
def type_order(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Type:
    return lambda *words: order(monkeypatch, capsys, *words)


async def test_who_orders_is_told_who_obeys(start: Start, type_order: Type) -> None:
    broker = start()
    crew = Crew(broker.url)
    at = ("--mqtt", broker.url, "--mission", "hall")
    async with crew.on_duty():
        typed = asyncio.to_thread
        assert await typed(type_order, "land", *at, "--sysid", 2) == (
            *(0, "vehicle 2: land accepted, it is exploring\n", ""),
        )
        code, said, complained = await typed(type_order, "return", *at, "--vehicles", 2)
        assert (code, complained) == (0, "")
        assert sorted(said.splitlines()) == [
            f"vehicle {sysid}: return accepted, it is exploring" for sysid in (1, 2)
        ]
        code, said, _ = await typed(type_order, "resume", *at, "--sysid", 1)
        assert (code, said) == (1, "vehicle 1: resume refused, it is exploring\n")
        code, said, _ = await typed(type_order, "pause", *at, "--timeout", 0.5)
        assert (code, said.count("pause accepted")) == (0, 2)
        code, said, complained = await typed(
            type_order, "land", *at, "--vehicles", 3, "--timeout", 0.5
        )
        assert (code, complained) == (1, "2 of 3 acknowledged within 0.5 s\n")


def test_who_orders_is_told_that_nobody_is_there(start: Start, type_order: Type) -> None:
    broker = start()
    at = ("--mqtt", broker.url, "--mission", "hall", "--timeout", 0.3)
    assert type_order("land", *at) == (1, "", "nobody acknowledged within 0.3 s\n")
    assert type_order("land", *at, "--sysid", 1) == (1, "", "0 of 1 acknowledged within 0.3 s\n")
    broker.kill()
    code, said, complained = type_order("land", *at)
    assert (code, said) == (2, "")
    assert complained == f"{broker.url}: [Errno 111] Connection refused\n"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--mqtt", "broker", "--mission", "hall"), "--mqtt: expected mqtt://"),
        (("--mqtt", "mqtt://a", "--mission", "+"), "--mission +: expected the name of a mission"),
        (
            ("--mqtt", "mqtt://a", "--mission", "hall", "--sysid", 1, "--vehicles", 2),
            "--vehicles counts those of an order to all",
        ),
    ],
)
def test_a_wrong_order_is_one_sentence(
    type_order: Type, words: tuple[object, ...], sentence: str
) -> None:
    code, said, complained = type_order("land", *words)
    assert (code, said, complained.count("\n")) == (2, "", 1)
    assert sentence in complained


def test_a_run_lands_everybody_when_the_broker_says_so(
    hall: Callable[..., Path],
    swarm_ctl_run: Callable[..., Session],
    start: Start,
    type_order: Type,
) -> None:
    broker = start()
    run = ("--speed", 5, "--duration", 1500, "--mqtt", broker.url)
    session = swarm_ctl_run(hall(), *run)
    session.wait_for("exploring", sysid=1)
    session.wait_for("exploring", sysid=2)
    broker.kill()
    before = len(session.events())
    session.wait_until(lambda: len(session.events()) > before)
    broker.start()
    session.wait_until(
        lambda: (
            type_order("land", "--mqtt", broker.url, "--mission", "hall", "--vehicles", 2)[0] == 0
        )
    )
    code, _, complaints = session.end()
    assert code == 0
    assert session.phases() == ["done", "done"]
    assert "land ordered by the operator" in " ".join(session.summary()["notes"])
    assert complaints.count("flying on without it") == complaints.count("connected again") == 1


@pytest.mark.mock_vehicle(vehicles=2, autopilot="mixed", rates="lean", speed=5)
def test_vehicles_that_fly_take_orders_one_by_one(
    hall: Callable[..., Path],
    swarm_ctl_run: Callable[..., Session],
    start: Start,
    type_order: Type,
    mock_swarm: RealSwarm,
) -> None:
    broker = start()
    links = [word for one in mock_swarm for word in ("--connect", one.url)]
    mission = hall(duration_s=1500.0, flight={"open_air": True})
    session = swarm_ctl_run(
        mission, *links, "--sysid", 1, "--speed", 5, "--mqtt", broker.url, command="fly"
    )
    session.wait_for("exploring", sysid=1)
    session.wait_for("exploring", sysid=2)
    at = ("--mqtt", broker.url, "--mission", "hall", "--sysid")
    assert type_order("land", *at, 2) == (0, "vehicle 2: land accepted, it is landing\n", "")
    session.wait_for("done", sysid=2)
    assert type_order("land", *at, 2) == (0, "vehicle 2: land accepted, it is done\n", "")
    assert type_order("pause", *at, 1) == (0, "vehicle 1: pause accepted, it is holding\n", "")
    assert type_order("return", *at, 1) == (0, "vehicle 1: return accepted, it is returning\n", "")
    assert session.end()[0] == 0
    assert session.phases() == ["done", "done"]


def test_a_run_without_its_broker_flies_as_well(
    hall: Callable[..., Path], swarm_ctl_run: Callable[..., Session]
) -> None:
    session = swarm_ctl_run(hall(), "--speed", 10, "--mqtt", "mqtt://127.0.0.1:1")
    code, _, complaints = session.end()
    assert (code, session.phases()) == (0, ["done", "done"])
    assert complaints.count("\n") == 1


def test_virtual_time_takes_no_orders(
    hall: Callable[..., Path], swarm_ctl_run: Callable[..., Session]
) -> None:
    session = swarm_ctl_run(hall(), "--virtual", "--mqtt", "mqtt://127.0.0.1")
    code, _, complaints = session.end()
    assert code == 2
    assert complaints.startswith("--mqtt: there is no time for orders in --virtual")
    assert not session.out.exists()


async def test_vehicles_that_wait_take_off_when_start_is_ordered(
    hall: Callable[..., Path],
    swarm_ctl_run: Callable[..., Session],
    start: Start,
    type_order: Type,
) -> None:
    broker = start()
    session = swarm_ctl_run(hall(), "--speed", 10, "--wait", "--mqtt", broker.url)
    for sysid in (1, 2):
        await asyncio.to_thread(session.wait_for, "ready", sysid=sysid)
    await asyncio.sleep(1.0)
    assert not any(e.get("data", {}).get("after") == "arming" for e in session.events())
    words = ("start", "--mqtt", broker.url, "--mission", "hall", "--vehicles", 2)
    code, said, _ = await asyncio.to_thread(type_order, *words)
    assert (code, sorted(said.splitlines())) == (
        0,
        [f"vehicle {sysid}: start accepted, it is ready" for sysid in (1, 2)],
    )
    assert (await asyncio.to_thread(session.end))[0] == 0
    assert session.phases() == ["done", "done"]
    ordered = next(e["time_s"] for e in session.events() if e["event"] == "OperatorOrder")
    assert ordered > 10.0, "it was waited for a second, ten of the mission"


def test_nobody_waits_in_virtual_time(
    hall: Callable[..., Path], swarm_ctl_run: Callable[..., Session]
) -> None:
    code, _, complaints = swarm_ctl_run(hall(), "--virtual", "--wait").end()
    assert (code, complaints.count("\n")) == (2, 1)
    assert complaints.startswith("--wait: nobody can order `start` in --virtual")
