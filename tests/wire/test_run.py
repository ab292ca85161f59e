"""`swarm-ctl run` as its user meets it: processes, sockets, signals and what they leave behind."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil  # noqa: TID251 - the reader of logs that everybody has
from session import PATIENCE_S, Session

import swarm_ctl.run.mock
from swarm_ctl.flight import Faults, finish
from swarm_ctl.link.udp import UdpLink
from swarm_ctl.mission import load_mission
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.run.fleet import STOP_SIGNALS
from swarm_ctl.run.mock import UdpRun

pytestmark = pytest.mark.wire

SUMMARY_KEYS = {
    *("mission", "world", "seed", "planner", "autopilot", "vehicles", "mode", "duration_s"),
    *("wall_s", "coverage_fraction", "victims_found", "victims_total", "collisions"),
    *("min_separation_m", "path_length_m", "energy_kwh", "setpoint_jitter_p99_ms"),
    *("messages_sent", "messages_lost", "run_sha256", "setpoint_late_fraction"),
    *("mock_late_fraction", "mock_dropped", "datagrams_unsent", "datagrams_unheard"),
}
PICTURES = {"coverage.png", "coverage_map.png", "paths.png", "contacts.png"}


Type = Callable[..., Session]
Hall = Callable[..., Path]
Processes = Callable[[str], list[int]]


# -- a run that goes well ------------------------------------------------------------------------


@pytest.mark.parametrize(("autopilot", "vehicles"), [("px4", 2), ("ardupilot", 1), ("mixed", 3)])
def test_a_run_ends_by_itself_and_leaves_its_record(
    hall: Hall, swarm_ctl_run: Type, autopilot: str, vehicles: int
) -> None:
    session = swarm_ctl_run(hall(), "--speed", 10, "--autopilot", autopilot, "--vehicles", vehicles)
    code, out, complaints = session.end()
    assert (code, complaints) == (0, "")
    assert "hall flown" in out
    assert "\x1b" not in out, "no colours in a pipe"
    summary = session.summary()
    assert summary.keys() >= SUMMARY_KEYS
    assert (summary["mode"], summary["outcome"]) == ("udp", "flown")
    assert (summary["autopilot"], summary["vehicles"]) == (autopilot, vehicles)
    assert summary["collisions"] == 0
    assert summary["coverage_fraction"] > 0.02
    assert summary["path_length_m"] > 5.0
    assert session.phases() == ["done"] * vehicles
    alone = {"contacts.png"} if vehicles == 1 else set()
    assert {path.name for path in session.out.glob("*.png")} == PICTURES - alone
    assert len(json.loads((session.out / "paths.json").read_text())["vehicles"]) == vehicles
    assert {path.name for path in (session.out / "truth").iterdir()} == {
        *("truth.json", "truth.npz", "world.json", "radio.json")
    }
    kinds = {"px4": [12], "ardupilot": [3], "mixed": [12, 3]}[autopilot]
    for sysid in range(1, vehicles + 1):
        assert heartbeats(session.out, sysid) == {(sysid, kinds[(sysid - 1) % len(kinds)])}


def heartbeats(out: Path, sysid: int) -> set[tuple[int, int]]:
    """Give sysid and autopilot of the heartbeats in a vehicle's log, read by pymavlink."""
    log: Any = mavutil.mavlink_connection(  # type: ignore[no-untyped-call]
        str(out / "tlogs" / f"vehicle-{sysid:03d}.tlog")
    )
    found = set()
    try:
        while (message := log.recv_match(type="HEARTBEAT")) is not None:
            if message.get_srcComponent() == 1:
                found.add((message.get_srcSystem(), message.autopilot))
    finally:
        log.close()
    return found


# -- what is broken on purpose -------------------------------------------------------------------


