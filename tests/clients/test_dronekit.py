from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from mock_process import Mock

pytestmark = pytest.mark.clients

Launch = Callable[..., tuple[Mock, list[int]]]
Fly = Callable[..., dict[str, Any]]


@pytest.mark.parametrize(
    ("personality", "version", "mode", "fix"),
    [("ardupilot", "APM:Copter-4.7", "STABILIZE", 6), ("px4", "PX4Copter-1.17", "LOITER", 3)],
)
def test_dronekit_connects_and_sees_the_vehicle(
    launch: Launch, fly: Fly, port: int, personality: str, version: str, mode: str, fix: int
) -> None:
    launch(personality)
    seen = fly("fly_dronekit", "attributes", f"udpin:127.0.0.1:{port}")
    assert seen["version"].startswith(version)
    assert (seen["mode"], seen["armed"], seen["state"]) == (mode, False, "STANDBY")
    assert (seen["fix"], seen["satellites"]) == (fix, 10)
    assert seen["battery_v"] > 12.0
    assert seen["parameters"] > 90
    assert seen["home_deg"] == pytest.approx([47.398, 8.546], abs=0.01)


def test_dronekit_flies_somewhere_and_home(launch: Launch, fly: Fly, port: int) -> None:
    launch("ardupilot", "--speed", 5)
    seen = fly("fly_dronekit", "flight", f"udpin:127.0.0.1:{port}")
    assert 10.0 < seen["farthest_m"] < 13.0
    assert seen["from_home_m"] < 1.0


def test_dronekit_sets_a_parameter(launch: Launch, fly: Fly, port: int) -> None:
    launch("ardupilot")
    seen = fly("fly_dronekit", "parameters", f"udpin:127.0.0.1:{port}", "WPNAV_SPEED", 432.0)
    assert seen["before"] != 432.0
    assert seen["after"] == 432.0
    assert 432.0 in seen["heard"]


def test_dronekit_uploads_reads_back_and_flies_a_mission(
    launch: Launch, fly: Fly, port: int
) -> None:
    launch("ardupilot", "--speed", 5)
    seen = fly("fly_dronekit", "mission", f"udpin:127.0.0.1:{port}")
    assert seen["kept"] == [22, 16]
    assert seen["next"] == 2


def test_dronekit_flies_five_vehicles_at_once(launch: Launch, fly: Fly) -> None:
    _, ports = launch("ardupilot", "--vehicles", 5, "--speed", 4)
    seen = fly("fly_dronekit", "fleet", *(f"udpout:127.0.0.1:{port}" for port in ports))
    assert all(2.5 < height_m < 3.5 for height_m in seen["heights_m"])
    assert seen["armed"] == [False] * 5
