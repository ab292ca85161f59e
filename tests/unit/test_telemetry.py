import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl import wire
from swarm_ctl.autopilot.telemetry import SUBSCRIBED, Telemetry

EAST = math.pi / 2


class Vehicle:
    """A vehicle's link as pymavlink would write it."""

    def __init__(self) -> None:
        self.telemetry = Telemetry(1)
        self._parser = wire.Parser(SUBSCRIBED)

    def says(self, message: Any, now: float = 1.0, component: int = 1) -> Telemetry:
        link = mavlink.MAVLink(None, srcSystem=1, srcComponent=component)
        for frame in self._parser.feed(bytes(message.pack(link))):
            self.telemetry.receive(frame, now)
        return self.telemetry


@pytest.fixture
def vehicle() -> Vehicle:
    return Vehicle()


def heartbeat(autopilot: int, base: int, custom: int, status: int = 4) -> Any:
    return mavlink.MAVLink_heartbeat_message(2, autopilot, base, custom, status, 3)


def distance(cm: int, orientation: int, sensor: int = 0, **more: Any) -> Any:
    return mavlink.MAVLink_distance_sensor_message(
        0, 10, 800, cm, 0, sensor, orientation, 255, **more
    )


def test_px4_and_ardupilot_are_told_apart_by_their_heartbeat(vehicle: Vehicle) -> None:
    px4 = vehicle.says(heartbeat(12, 128 + 17, 6 << 16))
    assert px4.autopilot is not None
    assert (px4.autopilot.name, px4.armed, px4.is_offboard) == ("px4", True, True)
    assert px4.mode_name == "OFFBOARD"
    guided = vehicle.says(heartbeat(3, 89, 4))
    assert guided.autopilot is not None
    assert (guided.autopilot.name, guided.armed, guided.is_offboard) == ("ardupilot", False, True)
    assert vehicle.says(heartbeat(3, 89, 6)).mode_name == "RTL"


def test_a_range_beyond_the_sensors_reach_means_nothing_there(vehicle: Vehicle) -> None:
    assert vehicle.says(distance(250, 0)).ranges_m[0] == pytest.approx(2.5)
    assert vehicle.says(distance(801, 0)).ranges_m[0] == math.inf


@pytest.mark.parametrize(
    ("orientation", "index"), [(0, 0), (12, 1), (6, 2), (2, 3), (24, 4), (25, 5)]
)
def test_each_rangefinder_has_its_place(vehicle: Vehicle, orientation: int, index: int) -> None:
    assert vehicle.says(distance(100, orientation)).ranges_m[index] == pytest.approx(1.0)


def test_a_peer_to_the_right_of_a_vehicle_that_faces_east_is_south(vehicle: Vehicle) -> None:
    vehicle.says(mavlink.MAVLink_attitude_message(0, 0.0, 0.0, EAST, 0, 0, 0))
    to_the_right = [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
    seen = distance(200, 100, sensor=7, quaternion=to_the_right)
    (fix,) = vehicle.says(seen, component=68).peer_fixes
    assert fix.sysid == 7
    assert fix.offset_ned_m == pytest.approx((-2.0, 0.0, 0.0), abs=1e-6)


def test_a_rangefinder_of_the_radio_is_no_rangefinder_of_the_vehicle(vehicle: Vehicle) -> None:
    assert vehicle.says(distance(100, 0), component=68).ranges_m[0] == math.inf


def test_a_victim_ahead_is_placed_in_the_local_frame(vehicle: Vehicle) -> None:
    vehicle.says(mavlink.MAVLink_attitude_message(0, 0.0, 0.0, EAST, 0, 0, 0))
    vehicle.says(mavlink.MAVLink_local_position_ned_message(0, 3.0, 4.0, -1.5, 0, 0, 0))
    target = mavlink.MAVLink_landing_target_message(
        0, 2, 12, 0, 0, 1.5, 0, 0, 1.0, 0.0, 1.2, [1, 0, 0, 0], 0, 1
    )
    (fix,) = vehicle.says(target).victim_fixes
    assert fix.number == 2
    assert fix.position_ned_m == pytest.approx((3.0, 5.0, -0.3), abs=1e-5)


def test_numbers_that_are_none_change_nothing(vehicle: Vehicle) -> None:
    nan = math.nan
    vehicle.says(mavlink.MAVLink_local_position_ned_message(0, 1.0, 2.0, -3.0, 0, 0, 0))
    after = vehicle.says(mavlink.MAVLink_local_position_ned_message(0, nan, 0, 0, 0, 0, 0), 9.0)
    assert after.position_ned_m == (1.0, 2.0, -3.0)
    assert after.position_s == 1.0
    after = vehicle.says(mavlink.MAVLink_attitude_message(0, nan, 0, 0, 0, 0, 0), 9.0)
    assert after.attitude_s == -math.inf


def test_a_battery_that_is_not_measured_is_not_empty(vehicle: Vehicle) -> None:
    def status(percent: int) -> Any:
        return mavlink.MAVLink_sys_status_message(
            0, 0, 0x10000000, 0, 12000, 100, percent, 0, 0, 0, 0, 0, 0
        )

    assert vehicle.says(status(-1)).battery_fraction is None
    assert vehicle.says(status(80)).battery_fraction == pytest.approx(0.8)
    assert vehicle.telemetry.prearm_ok
