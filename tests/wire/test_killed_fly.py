"""`swarm-ctl fly` is killed in flight and typed again: processes, sockets, signals, files."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from halls import write_hall
from mock_process import Mock

from mock_vehicle.testing import RealSwarm
from swarm_ctl.link.udp import UdpLink
from swarm_ctl.record.flight_journal import read_flight_journal
from swarm_ctl.record.resume import journals_in
from swarm_ctl.run.guardian import Ways

pytestmark = pytest.mark.wire

SPEED = 2
PATIENCE_S = 60.0
ROAM = {"kind": "lf-pso", "levy_min_m": 5.0, "avoid_distance_m": 0.7}
CLIMB = {"height_m": 1.5, "climb_m_s": 1.0}
EXPLORE = {
    "kind": "explore",
    "footprint_m": 0.5,
    "avoid_distance_m": 0.7,
}


class Pad:
    """A mock fleet in a process, and a user who flies it and kills what he has started."""

    def __init__(self, folder: Path, vehicles: int, autopilot: str, **changes: Any) -> None:
        mission = {"planner": EXPLORE, "flight": CLIMB, "duration_s": 25.0, **changes}
        self.mission = write_hall(folder, mission)
        self.folder, self.out = folder, folder / "run"
        words = ("--vehicles", vehicles, "--autopilot", autopilot, "--speed", SPEED)
        rest = ("--port", 0, "--rates", "lean", "--out", folder / "truth", "--json")
        self.mock = Mock(folder / "world.yaml", *words, *rest)
        self.ports: list[int] = self.mock.line()["ready"]["ports"]
        self.processes: list[subprocess.Popen[str]] = []

    def fly(self, *options: object, out: bool = True) -> subprocess.Popen[str]:
        """Type the command."""
        words: list[object] = ["-m", "swarm_ctl", "fly", self.mission, "--sysid", 1]
        words += [
            word for port in self.ports for word in ("--connect", f"udpout://127.0.0.1:{port}")
        ]
        words += ["--speed", SPEED, *(("--out", self.out) if out else ()), *options]
        self.processes.append(
            subprocess.Popen(
                [sys.executable, *map(str, words)],
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
        )
        return self.processes[-1]

    def kill(self, process: subprocess.Popen[str] | None = None) -> None:
        """Kill the whole process group, as a service manager would; no word is said."""
        process = process or self.processes[-1]
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()

    def state(self, sysid: int) -> dict[str, Any]:
        """Give what a controller has written last of everything."""
        file = self.out / "journals" / f"vehicle-{sysid:03d}.jsonl"
        state: dict[str, Any] = {}
        for page in read_flight_journal(file, {}).pages:
            state |= page
        return state

    def wait_for(self, is_so: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not is_so():
            assert time.monotonic() < deadline_s, [
                self.state(one + 1) for one in range(len(self.ports))
            ]
            assert self.processes[-1].poll() is None, self.processes[-1].communicate()
            time.sleep(0.02)  # noqa: TID251 - another process is watched

    def all_in(self, *phases: str) -> bool:
        return all(
            self.state(sysid).get("phase") in phases for sysid in range(1, len(self.ports) + 1)
        )

    def has_restarted(self, times: int) -> bool:
        """Tell whether every vehicle's last controller has written what it goes on from."""
        states = [self.state(one + 1) for one in range(len(self.ports))]
        return all(state.get("restart") == times for state in states)

    def has_explored(self, seconds: float) -> bool:
        state = self.state(1)
        begun_s = state.get("explored_from_s")
        return begun_s is not None and state["time_s"] > begun_s + seconds

    def truth(self) -> dict[str, Any]:
        """End the mock and read what its referee saw."""
        self.mock.wait()
        return dict(json.loads((self.folder / "truth" / "truth.json").read_text()))


@pytest.fixture
def pad(tmp_path: Path, end_guardians: Callable[[], None]) -> Iterator[Callable[..., Pad]]:
    pads: list[Pad] = []

    def build(vehicles: int = 2, autopilot: str = "mixed", **changes: Any) -> Pad:
        pads.append(Pad(tmp_path, vehicles, autopilot, **changes))
        return pads[-1]

    yield build
    for one in pads:
        for process in one.processes:
            process.kill()
            process.communicate()
        one.mock.end()
    end_guardians()  # which look after the killed for 10 s


Build = Callable[..., Pad]


