"""What a swarm tells a real MQTT broker, also one that dies, hangs or forgets."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import re
import socket
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import aiomqtt
import pytest
from halls import write_hall
from mosquitto import PASSWORDS, PROGRAM, Mosquitto, with_password
from session import Session

from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.phases import Phase
from swarm_ctl.bus import mqtt, publisher, voice
from swarm_ctl.bus.messages import Coverage, Event, Info, State, Status, Told, read
from swarm_ctl.bus.mqtt import Broker
from swarm_ctl.bus.orders import OrderDesk, Outcome
from swarm_ctl.bus.publisher import Publisher
from swarm_ctl.flight import orders_of
from swarm_ctl.mission import load_mission
from swarm_ctl.model import Event as Fact
from swarm_ctl.model import Operator, Vec3

pytestmark = [
    pytest.mark.wire,
    pytest.mark.skipif(PROGRAM is None or PASSWORDS is None, reason="mosquitto is not installed"),
]

PAGE = (Path(__file__).parents[2] / "docs" / "bus.md").read_text()
PATIENCE_S = 60.0
RUN = "2026-11-22T09:00:00+00:00"


@pytest.fixture(autouse=True)
def _brisk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mqtt, "RETRY_S", 0.05)
    monkeypatch.setattr(voice, "STATE_S", 0.05)
    monkeypatch.setattr(voice, "GROUND_S", 0.05)


class Crew:
    """Vehicles that somebody else moves, and what tells of them."""

    def __init__(
        self, folder: Path, url: str, *, run: str = RUN, sysids: tuple[int, ...] = (1, 2)
    ) -> None:
        orders = orders_of(load_mission(write_hall(folder, {})))
        self.agents = {sysid: Agent(sysid, orders) for sysid in sysids}
        info = Info(run, "hall", "udp", list(sysids), "lf-pso", 2, 40.0, 1, None, None)
        broker = Broker.parse(url, {})
        self.publisher = Publisher(broker, info, list(self.agents.values()))
        self.notes: list[str] = []

    def note(self, sysid: int, words: str) -> None:
        self.publisher.event(Fact(1.0, sysid, "LinkLost", {"silent_s": words}))

    def fly_to(self, sysid: int, north_m: float) -> None:
        agent = self.agents[sysid]
        agent.phase = Phase.EXPLORING
        agent.telemetry.position_ned_m = Vec3(north_m, 0.0, -1.5)
        self.publisher.look(agent)

    def land(self) -> None:
        for agent in self.agents.values():
            agent.phase = Phase.DONE

    @contextlib.asynccontextmanager
    async def on_air(self, *, sessions: int = 1) -> AsyncIterator[None]:
        """Tell until the end of the block, and then the last words."""
        async with asyncio.TaskGroup() as tasks:
            telling = tasks.create_task(self.publisher.run())
            await until(lambda: self.publisher.sessions >= sessions)
            yield
            self.land()
            self.notes = await self.publisher.finish()
            telling.cancel()


class Log:
    """All that a subscriber has heard, with nothing sorted out."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, bytes]] = []

    def told(self, kind: type[Told]) -> list[Any]:
        told = (read(topic, payload) for topic, payload in self.heard)
        return [one for one in told if isinstance(one, kind)]

    def status(self, sysid: int) -> str:
        said = [one.status for one in self.told(Status) if one.sysid == sysid]
        return str(said[-1]) if said else ""

    def events(self) -> list[tuple[int, int]]:
        return [(event.sysid, event.id) for event in self.told(Event)]


@contextlib.asynccontextmanager
async def subscriber(port: int, **who: Any) -> AsyncIterator[Log]:
    log = Log()

    async def listen(client: aiomqtt.Client) -> None:
        async for message in client.messages:
            log.heard.append((str(message.topic), bytes(message.payload)))

    async with aiomqtt.Client("127.0.0.1", port, **who) as client, asyncio.TaskGroup() as tasks:
        listening = tasks.create_task(listen(client))
        await client.subscribe("swarm/#", qos=1)
        yield log
        listening.cancel()


