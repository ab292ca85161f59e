"""`swarm-ctl fly` as its user meets it: UDP, TCP, a serial port, and what is said when it fails."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import threading
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import pytest
import yaml
from mock_process import Mock

from mock_vehicle.testing import RealSwarm, RealVehicle
from swarm_ctl import wire
from swarm_ctl.cli import main
from swarm_ctl.run.fleet import TWICE

pytestmark = pytest.mark.wire

SPEED = 10
MISSION: dict[str, Any] = {
    "duration_s": 3.0,
    "planner": {"kind": "lf-pso", "levy_min_m": 2.0, "avoid_distance_m": 0.7},
    "flight": {"height_m": 1.5, "climb_m_s": 1.0},
}
PATIENCE_S = 60.0
URL = "udpin://127.0.0.1:1454"
LANDING = {"AUTO.LAND", "LAND"}
ARM = wire.message("COMMAND_LONG")


class Shell:
    """A user who flies one mission and reads what is said."""

    def __init__(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        self._monkeypatch, self._capsys = monkeypatch, capsys
        self.out = folder / "run"
        self.mission = folder / "search.yaml"
        self.orders()

    def orders(self, **changes: Any) -> None:
        """Write the mission, which names no world."""
        self.mission.write_text(yaml.safe_dump(MISSION | changes))

    def words(self, *options: object, speed: float = SPEED) -> list[str]:
        fixed = ("swarm-ctl", "fly", self.mission, "--speed", speed, "--out", self.out)
        return [str(word) for word in (*fixed, *options)]

    def fly(self, *options: object, speed: float = SPEED) -> tuple[int, str, str]:
        """Type the command; give exit status, what it said and what it complained about."""
        self._monkeypatch.setattr(sys, "argv", self.words(*options, speed=speed))
        with pytest.raises(SystemExit) as ended:
            main()
        said, complained = self._capsys.readouterr()
        return int(ended.value.code or 0), said, complained

    def summary(self) -> dict[str, Any]:
        return dict(json.loads((self.out / "summary.json").read_text()))

    def ends(self) -> dict[int, tuple[str, str]]:
        """Give each sysid's last phase and why."""
        return {
            one["sysid"]: (one["phase"], one["reason"]) for one in self.summary()["per_vehicle"]
        }

    def events(self, name: str) -> list[dict[str, Any]]:
        with contextlib.suppress(FileNotFoundError):
            whole = (self.out / "events.jsonl").read_text().split("\n")[:-1]
            return [entry for line in whole if (entry := json.loads(line))["event"] == name]
        return []


@pytest.fixture
def shell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Shell:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("NO_COLOR", "1")
    return Shell(tmp_path, monkeypatch, capsys)


def vehicles(**how: Any) -> pytest.MarkDecorator:
    return pytest.mark.mock_vehicle.with_args(**{"speed": SPEED, "rates": "lean", **how})


def speakers(one: RealVehicle) -> set[tuple[int, int]]:
    """Give sysid and compid of all who spoke to a vehicle."""
    return {(message.sysid, message.compid) for message in one.received()}


# -- one vehicle ---------------------------------------------------------------------------------


NAMES = {"px4": "PX4, mode AUTO.LOITER", "ardupilot": "ArduPilot, mode STABILIZE"}


@pytest.mark.parametrize(
    "mock_vehicle",
    [
        {"autopilot": "px4", "rates": "full", "speed": 4},
        {"autopilot": "ardupilot", "rates": "lean"},
    ],
    ids=lambda how: f"{how['autopilot']}-{how['rates']}",
    indirect=True,
)
@vehicles(sysid=7)
def test_a_vehicle_is_found_by_its_heartbeat_and_flown(
    shell: Shell, mock_vehicle: RealVehicle, request: pytest.FixtureRequest
) -> None:
    url, name = mock_vehicle.url, NAMES[mock_vehicle.autopilot]
    speed = request.node.callspec.params["mock_vehicle"].get("speed", SPEED)
    code, said, complained = shell.fly("--connect", url, speed=speed)
    assert (code, complained) == (0, "")
    assert f"heard sysid 7 at {url}: flying this one" in said
    assert f"vehicle 7 at {url}: {name}" in said
    assert "disarmed, battery 100%" in said
    assert mock_vehicle.truth.landed
    assert not mock_vehicle.truth.armed
    assert mock_vehicle.truth.distance_to_home_m < 1.5
    assert shell.ends() == {7: ("done", "")}
    assert shell.summary()["autopilot"] == mock_vehicle.autopilot
    assert speakers(mock_vehicle) == {(7, 191)}


