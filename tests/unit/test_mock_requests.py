from __future__ import annotations

import math
from collections import Counter
from typing import Any

import pytest
from mock_client import ACCEPTED, DENIED, FAILED, UNSUPPORTED, Client, airborne, both
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.fleet import Fleet
from mock_vehicle.vehicle import Personality
from mock_vehicle.world.field import open_field

COMPANION, GROUND = 0, 1
HOVER_PWM = {"px4": 1507, "ardupilot": 1583}


class Station:
    """A client at full rates on one link of one vehicle, in virtual time."""

    def __init__(self, personality: Personality, link: int = COMPANION) -> None:
        self.fleet = Fleet(open_field(), [personality], seed=1, rates="full")
        self.link = link
        self.steps = 0
        self.oracle = mavlink.MAVLink(None)
        self.mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)

    def send(self, message: Any) -> None:
        now = self.steps * self.fleet.step_s
        self.fleet.receive(0, message.pack(self.mav), now, self.link)

    def hz(self, seconds: float = 20.0) -> dict[str, float]:
        """Count what comes in the next seconds."""
        heard: Counter[str] = Counter()
        for _ in range(round(seconds / self.fleet.step_s)):
            self.steps += 1
            companion = [data for _, data in self.fleet.step(self.steps * self.fleet.step_s)]
            ground = self.fleet.answers(0, GROUND) if self.link == GROUND else []
            for data in companion if self.link == COMPANION else ground:
                heard.update(m.get_type() for m in self.oracle.parse_buffer(data) or [])
        return {name: count / seconds for name, count in heard.items()}


RECORDED_HZ: dict[int, dict[str, float]] = {
    # default_streams of the PX4 record, counted in real time.
    COMPANION: {
        "ATTITUDE": 98.77,
        "HIGHRES_IMU": 49.4,
        "ATTITUDE_QUATERNION": 49.4,
        "GLOBAL_POSITION_INT": 49.4,
        "LOCAL_POSITION_NED": 29.65,
        "ODOMETRY": 29.65,
        "TIMESYNC": 9.9,
        "ALTITUDE": 9.9,
        "ATTITUDE_TARGET": 9.9,
        "POSITION_TARGET_LOCAL_NED": 9.9,
        "SERVO_OUTPUT_RAW": 9.9,
        "VFR_HUD": 9.9,
        "GPS_RAW_INT": 7.9,
        "EXTENDED_SYS_STATE": 4.95,
        "SYS_STATUS": 4.95,
        "MISSION_CURRENT": 1.0,
        "HEARTBEAT": 1.0,
        "ESTIMATOR_STATUS": 1.0,
        "OPEN_DRONE_ID_LOCATION": 1.0,
        "OPEN_DRONE_ID_SYSTEM": 1.0,
        "PING": 1.0,
        "SCALED_PRESSURE": 1.0,
        "SYSTEM_TIME": 1.0,
        "BATTERY_STATUS": 0.5,
        "UNKNOWN_436": 0.5,  # CURRENT_MODE, which pymavlink does not know
        "HOME_POSITION": 0.5,
        "VIBRATION": 0.5,
    },
    GROUND: {
        "SERVO_OUTPUT_RAW": 49.4,
        "ATTITUDE": 49.4,
        "ATTITUDE_QUATERNION": 49.4,
        "GLOBAL_POSITION_INT": 49.4,
        "LOCAL_POSITION_NED": 49.4,
        "ATTITUDE_TARGET": 49.4,
        "POSITION_TARGET_LOCAL_NED": 49.4,
        "GPS_RAW_INT": 4.95,
        "VFR_HUD": 3.95,
        "HEARTBEAT": 1.0,
        "ALTITUDE": 1.0,
        "EXTENDED_SYS_STATE": 1.0,
        "OPEN_DRONE_ID_LOCATION": 1.0,
        "OPEN_DRONE_ID_SYSTEM": 1.0,
        "SCALED_PRESSURE": 1.0,
        "SYS_STATUS": 1.0,
        "MISSION_CURRENT": 1.0,
        "BATTERY_STATUS": 0.5,
        "UNKNOWN_436": 0.5,
        "ESTIMATOR_STATUS": 0.5,
        "HOME_POSITION": 0.5,
        "PING": 0.1,
        "VIBRATION": 0.1,
    },
}


@pytest.mark.parametrize("link", [COMPANION, GROUND])
def test_px4_streams_as_often_as_recorded(link: int) -> None:
    station = Station("px4", link)
    station.hz(2.0)
    measured = station.hz()
    measured.pop("DISTANCE_SENSOR")  # six of them, where the recorded vehicle had one
    assert measured.keys() == RECORDED_HZ[link].keys()
    for name, hz in RECORDED_HZ[link].items():
        assert measured[name] == pytest.approx(hz / 0.988, rel=0.03, abs=0.05), name


