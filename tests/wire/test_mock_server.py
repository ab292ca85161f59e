from __future__ import annotations

import asyncio
import contextlib
import json
import os
import resource
import signal
import socket
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mock_process import PATIENCE_S, Mock
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.autopilot.parameters import DATA
from mock_vehicle.cli import serve
from mock_vehicle.fleet import Fleet
from mock_vehicle.ports import hint, plan_further_ports, plan_ports, plan_shown_ports
from mock_vehicle.server import Server
from mock_vehicle.world.field import open_field
from swarm_ctl import wire

pytestmark = pytest.mark.wire

WORLD = """
name: yard
size_m: [30, 20]
ceiling_m: 5
starts: {grid: {origin_m: [5, 5], spacing_m: 2}}
victims: [{name: ann, position_m: [25, 15, 0.3]}]
"""


class Companion:
    """A plain socket and pymavlink's own codec."""

    def __init__(self, port: int, sysid: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(PATIENCE_S)
        self.socket.connect(("127.0.0.1", port))
        self.sysid = sysid
        self.codec = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=191)
        self.codec.robust_parsing = True

    def send(self, message: Any) -> None:
        self.socket.send(message.pack(self.codec))

    def heartbeat(self) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))

    def climb(self) -> None:
        mask = 0b0000_0101_1100_0111
        zeros = (0.0,) * 3
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, self.sysid, 1, 1, mask, *zeros, 0.0, 0.0, -1.0, *zeros, 0.0, 0.0
            )
        )

    def command(self, number: int, *parameters: float) -> None:
        filled = (*parameters, *(0.0,) * (7 - len(parameters)))
        self.send(mavlink.MAVLink_command_long_message(self.sysid, 1, number, 0, *filled))

    def expect(self, wanted: Callable[[Any], bool]) -> Any:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for message in self.codec.parse_buffer(self.socket.recv(4096)) or []:
                if wanted(message):
                    return message
        pytest.fail("the message never came")


@pytest.fixture
def world(tmp_path: Path) -> Path:
    file = tmp_path / "yard.yaml"
    file.write_text(WORLD)
    return file


@pytest.fixture
def start() -> Iterator[Callable[..., Mock]]:
    started: list[Mock] = []

    def begin(*arguments: object) -> Mock:
        started.append(Mock(*arguments))
        return started[-1]

    yield begin
    for mock in started:
        mock.end()


@pytest.fixture
def meet() -> Iterator[Callable[[int, int], Companion]]:
    met: list[Companion] = []

    def connect(port: int, sysid: int) -> Companion:
        met.append(Companion(port, sysid))
        return met[-1]

    yield connect
    for companion in met:
        companion.socket.close()


Start = Callable[..., Mock]
Meet = Callable[[int, int], Companion]


def test_a_fleet_arms_and_climbs_over_udp(
    world: Path, start: Start, meet: Meet, tmp_path: Path
) -> None:
    out = tmp_path / "truth"
    lean = ("--rates", "lean", "--speed", 4)
    mock = start(world, "--vehicles", 2, "--port", 0, "--json", *lean, "--out", out)
    ready = mock.line()["ready"]
    assert ready["sysids"] == [1, 2]
    assert ready["world"] == "yard"
    assert ready["autopilots"] == ["px4", "px4"]
    assert ready["victims_total"] == 1
    companions = [meet(*pair) for pair in zip(ready["ports"], ready["sysids"], strict=True)]
    for companion in companions:
        companion.heartbeat()
    for companion in companions:
        heartbeat = companion.expect(lambda m: m.get_type() == "HEARTBEAT")
        assert heartbeat.get_srcSystem() == companion.sysid
    pilot = companions[0]
    for _ in range(10):
        pilot.climb()
        pilot.expect(lambda m: m.get_type() == "LOCAL_POSITION_NED")
    pilot.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)
    pilot.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def is_up(message: Any) -> bool:
        pilot.climb()
        return bool(message.get_type() == "LOCAL_POSITION_NED" and message.z < -1.0)

    pilot.expect(is_up)
    progress = mock.line()
    while not progress["airborne"]:
        progress = mock.line()
    assert [vehicle["armed"] for vehicle in progress["vehicles"]] == [True, False]
    assert progress["behind_s"] >= 0.0
    mock.process.send_signal(signal.SIGTERM)
    code, lines, complaints = mock.wait()
    assert code == 0
    assert not complaints.strip() or "falling behind" in complaints  # on a busy machine
    assert lines[-1]["done"]["victims_total"] == 1
    assert {file.name for file in out.iterdir()} == {
        *("truth.json", "truth.npz", "world.json", "radio.json")
    }
    assert json.loads((out / "truth.json").read_text())["path_length_m"] > 1.0


