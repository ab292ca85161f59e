"""`swarm-ctl doctor` as its user meets it: real sockets, exit codes, and what it says."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from halls import write_hall
from surgery import HEALTHY

from mock_vehicle.testing import RealSwarm, RealVehicle
from swarm_ctl.cli import main

pytestmark = [
    pytest.mark.wire,
    pytest.mark.mock_vehicle(speed=4, rates="lean", parameters=HEALTHY["px4"]),
]
BLIND = {"GUID_TIMEOUT": 3.0, "FS_GCS_ENABLE": 1}
"""What would bite, with one that may be set and one that may not."""

Doctor = Callable[..., tuple[int, str, str]]


@pytest.fixture
def doctor(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Doctor:
    """Type `swarm-ctl doctor` for simulators four times as fast."""
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("NO_COLOR", "1")

    def run(*words: object, speed: float = 4.0) -> tuple[int, str, str]:
        line = ["swarm-ctl", "doctor", "--speed", speed, "--timeout", 5, *words]
        monkeypatch.setattr(sys, "argv", [str(word) for word in line])
        with pytest.raises(SystemExit) as ended:
            main()
        said, complained = capsys.readouterr()
        assert "Traceback" not in complained
        return int(ended.value.code or 0), said, complained

    return run


def test_a_healthy_vehicle_is_fit_to_fly(mock_vehicle: RealVehicle, doctor: Doctor) -> None:
    code, said, _ = doctor("--connect", mock_vehicle.url)
    assert code == 0
    assert "vehicle 1: px4 1.17.0 alpha, quadrotor, AUTO.LOITER" in said
    assert said.endswith("Fit to fly: 1 vehicle, no warnings.\n")


@pytest.mark.mock_vehicle(autopilot="ardupilot", parameters=BLIND)
def test_what_would_bite_is_said_and_left_alone(mock_vehicle: RealVehicle, doctor: Doctor) -> None:
    code, said, _ = doctor("--connect", mock_vehicle.url)
    assert code == 1
    assert "GUID_TIMEOUT" in said
    assert "3 s; advised: 1 s" in said
    assert "--fix would set GUID_TIMEOUT" in said
    assert "Do not fly: 1 error" in said
    assert mock_vehicle.received("PARAM_SET") == []
    assert mock_vehicle.parameters["GUID_TIMEOUT"] == 3.0


@pytest.mark.mock_vehicle(autopilot="ardupilot", parameters=BLIND)
def test_fixing_says_what_it_set_and_what_it_left(
    mock_vehicle: RealVehicle, doctor: Doctor
) -> None:
    code, said, _ = doctor("--connect", mock_vehicle.url, "--fix")
    assert code == 0
    assert "set GUID_TIMEOUT: 3 -> 1" in said
    assert "left as they are: FS_GCS_ENABLE, FS_OPTIONS" in said
    assert mock_vehicle.parameters["GUID_TIMEOUT"] == 1.0
    assert mock_vehicle.parameters["FS_GCS_ENABLE"] == 1
    assert doctor("--connect", mock_vehicle.url, "--strict")[0] == 1


def test_programs_read_json(mock_vehicle: RealVehicle, doctor: Doctor, tmp_path: Path) -> None:
    mission = write_hall(tmp_path, {})
    code, said, _ = doctor("--connect", mock_vehicle.url, "--mission", mission, "--json")
    report: dict[str, Any] = json.loads(said)
    (vehicle,) = report["vehicles"]
    assert (code, report["fit"], report["silent"]) == (1, False, [])
    assert (vehicle["sysid"], vehicle["autopilot"], vehicle["armed"]) == (1, "px4", False)
    assert vehicle["clock_rate"] == pytest.approx(1.0, abs=0.1)
    found = {finding["check"]: finding for finding in vehicle["findings"]}
    assert found["RTL_RETURN_ALT"]["severity"] == "error"
    assert found["RTL_RETURN_ALT"]["fix"] == {"RTL_RETURN_ALT": 1.5}
    assert (vehicle["changed"], vehicle["not_taken"]) == ({}, [])


def test_a_simulator_that_is_faster_than_told_is_not_fit(
    mock_vehicle: RealVehicle, doctor: Doctor
) -> None:
    code, said, _ = doctor("--connect", mock_vehicle.url, speed=1.0)
    assert code == 1
    assert "times as fast as expected" in said


@pytest.mark.mock_vehicle(autopilot="ardupilot", one_port=True, parameters=HEALTHY["ardupilot"])
def test_all_who_call_one_port_are_examined(mock_swarm: RealSwarm, doctor: Doctor) -> None:
    (url,) = {vehicle.url for vehicle in mock_swarm}
    code, said, _ = doctor("--connect", url)
    assert code == 0
    assert "vehicle 1: " in said
    assert said.endswith("Fit to fly: 2 vehicles, no warnings.\n")
    code, said, _ = doctor("--connect", url, "--sysid", 2)
    assert (code, "vehicle 1: " in said, "vehicle 2: " in said) == (0, False, True)


def test_a_link_on_which_nobody_is_heard_fails(
    mock_vehicle: RealVehicle, doctor: Doctor, free_udp_port: int
) -> None:
    silent = f"udpin://127.0.0.1:{free_udp_port}"
    code, said, _ = doctor("--connect", mock_vehicle.url, "--connect", silent)
    assert code == 1
    assert f"{silent}: no autopilot is heard" in said


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--connect", "udpin://127.0.0.1:0"), "udpin://127.0.0.1:0: no autopilot is heard"),
        (("--connect", "carrier-pigeon://1"), "carrier-pigeon://1: expected udpin://"),
        (("--connect", "udpin://127.0.0.1:0", "--mission", "none.yaml"), "none.yaml: there is no"),
        (("--connect", "udpin://127.0.0.1:0", "--signing-key", "none"), "signing key none: "),
        ((), "missing option '--connect'"),
        (("--connect", "udpin://127.0.0.1:0", "--sysid", "300"), "--sysid 300: a vehicle's sysid"),
    ],
)
def test_what_cannot_be_examined_is_exit_2(
    doctor: Doctor, options: tuple[str, ...], sentence: str
) -> None:
    code, said, complained = doctor("--timeout", 1, *options)
    assert (code, said) == (2, "")
    assert sentence in complained