def test_ardupilot_streams_twenty_five_kinds_when_asked_for_all() -> None:
    station = Station("ardupilot")
    station.hz(2.0)
    assert station.hz() == {"HEARTBEAT": 1.0, "TIMESYNC": 0.1}
    station.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1))
    measured = station.hz()
    asked = {name for name, hz in measured.items() if hz == pytest.approx(4.0, abs=0.1)}
    assert len(asked - {"LOCAL_POSITION_NED", "WIND"}) == 25, "these two need a position"
    assert asked >= {"AHRS2", "SIMSTATE", "EKF_STATUS_REPORT", "ESC_TELEMETRY_1_TO_4", "MEMINFO"}
    station.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 0))
    assert station.hz(10.0).keys() <= {"HEARTBEAT", "TIMESYNC"}


@pytest.mark.parametrize(("asked_hz", "served_hz"), [(5, 5), (25, 25), (100, 100), (1000, 100)])
def test_px4_serves_an_attitude_up_to_its_steps(asked_hz: float, served_hz: float) -> None:
    station = Station("px4")
    station.send(
        mavlink.MAVLink_command_long_message(1, 1, 511, 0, 30, 1e6 / asked_hz, 0, 0, 0, 0, 0)
    )
    assert station.hz(5.0)["ATTITUDE"] == pytest.approx(served_hz, abs=0.5)


def test_px4_has_no_more_fixes_than_its_receiver() -> None:
    station = Station("px4")
    station.send(mavlink.MAVLink_command_long_message(1, 1, 511, 0, 24, 5e4, 0, 0, 0, 0, 0))
    assert station.hz(5.0)["GPS_RAW_INT"] == pytest.approx(8.0, abs=0.2)


# REQUEST_MESSAGE.

GIVEN_BY_ARDUPILOT = {
    148: "AUTOPILOT_VERSION",
    242: "HOME_POSITION",
    49: "GPS_GLOBAL_ORIGIN",
    32: "LOCAL_POSITION_NED",
    33: "GLOBAL_POSITION_INT",
    1: "SYS_STATUS",
    0: "HEARTBEAT",
    245: "EXTENDED_SYS_STATE",
    147: "BATTERY_STATUS",
    30: "ATTITUDE",
    31: "ATTITUDE_QUATERNION",
    83: "ATTITUDE_TARGET",
    105: "HIGHRES_IMU",
    241: "VIBRATION",
    244: "MESSAGE_INTERVAL",
    42: "MISSION_CURRENT",
    2: "SYSTEM_TIME",
    108: "SIM_STATE",
    164: "SIMSTATE",
    193: "EKF_STATUS_REPORT",
}
GIVEN_BY_PX4 = {
    148: "AUTOPILOT_VERSION",
    242: "HOME_POSITION",
    49: "GPS_GLOBAL_ORIGIN",
    264: "FLIGHT_INFORMATION",
    147: "BATTERY_STATUS",
    244: "MESSAGE_INTERVAL",
    115: "HIL_STATE_QUATERNION",
    109: "RADIO_STATUS",
}
SILENTLY_ACCEPTED = {"ardupilot": (85, 87, 22, 162, 435), "px4": (300, 395, 397, 435)}
REFUSED = {
    "ardupilot": (300, 395, 397, 331, 230, 436, 76, 253, 410, 65000, 64),
    "px4": (27, 9999, 178, 193),
}


@both
def test_requested_messages_come_as_recorded(personality: Personality) -> None:
    client = Client(personality)
    client.fly(2.0)
    given = GIVEN_BY_PX4 if personality == "px4" else GIVEN_BY_ARDUPILOT
    for number, name in given.items():
        client.heard.clear()
        assert client.command(512, number, 30) == [(512, ACCEPTED)], name
        assert client.times(name), name


@both
def test_nothing_to_say_is_accepted_and_the_unknown_is_not(personality: Personality) -> None:
    client = Client(personality)
    client.fly(2.0)
    for number in SILENTLY_ACCEPTED[personality]:
        assert client.command(512, number) == [(512, ACCEPTED)], number
    refusal = {"px4": DENIED, "ardupilot": FAILED}[personality]
    for number in REFUSED[personality]:
        assert client.command(512, number) == [(512, refusal)], number


# What stands in them.


def given(client: Client, number: int, name: str) -> Any:
    client.command(512, number)
    return client.last(name)


@both
def test_an_accelerometer_at_rest_feels_one_g_upwards(personality: Personality) -> None:
    client = Client(personality)
    client.fly(2.0)
    imu = given(client, 105, "HIGHRES_IMU")
    assert (imu.xacc, imu.yacc, imu.zacc) == pytest.approx((0.0, 0.0, -9.80665), abs=1e-4)
    assert imu.abs_pressure == pytest.approx(955.8, abs=0.3)
    assert imu.pressure_alt == pytest.approx(489.4)
    north = math.atan2(-imu.ymag, imu.xmag)
    assert north == pytest.approx(0.5 - 0.0556, abs=0.01)  # its heading, less the declination