def test_the_remote_is_called_unasked(world: Path, start: Start) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        ground.settimeout(PATIENCE_S)
        remote = f"127.0.0.1:{ground.getsockname()[1]}"
        began = time.monotonic()
        mock = start(world, "--port", 0, "--remote", remote, "--first-sysid", 7, "--json")
        codec = mavlink.MAVLink(None)
        heard: list[Any] = []
        while not any(message.get_type() == "HEARTBEAT" for message in heard):
            heard += codec.parse_buffer(ground.recv(4096)) or []
        assert {message.get_srcSystem() for message in heard} == {7}
        assert time.monotonic() - began < 5.0  # alone well below one second
    assert mock.process.poll() is None


def test_a_closed_stdin_ends_the_mock(world: Path, start: Start) -> None:
    mock = start(world, "--port", 0, "--json")
    assert "ready" in mock.line()
    code, lines, _ = mock.wait()  # closes stdin
    assert code == 0
    assert "done" in lines[-1]


def test_a_duration_ends_the_mock(world: Path, start: Start) -> None:
    mock = start(world, "--port", 0, "--json", "--duration", 2, "--speed", 10)
    assert "ready" in mock.line()
    assert mock.line()["done"]["time_s"] == pytest.approx(2.0)


def test_a_clock_that_is_too_fast_falls_behind_and_says_so(world: Path, start: Start) -> None:
    mock = start(world, "--port", 0, "--json", "--vehicles", 5, "--speed", 1000, "--duration", 60)
    assert mock.process.wait(2 * PATIENCE_S) == 0
    _, lines, complaints = mock.wait()
    assert lines[-1]["done"]["time_s"] == pytest.approx(60.0)
    assert lines[-1]["done"]["behind_s"] > 1.0
    assert lines[-1]["done"]["mock_late_fraction"] > 0.5
    assert complaints.startswith("mock-vehicle: falling behind real time by ")


def test_the_fault_fleet_ends_the_process_with_nothing_written_but_the_world(
    world: Path, start: Start, tmp_path: Path
) -> None:
    out = tmp_path / "truth"
    mock = start(world, "--port", 0, "--json", "--fault", "fleet@0.5", "--out", out)
    assert "ready" in mock.line()
    mock.process.wait(PATIENCE_S)
    code, lines, complaints = mock.wait()
    assert code == 70
    assert not any("done" in line for line in lines)
    assert complaints == ""
    assert [path.name for path in out.iterdir()] == ["world.json"]


def test_garbage_does_no_harm(world: Path, start: Start, meet: Meet) -> None:
    ready = start(world, "--port", 0, "--json").line()["ready"]
    companion = meet(ready["ports"][0], 1)
    for size in (0, 1, 12, 300, 2000):
        companion.socket.send(os.urandom(size))
    companion.heartbeat()
    companion.expect(lambda m: m.get_type() == "HEARTBEAT")


@pytest.mark.parametrize(
    ("change", "arguments", "sentence"),
    [
        ("radio: {radus_m: 3}", (), "radio.radus_m"),
        ("faults: [{time_s: 1, vehicle: 1, kind: daed}]", (), "faults[0].kind"),
        ("", ("--fault", "daed:1@3"), "did you mean 'dead'"),
        ("", ("--fault", "dead:9@3"), "there is no vehicle 9"),
        ("", ("--remote", "nowhere"), "expected HOST:PORT"),
        ("", ("--vehicles", 250, "--first-sysid", 9), "not 255"),
        ("", ("--vehicles", 200), "starts.grid"),
        ("", ("--param", DATA / "ardupilot.param"), "ardupilot.param:3: there is no parameter"),
        ("", ("--param", "none.param"), "none.param"),
        ("", ("--ports", "14580"), "--port and --ports say the same"),
    ],
)
def test_a_mistake_is_one_sentence_and_exit_2(
    world: Path, start: Start, change: str, arguments: tuple[object, ...], sentence: str
) -> None:
    world.write_text(WORLD + change + "\n")
    code, lines, complaint = start(world, "--port", 0, "--json", *arguments).wait()
    assert code == 2
    assert lines == []
    assert sentence in complaint
    assert complaint.count("\n") == 1
    assert "Traceback" not in complaint


def test_a_missing_world_and_a_taken_port_are_named(world: Path, start: Start) -> None:
    code, _, complaint = start(world.with_name("none.yaml"), "--port", 0).wait()
    assert code == 2
    assert "none.yaml" in complaint
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        code, _, complaint = start(world, "--port", port).wait()
    assert code == 2
    assert f"127.0.0.1:{port}" in complaint


