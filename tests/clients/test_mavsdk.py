from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import flown
import pytest
from mock_process import Mock

from swarm_ctl.export import export_run

pytestmark = pytest.mark.clients
both = pytest.mark.parametrize("personality", ["px4", "ardupilot"])

Launch = Callable[..., tuple[Mock, list[int]]]
Fly = Callable[..., dict[str, Any]]


@pytest.mark.parametrize(
    ("personality", "autopilot", "version"),
    [("px4", "PX4", [1, 17]), ("ardupilot", "ARDUPILOT", [4, 7])],
)
def test_mavsdk_learns_who_it_is_and_arms_and_disarms_on_the_ground(
    launch: Launch, fly: Fly, port: int, personality: str, autopilot: str, version: list[int]
) -> None:
    launch(personality)
    seen = fly("fly_mavsdk", "introduction", port)
    assert (seen["autopilot"], seen["vehicle"]) == (autopilot, "MULTICOPTER")
    assert seen["version"] == version
    assert int(seen["uid"], 16) != 0


@both
def test_mavsdk_flies_from_health_to_home(
    launch: Launch, fly: Fly, port: int, personality: str
) -> None:
    launch(personality, "--first-sysid", 7, "--speed", 3)
    seen = fly("fly_mavsdk", "flight", port)
    assert seen["sysid"] == 7
    assert seen["in_air"]
    assert seen["offboard"]
    assert {"OFFBOARD", "RETURN_TO_LAUNCH"} <= set(seen["modes"])
    assert seen["from_home_m"] < 1.0


@pytest.mark.parametrize(
    ("personality", "integer", "real", "count"),
    [
        ("px4", "NAV_RCL_ACT", "MPC_XY_VEL_MAX", range(90, 1000)),
        ("ardupilot", "FS_GCS_ENABLE", "WPNAV_SPEED", range(1349, 1350)),
    ],
)
def test_mavsdk_reads_and_writes_parameters(
    launch: Launch, fly: Fly, port: int, personality: str, integer: str, real: str, count: range
) -> None:
    launch(personality)
    seen = fly("fly_mavsdk", "parameters", port, integer, real)
    assert seen["count"] in count
    assert seen["took_s"] < 20.0  # about 1 s on an idle machine
    assert (seen["integer"], seen["real"]) == (2, 7.25)
    assert seen["unknown"] == "TIMEOUT", "neither autopilot says that a parameter does not exist"


@both
def test_mavsdk_uploads_reads_back_and_flies_a_mission(
    launch: Launch, fly: Fly, port: int, personality: str
) -> None:
    launch(personality, "--speed", 3)
    seen = fly("fly_mavsdk", "mission", port)
    for kept, sent in zip(seen["kept_deg"], seen["sent_deg"], strict=True):
        assert kept == pytest.approx(sent, abs=2e-7)
    assert {1, 2, 3} <= set(seen["reached"])
    assert seen["from_end_m"] < 4.0
    assert {"MISSION", "LAND"} <= set(seen["modes"])


def test_mavsdk_reads_the_plan_of_a_run_and_a_vehicle_takes_it(
    launch: Launch, fly: Fly, port: int, tmp_path: Path
) -> None:
    run = flown.fly(tmp_path, vehicles=2, duration_s=40.0)
    launch("px4")
    seen = fly("fly_mavsdk", "plan", port, export_run(run, "plan"))
    assert seen["commands"] == [[22, 16, 20]] * 2, "take-off, the victim, home"


@both
def test_mavsdk_flies_five_vehicles_at_once(
    launch: Launch, fly: Fly, port: int, personality: str
) -> None:
    launch(personality, "--vehicles", 5, "--speed", 3)
    seen = fly("fly_mavsdk", "fleet", port, 5)
    assert sorted(seen["north_m"]) == ["1", "2", "3", "4", "5"]
    assert all(north_m > 2.0 for north_m in seen["north_m"].values())


@both
def test_mavsdk_discovers_25_vehicles_by_ids_of_their_own(
    launch: Launch, fly: Fly, port: int, personality: str
) -> None:
    launch(personality, "--vehicles", 25)
    seen = fly("fly_mavsdk", "discovery", port, 25)
    assert seen["known_s"] < 20.0  # 1.3 s on an idle machine
    assert seen["sysids"] == list(range(1, 26))
    assert len(set(seen["uids"])) == 25
