"""Frames and their conventions, against pymap3d and against the mock's own geodesy."""

from __future__ import annotations

import math

import pymap3d
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mock_vehicle.geodesy import Origin
from swarm_ctl.frames import (
    Geodetic,
    body_to_ned,
    enu_to_ned,
    geodetic_to_ned,
    ned_to_geodetic,
    rotate,
    turn,
    wrap_rad,
)
from swarm_ctl.model import Vec3

ANGLE = st.floats(-10.0, 10.0)
YAW = st.floats(-math.pi, math.pi)
PITCH = st.floats(-1.5, 1.5)
PLACES = st.builds(Geodetic, st.floats(-89, 89), st.floats(-180, 180), st.floats(-400, 9000))
OFFSETS = st.builds(Vec3, st.floats(-1000, 1000), st.floats(-1000, 1000), st.floats(-200, 200))
VECTORS = st.builds(Vec3, *[st.floats(-100, 100)] * 3)
ZURICH = Geodetic(47.3977418, 8.5455939, 489.4)
FIJI = Geodetic(-17.8, 179.9999, 3.0)
USHUAIA = Geodetic(-54.8, -68.3, 20.0)
MILLIMETRE = 1e-3


def near(vector: Vec3, *expected: float) -> bool:
    return vector == pytest.approx(expected, abs=1e-9)


def azimuth_and_elevation_rad(vector: Vec3) -> tuple[float, float]:
    north, east, down = (component * 1e6 for component in vector)
    azimuth_deg, elevation_deg, _ = pymap3d.ned2aer(north, east, down)  # below 1 mm it sees nothing
    return math.radians(azimuth_deg), math.radians(elevation_deg)


# -- body and local --------------------------------------------------------------------------------


def test_ahead_of_a_vehicle_that_faces_east_is_east() -> None:
    assert near(body_to_ned(Vec3(1, 0, 0), 0, 0, math.pi / 2), 0, 1, 0)


def test_right_of_a_vehicle_that_faces_east_is_south() -> None:
    assert near(body_to_ned(Vec3(0, 1, 0), 0, 0, math.pi / 2), -1, 0, 0)


def test_ahead_of_a_vehicle_that_pitches_up_points_up() -> None:
    assert near(body_to_ned(Vec3(1, 0, 0), 0, math.pi / 2, 0), 0, 0, -1)


def test_below_a_vehicle_that_rolls_right_points_left() -> None:
    assert near(body_to_ned(Vec3(0, 0, 1), math.pi / 2, 0, 0), 0, -1, 0)


def test_a_quarter_turn_about_down_turns_ahead_to_the_right() -> None:
    half = math.sqrt(0.5)
    assert near(rotate((half, 0, 0, half), Vec3(1, 0, 0)), 0, 1, 0)


@given(ANGLE, ANGLE, ANGLE, VECTORS)
def test_a_rotation_keeps_length(roll: float, pitch: float, yaw: float, v: Vec3) -> None:
    turned = body_to_ned(v, roll, pitch, yaw)
    assert math.hypot(*turned) == pytest.approx(math.hypot(*v), abs=1e-9)


@given(YAW, PITCH, ANGLE)
def test_ahead_lies_where_yaw_and_pitch_say_whatever_the_roll(
    yaw: float, pitch: float, roll: float
) -> None:
    azimuth, elevation = azimuth_and_elevation_rad(body_to_ned(Vec3(1, 0, 0), roll, pitch, yaw))
    assert math.cos(azimuth - yaw) == pytest.approx(1.0)
    assert elevation == pytest.approx(pitch, abs=1e-8)


@given(YAW, YAW)
def test_a_bearing_counts_clockwise_from_the_nose(yaw: float, bearing: float) -> None:
    """The radio tells a peer's bearing by a quaternion that turns body +x towards the peer."""
    seen = rotate((math.cos(bearing / 2), 0.0, 0.0, math.sin(bearing / 2)), Vec3(5, 0, 0))
    azimuth, elevation = azimuth_and_elevation_rad(body_to_ned(seen, 0.0, 0.0, yaw))
    assert math.cos(azimuth - (yaw + bearing)) == pytest.approx(1.0)
    assert elevation == pytest.approx(0.0, abs=1e-9)