def test_the_schema_of_world_files_needs_no_world(start: Start) -> None:
    mock = start("--schema")
    out, _ = mock.process.communicate(timeout=PATIENCE_S)
    assert mock.process.returncode == 0
    schema = json.loads(out)
    assert schema["required"] == ["name"]
    assert schema["properties"]["size_m"]["description"].startswith("Extent in x and y")


def test_setpoints_are_noted_when_they_arrive_and_not_at_the_last_step(
    world: Path, start: Start, meet: Meet, tmp_path: Path
) -> None:
    # 110 ms apart; counted in steps of 20 ms they would seem 100 or 120 ms apart.
    mock = start(world, "--port", 0, "--json", "--out", tmp_path / "truth")
    (port,) = mock.line()["ready"]["ports"]
    companion = meet(port, 1)
    begin = time.monotonic()
    for number in range(30):
        time.sleep(max(0.0, begin + 0.110 * number - time.monotonic()))  # noqa: TID251
        companion.climb()
    code, _, _ = mock.wait()
    assert code == 0
    jitter_ms = json.loads((tmp_path / "truth/truth.json").read_text())["setpoint_jitter_p99_ms"]
    assert jitter_ms > 9.0
    assert abs(jitter_ms - 20.0 * round(jitter_ms / 20.0)) > 1e-3


def test_ports_are_those_of_the_real_simulators() -> None:
    def ports(base: int | None, remote: str | None = None, **more: str) -> list[tuple[int, object]]:
        kinds = ["px4", "ardupilot"]
        planned = plan_ports(kinds, host="127.0.0.1", base=base, remote=remote, **more)
        return [(port.bind[1], port.remote and port.remote[1]) for port in planned]

    assert ports(None) == [(14580, 14540), (14651, 14550)]
    assert ports(20000) == [(20000, 14540), (20001, 14550)]
    assert ports(0) == [(0, None), (0, None)]
    assert ports(0, "127.0.0.1:9") == [(0, 9), (0, 9)]
    assert ports(None, listed="900,800-850") == [(900, 14540), (800, 14550)]


def test_people_get_a_line_to_read(world: Path, start: Start) -> None:
    mock = start(world, "--port", 0, "--duration", 1.5, "--autopilot", "mixed", "--vehicles", 2)
    out, complaints = mock.process.communicate(timeout=PATIENCE_S)
    assert mock.process.returncode == 0
    assert complaints == ""
    assert "yard" in out
    assert "ardupilot" in out
    assert "coverage" in out


@pytest.mark.parametrize("listed", ["", "x", "0", "70000", "5-", "-5", "9-8", "7,7", "14580"])
def test_ports_that_cannot_be_are_named(listed: str) -> None:
    with pytest.raises(ValueError, match=f"--ports {listed}: "):
        plan_ports(["px4", "px4"], host="127.0.0.1", listed=listed)


def test_without_a_world_it_flies_over_an_open_field_until_told_to_stop(start: Start) -> None:
    mock = start("--port", 0, "--sysid", 3)
    assert mock.process.stdout is not None
    assert mock.process.stdout.readline() == "open field: 1 vehicle; Ctrl-C ends\n"
    assert "sysid 3 px4" in mock.process.stdout.readline()
    mock.process.send_signal(signal.SIGINT)
    out, complaints = mock.process.communicate(timeout=PATIENCE_S)
    assert (mock.process.returncode, complaints) == (0, "")
    assert "armed 0/1" in out
    assert "AUTO.LOITER 1" in out
    assert "stopped after" in out


def test_clients_are_told_in_their_own_words_where_to_connect() -> None:
    here = ("127.0.0.1", 14580)
    assert hint(here, ("127.0.0.1", 14540)) == (
        "MAVSDK udpin://0.0.0.0:14540 · pymavlink, MAVProxy, DroneKit udpin:0.0.0.0:14540"
    )
    assert "udpin://10.0.0.7:14540" in hint(here, ("10.0.0.7", 14540))
    assert "udpout:127.0.0.1:14580" in hint(here, None)


def test_a_viewer_is_shown_the_true_attitude_of_a_px4() -> None:
    fleet = Fleet(open_field(), ["px4", "ardupilot"], seed=1, rates="full")
    assert fleet.places == [(0, 0), (1, 0), (0, 1), (0, 2)]
    codec = mavlink.MAVLink(None)
    shown: list[Any] = []
    for step in range(1, 201):
        fleet.step(step * fleet.step_s)
        shown += [m for data in fleet.answers(0, 2) for m in codec.parse_buffer(data) or []]
    kinds = [message.get_type() for message in shown]
    assert kinds.count("HIL_STATE_QUATERNION") == pytest.approx(50, abs=1)
    assert "ATTITUDE" not in kinds