async def late_log(port: int, **who: Any) -> Log:
    """Subscribe when all is over, and wait until nothing more comes that the broker has kept."""
    async with subscriber(port, **who) as log:
        count = -1
        while count < len(log.heard):
            count = len(log.heard)
            await asyncio.sleep(0.3)
    return log


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not is_so():  # noqa: ASYNC110 - another process is waited for
            await asyncio.sleep(0.01)


# -- who listens ---------------------------------------------------------------------------------


async def test_a_subscriber_sees_where_vehicles_are_and_what_they_have_seen(
    broker: Mosquitto, tmp_path: Path
) -> None:
    crew = Crew(tmp_path, broker.url)
    async with subscriber(broker.port) as log, crew.on_air():
        for step in range(40):
            crew.fly_to(2, 0.1 * step)
            await asyncio.sleep(0.01)
        await until(lambda: log.status(1) == log.status(2) == "online")
        await until(lambda: any(one.position_ned_m[0] > 3.8 for one in log.told(State)))
        crew.land()
        await until(lambda: log.status(1) == log.status(2) == "done")
    assert {info.mission for info in log.told(Info)} == {"hall"}
    last = [state for state in log.told(State) if state.sysid == 2][-1]
    assert (last.phase, last.seen_m2 > 1.0) == ("done", True)
    deltas = [p for t, p in log.heard if t == "swarm/hall/2/coverage"]
    told = [Coverage.load(payload) for payload in deltas]
    assert [one.number for one in told if one] == list(range(1, len(told) + 1))
    whole = log.told(Coverage)[-1]
    squares = sum(count for one in told if one for *_, count in one.rows)
    assert squares == sum(count for *_, count in whole.rows)
    assert crew.notes == []


async def test_a_latecomer_gets_every_event_once_and_the_last_of_all_else(
    broker: Mosquitto, tmp_path: Path
) -> None:
    crew = Crew(tmp_path, broker.url)
    async with crew.on_air():
        for number in range(30):
            crew.note(1 + number % 2, f"{number}")
    log = await late_log(broker.port)
    assert sorted(log.events()) == [(sysid, number) for sysid in (1, 2) for number in range(1, 16)]
    kinds = Counter(topic.split("/")[-1] for topic, _ in log.heard if "event" not in topic)
    assert (kinds["info"], kinds["status"], kinds["state"]) == (1, 2, 2)


async def test_what_an_earlier_run_left_is_forgotten(broker: Mosquitto, tmp_path: Path) -> None:
    earlier, other = Crew(tmp_path, broker.url), Crew(tmp_path, broker.url, sysids=(7,))
    for crew in (earlier, other):
        async with crew.on_air():
            for sysid in crew.agents:
                crew.note(sysid, "then")
                crew.note(sysid, "then, too")
                crew.fly_to(sysid, 0.0)
                crew.fly_to(sysid, 1.0)
    again = Crew(tmp_path, broker.url, run="2026-11-22T10:00:00+00:00")
    async with again.on_air():
        again.note(1, "now")
    log = await late_log(broker.port)
    assert sorted(log.events()) == [(1, 1), (7, 1), (7, 2)], "another process's vehicle stays"
    assert {(one.sysid, one.run) for one in log.told(Coverage)} == {(7, RUN)}
    assert {one.run for one in log.told(State) if one.sysid < 3} == {"2026-11-22T10:00:00+00:00"}


async def test_what_a_restarted_controller_tells_is_added_to_what_was_told(
    broker: Mosquitto, tmp_path: Path
) -> None:
    for restarts in (0, 1):
        crew = Crew(tmp_path, broker.url)
        crew.agents[1].trail.fresh = []  # as whoever reads a journal does
        for north_m in range(6):
            crew.agents[1].trail.mark(Vec3(0.5 * north_m, 0.0, -1.5))
        crew.publisher = Publisher(
            Broker.parse(broker.url, {}),
            Info(RUN, "hall", "fly", [1, 2], "lf-pso", 2, 40.0, 1, None, None),
            list(crew.agents.values()),
            restarts={1: restarts, 2: restarts}.__getitem__,
        )
        async with crew.on_air():
            crew.note(1, "here")
    log = await late_log(broker.port)
    assert sorted(log.events()) == [(1, 1), (1, 1_000_001)]
    (whole,) = log.told(Coverage)
    assert whole.number == 1_000_001
    assert max(row[0] for row in whole.rows) > 10, "what was seen before the restart is in it"


