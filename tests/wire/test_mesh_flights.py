"""Vehicles flown by processes of their own that share a mesh, a surveyed frame and no radio."""

from __future__ import annotations

import contextlib
import json
import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
import yaml
from mosquitto import Mosquitto
from session import Session

from mock_vehicle.testing import Plan, RealSwarm, Truth, launch
from swarm_ctl import wire
from swarm_ctl.agent.beacon import SUMMARY_TYPE
from swarm_ctl.agent.peer import plus
from swarm_ctl.cli import main
from swarm_ctl.explore.pieces import read_summary
from swarm_ctl.frames import enu_to_ned
from swarm_ctl.model import Vec3

pytestmark = pytest.mark.wire

SPEED = 5
PATIENCE_S = 400.0
"""Mission time."""
STARTS_M = {1: [1, 1, 0], 2: [1, 3, 0], 3: [3, 2, 0]}
"""As in worlds and surveys: x east, y north, z up."""
WORLD: dict[str, Any] = {
    "name": "room",
    "starts": [{"position_m": start[:2]} for start in STARTS_M.values()],
    "gnss": {"reception": "denied"},
    "radio": {"radius_m": 0},
}
MISSION: dict[str, Any] = {
    "duration_s": 20.0,
    "planner": {"kind": "explore", "levy_min_m": 2.0, "avoid_distance_m": 0.7},
    "frame": {"shared": "surveyed", "starts_m": STARTS_M},
}


@pytest.fixture
def fly(tmp_path: Path, peers_url: str) -> Iterator[Callable[..., Fleet]]:
    """Give a function that flies vehicles, each by a process of its own."""
    with contextlib.ExitStack() as stack:

        def begin(vehicles: int, speed: int = SPEED, room_m: float = 8.0, **changes: Any) -> Fleet:
            world = {**WORLD, "size_m": [room_m, room_m]}
            (tmp_path / "room.yaml").write_text(yaml.safe_dump(world))
            (tmp_path / "search.yaml").write_text(yaml.safe_dump({**MISSION, **changes}))
            plan = {"autopilot": "mixed", "vehicles": vehicles, "speed": speed, "rates": "lean"}
            swarm = stack.enter_context(launch(Plan.of({**plan, "world": tmp_path / "room.yaml"})))
            assert isinstance(swarm, RealSwarm)
            return Fleet(swarm, tmp_path, peers_url, speed)

        yield begin


class Fleet:
    """Vehicles of a mock in the air, their controllers' processes, and what these leave behind."""

    def __init__(self, swarm: RealSwarm, folder: Path, peers: str, speed: int) -> None:
        self.swarm = swarm
        self.nearest_m = math.inf
        self._folder = folder
        words = [sys.executable, "-m", "swarm_ctl", "fly", str(folder / "search.yaml")]
        words += ["--speed", str(speed), "--peers", peers]
        self._processes = [
            subprocess.Popen(
                [*words, "--connect", swarm[n].url, "--out", str(folder / str(n))],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )
            for n in swarm.sysids
        ]

    def fly_until(self, is_so: Callable[[], bool]) -> None:
        def look(truths: list[Truth]) -> bool:
            places = [
                plus(Vec3(*one.position_ned_m), enu_to_ned(Vec3(*start)))
                for one, start in zip(truths, STARTS_M.values(), strict=False)
            ]
            apart_m = [math.dist(*both) for both in combinations(places, 2)]
            self.nearest_m = min(self.nearest_m, *apart_m)
            return is_so()

        self.swarm.wait_until(look, PATIENCE_S)

    def end(self) -> list[str]:
        """Wait for the landings; give what each process complained about."""
        self.fly_until(lambda: all(one.poll() is not None for one in self._processes))
        complaints = [one.communicate()[1].decode() for one in self._processes]
        assert [one.returncode for one in self._processes] == [0] * len(self._processes)
        return complaints

    def met(self, sysid: int, which: str = "gained") -> list[int]:
        """Give whom a vehicle came to hear, or lost, in this order."""
        file = self._folder / str(sysid) / "events.jsonl"
        lines = file.read_text().split("\n")[:-1] if file.exists() else []
        entries = [json.loads(line) for line in lines]
        changes = [e["data"][which] for e in entries if e["event"] == "ContactsChanged"]
        return [peer for change in changes for peer in change]

    def trails_known(self, sysid: int) -> dict[int, int]:
        """Give how much of whose trail a vehicle has told that it knows, by its own record."""
        (tlog,) = (self._folder / str(sysid)).rglob("*.tlog")
        known: dict[int, int] = {}
        for frame in wire.Parser(("TUNNEL",)).feed(tlog.read_bytes()):
            said = frame.values
            if frame.sysid == sysid and said.payload_type == SUMMARY_TYPE:
                pairs = read_summary(said.payload[: said.payload_length]) or []
                known.update((origin & 0xFF, length) for origin, length in pairs)
        return known