def test_a_mission_survives_two_kills(pad: Build) -> None:
    field = pad(3)
    field.fly()
    for restart, flown_s in enumerate((2.0, 6.0), 1):
        field.wait_for(lambda flown_s=flown_s: field.has_explored(flown_s))  # type: ignore[misc]
        begun_s = [field.state(sysid)["explored_from_s"] for sysid in (1, 2, 3)]
        before = {file: file.read_bytes() for file in record(field.out)}
        field.kill()
        whole = {file: file.read_bytes() for file in record(field.out)}
        assert all(whole[file].startswith(data) for file, data in before.items())
        field.fly()
        field.wait_for(lambda restart=restart: field.has_restarted(restart))  # type: ignore[misc]
        assert field.all_in("holding", "exploring")
        assert all(file.read_bytes().startswith(data) for file, data in whole.items())
    said, complained = field.processes[-1].communicate(timeout=PATIENCE_S)
    assert field.processes[-1].returncode == 0, said + complained
    assert complained == ""
    assert "taking up" in said
    summary = json.loads((field.out / "summary.json").read_text())
    assert [(one["phase"], one["reason"]) for one in summary["per_vehicle"]] == [("done", "")] * 3
    assert [one["explored_from_s"] for one in summary["per_vehicle"]] == begun_s
    truth = field.truth()
    assert truth["collisions"] == 0
    for sysid, file in journals_in(field.out).items():
        story = read_flight_journal(file, {"sysid": sysid})
        assert (story.fault, story.restarts) == ("", 2)


def record(out: Path) -> list[Path]:
    return [*out.glob("journals/*"), *out.glob("tlogs/*"), out / "events.jsonl"]


def test_the_newest_run_that_was_killed_is_taken_up_and_no_other(pad: Build) -> None:
    field = pad(1, "ardupilot")
    first = field.fly(out=False)
    field.wait_for(lambda: any((field.folder / "runs").glob("*/journals/*")))
    (field.out,) = (field.folder / "runs").glob("hall-*")
    field.wait_for(lambda: field.all_in("exploring"))
    twin = field.fly(out=False)
    _, complained = twin.communicate(timeout=PATIENCE_S)
    assert twin.returncode == 2
    assert "another process is flying this vehicle" in complained
    field.kill(first)
    again = field.fly(out=False)
    field.wait_for(lambda: field.state(1).get("restart") == 1)
    field.kill(again)
    said, _ = field.fly("--new", out=False).communicate(timeout=PATIENCE_S)
    assert "taking up" not in said
    assert "armed already" in said
    assert len(list((field.folder / "runs").glob("hall-*"))) == 2


# -- the guardian --------------------------------------------------------------------------------


KEY = "correct horse battery staple"
OFFBOARD = {"OFFBOARD", "GUIDED"}


@pytest.mark.mock_vehicle(autopilot="mixed", vehicles=2, rates="lean", signing_key=KEY)
def test_vehicles_hover_while_their_controllers_hang_or_are_dead(
    mock_swarm: RealSwarm, tmp_path: Path, end_guardians: Callable[[], None]
) -> None:
    key, mission = tmp_path / "key", tmp_path / "roam.yaml"
    key.write_text(KEY)
    mission.write_text(yaml.safe_dump({"duration_s": 300.0, "planner": ROAM, "flight": CLIMB}))
    words = ["fly", mission, "--sysid", 1, "--out", tmp_path / "run", "--signing-key", key]
    words += [word for one in mock_swarm for word in ("--connect", one.url)]
    with subprocess.Popen(
        [sys.executable, "-m", "swarm_ctl", *map(str, words)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    ) as process:
        try:
            for number in (signal.SIGSTOP, signal.SIGKILL):
                for one in mock_swarm:
                    one.wait_until(lambda truth: truth.speed_m_s > 0.6)
                process.send_signal(number)
                for one in mock_swarm:
                    one.wait_until(lambda truth: truth.speed_m_s < 0.1, timeout_s=4.0)
                until_s = mock_swarm[1].truth.time_s + 2.0
                mock_swarm[1].wait_until(lambda truth: truth.time_s > until_s)  # noqa: B023
                for one in mock_swarm:
                    assert one.truth.speed_m_s < 0.1
                    assert one.truth.height_m > 1.0
                    assert one.truth.mode in OFFBOARD, "no failsafe was needed"
                process.send_signal(signal.SIGCONT)
        finally:
            process.kill()
            end_guardians()


def test_the_guardian_speaks_from_the_port_that_a_dead_controller_had() -> None:
    vehicle, controller = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with vehicle, controller:
        for one in (vehicle, controller):
            one.bind(("127.0.0.1", 0))
            one.settimeout(2.0)
        called, ways = controller.getsockname(), Ways()
        reach = f"udpout://127.0.0.1:{vehicle.getsockname()[1]}/{called[1]}"
        ways.send(reach, b"it hangs")
        data, source = vehicle.recvfrom(64)
        assert (data, source == called) == (b"it hangs", False)
        controller.close()
        vehicle.connect(called)  # as ArduPilot's UDP clients: they hear nobody else
        ways.send(reach, b"it is dead")
        assert vehicle.recv(64) == b"it is dead"
        UdpLink(f"udpin://127.0.0.1:{called[1]}").close()  # raises when a successor cannot have it