def test_a_run_ends_five_seconds_after_its_fleet_was_killed(
    hall: Hall, swarm_ctl_run: Type, processes: Processes
) -> None:
    session = swarm_ctl_run(hall(), "--speed", 10, "--duration", 100)
    session.wait_for("exploring", sysid=2)
    (mock,) = processes("mock_vehicle")
    os.kill(mock, signal.SIGKILL)
    code, out, complaints = session.end()
    assert (code, complaints) == (1, "")
    summary = session.summary()
    assert summary["outcome"] == "failed"
    assert session.phases() == ["failed", "failed"]
    (died,) = [note for note in summary["notes"] if note.startswith("the mock fleet died at ")]
    assert died in out
    died_s = float(died.split()[-2])
    assert 4.0 < summary["duration_s"] - died_s < 15.0
    assert "vehicles 1 and 2: its autopilot died with the mock fleet" in summary["notes"]
    assert summary["coverage_fraction"] is None, "nobody is left who knows"


def test_the_others_fly_on_when_a_vehicle_and_a_controller_die(
    hall: Hall, swarm_ctl_run: Type
) -> None:
    faults = ("--fault", "dead:2@12", "--fault", "controller:3@12")
    session = swarm_ctl_run(hall(), "--vehicles", 4, "--speed", 8, *faults)
    code, out, _ = session.end()
    assert code == 0
    assert session.phases() == ["done", "failed", "failed", "done"]
    notes = " ".join(session.summary()["notes"])
    assert "vehicle 2: nothing heard from its autopilot" in notes
    assert "vehicle 3: its controller was killed" in notes
    assert "vehicle 3: its controller was killed" in out


@pytest.mark.parametrize("moment", ["0", "12"])
def test_a_fleet_that_dies_by_itself_ends_the_run(
    hall: Hall, swarm_ctl_run: Type, moment: str
) -> None:
    session = swarm_ctl_run(hall(), "--speed", 10, "--fault", f"fleet@{moment}")
    code, _, complaints = session.end()
    assert (code, complaints) == (1, "")
    summary = session.summary()
    assert any(note.startswith("the mock fleet died at ") for note in summary["notes"])
    assert summary["duration_s"] < float(moment) + 20.0
    assert session.phases() == ["failed", "failed"]


# -- signals -------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("mode", [("--speed", 10), ("--virtual",)])
def test_an_interrupted_run_lands_everybody_and_writes_the_summary(
    hall: Hall, swarm_ctl_run: Type, mode: tuple[object, ...], number: int
) -> None:
    session = swarm_ctl_run(hall(), "--duration", 1500, *mode)
    session.wait_for("exploring", sysid=2)
    if number == signal.SIGINT:
        session.ctrl_c()
    else:
        session.signal(number)
    code, out, complaints = session.end()
    assert (code, complaints) == (130, "")
    assert "hall interrupted" in out
    assert session.summary()["outcome"] == "interrupted"
    assert session.phases() == ["done", "done"]
    assert {path.name for path in session.out.glob("*.png")} == PICTURES


@pytest.mark.parametrize("mode", [("--speed", 4), ("--virtual", "--vehicles", 12)])
def test_a_second_interrupt_ends_the_run_at_once(
    hall: Hall, swarm_ctl_run: Type, mode: tuple[object, ...]
) -> None:
    session = swarm_ctl_run(hall(), "--duration", 1500, *mode)
    session.wait_for("exploring")
    session.ctrl_c()
    session.wait_until(lambda: "OperatorOrder" in str(session.events()))
    session.ctrl_c()
    code, _, complaints = session.end()
    assert (code, complaints) == (130, "")
    summary = session.summary()
    assert summary["outcome"] == "interrupted"
    assert "interrupted twice: ended without waiting for the landings" in summary["notes"]
    assert "failed" in session.phases()