# -- brokers that are not as they should be ------------------------------------------------------


async def test_a_broker_that_died_and_forgot_is_told_all_again(
    broker: Mosquitto, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    crew = Crew(tmp_path, broker.url)
    async with crew.on_air():
        crew.note(1, "before")
        crew.fly_to(1, 0.0)
        journals = [voice.journal for voice in crew.publisher._voices.values()]
        for outage in range(3):
            await until(lambda: crew.publisher.sessions > outage)  # noqa: B023 - awaited here
            await until(lambda: all(journal.due() is None for journal in journals))
            broker.kill()
            crew.note(1, "meanwhile")
            crew.note(2, "meanwhile")
            crew.fly_to(1, 1.0 + outage)
            broker.start()
    gc.collect()
    assert [record for record in caplog.records if record.name == "asyncio"] == []
    log = await late_log(broker.port)
    assert sorted(log.events()) == [(1, 1), (1, 2), (1, 3), (1, 4), (2, 1), (2, 2), (2, 3)]
    assert (log.status(1), log.status(2)) == ("done", "done")
    (whole,) = log.told(Coverage)
    cells = sum(count for *_, count in whole.rows)
    assert cells == crew.publisher._voices[1]._ground.cells > 0
    assert crew.notes == []


async def test_a_frozen_broker_holds_up_nobody_and_loses_nothing(
    broker: Mosquitto, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    crew = Crew(tmp_path, broker.url)
    loop = asyncio.get_running_loop()
    async with crew.on_air():
        broker.freeze()
        began_s, longest_s = loop.time(), 0.0
        for number in range(100):
            before_s = loop.time()
            crew.note(1, f"{number}")
            crew.fly_to(1, 0.1 * number)
            await asyncio.sleep(0)
            longest_s = max(longest_s, loop.time() - before_s)
            await asyncio.sleep(0.005)
        assert longest_s < 0.5 * (loop.time() - began_s), "no note waits for an answer"
        broker.thaw()
    gc.collect()
    assert [record for record in caplog.records if record.name == "asyncio"] == []
    log = await late_log(broker.port)
    assert len(log.events()) == len(set(log.events())) == 100


async def test_what_is_on_its_way_when_the_mission_ends_is_told_once(
    broker: Mosquitto, tmp_path: Path
) -> None:
    crew = Crew(tmp_path, broker.url)
    teller = crew.publisher._voices[1]
    async with subscriber(broker.port) as log, crew.on_air():
        crew.fly_to(1, 0.0)
        await until(lambda: sum(one.sysid == 1 for one in log.told(State)) > 1)
        broker.freeze()
        crew.note(1, "late")
        crew.fly_to(1, 1.0)
        await until(lambda: teller._untold is not None)
        crew.land()
        await asyncio.sleep(3.0 * voice.STATE_S)
        broker.thaw()
        await until(lambda: log.status(1) == "done")
    assert log.events() == [(1, 1)]
    assert [t for t, _ in log.heard].count("swarm/hall/1/coverage") == 1


async def test_what_never_got_out_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(publisher, "LAST_WORDS_S", 0.2)
    crew = Crew(tmp_path, "mqtt://127.0.0.1:1")
    async with crew.on_air(sessions=0):
        for number in range(1002):
            crew.note(1, f"{number}")
    assert crew.notes == ["mqtt://127.0.0.1:1: 2 events were lost, 1000 events were never taken"]


async def test_a_broker_that_lets_nobody_in_without_a_password_is_told_with_it(
    tmp_path: Path,
) -> None:
    broker = Mosquitto(tmp_path, *with_password(tmp_path, "ann", "right"))
    broker.start()
    try:
        for password, is_in in (("wrong", False), ("right", True)):
            crew = Crew(tmp_path, broker.url.replace("//", f"//ann:{password}@"))
            async with crew.on_air(sessions=int(is_in)):
                crew.note(1, "here")
                await asyncio.sleep(0.3)
            assert (crew.notes == []) == is_in
    finally:
        broker.kill()


async def test_the_rules_of_the_page_let_vehicles_tell_and_operators_order(
    tmp_path: Path,
) -> None:
    (rules,) = re.findall(r"```\w*\n(user vehicle\n.*?)```", PAGE, re.DOTALL)
    (tmp_path / "rules").write_text(rules)
    names = with_password(tmp_path, "vehicle", "pass", "operator", "viewer")
    broker = Mosquitto(tmp_path, *names, f"acl_file {tmp_path / 'rules'}")
    broker.start()
    heard: list[tuple[int, Operator]] = []

    def obey(sysid: int, operator: Operator | None) -> Outcome:
        heard.extend([(sysid, operator)] if operator else [])
        return Outcome(True, "exploring", 1.0)

    url = broker.url.replace("//", "//vehicle:pass@")
    crew, desk = Crew(tmp_path, url), OrderDesk(Broker.parse(url, {}), "hall", [1, 2], obey)
    try:
        async with asyncio.TaskGroup() as tasks, crew.on_air():
            serving = tasks.create_task(desk.run())
            await until(lambda: desk.sessions > 0)
            crew.note(1, "here")
            for user in ("vehicle", "viewer", "operator"):
                who: dict[str, Any] = {"username": user, "password": "pass"}
                async with aiomqtt.Client("127.0.0.1", broker.port, **who) as client:
                    await client.publish("swarm/hall/1/order", "land", qos=1)
                    await client.publish("swarm/hall/2/event/9", user, qos=1, retain=True)
                    await client.publish("swarm/hall/order", "return", qos=1)
            await until(lambda: len(heard) >= 3)
            serving.cancel()
        log = await late_log(broker.port, username="viewer", password="pass")  # noqa: S106
    finally:
        broker.kill()
    assert heard == [(1, Operator.LAND), (1, Operator.RETURN), (2, Operator.RETURN)]
    assert log.events() == [(1, 1)]
    assert ("swarm/hall/2/event/9", b"vehicle") in log.heard, "nobody else tells of vehicles"


async def test_two_missions_on_one_broker_do_not_meet(broker: Mosquitto, tmp_path: Path) -> None:
    here = Crew(tmp_path, broker.url)
    there = Crew(tmp_path, broker.url)
    for one in there.publisher._voices.values():
        one._mission = "attic"
    async with here.on_air(), there.on_air():
        here.note(1, "in the hall")
        there.note(1, "in the attic")
        there.note(1, "still")
    log = await late_log(broker.port)
    topics = sorted(topic for topic, _ in log.heard if "event" in topic)
    assert topics == [
        "swarm/attic/1/event/1",
        "swarm/attic/1/event/2",
        "swarm/hall/1/event/1",
    ]
    assert sum(topic.endswith("status") for topic, _ in log.heard) == 4


# -- a run ---------------------------------------------------------------------------------------


@pytest.fixture
def black_hole() -> Iterator[str]:
    """Give the address of somebody who takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        yield f"mqtt://127.0.0.1:{silent.getsockname()[1]}"


def expected_events(session: Session) -> Counter[tuple[int, str]]:
    """Count what the run folder says that was news, by vehicle and name."""
    dull = {"ContactsChanged", "Connected", "CommandProgress", "RunStarted", "RunResumed"}
    return Counter(
        (event["sysid"], event["event"])
        for event in session.events()
        if event["event"] not in dull and event.get("data", {}).get("severity", 0) <= 4
    )


async def test_every_event_of_a_mission_arrives_once_though_its_broker_was_killed_three_times(
    hall: Callable[..., Path], swarm_ctl_run: Callable[..., Session], broker: Mosquitto
) -> None:
    mission = hall(duration_s=60.0, vehicles=3)
    session = swarm_ctl_run(mission, "--speed", 5, "--mqtt", broker.url)
    for moment in ("takeoff", "exploring", "returning"):
        await asyncio.to_thread(session.wait_for, moment, sysid=2)
        broker.kill()
        await asyncio.sleep(0.5)
        broker.start()
    code, _, complaints = await asyncio.to_thread(session.end)
    assert (code, session.phases()) == (0, ["done"] * 3)
    log = await late_log(broker.port)
    found = [(event.sysid, event.name) for event in log.told(Event)]
    assert Counter(found) == expected_events(session)
    assert len(log.events()) == len(set(log.events()))
    assert complaints.count("flying on without it") == complaints.count("connected again") <= 3
    assert complaints.count("\n") <= 6
    explored = [
        one["explored_to_s"] - one["explored_from_s"] for one in session.summary()["per_vehicle"]
    ]
    assert explored == pytest.approx([60.0] * 3, abs=1.0)
    info = log.told(Info)[0]
    assert info.plan["name"] == "hall"
    assert "victims" not in info.plan
    assert sorted(state.origin_ned_m for state in log.told(State)) == [
        [6.0, 6.0, 0.0],
        [6.0, 8.0, 0.0],
        [6.0, 10.0, 0.0],
    ]


async def test_the_last_will_of_a_killed_controller_says_offline(
    hall: Callable[..., Path],
    swarm_ctl_run: Callable[..., Session],
    processes: Callable[[str], list[int]],
    broker: Mosquitto,
) -> None:
    session = swarm_ctl_run(hall(), "--speed", 5, "--duration", 1500, "--mqtt", broker.url)
    async with subscriber(broker.port) as log:
        await asyncio.to_thread(session.wait_for, "exploring")
        await until(lambda: log.status(1) == log.status(2) == "online")
        session.process.kill()
        await until(lambda: log.status(1) == log.status(2) == "offline")
    await until(lambda: processes("mock_vehicle") == [])


def test_a_run_flies_on_beside_a_broker_that_says_nothing(
    hall: Callable[..., Path], swarm_ctl_run: Callable[..., Session], black_hole: str
) -> None:
    session = swarm_ctl_run(hall(duration_s=30.0), "--speed", 5, "--mqtt", black_hole)
    code, _, complaints = session.end()
    assert (code, session.phases()) == (0, ["done", "done"])
    assert complaints.count("\n") == 1
    notes = json.dumps(session.summary()["notes"])
    assert "events were never taken" in notes


# -- a broker in the process itself --------------------------------------------------------------


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


async def test_a_run_may_be_its_own_broker(
    hall: Callable[..., Path], swarm_ctl_run: Callable[..., Session]
) -> None:
    port = free_port()
    session = swarm_ctl_run(
        hall(vehicles=6), "--speed", 5, "--duration", 1500, "--mqtt", f"embedded:{port}"
    )
    for sysid in range(1, 7):
        await asyncio.to_thread(session.wait_for, "exploring", sysid=sysid)
    async with subscriber(port) as log:
        await until(lambda: {log.status(sysid) for sysid in range(1, 7)} == {"online"})
        await until(lambda: len(log.events()) >= 24)
    assert "PhaseChanged" in {event.name for event in log.told(Event)}
    assert len(log.events()) == len(set(log.events()))
    assert log.told(Info)[0].mission == "hall"
    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.publish("swarm/hall/order", "land", qos=1)
    code, _, complaints = await asyncio.to_thread(session.end)
    assert (code, complaints, session.phases()) == (0, "", ["done"] * 6)


def test_a_port_in_use_is_told_before_anything_flies(
    hall: Callable[..., Path], swarm_ctl_run: Callable[..., Session], broker: Mosquitto
) -> None:
    session = swarm_ctl_run(hall(), "--mqtt", f"embedded:{broker.port}")
    code, _, complaints = session.end()
    assert code == 2
    assert complaints == (
        f"--mqtt embedded: port {broker.port} cannot be had: it is in use; name another one, as "
        "embedded:18830\n"
    )
    assert not session.out.exists()
