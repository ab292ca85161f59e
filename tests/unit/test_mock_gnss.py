from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mock_client import ACCEPTED, AP_LAND, FAILED, PX4_LAND, REJECTED, Client, both
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.geodesy import TESTING_GROUND
from mock_vehicle.sensors.gnss import Gnss, Reception
from mock_vehicle.vehicle import Personality

LATITUDE_E7, LONGITUDE_E7 = 473977418, 85455939
NORTH_10_M_E7 = 899


def asked(client: Client, number: int, kind: str) -> Any:
    """Ask for a message, and give it, or None when it does not come."""
    assert client.command(512, number) == [(512, ACCEPTED)]
    return next((m for at, m in client.heard if m.get_type() == kind and at == client.now), None)


def ready(personality: Personality) -> Client:
    client = Client(personality)
    client.fly(1.5)
    return client


# A fix.


@both
def test_the_globe_is_told_as_the_local_frame_tells_it(personality: Personality) -> None:
    client = ready(personality)
    client.take_off(10.0)
    client.go_offboard()
    client.fly(20.0, mask=0xDF8, x=10.0, y=0.0, z=-10.0)
    place = asked(client, 33, "GLOBAL_POSITION_INT")
    assert place.lat - LATITUDE_E7 == pytest.approx(NORTH_10_M_E7 + 270, abs=20)  # 3 m: its start
    assert place.relative_alt == pytest.approx(10_000, abs=300)
    assert place.alt == pytest.approx(489_400 + 10_000, abs=300)
    assert place.hdg == pytest.approx(math.degrees(0.5) * 100, abs=2)
    fix = asked(client, 24, "GPS_RAW_INT")
    assert (fix.lat, fix.lon) == pytest.approx((place.lat, place.lon), abs=2)
    assert fix.fix_type == {"px4": 3, "ardupilot": 6}[personality]
    assert fix.satellites_visible == 10


@both
def test_home_is_where_it_started_until_told_otherwise(personality: Personality) -> None:
    client = ready(personality)
    start = TESTING_GROUND.to_global(3.0, -2.0, 0.0)
    home = asked(client, 242, "HOME_POSITION")
    assert home.latitude == round(start.latitude_deg * 1e7)
    assert (home.altitude, home.x, home.y, home.z) == (489_400, 0.0, 0.0, 0.0)
    assert client.command(179, 0, 0, 0, 0, 47.3978, 8.5456, 500.0) == [(179, ACCEPTED)]
    moved = asked(client, 242, "HOME_POSITION")
    assert (moved.latitude, moved.longitude) == pytest.approx((473978000, 85456000), abs=20)
    assert moved.altitude == 500_000
    assert moved.z == pytest.approx(-10.6, abs=1e-4)
    assert asked(client, 33, "GLOBAL_POSITION_INT").relative_alt == pytest.approx(-10_600, abs=1)
    client.send(
        mavlink.MAVLink_command_int_message(
            7, 1, 0, 179, 0, 0, 0, 0, 0, 0, 473979000, 85457000, 490.0
        )
    )
    client.tick()
    assert asked(client, 242, "HOME_POSITION").latitude == 473979000
    assert client.command(179, 1) == [(179, ACCEPTED)]
    client.command(410)
    assert client.last("HOME_POSITION").latitude == home.latitude


@both
def test_a_home_of_nonsense_is_refused(personality: Personality) -> None:
    client = ready(personality)
    denial = {"px4": REJECTED, "ardupilot": FAILED}[personality]
    for place in ((math.nan, 8.0, 0.0), (95.0, 8.0, 0.0), (47.0, 8.0, math.inf)):
        assert client.command(179, 0, 0, 0, 0, *place) == [(179, denial)]


@both
def test_home_lies_nowhere_before_the_first_fix(personality: Personality) -> None:
    client = Client(personality, boot_s=None)
    client.fly(1.0)
    assert asked(client, 242, "HOME_POSITION") is None
    assert asked(client, 49, "GPS_GLOBAL_ORIGIN") is None
    client.fly(20.0)
    assert asked(client, 242, "HOME_POSITION").latitude
    assert asked(client, 49, "GPS_GLOBAL_ORIGIN").latitude