# -- several -------------------------------------------------------------------------------------


@vehicles(autopilot="mixed", vehicles=3, sysid=11)
def test_one_sysid_counts_up_over_several_links(shell: Shell, mock_swarm: RealSwarm) -> None:
    links = [word for one in mock_swarm for word in ("--connect", one.url)]
    code, said, _ = shell.fly(*links, "--sysid", 11)
    assert code == 0
    assert "search flown  3 vehicles, mixed" in said
    assert shell.ends() == {11: ("done", ""), 12: ("done", ""), 13: ("done", "")}
    assert [speakers(one) for one in mock_swarm] == [{(11, 191)}, {(12, 191)}, {(13, 191)}]


@vehicles(autopilot="ardupilot", vehicles=3, sysid=5, one_port=True)
def test_vehicles_that_call_one_port_are_each_answered_where_they_are(
    shell: Shell, mock_swarm: RealSwarm
) -> None:
    sysids = [word for one in mock_swarm for word in ("--sysid", one.sysid)]
    code, _, _ = shell.fly("--connect", mock_swarm[5].url, *sysids)
    assert code == 0
    assert shell.ends() == {5: ("done", ""), 6: ("done", ""), 7: ("done", "")}
    assert [speakers(one) for one in mock_swarm] == [{(5, 191)}, {(6, 191)}, {(7, 191)}]


def test_vehicles_behind_one_port_hear_of_each_other_what_their_own_radios_hear(
    shell: Shell, hall: Callable[..., Path], free_udp_port: int
) -> None:
    where = f"127.0.0.1:{free_udp_port}"
    world = hall().parent / "world.yaml"
    options = ("--vehicles", 3, "--autopilot", "ardupilot", "--sysid", 5, "--speed", SPEED)
    mock = Mock(world, *options, "--port", 0, "--remote", where, "--json")
    try:
        sysids = [word for sysid in (5, 6, 7) for word in ("--sysid", sysid)]
        code, _, _ = shell.fly("--connect", f"udpin://{where}", *sysids)
    finally:
        mock.end()
    assert code == 0
    assert shell.ends() == {5: ("done", ""), 6: ("done", ""), 7: ("done", "")}
    first = {event["sysid"]: event["data"] for event in reversed(shell.events("ContactsChanged"))}
    assert first[5]["gained"] == [6], "2 m away, in a row, with radios of 3 m"
    assert first[7]["gained"] == [6]


@vehicles(vehicles=2, sysid=3, one_port=True)
def test_several_autopilots_and_no_sysid_are_listed(shell: Shell, mock_swarm: RealSwarm) -> None:
    url = mock_swarm[3].url
    assert shell.fly("--connect", url) == (
        *(2, ""),
        f"{url}: heard sysids 3 and 4; say which by --sysid\n",
    )
    assert not shell.out.exists()
    assert [speakers(one) for one in mock_swarm] == [set(), set()]


# -- what is left alone --------------------------------------------------------------------------