@given(ANGLE, ANGLE, ANGLE, VECTORS)
def test_angles_and_the_quaternion_of_the_same_attitude_turn_alike(
    roll: float, pitch: float, yaw: float, v: Vec3
) -> None:
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    quaternion = (  # MAVLink ATTITUDE_QUATERNION: w, x, y, z; body to NED
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    assert rotate(quaternion, v) == pytest.approx(body_to_ned(v, roll, pitch, yaw), abs=1e-9)


@given(YAW, VECTORS)
def test_a_turn_is_clockwise_and_leaves_down_alone(angle: float, v: Vec3) -> None:
    turned = turn(v, angle)
    assert turned.z == v.z
    if math.hypot(v.x, v.y) > 1e-3:
        before, after = azimuth_and_elevation_rad(v)[0], azimuth_and_elevation_rad(turned)[0]
        assert math.cos(after - before - angle) == pytest.approx(1.0)
    assert turn(turned, -angle) == pytest.approx(v, abs=1e-9)


@given(st.floats(-1e4, 1e4))
def test_wrapping_keeps_the_direction(angle: float) -> None:
    wrapped = wrap_rad(angle)
    assert -math.pi < wrapped <= math.pi + 1e-12
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-7)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-7)


@given(VECTORS)
def test_a_floor_plan_lies_north_up(v: Vec3) -> None:
    """x east, y north, z up: what pymap3d calls ENU has the same azimuth, elevation and range."""
    flipped = enu_to_ned(v)
    assert pymap3d.ned2aer(*flipped) == pytest.approx(pymap3d.enu2aer(*v), abs=1e-9)
    assert math.hypot(*flipped) == math.hypot(*v)


# -- the globe -------------------------------------------------------------------------------------


@given(PLACES, OFFSETS)
@example(FIJI, Vec3(0.0, 1000.0, 0.0)).via("over the date line")
@example(USHUAIA, Vec3(-1000.0, -1000.0, 100.0)).via("south and west")
@example(Geodetic(0.0, 0.0, 0.0), Vec3(-1.0, -1.0, 0.0)).via("where every sign changes")
def test_a_place_a_kilometre_off_is_where_pymap3d_says(origin: Geodetic, offset: Vec3) -> None:
    place = ned_to_geodetic(offset, origin)
    latitude, longitude, altitude = pymap3d.ned2geodetic(*offset, *origin)
    assert place.latitude_deg == pytest.approx(latitude, abs=1e-8)
    assert math.cos(math.radians(place.longitude_deg - longitude)) == pytest.approx(1.0)
    assert place.altitude_m == pytest.approx(altitude, abs=MILLIMETRE)
    assert pymap3d.geodetic2ned(*place, *origin) == pytest.approx(offset, abs=MILLIMETRE)


@given(PLACES, OFFSETS)
@example(FIJI, Vec3(0.0, 1000.0, 0.0)).via("over the date line")
def test_there_and_back_is_the_same_place(origin: Geodetic, offset: Vec3) -> None:
    place = ned_to_geodetic(offset, origin)
    assert -180.0 <= place.longitude_deg <= 180.0
    assert geodetic_to_ned(place, origin) == pytest.approx(offset, abs=1e-5)


@given(PLACES, PLACES)
def test_two_places_anywhere_are_as_far_apart_as_pymap3d_says(a: Geodetic, b: Geodetic) -> None:
    assert geodetic_to_ned(a, b) == pytest.approx(pymap3d.geodetic2ned(*a, *b), abs=MILLIMETRE)


def test_east_of_the_date_line_is_a_step_and_not_a_journey() -> None:
    west, east = Geodetic(-17.8, 179.9999, 0.0), Geodetic(-17.8, -179.9999, 0.0)
    north, to_the_east, _ = geodetic_to_ned(east, west)
    assert north == pytest.approx(0.0, abs=0.01)
    assert to_the_east == pytest.approx(21.2, abs=0.1)


@given(OFFSETS)
def test_the_mock_lies_in_the_same_directions_on_its_sphere(offset: Vec3) -> None:
    """A witness written apart: its Earth is a sphere, 0.3 % off in longitude at 47 degrees."""
    place = Geodetic(*Origin(*ZURICH).to_global(*offset))
    seen = geodetic_to_ned(place, ZURICH)
    off_m = math.dist(seen[:2], offset[:2])
    assert off_m <= 0.004 * math.hypot(offset.x, offset.y) + 0.1  # a tangent plane is no sphere
    assert seen.z == pytest.approx(offset.z, abs=0.2)
    back = Origin(*ZURICH).to_local(*ned_to_geodetic(offset, ZURICH))
    assert math.dist(back[:2], offset[:2]) <= 0.004 * math.hypot(offset.x, offset.y) + 0.1