# A bad fix, and none.


def denied(personality: Personality) -> Client:
    """Launch in a world without satellites, where flow or vision navigates."""
    client = Client(personality)
    client.readings.has_odometry = True
    client.readings.gnss_reception[:] = Reception.DENIED
    client.fly(1.5)
    return client


@both
def test_a_denied_world_is_flown_without_a_place_on_the_globe(personality: Personality) -> None:
    client = denied(personality)
    client.take_off(5.0)
    client.command(511, 32, 1e5)
    client.fly(20.0)
    assert client.height_m == pytest.approx(5.0, abs=0.3)
    assert client.times("LOCAL_POSITION_NED")[-1] == pytest.approx(client.now)
    fix = asked(client, 24, "GPS_RAW_INT")
    assert (fix.fix_type, fix.lat, fix.eph) == (1, 0, 0xFFFF)
    assert asked(client, 242, "HOME_POSITION") is None
    place = asked(client, 33, "GLOBAL_POSITION_INT")
    assert (place.lat if place else 0) == 0  # ArduPilot sends zeros, PX4 nothing
    assert (place is None) == (personality == "px4")
    assert not asked(client, 1, "SYS_STATUS").onboard_control_sensors_health & 0x20


@both
def test_a_vehicle_without_satellites_believes_the_origin_it_is_told(
    personality: Personality,
) -> None:
    client = denied(personality)
    client.send(mavlink.MAVLink_set_gps_global_origin_message(7, 470000000, 80000000, 100_000))
    client.tick()
    assert client.last("GPS_GLOBAL_ORIGIN").latitude == 470000000
    assert asked(client, 33, "GLOBAL_POSITION_INT").lat == 470000000
    assert asked(client, 242, "HOME_POSITION").altitude == 100_000


@both
def test_an_origin_of_satellites_is_not_talked_away(personality: Personality) -> None:
    client = ready(personality)
    client.send(mavlink.MAVLink_set_gps_global_origin_message(7, 470000000, 80000000, 100_000))
    assert asked(client, 49, "GPS_GLOBAL_ORIGIN").latitude != 470000000


@both
def test_a_glitch_moves_the_fix_and_takes_the_estimate_along(personality: Personality) -> None:
    client = ready(personality)
    client.command(511, 32, 1e5)
    client.readings.gnss_error_ned_m[:] = (10.0, 0.0, 0.0)
    client.fly(1.0)
    fix = asked(client, 24, "GPS_RAW_INT")
    assert fix.lat - LATITUDE_E7 == pytest.approx(NORTH_10_M_E7 + 270, abs=2)
    assert client.last("LOCAL_POSITION_NED").x == pytest.approx(10.0)
    client.readings.has_odometry = True
    client.fly(1.0)
    assert client.last("LOCAL_POSITION_NED").x == pytest.approx(0.0)


def test_degraded_fixes_wander_about_the_truth() -> None:
    gnss = Gnss(50, Reception.DEGRADED, np.random.default_rng(1))
    errors = np.array([gnss.measure(0.1) for _ in range(3000)])[1000:]
    assert errors.mean() == pytest.approx(0.0, abs=0.3)
    assert errors[..., 0].std() == pytest.approx(3.0, rel=0.15)
    assert errors[..., 2].std() == pytest.approx(6.0, rel=0.15)
    assert np.abs(np.diff(errors, axis=0)).max() < 6.0


def test_a_receiver_that_receives_is_right() -> None:
    gnss = Gnss(2, Reception.PRESENT, np.random.default_rng(1))
    assert not gnss.measure(0.1).any()
    gnss.glitch_ned_m[1] = (5.0, 0.0, 0.0)
    assert gnss.measure(0.1).tolist() == [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]]


# Satellites lost in flight, with nothing else to navigate by.