@vehicles(vehicles=2, autopilot="mixed")
def test_a_vehicle_that_is_armed_already_is_left_alone_and_the_other_flies(
    shell: Shell, mock_swarm: RealSwarm
) -> None:
    armed, other = mock_swarm
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as pilot:
        pilot.sendto(ARM.pack(0, 255, 190, 1, 1, 400, 0, 1.0, *[0.0] * 6), armed.address)
        armed.wait_until(lambda truth: truth.armed)
    links = ("--connect", armed.url, "--connect", other.url)
    code, said, _ = shell.fly(*links, "--sysid", 1)
    assert code == 0
    assert f"vehicle 1 at {armed.url}: PX4, mode AUTO.LOITER, armed" in said
    assert shell.ends()[1] == ("failed", "armed already, in AUTO.LOITER: somebody else flies it")
    assert shell.ends()[2] == ("done", "")
    assert "vehicle 1: armed already" in said
    assert speakers(armed) == {(255, 190)}, "not a word of ours"


@vehicles(vehicles=2)
def test_a_wrong_sysid_fails_by_itself_and_the_other_flies(
    shell: Shell, mock_swarm: RealSwarm
) -> None:
    right, wrong = mock_swarm
    pairs = ("--connect", right.url, "--sysid", 1, "--connect", wrong.url, "--sysid", 9)
    code, said, _ = shell.fly(*pairs)
    assert code == 0
    assert shell.ends()[1] == ("done", "")
    assert shell.ends()[9] == ("failed", f"heard sysid 2 at {wrong.url}, but not 9")
    assert f"vehicle 9: heard sysid 2 at {wrong.url}, but not 9" in said
    assert speakers(wrong) == set()


@vehicles(signing_key="correct horse battery staple")
def test_who_does_not_sign_with_our_key_is_not_flown(
    shell: Shell, mock_vehicle: RealVehicle, tmp_path: Path
) -> None:
    key = tmp_path / "key"
    key.write_text("another one altogether")
    url = mock_vehicle.url
    code, _, _ = shell.fly("--connect", url, "--signing-key", key)
    assert code == 1
    assert shell.ends() == {1: ("failed", f"what it sends at {url} is not signed with our key")}
    assert not mock_vehicle.truth.armed


@vehicles(signing_key="correct horse battery staple")
def test_a_signed_vehicle_is_flown_with_its_key(
    shell: Shell, mock_vehicle: RealVehicle, tmp_path: Path
) -> None:
    key = tmp_path / "key"
    key.write_text("correct horse battery staple")
    code, _, _ = shell.fly("--connect", mock_vehicle.url, "--sysid", 1, "--signing-key", key)
    assert (code, mock_vehicle.refused) == (0, 0)


@vehicles(autopilot="ardupilot", boot="real")
def test_a_vehicle_that_has_no_position_yet_is_not_waited_for_for_ever(
    shell: Shell, mock_vehicle: RealVehicle
) -> None:
    shell.orders(flight={**MISSION["flight"], "ready_timeout_s": 5.0})
    code, _, _ = shell.fly("--connect", mock_vehicle.url)
    assert code == 1
    phase, reason = shell.ends()[1]
    assert phase == "failed"
    assert reason.startswith("not ready after 5 s: no local position")


# -- mistakes ------------------------------------------------------------------------------------


def test_silence_is_one_sentence(shell: Shell, free_udp_port: int) -> None:
    url = f"udpin://127.0.0.1:{free_udp_port}"
    hint = "is the vehicle on, and does it speak to this address?"
    silence = f"nothing heard at {url} within 30 s; {hint}\n"
    assert shell.fly("--connect", url, speed=60) == (2, "", silence)
    assert not shell.out.exists()
    code, said, _ = shell.fly("--connect", url, "--sysid", 1, speed=60)
    assert code == 1
    assert f"vehicle 1: nothing heard at {url} within 30 s" in said


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--connect", "14540"], "14540: expected udpin://HOST:PORT, udpout://HOST:PORT, tcpout"),
        (["--connect", "udpin://:1", "--sysid", 1], "udpin://:1: expected udpin://HOST:PORT"),
        (["--connect", URL, "--sysid", 256], "--sysid 256: a vehicle's sysid is 1 to 255"),
        (["--connect", URL, "--sysid", 3, "--sysid", 3], "--sysid 3: given twice"),
        (["--connect", URL, "--connect", URL + "1"], "several --connect want --sysid"),
        (
            [
                "--connect",
                URL,
                "--connect",
                URL + "1",
                *("--sysid", 1, "--sysid", 2, "--sysid", 3),
            ],
            "2 --connect and 3 --sysid do not pair up",
        ),
        (["--connect", URL, "--planner", "magic"], "--planner: must be"),
    ],
)
def test_a_mistake_is_one_sentence(shell: Shell, options: list[object], sentence: str) -> None:
    code, said, complained = shell.fly(*options)
    assert (code, said) == (2, "")
    assert sentence in complained
    assert complained.count("\n") == 1
    assert not shell.out.exists()


