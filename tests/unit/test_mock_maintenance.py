from __future__ import annotations

import pytest
from mock_client import (
    ACCEPTED,
    AP_GUIDED,
    DENIED,
    FAILED,
    REJECTED,
    UNSUPPORTED,
    Client,
    both,
)

from mock_vehicle.vehicle import Personality

# The result tables of both records, for what has no effect that could be seen.


@pytest.mark.parametrize(
    ("command", "result"),
    [
        ((0,), UNSUPPORTED),
        ((16,), UNSUPPORTED),
        ((31999, 1), UNSUPPORTED),
        ((183, 9, 1500), ACCEPTED),
        ((185, 0), FAILED),
        ((195,), ACCEPTED),
        ((197,), ACCEPTED),
        ((208, 2), ACCEPTED),
        ((211, 1, 1), FAILED),
        ((218, 9), ACCEPTED),
        ((245, 1), DENIED),
        ((519, 1), UNSUPPORTED),
        ((530,), UNSUPPORTED),
        ((2000,), FAILED),
        ((42007, 1), ACCEPTED),
        ((34,), UNSUPPORTED),
    ],
)
def test_ardupilot_answers_as_recorded(command: tuple[float, ...], result: int) -> None:
    number = int(command[0])
    assert Client("ardupilot").command(number, *command[1:]) == [(number, result)]


@pytest.mark.parametrize(
    ("command", "result"),
    [
        ((16,), UNSUPPORTED),
        ((31999, 1), UNSUPPORTED),
        ((60000, 1), UNSUPPORTED),
        ((185, 0), DENIED),
        ((209, 1), UNSUPPORTED),
        ((222,), UNSUPPORTED),
        ((241,), ACCEPTED),
        ((401,), ACCEPTED),
        ((519, 1), ACCEPTED),
    ],
)
def test_px4_answers_as_recorded(command: tuple[float, ...], result: int) -> None:
    number = int(command[0])
    assert Client("px4").command(number, *command[1:]) == [(number, result)]


@both
def test_a_reboot_is_acknowledged_and_forgets_the_mode(personality: Personality) -> None:
    client = Client(personality)
    client.fly(2.0)
    first = client.vehicle.mode
    client.set_mode(AP_GUIDED if personality == "ardupilot" else 6 << 16)
    assert client.command(246, 1) == [(246, ACCEPTED)]
    client.fly(1.0)
    assert client.vehicle.mode == first
    assert client.last("HEARTBEAT").custom_mode == first
    client.command(511, 30, 1e5)
    client.tick()
    assert client.last("ATTITUDE").time_boot_ms < 2000


@both
def test_nothing_of_the_machine_is_touched_in_flight(personality: Personality) -> None:
    client = Client(personality)
    client.take_off()
    refusal = {"px4": DENIED, "ardupilot": FAILED}[personality]
    assert client.command(246, 1) == [(246, refusal)]
    refusal = {"px4": REJECTED, "ardupilot": FAILED}[personality]
    assert client.command(241, 1) == [(241, refusal)]
    assert client.vehicle.armed


def test_gyros_are_calibrated_for_half_a_second() -> None:
    client = Client("ardupilot")
    assert client.command(241, 1) == []
    start_s = client.now
    client.fly(1.0)
    acknowledged_s = client.times("COMMAND_ACK")[-1]
    assert acknowledged_s - start_s == pytest.approx(0.527, abs=0.11)
    assert client.texts == ["Initialising ArduPilot"]
    assert client.command(241, 0, 0, 1) == [(241, ACCEPTED)]
    assert client.texts[-1] == "Barometer calibration complete"


def test_a_calibration_tells_what_it_measured() -> None:
    client = Client("ardupilot", rates="full")
    client.fly(1.5)
    client.heard.clear()
    client.command(241, 0, 0, 1)
    client.command(241, 1)
    client.fly(1.0)
    told = [m.param_id for _, m in client.heard if m.get_type() == "PARAM_VALUE"]
    assert told[:2] == ["BARO1_GND_PRESS", "BARO2_GND_PRESS"]
    assert told[2:5] == ["INS_GYROFFS_X", "INS_GYROFFS_Y", "INS_GYROFFS_Z"]


def test_a_motor_is_tested_for_as_long_as_asked() -> None:
    client = Client("ardupilot")
    assert client.command(209, 1, 0, 5, 2.0) == [(209, ACCEPTED)]
    client.fly(1.5)
    assert client.texts == ["starting motor test"]
    client.fly(1.0)
    assert client.texts[-1] == "finished motor test"


def test_the_banner_names_firmware_board_and_frame() -> None:
    client = Client("ardupilot")
    assert client.command(42428) == [(42428, ACCEPTED)]
    assert client.texts[0].startswith("ArduCopter V4.7")
    assert client.texts[2] == "Frame: QUAD/PLUS"


@both
def test_a_terminated_flight_falls(personality: Personality) -> None:
    client = Client(personality)
    client.take_off(10.0)
    assert client.command(185, 1) == [(185, ACCEPTED)]
    client.fly(3.0)
    assert client.height_m == 0.0
    assert not client.vehicle.armed


def test_ardupilot_tells_a_hard_landing_and_its_compasses() -> None:
    client = Client("ardupilot", rates="full")
    client.take_off(4.0)
    assert [text for text in client.texts if "in-flight yaw" in text] == [
        "EKF3 IMU0 MAG0 in-flight yaw alignment complete",
        "EKF3 IMU1 MAG0 in-flight yaw alignment complete",
    ]
    client.set_mode(9)
    client.fly_until(lambda: not client.vehicle.armed)
    (hit,) = (text for text in client.texts if text.startswith("SIM Hit ground"))
    assert float(hit.split()[4]) == pytest.approx(0.5, abs=0.1)