def test_ardupilot_lands_8_s_after_the_satellites_are_gone() -> None:
    client = Client("ardupilot", rates="full")
    client.take_off(6.0)
    client.command(511, 32, 1e5)
    client.readings.gnss_reception[:] = Reception.DENIED
    lost_s = client.now
    assert client.fly_until(lambda: client.vehicle.mode == AP_LAND) == pytest.approx(8.2, abs=0.2)
    assert client.texts[-2:] == ["EKF variance", "EKF Failsafe: changed to LAND Mode"]
    client.fly(1.0)
    heartbeat = client.last("HEARTBEAT")
    assert (heartbeat.base_mode, heartbeat.system_status) == (209, 5)
    assert asked(client, 193, "EKF_STATUS_REPORT").flags == 37
    client.fly(10.0)
    assert client.times("LOCAL_POSITION_NED")[-1] - lost_s == pytest.approx(15.2, abs=0.2)
    assert asked(client, 193, "EKF_STATUS_REPORT").flags == 167
    client.fly_until(lambda: not client.vehicle.armed)
    assert client.height_m == 0.0
    assert client.command(400, 1) == [(400, FAILED)]
    assert "Arm: Need Position Estimate" in client.texts


def test_a_parameter_switches_ardupilots_receiver_off() -> None:
    client = ready("ardupilot")
    client.vehicle.autopilot.set_parameter("SIM_GPS1_ENABLE", 0.0)
    client.tick()
    fix = asked(client, 24, "GPS_RAW_INT")
    assert (fix.fix_type, fix.satellites_visible) == (1, 3)


def test_px4_lands_without_satellites_until_they_are_back() -> None:
    client = ready("px4")
    client.take_off(20.0)
    client.go_offboard()
    client.fly(1.0, vx=0.0)
    client.readings.gnss_reception[:] = Reception.DENIED
    client.fly(6.5, vx=0.0)
    blind = client.last("HEARTBEAT")
    assert (blind.custom_mode, blind.system_status) == (PX4_LAND, 5)
    assert client.now - client.times("LOCAL_POSITION_NED")[-1] > 1.0
    client.readings.gnss_reception[:] = Reception.PRESENT
    client.fly(2.0, vx=0.0)
    assert client.last("HEARTBEAT").custom_mode == 6 << 16
    assert client.height_m > 10.0


@both
def test_satellites_that_come_back_soon_are_not_missed(personality: Personality) -> None:
    client = ready(personality)
    client.take_off(5.0)
    mode = client.vehicle.mode
    client.readings.gnss_reception[:] = Reception.DENIED
    client.fly(4.5)
    client.readings.gnss_reception[:] = Reception.PRESENT
    client.fly(20.0)
    assert client.vehicle.mode == mode
    assert client.height_m == pytest.approx(5.0, abs=0.3)


@both
def test_a_vehicle_that_never_saw_satellites_does_not_arm(personality: Personality) -> None:
    client = Client(personality)
    client.readings.gnss_reception[:] = Reception.DENIED
    client.fly(5.0)
    denial = {"px4": REJECTED, "ardupilot": FAILED}[personality]
    assert client.command(400, 1) == [(400, denial)]


def test_home_is_where_it_armed_last_and_it_returns_there() -> None:
    client = ready("ardupilot")
    client.take_off(5.0)
    client.go_offboard()
    client.fly(15.0, mask=0xDF8, x=8.0, y=0.0, z=-5.0)
    client.set_mode(AP_LAND)
    client.fly_until(lambda: not client.vehicle.armed)
    client.take_off(5.0)
    assert asked(client, 242, "HOME_POSITION").x == pytest.approx(8.0, abs=0.5)
    client.go_offboard()
    client.fly(15.0, mask=0xDF8, x=20.0, y=0.0, z=-5.0)
    client.set_mode(6)
    client.fly_until(lambda: not client.vehicle.armed, within_s=120.0)
    assert client.dynamics.position_ned_m[0, 0] == pytest.approx(3.0 + 8.0, abs=0.7)
