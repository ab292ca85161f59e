import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.frames import body_to_ned, rotate, wrap_rad
from swarm_ctl.model import Vec3

ANGLE = st.floats(-10.0, 10.0)


def near(vector: Vec3, *expected: float) -> bool:
    return vector == pytest.approx(expected, abs=1e-9)


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


@given(ANGLE, ANGLE, ANGLE, st.tuples(*[st.floats(-100, 100)] * 3))
def test_a_rotation_keeps_length(
    roll: float, pitch: float, yaw: float, v: tuple[float, ...]
) -> None:
    turned = body_to_ned(Vec3(*v), roll, pitch, yaw)
    assert math.hypot(*turned) == pytest.approx(math.hypot(*v), abs=1e-9)


@given(st.floats(-1e4, 1e4))
def test_wrapping_keeps_the_direction(angle: float) -> None:
    wrapped = wrap_rad(angle)
    assert -math.pi < wrapped <= math.pi + 1e-12
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-7)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-7)
