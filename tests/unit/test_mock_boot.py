from __future__ import annotations

import pytest
from mock_client import ACCEPTED, AP_GUIDED, FAILED, REJECTED, Client

from mock_vehicle.autopilot.boot import ANNOUNCEMENTS

AUTO = 3


def booted(until_s: float) -> Client:
    """Boot ArduPilot as slowly as the real one."""
    client = Client("ardupilot", boot_s=None, rates="full")
    client.fly(until_s)
    return client


def test_ardupilot_tells_its_boot_as_recorded() -> None:
    client = booted(45.0)
    said = {m.text: at for at, m in client.heard if m.get_type() == "STATUSTEXT"}
    assert list(said) == [announcement.text.format(amsl_m=489.4) for announcement in ANNOUNCEMENTS]
    assert said["ArduPilot Ready"] == pytest.approx(2.46, abs=0.1)
    assert said["EKF3 IMU0 is using GPS"] == pytest.approx(41.43, abs=0.1)
    assert client.times("HOME_POSITION") == pytest.approx([20.0], abs=0.1)
    assert client.times("GPS_GLOBAL_ORIGIN") == pytest.approx([20.0], abs=0.1)


@pytest.mark.parametrize(
    ("uptime_s", "reasons"),
    [
        (2.0, ["System not initialised"]),
        (
            5.1,
            [
                "Need Alt Estimate",
                "Accels inconsistent",
                "EKF attitude is bad",
                "AHRS: waiting for home",
            ],
        ),
        (7.2, ["Accels inconsistent", "AHRS: waiting for home"]),
        (17.2, ["Gyros inconsistent", "AHRS: waiting for home"]),
        (21.3, ["Gyros inconsistent", "Need Position Estimate"]),
        (39.4, ["Need Position Estimate"]),
    ],
)
def test_ardupilot_says_why_it_does_not_arm_yet(uptime_s: float, reasons: list[str]) -> None:
    client = booted(uptime_s)
    client.heard.clear()
    assert client.command(400, 1) == [(400, FAILED)]
    assert [text for text in client.texts if text.startswith("Arm")] == [
        f"Arm: {reason}" for reason in reasons
    ]


def test_prearm_checks_tell_all_reasons_at_once() -> None:
    client = booted(4.1)
    client.set_mode(AUTO)
    client.heard.clear()
    assert client.command(401) == [(401, ACCEPTED)]
    assert client.texts[0] == "PreArm: Need Alt Estimate"
    assert client.texts[4] == "PreArm: Mode requires mission"
    client.set_mode(0)
    client.fly(27.0)
    repeated = [at for at, m in client.heard if "Need Position" in str(m)]
    assert repeated == pytest.approx([30.47], abs=0.3)


def test_a_mode_set_during_the_boot_of_ardupilot_is_forgotten() -> None:
    client = booted(1.5)
    assert client.set_mode(AP_GUIDED) == [(176, ACCEPTED)]
    assert client.vehicle.mode == AP_GUIDED
    client.fly(1.0)
    assert client.vehicle.mode == 0


def test_the_first_heartbeats_of_ardupilot_look_guided() -> None:
    client = booted(3.2)
    seen = [(m.base_mode, m.system_status) for _, m in client.heard if m.get_type() == "HEARTBEAT"]
    assert seen == [(89, 1), (89, 1), (81, 3)]


def test_estimators_come_up_step_by_step() -> None:
    ardupilot = Client("ardupilot", boot_s=None, rates="full")
    ardupilot.command(511, 193, 1e5)
    ardupilot.fly(43.0)
    flags = [(at, m.flags) for at, m in ardupilot.heard if m.get_type() == "EKF_STATUS_REPORT"]
    assert list(dict.fromkeys(flag for _, flag in flags)) == [1024, 0, 167, 831]
    assert next(at for at, flag in flags if flag == 831) == pytest.approx(41.5, abs=0.1)
    px4 = Client("px4", boot_s=None, rates="full")
    px4.command(511, 230, 1e5)
    px4.fly(5.0)
    states = [m.flags for _, m in px4.heard if m.get_type() == "ESTIMATOR_STATUS"]
    assert list(dict.fromkeys(states)) == [164, 229, 1023]


def test_px4_rejects_arming_until_it_is_healthy() -> None:
    client = Client("px4", boot_s=None, rates="full")
    client.gcs_heartbeat()
    client.fly(2.0)
    assert client.command(400, 1) == [(400, REJECTED)]
    assert client.texts[0].startswith("Arming denied: Resolve system health")
    client.fly(3.0)
    assert client.command(400, 1) == [(400, ACCEPTED)]


def test_a_short_boot_says_the_same_sooner() -> None:
    client = Client("ardupilot", boot_s=1.0, rates="full")
    client.fly(1.2)
    assert client.texts == [a.text.format(amsl_m=489.4) for a in ANNOUNCEMENTS]


def test_a_reboot_starts_all_over() -> None:
    client = Client("ardupilot", boot_s=1.0, rates="full")
    client.fly(2.0)
    client.heard.clear()
    client.vehicle.autopilot.reboot(client.now)
    client.fly(1.5)
    assert "ArduPilot Ready" in client.texts
    assert client.times("HOME_POSITION")