@pytest.mark.parametrize("peers_url", ["multicast"], indirect=True)
def test_vehicles_of_two_processes_keep_apart_by_the_mesh(fly: Callable[..., Fleet]) -> None:
    # sped up, what the mesh takes is as many times longer to who flies; in a room so small, those
    # who know nothing of each other touch
    fleet = fly(2, speed=1, room_m=4.0, planner={**MISSION["planner"], "kind": "lf-pso"})
    assert fleet.end() == ["", ""]
    assert fleet.nearest_m > 0.7
    print(f"closest approach {fleet.nearest_m:.2f} m")  # noqa: T201


def test_vehicles_of_three_processes_find_one_another_and_share_trails(
    fly: Callable[..., Fleet],
) -> None:
    fleet = fly(3)
    assert fleet.end() == ["", "", ""]
    for sysid in STARTS_M:
        others = set(STARTS_M) - {sysid}
        assert others <= set(fleet.met(sysid))
        known = fleet.trails_known(sysid)
        assert all(known.get(other, 0) > 3 for other in others), known


@pytest.mark.parametrize("peers_url", ["mqtt"], indirect=True)
def test_a_broker_that_dies_in_flight_disturbs_nobody_and_comes_back(
    fly: Callable[..., Fleet], broker: Mosquitto
) -> None:
    fleet = fly(2, duration_s=90.0)
    fleet.fly_until(lambda: bool(fleet.met(1) and fleet.met(2)))
    broker.kill()
    fleet.fly_until(lambda: bool(fleet.met(1, "lost") and fleet.met(2, "lost")))
    broker.start()
    complaints = fleet.end()
    assert fleet.met(1) == [2, 2]
    assert fleet.met(2)[:2] == [1, 1]
    for words in complaints:
        assert words.count("flying on without peers over it") == 1
        assert words.count("connected again") == 1
        assert words.count("\n") == 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            ["--sysid", "1", "--peers", "udp://127.0.0.1:14700"],
            "networks; expected a multicast group",
        ),
        (["--sysid", "7"], "search.yaml: frame.starts_m: lacks vehicle 7; all that fly must be in"),
    ],
)
def test_what_cannot_be_flown_in_a_shared_frame_is_told_in_one_sentence(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    words: str,
) -> None:
    mission = tmp_path / "search.yaml"
    mission.write_text(yaml.safe_dump(MISSION))
    fixed = ["--connect", "udpin://127.0.0.1:0", "--out", str(tmp_path / "run")]
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(sys, "argv", ["swarm-ctl", "fly", str(mission), *fixed, *options])
    with pytest.raises(SystemExit) as ended:
        main()
    complained = capsys.readouterr().err.strip()
    assert ended.value.code == 2
    assert words in complained
    assert "\n" not in complained
    assert not (tmp_path / "run").exists()


def test_in_virtual_time_there_is_no_network(
    hall: Callable[..., Path], swarm_ctl_run: Callable[..., Session]
) -> None:
    session = swarm_ctl_run(hall(), "--virtual", "--peers", "udp://239.255.42.42:14700")
    code, _, complaints = session.end()
    assert (code, complaints.count("\n")) == (2, 1)
    assert complaints.startswith("--peers: in --virtual the mock's radio is all")
    assert not session.out.exists()