def test_an_interrupt_before_the_fleet_is_up_keeps_everybody_on_the_ground(
    hall: Hall, swarm_ctl_run: Type, processes: Processes
) -> None:
    session = swarm_ctl_run(hall(), "--speed", 10, "--duration", 1500)
    session.wait_until(lambda: processes("mock_vehicle") != [])
    session.ctrl_c()
    code, _, complaints = session.end()
    assert (code, complaints) == (130, "")
    assert session.phases() == ["done", "done"]


def test_two_interrupts_before_the_fleet_is_up_leave_no_half_record(
    hall: Hall, swarm_ctl_run: Type, processes: Processes
) -> None:
    session = swarm_ctl_run(hall(), "--duration", 1500)
    session.wait_until(lambda: processes("mock_vehicle") != [])
    session.ctrl_c()
    session.wait_until(lambda: "OperatorOrder" in str(session.events()))
    session.ctrl_c()
    code, out, complaints = session.end()
    assert (code, complaints) == (130, "")
    assert session.out.exists() == ("hall interrupted" in out), "no record but a whole one"


def test_a_killed_controller_takes_its_fleet_with_it_and_leaves_a_readable_record(
    hall: Hall, swarm_ctl_run: Type, processes: Processes
) -> None:
    session = swarm_ctl_run(hall(), "--speed", 10, "--duration", 1500)
    session.wait_for("exploring")
    (mock,) = processes("mock_vehicle")
    session.signal(signal.SIGKILL)
    session.process.wait(PATIENCE_S)
    deadline_s = time.monotonic() + PATIENCE_S
    while processes("mock_vehicle"):
        assert time.monotonic() < deadline_s, f"{mock} lives on"
    mission = json.loads((session.out / "mission.json").read_text())
    assert mission["mission"]["vehicles"] == 2
    assert session.events()[0]["event"] == "RunStarted"
    assert session.events()[-1]["sysid"] in {1, 2}


def test_a_reader_who_leaves_does_not_bring_the_swarm_down(hall: Hall, swarm_ctl_run: Type) -> None:
    session = swarm_ctl_run(hall(), "--speed", 10, "--duration", 2)
    assert session.process.stdout is not None
    session.process.stdout.close()
    session.process.stdout = None
    code, _, complaints = session.end()
    assert (code, complaints) == (0, "")
    assert session.phases() == ["done", "done"]


# -- a fleet that does not start -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("world", "fault", "sentence"),
    [
        ({"radio": {"radus_m": 3}}, "dead:1@2", "world.yaml: radio.radus_m: unknown key"),
        ({"starts": [{"position_m": [99, 99]}]}, "dead:1@2", "world.yaml: starts"),
        ({}, "daed:1@2", "--fault daed:1@2: 'daed' is no fault; did you mean 'dead'?"),
        ({}, "dead:3@2", "there is no vehicle 3; they are 1 to 2"),
    ],
)
def test_what_the_fleet_complains_about_is_the_one_sentence(
    hall: Hall, swarm_ctl_run: Type, world: dict[str, Any], fault: str, sentence: str
) -> None:
    session = swarm_ctl_run(hall(world=world), "--fault", fault)
    code, out, complaint = session.end()
    assert (code, out) == (2, "")
    assert sentence in complaint
    assert complaint.count("\n") == 1
    assert not session.out.exists(), "nothing flew, so there is no record"


# -- inside one process --------------------------------------------------------------------------