def test_a_swarm_that_is_shown_calls_a_ground_station_and_a_viewer_for_each() -> None:
    ports = plan_shown_ports(3, host="127.0.0.1")
    assert [port.remote and port.remote[1] for port in ports] == [
        *(14550, 14550, 14550),
        *(19410, 19411, 19412),
    ]
    assert {port.bind[1] for port in ports} == {0}, "from free ports: two runs are no clash"
    fleet = Fleet(open_field(), ["px4", "ardupilot", "px4"], seed=1, rates="shown")
    assert len(fleet.places) == 3 + len(ports)
    assert fleet.places[3:] == [(i, link) for link in (1, 2) for i in range(3)]


def test_a_shown_swarm_moves_in_viewers_and_tells_its_companions_no_more_than_others() -> None:
    kinds = ["px4", "ardupilot"]
    fleets = [Fleet(open_field(), kinds, seed=1, rates=rates) for rates in ("lean", "shown")]
    codec = mavlink.MAVLink(None)
    seen: dict[tuple[int, int], Counter[str]] = defaultdict(Counter)
    companions: list[list[bytes]] = [[], []]
    for step in range(1, 501):
        for fleet, said in zip(fleets, companions, strict=True):
            fleet.step(step * fleet.step_s)
            said.extend(fleet.answers(0, 0))
        for index, link in fleets[1].places[2:]:
            if (index, link, step) == (1, 2, 200):  # as Hawkeye does when it hears of a vehicle
                for wanted in ("ATTITUDE_QUATERNION", "GLOBAL_POSITION_INT"):
                    number = wire.message(wanted).id
                    ask = codec.command_long_encode(2, 1, 511, 0, number, 20_000, 0, 0, 0, 0, 0)
                    fleets[1].receive(1, ask.pack(codec), step * fleets[1].step_s, 2)
            for data in fleets[1].answers(index, link):
                seen[index, link].update(m.get_type() for m in codec.parse_buffer(data) or [])
    assert companions[0] == companions[1]
    assert seen[0, 2]["HIL_STATE_QUATERNION"] == pytest.approx(100, abs=2), "10 Hz"
    assert seen[0, 2]["HEARTBEAT"] == pytest.approx(10, abs=1)
    assert seen[0, 1]["GLOBAL_POSITION_INT"] == pytest.approx(40, abs=12)
    assert seen[0, 1]["HEARTBEAT"] == seen[1, 1]["HEARTBEAT"] == pytest.approx(10, abs=1)
    assert seen[1, 2]["ATTITUDE_QUATERNION"] == pytest.approx(60, abs=4), "from 4 s on"
    assert seen[1, 2]["GLOBAL_POSITION_INT"] == pytest.approx(60, abs=4)


def test_a_fleet_that_nobody_reads_does_not_grow() -> None:
    kinds = ["px4", "ardupilot", "px4"]
    ports = plan_ports(kinds, host="127.0.0.1", base=0)
    ports += plan_further_ports(kinds, host="127.0.0.1", usual=False)
    fleet = Fleet(open_field(), kinds, seed=1, rates="full")
    server = Server(fleet, ports, speed=100.0)
    asyncio.run(server.run(duration_s=2.0))
    assert not any(fleet.answers(*place) for place in fleet.places)


@pytest.mark.parametrize("is_written", [True, False])
def test_what_nobody_writes_is_not_remembered(tmp_path: Path, is_written: bool) -> None:
    fleet = Fleet(open_field(), ["px4"], seed=1, rates="lean")
    serving = serve(
        fleet,
        plan_ports(["px4"], host="127.0.0.1", base=0),
        (),
        lambda *_: contextlib.nullcontext(lambda: None),
        speed=20.0,
        duration_s=4.0,
        out=tmp_path / "truth" if is_written else None,
    )
    asyncio.run(serving)
    truth = fleet.referee.files()["truth.npz"]
    kept = [len(truth[name]) for name in ("track_time_s", "coverage_time_s", "links")]
    assert min(kept) > 1 if is_written else not any(kept)
    assert (tmp_path / "truth" / "truth.npz").exists() is is_written


def test_starting_costs_little(start: Start) -> None:
    before_s = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    assert start("--port", 0, "--duration", 0.02).process.wait(PATIENCE_S) == 0
    after_s = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    assert after_s - before_s < 1.5  # processor time; 0.3 s when it was written
