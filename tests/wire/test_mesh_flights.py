"""Vehicles flown by processes of their own that share a mesh, a surveyed frame and no radio."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from session import Session

from mock_vehicle.testing import Plan, RealSwarm, Truth, launch
from swarm_ctl.cli import main

pytestmark = pytest.mark.wire

SPEED = 5
PATIENCE_S = 400.0
"""Mission time."""
STARTS_APART_M = 2.0
WORLD = """
name: room
size_m: [8, 8]
starts: [{position_m: [3, 4]}, {position_m: [5, 4]}]
gnss: {reception: denied}
radio: {radius_m: 0}
"""
MISSION: dict[str, Any] = {
    "duration_s": 20.0,
    "planner": {"kind": "lf-pso", "levy_min_m": 2.0, "avoid_distance_m": 0.7},
    "frame": {"shared": "surveyed", "starts_m": {1: [3, 4, 0], 2: [5, 4, 0]}},
}


def contacts(run: Path) -> list[list[int]]:
    """Give whom a vehicle came to hear, one list each time."""
    entries = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    return [e["data"]["gained"] for e in entries if e["event"] == "ContactsChanged"]


def apart_m(truths: list[Truth]) -> float:
    (north, east, down), other = truths[0].position_ned_m, truths[1].position_ned_m
    return math.dist((north, east - STARTS_APART_M, down), other)


def test_vehicles_of_two_processes_keep_apart_by_the_mesh(tmp_path: Path, peers_url: str) -> None:
    world, mission = tmp_path / "room.yaml", tmp_path / "search.yaml"
    world.write_text(WORLD)
    mission.write_text(yaml.safe_dump(MISSION))
    fly = [sys.executable, "-m", "swarm_ctl", "fly", str(mission), "--speed", str(SPEED)]
    plan = {"autopilot": "mixed", "vehicles": 2, "world": world, "speed": SPEED, "rates": "lean"}
    nearest_m = math.inf
    with launch(Plan.of(plan)) as swarm:
        assert isinstance(swarm, RealSwarm)
        processes = [
            subprocess.Popen(
                [
                    *fly,
                    "--connect",
                    swarm[n].url,
                    "--out",
                    str(tmp_path / str(n)),
                    "--peers",
                    peers_url,
                ],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )
            for n in swarm.sysids
        ]

        def have_landed(truths: list[Truth]) -> bool:
            nonlocal nearest_m
            nearest_m = min(nearest_m, apart_m(truths))
            return all(process.poll() is not None for process in processes)

        swarm.wait_until(have_landed, PATIENCE_S)
    assert [process.communicate()[1] for process in processes] == [b"", b""]
    assert [process.returncode for process in processes] == [0, 0]
    assert [2] in contacts(tmp_path / "1")
    assert [1] in contacts(tmp_path / "2")
    assert nearest_m > 0.7
    print(f"closest approach {nearest_m:.2f} m")  # noqa: T201


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
