from __future__ import annotations

import os
import re
import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from mock_process import Mock

pytestmark = pytest.mark.clients

PATIENCE_S = 60.0
MAVPROXY = Path(sys.executable).with_name("mavproxy.py")
PLAN = """QGC WPL 110
0\t0\t0\t16\t0\t0\t0\t0\t47.3979217\t8.5458596\t489.4\t1
1\t0\t3\t22\t0\t0\t0\t0\t47.3979217\t8.5458596\t3.0\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.3980000\t8.5458596\t3.0\t1
3\t0\t3\t21\t0\t0\t0\t0\t47.3980000\t8.5458596\t0.0\t1
"""
STATUS = "status LOCAL_POSITION_NED"
NORTH_M = r"LOCAL_POSITION_NED \{.* x : (-?[\d.e-]+)"
DOWN_M = r"LOCAL_POSITION_NED \{.* z : (-?[\d.e-]+)"

TAKEN_OFF = "NAV_TAKEOFF: (ACCEPTED|FAILED)"
"""It fails when it is said again because the first answer was lost."""

Launch = Callable[..., tuple[Mock, list[int]]]


class Operator:
    """Types commands into MAVProxy and reads what it prints."""

    def __init__(self, port: int, folder: Path) -> None:
        self.console = subprocess.Popen(
            [sys.executable, MAVPROXY, f"--master=udpin:127.0.0.1:{port}", "--aircraft=mock"],
            cwd=folder,
            env={**os.environ, "HOME": str(folder), "PYTHONUNBUFFERED": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        assert self.console.stdin is not None
        assert self.console.stdout is not None
        self.keyboard, self.screen = self.console.stdin, self.console.stdout
        self.unread = ""

    def types(self, line: str) -> None:
        self.keyboard.write(f"{line}\n".encode())
        self.keyboard.flush()

    def finds(self, pattern: str, patience_s: float) -> re.Match[str] | None:
        """Read until this appears; nothing is read twice."""
        deadline = time.monotonic() + patience_s
        while not (match := re.search(pattern, self.unread)):
            rest_s = deadline - time.monotonic()
            if rest_s < 0.0:
                return None
            if select.select([self.screen], [], [], rest_s)[0]:
                self.unread += os.read(self.screen.fileno(), 65536).decode(errors="replace")
            assert self.console.poll() is None, self.unread
        self.unread = self.unread[match.end() :]
        return match

    def reads(self, *patterns: str) -> None:
        """Wait for these to appear, one after the other."""
        for pattern in patterns:
            assert self.finds(pattern, PATIENCE_S), f"no {pattern!r} in {self.unread!r}"

    def insists(self, line: str, pattern: str) -> None:
        """Type it until this appears: a busy MAVProxy loses some of what vehicles send it."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            self.types(line)
            if self.finds(pattern, 3.0):
                return
        raise AssertionError(f"{line}: no {pattern!r} in {self.unread!r}")

    def asks(self, question: str, answer: str, enough: Callable[[float], bool]) -> None:
        """Type it twice a second until the number in the answer is right."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            self.types(question)
            if (match := self.finds(answer, 0.5)) and enough(float(match[1])):
                return
        raise AssertionError(f"{question}: never right in {self.unread!r}")

    def leaves(self) -> None:
        self.keyboard.close()
        try:
            self.console.wait(10.0)
        finally:
            self.console.kill()
            self.console.wait()
            self.screen.close()


@pytest.fixture
def operator(port: int, tmp_path: Path) -> Iterator[Operator]:
    operator = Operator(port, tmp_path)
    yield operator
    operator.leaves()


def test_mavproxy_flies_an_ardupilot_there_and_back(launch: Launch, operator: Operator) -> None:
    launch("ardupilot", "--speed", 5)
    operator.reads("Detected vehicle 1:1", "Received 1349 parameters")
    operator.insists("mode GUIDED", "Mode GUIDED")
    operator.insists("arm throttle", "ARMED")
    operator.insists("takeoff 3", TAKEN_OFF)
    operator.types("set streamrate 10")
    operator.asks(STATUS, DOWN_M, lambda down_m: down_m < -2.7)
    operator.types("position 5 0 0")
    operator.asks(STATUS, NORTH_M, lambda north_m: north_m > 4.0)
    operator.insists("mode RTL", "Mode RTL")
    operator.reads("DISARMED")


def test_mavproxy_flies_a_px4_up_and_down(launch: Launch, operator: Operator) -> None:
    # Its `mode` fails on every PX4, and its `takeoff` sends a height that PX4 takes for AMSL.
    # It loses some of what PX4 sends at full rates, so what is read here is said again and again.
    launch("px4", "--speed", 2)
    operator.reads("Detected vehicle 1:1", r"Received \d+ parameters")
    operator.insists("arm throttle", "ARMED")
    operator.insists("long NAV_TAKEOFF nan nan nan nan nan nan nan", "Mode TAKEOFF")
    operator.asks(STATUS, DOWN_M, lambda down_m: down_m < -2.0)
    operator.insists("long NAV_RETURN_TO_LAUNCH", "Mode RTL")
    operator.reads("DISARMED")


@pytest.mark.parametrize(
    ("personality", "name"), [("ardupilot", "WPNAV_SPEED"), ("px4", "MPC_XY_VEL_MAX")]
)
def test_mavproxy_reads_and_writes_parameters(
    launch: Launch, operator: Operator, personality: str, name: str
) -> None:
    launch(personality)
    operator.reads(r"Received \d+ parameters")
    operator.types(f"param set {name} 7.25")
    operator.asks(f"param show {name}", rf"{name} +([\d.]+)", lambda value: value == 7.25)
    operator.insists(f"param fetch {name}", rf"{name} = 7.25")


@pytest.mark.parametrize("personality", ["px4", "ardupilot"])
def test_mavproxy_loads_and_lists_a_mission(
    launch: Launch, operator: Operator, tmp_path: Path, personality: str
) -> None:
    (tmp_path / "plan.txt").write_text(PLAN)
    launch(personality)
    operator.reads(r"Received \d+ parameters")
    operator.types("wp load plan.txt")
    operator.reads("Sent all 4 waypoints", "MISSION_ACK: TYPE_MISSION: ACCEPTED")
    operator.types("wp save back.txt")
    operator.reads("Saved 4 waypoints")


def test_mavproxy_flies_five_vehicles_on_one_port(launch: Launch, operator: Operator) -> None:
    mock, _ = launch("ardupilot", "--vehicles", 5, "--speed", 2)
    operator.reads(*["Detected vehicle"] * 5, "Received 1349 parameters")
    for sysid in range(1, 6):
        operator.insists(f"vehicle {sysid}", f"Set vehicle {sysid}")
        operator.insists("mode GUIDED", "DO_SET_MODE: ACCEPTED")
        operator.insists("arm throttle", "COMPONENT_ARM_DISARM: ACCEPTED")
        operator.insists("takeoff 3", TAKEN_OFF)
    assert any(mock.line()["airborne"] == 5 for _ in range(20))
    for sysid in range(1, 6):
        operator.insists(f"vehicle {sysid}", f"Set vehicle {sysid}")
        operator.insists("mode LAND", "DO_SET_MODE: ACCEPTED")
    assert any(mock.line()["airborne"] == 0 for _ in range(30))