@both
def test_an_accelerometer_feels_the_thrust_that_brakes(personality: Personality) -> None:
    client = airborne(personality)
    client.fly(0.8, vx=4.0)
    acceleration = client.dynamics.acceleration_ned_m_s2[0].tolist()
    imu = given(client, 105, "HIGHRES_IMU")
    felt = math.hypot(imu.xacc, imu.yacc, imu.zacc)
    expected = math.hypot(acceleration[0], acceleration[1], acceleration[2] - 9.80665)
    assert felt == pytest.approx(expected, abs=1e-3)
    assert felt > 9.9


@both
def test_motors_stand_idle_and_hover_as_recorded(personality: Personality) -> None:
    client = Client(personality)
    client.fly(2.0)
    parked = given(client, 36, "SERVO_OUTPUT_RAW")
    assert parked.servo1_raw == {"px4": 900, "ardupilot": 1000}[personality]
    client.take_off()
    client.fly(5.0)
    flying = given(client, 36, "SERVO_OUTPUT_RAW")
    assert flying.servo1_raw == pytest.approx(HOVER_PWM[personality], abs=10)
    assert flying.servo5_raw == {"px4": 900, "ardupilot": 0}[personality]
    thrust = given(client, 83, "ATTITUDE_TARGET").thrust
    assert thrust == pytest.approx({"px4": 0.51, "ardupilot": 0.35}[personality], abs=0.02)


def test_px4_says_which_setpoint_it_follows() -> None:
    client = Client("px4")
    client.fly(2.0)
    waiting = given(client, 85, "POSITION_TARGET_LOCAL_NED")
    assert (waiting.type_mask, waiting.afz) == (63, 100.0)
    client = airborne("px4")
    client.fly(1.0, vx=2.0, vy=-1.0)
    target = given(client, 85, "POSITION_TARGET_LOCAL_NED")
    assert target.type_mask == 7
    assert (target.vx, target.vy, target.vz) == (2.0, -1.0, 0.0)


def test_ardupilot_says_which_setpoint_it_follows_in_guided_alone() -> None:
    client = airborne("ardupilot")
    client.fly(1.0, vx=2.0)
    assert given(client, 85, "POSITION_TARGET_LOCAL_NED").type_mask == 0xC07
    client.fly(1.0, mask=0xDF8, x=3.0, z=-5.0)
    target = given(client, 85, "POSITION_TARGET_LOCAL_NED")
    assert (target.type_mask, target.x, target.z) == (0xDF8, 3.0, -5.0)
    client.set_mode(17)
    client.heard.clear()
    client.command(512, 85)
    assert not client.times("POSITION_TARGET_LOCAL_NED")


@both
def test_the_truth_is_told_to_viewers(personality: Personality) -> None:
    client = Client(personality)
    client.readings.drift_ned_m[:] = (50.0, 0.0, 0.0)
    client.fly(2.0)
    if personality == "px4":
        truth = given(client, 115, "HIL_STATE_QUATERNION")
        latitude = truth.lat
    else:
        latitude = given(client, 108, "SIM_STATE").lat_int
    assert latitude == pytest.approx(473977418 + 270, abs=2)
    estimate = given(client, 33, "GLOBAL_POSITION_INT")
    assert estimate.lat - latitude == pytest.approx(4497, abs=5)


def test_odometry_repeats_position_and_attitude() -> None:
    client = airborne("px4")
    client.fly(1.0, vx=1.0)
    odometry = given(client, 331, "ODOMETRY")
    local = given(client, 32, "LOCAL_POSITION_NED")
    assert odometry.x == pytest.approx(local.x, abs=0.2)
    assert (odometry.frame_id, odometry.child_frame_id, odometry.estimator_type) == (1, 1, 8)
    assert math.hypot(*odometry.q) == pytest.approx(1.0)
    assert 2 * math.atan2(odometry.q[3], odometry.q[0]) == pytest.approx(0.5, abs=0.05)


def test_the_time_of_day_waits_for_the_satellites() -> None:
    client = Client("ardupilot", boot_s=None)
    client.fly(9.0)
    assert given(client, 2, "SYSTEM_TIME").time_unix_usec == 0
    client.fly(2.0)
    told = given(client, 2, "SYSTEM_TIME")
    asked_s = client.now - 0.1  # one tick ago
    assert told.time_unix_usec == pytest.approx((1_767_225_600 + asked_s) * 1e6, abs=10)
    assert told.time_boot_ms == pytest.approx(asked_s * 1e3, abs=1)


def test_px4_tells_its_protocol_version_in_both_ways() -> None:
    client = Client("px4")
    client.fly(1.5)
    assert client.command(512, 300) == [(512, ACCEPTED)]
    assert client.command(519, 1) == [(519, ACCEPTED)]
    told = [m for _, m in client.heard if m.get_type() == "UNKNOWN_300"]  # pymavlink has it not
    assert len(told) == 2


def test_ardupilot_has_no_protocol_version_to_tell() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    assert client.command(512, 300) == [(512, FAILED)]
    assert client.command(519, 1) == [(519, UNSUPPORTED)]