def test_a_taken_port_is_one_sentence(shell: Shell) -> None:
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as other:
        other.bind(("127.0.0.1", 0))
        url = f"udpin://127.0.0.1:{other.getsockname()[1]}"
        taken = "another program listens there already; end it, or take another port"
        assert shell.fly("--connect", url) == (2, "", f"{url}: {taken}\n")


# -- the record ----------------------------------------------------------------------------------


@vehicles()
def test_the_record_tells_what_the_vehicle_knew_and_no_more(
    shell: Shell, mock_vehicle: RealVehicle
) -> None:
    _, said, _ = shell.fly("--connect", mock_vehicle.url)
    rows = said.split("search flown")[1].split("time")[0].splitlines()
    shares = [row for row in rows if "%" in row and "pace" not in row]
    assert not shares, "nobody knows what share was explored"
    assert "contacts" not in said.split("search flown")[1]
    summary = shell.summary()
    assert (summary["mode"], summary["outcome"], summary["world"]) == ("fly", "flown", None)
    assert (summary["coverage_fraction"], summary["collisions"]) == (None, None)
    assert (summary["victims_found"], summary["victims_total"]) == (0, None)
    assert summary["path_length_m"] > 2.0
    assert summary["notes"] == []
    assert {path.name for path in shell.out.iterdir()} == {
        *("mission.json", "events.jsonl", "journals", "tlogs", "paths.json", "paths.png"),
        *("summary.json", "contacts.json", "report.html"),
    }
    assert json.loads((shell.out / "mission.json").read_text())["mode"] == "fly"


# -- signals -------------------------------------------------------------------------------------


@vehicles(autopilot="mixed", vehicles=2)
def test_sigterm_lands_everybody(shell: Shell, mock_swarm: RealSwarm) -> None:
    shell.orders(duration_s=1000.0)
    process = started(shell, mock_swarm)
    mock_swarm.wait_until(lambda truths: all(truth.height_m > 1.0 for truth in truths), 60.0)
    process.send_signal(signal.SIGTERM)
    assert ended(process) == 130
    assert [truth.armed for truth in mock_swarm.truths] == [False, False]
    assert {phase for phase, _ in shell.ends().values()} == {"done"}
    assert shell.summary()["outcome"] == "interrupted"


@vehicles(autopilot="mixed", vehicles=2)
def test_a_second_signal_ends_at_once_and_leaves_the_vehicles_to_their_failsafes(
    shell: Shell, mock_swarm: RealSwarm
) -> None:
    shell.orders(duration_s=1000.0)
    process = started(shell, mock_swarm)
    mock_swarm.wait_until(lambda truths: all(truth.height_m > 1.0 for truth in truths), 60.0)
    process.send_signal(signal.SIGINT)
    mock_swarm.wait_until(lambda truths: all(truth.mode in LANDING for truth in truths))
    process.send_signal(signal.SIGINT)
    assert ended(process) == 130
    assert {phase for phase, _ in shell.ends().values()} == {"failed"}
    assert shell.summary()["notes"][0] == TWICE


