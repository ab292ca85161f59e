"""Walls that a rangefinder saw before it fell silent."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl import wire
from swarm_ctl.agent.blind import FORGOTTEN_M, Remembered, sight
from swarm_ctl.agent.geofence import Guard, Motion
from swarm_ctl.agent.params import FlightParams, Limits
from swarm_ctl.autopilot.telemetry import SUBSCRIBED, Telemetry
from swarm_ctl.model import ZERO, Vec3

FRONT, BACK, DOWN = 0, 1, 5
STALE_S = 0.5


class Vehicle:
    """Telemetry as frames bring it."""

    def __init__(self) -> None:
        self.telemetry = Telemetry(1)
        self._parser = wire.Parser(SUBSCRIBED)
        self._mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def tell(self, message: mavlink.MAVLink_message, now: float) -> None:
        for frame in self._parser.feed(message.pack(self._mav)):
            self.telemetry.receive(frame, now)

    def stand(self, north: float, east: float, now: float, yaw_rad: float = 0.0) -> None:
        ms = round(now * 1000)
        self.tell(mavlink.MAVLink_attitude_message(ms, 0, 0, yaw_rad, 0, 0, 0), now)
        place = (north, east, -2.0, 0.1, 0.0, 0.0)
        self.tell(mavlink.MAVLink_local_position_ned_message(ms, *place), now)

    def see(self, orientation: int, cm: int, now: float) -> None:
        fields = (round(now * 1000), 20, 800, cm, 0, 1, orientation, 255)
        self.tell(mavlink.MAVLink_distance_sensor_message(*fields), now)


@pytest.fixture
def vehicle() -> Vehicle:
    """Give one that sees a wall 2 m to the north at 1 s, and another 3 m below."""
    vehicle = Vehicle()
    vehicle.stand(5.0, 5.0, 1.0)
    vehicle.see(0, 200, 1.0)
    vehicle.see(25, 300, 1.0)
    return vehicle


def test_what_was_told_just_now_is_taken_as_it_is(vehicle: Vehicle) -> None:
    ranges_m, walls = sight(vehicle.telemetry, 1.1, STALE_S)
    assert (ranges_m[FRONT], ranges_m[DOWN], walls) == (2.0, 3.0, [])


def test_what_was_told_a_moment_ago_is_shortened_by_what_was_flown(vehicle: Vehicle) -> None:
    vehicle.stand(5.4, 5.0, 1.4)
    ranges_m, walls = sight(vehicle.telemetry, 1.4, STALE_S)
    assert ranges_m[FRONT] == pytest.approx(1.6)
    assert ranges_m[BACK] == math.inf
    assert not walls


def test_a_wall_stays_where_it_stood_though_the_vehicle_turns(vehicle: Vehicle) -> None:
    vehicle.stand(5.5, 5.2, 3.0, yaw_rad=2.0)
    ranges_m, walls = sight(vehicle.telemetry, 3.0, STALE_S)
    assert ranges_m == [math.inf] * 6
    ahead, below = walls
    assert tuple(ahead.direction) == pytest.approx((1.0, 0.0, 0.0))
    assert tuple(below.direction) == pytest.approx((0.0, 0.0, 1.0))
    assert (ahead.distance_m, below.distance_m) == pytest.approx((1.5, 3.0))


def test_far_from_where_a_wall_was_seen_it_is_forgotten(vehicle: Vehicle) -> None:
    vehicle.stand(5.0, 5.0 + FORGOTTEN_M + 0.1, 3.0)
    assert sight(vehicle.telemetry, 3.0, STALE_S) == ([math.inf] * 6, [])


def test_a_start_that_is_set_anew_moves_no_wall(vehicle: Vehicle) -> None:
    vehicle.telemetry.start_here()
    vehicle.stand(5.5, 5.0, 3.0)
    _, walls = sight(vehicle.telemetry, 3.0, STALE_S)
    assert walls[0].distance_m == pytest.approx(1.5)


def test_towards_a_remembered_wall_nobody_flies_nor_is_anybody_pushed_off() -> None:
    guard = Guard(Limits(radius_m=10.0, floor_m=0.5, ceiling_m=4.0), FlightParams())
    still, clear = Motion(Vec3(0, 0, -2), ZERO, 0.0), [math.inf] * 6
    wall = Remembered(Vec3(1.0, 0.0, 0.0), 0.4)
    assert guard.confine(Vec3(1, 0, 0), still, clear, [], [wall]).x == pytest.approx(0, abs=0.011)
    assert guard.confine(ZERO, still, clear, [], [wall]) == ZERO
    assert guard.confine(Vec3(-0.5, 0, 0), still, clear, [], [wall]).x == pytest.approx(-0.5)