class Swarm:
    """A run whose controllers and sockets a test can reach."""

    def __init__(self, mission: Path, monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
        loaded = load_mission(mission, **changes)
        out = mission.parent / "run"
        self.folder = RunFolder.create(out, "hall", loaded.dump(), seed=1, mode="udp")
        self.run = UdpRun(loaded, self.folder, speed=10.0, faults=Faults())
        self.links: list[UdpLink] = []
        swarm = self

        class Known(UdpLink):
            def __init__(self, url: str) -> None:
                super().__init__(url)
                swarm.links.append(self)

        monkeypatch.setattr(swarm_ctl.run.mock, "UdpLink", Known)

    async def fly(self, progress: Callable[[UdpRun], None] = lambda _: None) -> dict[str, Any]:
        """Fly to the end; no task and no socket may be left."""
        await self.run.fly(progress)
        assert asyncio.all_tasks() == {asyncio.current_task()}
        assert [link.fileno() for link in self.links] == [-1] * len(self.links)
        return finish(
            self.run.mission,
            self.folder,
            self.run.controllers,
            mode="udp",
            time_s=self.run.now,
            wall_s=1.0,
            interrupted=self.run.interrupted,
            notes=self.run.notes,
        )

    def phases(self) -> list[str]:
        return [controller.agent.phase.value for controller in self.run.controllers]

    def is_exploring(self) -> bool:
        return all(phase in {"exploring", "avoiding"} for phase in self.phases())


@pytest.fixture
def swarm(hall: Hall, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Swarm]]:
    with contextlib.ExitStack() as folders:

        def prepare(**changes: Any) -> Swarm:
            prepared = Swarm(hall(), monkeypatch, **changes)
            folders.enter_context(prepared.folder)
            return prepared

        yield prepare


Prepare = Callable[..., Swarm]


async def test_controllers_that_break_do_not_stop_the_others(
    swarm: Prepare, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = swarm(vehicles=3)
    _, receiving, deciding = flight.run.controllers

    def broken(*_: Any) -> Any:
        raise TypeError("no idea")

    def break_in_flight(_: UdpRun) -> None:
        if flight.phases()[0] == "exploring":
            monkeypatch.setattr(receiving.agent.parser, "feed", broken)
            monkeypatch.setattr(deciding, "tick", broken)

    summary = await flight.fly(break_in_flight)
    assert flight.phases() == ["done", "failed", "failed"]
    assert "vehicles 2 and 3: its controller broke: TypeError: no idea" in summary["notes"]
    assert summary["outcome"] == "flown"


async def test_a_controller_that_breaks_by_an_order_keeps_it_from_no_other(
    swarm: Prepare, monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = swarm(vehicles=3, duration_s=1500.0)

    def broken(*_: Any) -> Any:
        raise TypeError("no idea")

    def order_in_flight(_: UdpRun) -> None:
        if flight.is_exploring() and not flight.run.interrupted:
            monkeypatch.setattr(flight.run.controllers[0].agent, "order", broken)
            flight.run.interrupt()

    await flight.fly(order_in_flight)
    assert flight.phases() == ["failed", "done", "done"]


async def test_garbage_is_counted_and_changes_nothing(swarm: Prepare) -> None:
    flight = swarm()
    dice = np.random.default_rng(1)
    sent = 0
    with contextlib.closing(UdpLink("udpin://127.0.0.1:0")) as stranger:

        def throw(_: UdpRun) -> None:
            nonlocal sent
            for link in flight.links if flight.is_exploring() else ():
                port = link._socket.getsockname()[1]
                for size in (0, 1, 12, 300, 2048, 9000):
                    stranger._socket.sendto(dice.bytes(size), ("127.0.0.1", port))
                    sent += 1

        summary = await flight.fly(throw)
    assert sent > 10
    assert flight.phases() == ["done", "done"]
    assert summary["collisions"] == 0
    for controller in flight.run.controllers:
        assert controller.agent.parser.stats.skipped_bytes > 1000
        assert controller.agent.trouble == ""


async def test_a_view_that_cannot_be_drawn_is_noted_and_the_swarm_flies_on(swarm: Prepare) -> None:
    handlers = [signal.getsignal(number) for number in STOP_SIGNALS]
    flight = swarm(vehicles=1, duration_s=2.0)

    def full(_: UdpRun) -> None:
        raise OSError(28, "No space left on device")

    await flight.fly(full)
    assert flight.phases() == ["done"]
    assert flight.run.notes.count("not everything could be written: No space left on device") == 1
    assert [signal.getsignal(number) for number in STOP_SIGNALS] == handlers, "given back"