def started(shell: Shell, swarm: RealSwarm) -> subprocess.Popen[str]:
    links = [word for one in swarm for word in ("--connect", one.url)]
    words = [sys.executable, "-m", "swarm_ctl", *shell.words(*links, "--sysid", 1)[1:]]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def ended(process: subprocess.Popen[str]) -> int:
    _, complained = process.communicate(timeout=PATIENCE_S)
    assert complained == ""
    return process.returncode


# -- TCP and serial ------------------------------------------------------------------------------


class Bridge(ABC):
    """Carries bytes between a vehicle on UDP and a stream, as a router or a radio does."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.connect(address)
        self._udp.setblocking(False)
        self._ends = False
        self._thread = threading.Thread(target=self._carry, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends = True
        self._thread.join()
        self.cut()
        self._udp.close()

    @abstractmethod
    def stream(self) -> int:
        """Give the descriptor of the stream; -1 while nobody is there."""

    @abstractmethod
    def cut(self) -> None:
        """Break the stream."""

    def _carry(self) -> None:
        while not self._ends:
            stream = self.stream()
            watched = [self._udp.fileno(), *([stream] if stream >= 0 else [])]
            readable, _, _ = select.select(watched, [], [], 0.01)
            with contextlib.suppress(OSError):
                if self._udp.fileno() in readable:
                    data = self._udp.recv(4096)
                    if stream >= 0:
                        os.write(stream, data)
                if stream in readable:
                    data = os.read(stream, 4096)
                    if data:
                        self._udp.send(data)
                    else:
                        self.cut()


class TcpBridge(Bridge):
    def __init__(self, address: tuple[str, int]) -> None:
        super().__init__(address)
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self._peer: socket.socket | None = None
        self.url = f"tcpout://127.0.0.1:{self._server.getsockname()[1]}"
        self.accepted = 0

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        self._server.close()

    def stream(self) -> int:
        if self._peer is None:
            with contextlib.suppress(BlockingIOError):
                self._peer, _ = self._server.accept()
                self.accepted += 1
        return self._peer.fileno() if self._peer else -1

    def cut(self) -> None:
        if self._peer is not None:
            peer, self._peer = self._peer, None
            peer.close()


class SerialBridge(Bridge):
    def __init__(self, address: tuple[str, int]) -> None:
        super().__init__(address)
        self._master, slave = pty.openpty()
        tty.setraw(self._master)
        os.set_blocking(self._master, False)
        self._slave = slave  # held open, as a device is there with or without a reader
        self.url = f"serial://{os.ttyname(slave)}:921600"

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        os.close(self._slave)
        os.close(self._master)

    def stream(self) -> int:
        return self._master

    def cut(self) -> None: ...


@vehicles(autopilot="ardupilot")
def test_a_tcp_link_that_breaks_in_flight_is_made_again_and_the_mission_goes_on(
    shell: Shell, mock_vehicle: RealVehicle
) -> None:
    shell.orders(duration_s=12.0, limits={"link_hold_s": 15.0, "link_lost_s": 30.0})
    with TcpBridge(mock_vehicle.address) as bridge:

        def cut_in_flight() -> None:
            mock_vehicle.wait_until(lambda truth: truth.height_m > 1.4, 60.0)
            bridge.cut()

        scissors = threading.Thread(target=cut_in_flight)
        scissors.start()
        code, said, _ = shell.fly("--connect", bridge.url)
        scissors.join()
        assert code == 0, said
        assert bridge.accepted == 2
    assert shell.ends() == {1: ("done", "")}
    assert mock_vehicle.truth.distance_to_home_m < 1.5


@vehicles(autopilot="px4")
def test_a_vehicle_on_a_serial_port_is_flown(shell: Shell, mock_vehicle: RealVehicle) -> None:
    with SerialBridge(mock_vehicle.address) as bridge:
        code, said, complained = shell.fly("--connect", bridge.url)
    assert (code, complained) == (0, "")
    assert f"vehicle 1 at {bridge.url}: PX4" in said
    assert mock_vehicle.truth.landed
