import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.safety import (
    TOLERANCE_M_S,
    Constraint,
    limit_velocity,
    peer_limit,
    wall_limit,
)
from swarm_ctl.model import Vec3

SPEED_M_S, CLIMB_M_S = 1.0, 1.0
ACCELERATION_M_S2 = 2.0
SEPARATION_M, CONTACT_M = 1.0, 0.8
TICK_S, PHYSICS_S = 0.1, 0.02

angle = st.floats(-math.pi, math.pi)
component = st.floats(-3.0, 3.0)


def unit(heading_rad: float, climb_rad: float) -> Floats:
    level = math.cos(climb_rad)
    return np.array(
        [level * math.cos(heading_rad), level * math.sin(heading_rad), -math.sin(climb_rad)]
    )


def half_space(normal: Floats, limit: float) -> Constraint:
    x, y, z = normal.tolist()
    return x, y, z, limit


half_spaces = st.lists(
    st.builds(
        lambda heading, climb, limit: half_space(unit(heading, climb), limit),
        angle,
        st.floats(-1.5, 1.5),
        st.floats(-0.5, 2.0),
    ),
    max_size=10,
)


def towards(velocity: Vec3, constraint: Constraint) -> float:
    nx, ny, nz, _ = constraint
    return velocity.x * nx + velocity.y * ny + velocity.z * nz


def filtered(own_m: Floats, peer_m: Floats, wanted: Floats) -> Floats:
    offset_m = peer_m - own_m
    distance_m = float(np.linalg.norm(offset_m))
    limit = peer_limit(distance_m, SEPARATION_M, ACCELERATION_M_S2 / 2, SPEED_M_S)
    constraint = half_space(offset_m / distance_m, limit)
    x, y, z = wanted.tolist()
    return np.array(limit_velocity((x, y, z), [constraint], SPEED_M_S, CLIMB_M_S))


def closest_approach_m(start: Floats, goals: Floats) -> float:
    """Fly two vehicles that brake and turn with 2 m/s2 towards their goals for 15 s."""
    position_m, closest_m = start.copy(), math.inf
    velocity = goals - start
    velocity *= SPEED_M_S / np.linalg.norm(velocity, axis=1)[:, None]
    for _ in range(150):
        wanted = goals - position_m
        wanted *= SPEED_M_S / np.maximum(np.linalg.norm(wanted, axis=1), 0.1)[:, None]
        setpoint = np.array(
            [filtered(position_m[i], position_m[1 - i], wanted[i]) for i in range(2)]
        )
        for _ in range(round(TICK_S / PHYSICS_S)):
            change = setpoint - velocity
            size = np.maximum(np.linalg.norm(change, axis=1), 1e-9)
            velocity += change * np.minimum(1.0, ACCELERATION_M_S2 * PHYSICS_S / size)[:, None]
            position_m += velocity * PHYSICS_S
            closest_m = min(closest_m, float(np.linalg.norm(position_m[0] - position_m[1])))
    return closest_m


@settings(derandomize=True, max_examples=25, deadline=None)
@given(angle, st.floats(-1.5, 1.5), st.floats(-0.6, 0.6), st.floats(-math.pi, math.pi))
def test_two_vehicles_head_on_from_any_direction_stay_apart(
    heading_rad: float, climb_rad: float, miss_m: float, aside_rad: float
) -> None:
    axis = unit(heading_rad, climb_rad)
    aside = miss_m * np.cross(axis, unit(aside_rad, 0.3))
    start = np.array([-4.0 * axis, 4.0 * axis + aside])
    goals = np.array([4.0 * axis, -4.0 * axis + aside])
    assert closest_approach_m(start, goals) >= CONTACT_M


def test_the_flight_above_would_end_in_contact_without_the_filter(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(globals(), "filtered", lambda _own, _peer, wanted: wanted)
    ends = np.array([[-4.0, 0.0, 0.0], [4.0, 0.0, 0.0]])
    assert closest_approach_m(ends, ends[::-1]) < 0.1


def test_a_wall_stops_a_vehicle_at_its_standoff() -> None:
    north_m, velocity, wall_m = 0.0, 1.0, 5.0
    furthest_m = 0.0
    for _ in range(200):
        limit = wall_limit(wall_m - north_m, 0.5, ACCELERATION_M_S2 / 2)
        setpoint = limit_velocity((1.0, 0.0, 0.0), [(1.0, 0.0, 0.0, limit)], 1.0, 1.0).x
        for _ in range(5):
            change = setpoint - velocity
            velocity += math.copysign(min(abs(change), 2.0 * PHYSICS_S), change)
            north_m += velocity * PHYSICS_S
            furthest_m = max(furthest_m, north_m)
    assert north_m == pytest.approx(4.5, abs=0.01)
    assert furthest_m < 4.55


def test_limits_towards_a_peer() -> None:
    assert peer_limit(2.0, 1.0, 1.0, 1.0) == 1.0  # 1 m/s at the paper's radius: R = Ds + v2/a
    assert peer_limit(1.04, 1.0, 1.0, 1.0) == pytest.approx(0.08)  # 2 e wins close by
    assert peer_limit(1.0, 1.0, 1.0, 1.0) == 0.0
    assert peer_limit(0.9, 1.0, 1.0, 1.0) == pytest.approx(-0.2)
    assert peer_limit(0.1, 1.0, 1.0, 1.0) == -1.0  # away, but not faster than it flies


@given(st.floats(1.01, 5.0), st.floats(0.05, 2.0))
def test_a_speed_towards_a_peer_flown_until_the_vehicle_obeys_is_the_limit_of_what_is_left(
    distance_m: float, response_s: float
) -> None:
    limit = peer_limit(distance_m, 1.0, 1.0, 1.0, response_s)
    left_m = distance_m - response_s * limit
    assert limit == pytest.approx(peer_limit(left_m, 1.0, 1.0, 1.0), abs=1e-6)


def test_limits_towards_a_wall() -> None:
    assert wall_limit(2.5, 0.5, 1.0) == pytest.approx(2.0)
    assert wall_limit(0.6, 0.5, 1.0) == pytest.approx(0.2)
    assert wall_limit(0.4, 0.5, 1.0) == pytest.approx(-0.2)
    assert wall_limit(0.0, 0.5, 1.0) == -0.5
    assert wall_limit(0.0, 0.5, 1.0, 0.3) == -0.3


def test_a_velocity_that_harms_nobody_is_left_alone() -> None:
    velocity = Vec3(0.3, -0.4, 0.2)
    assert limit_velocity(velocity, [(1.0, 0.0, 0.0, 0.5)], 1.0, 0.5) == velocity
    assert limit_velocity(velocity, [], 1.0, 0.5) == velocity


def test_a_vehicle_slides_along_what_is_ahead() -> None:
    north = (1.0, 0.0, 0.0, 0.0)
    assert limit_velocity((0.6, 0.3, 0.0), [north], 1.0, 0.5) == (0.0, 0.3, 0.0)


def test_the_speed_limits_preserve_the_direction() -> None:
    assert limit_velocity((3.0, 4.0, 1.0), [], 1.0, 0.5) == pytest.approx((0.6, 0.8, 0.2))
    assert limit_velocity((0.6, 0.0, -2.0), [], 1.0, 0.5) == pytest.approx((0.15, 0.0, -0.5))


def test_a_vehicle_that_is_wedged_in_stops() -> None:
    wedge = [half_space(unit(heading, 0.0), 0.0) for heading in (0.0, 2.1, -2.1)]
    assert limit_velocity((1.0, 0.5, 0.0), wedge, 1.0, 0.5) == pytest.approx((0, 0, 0), abs=0.06)


@settings(derandomize=True, max_examples=300)
@given(st.tuples(component, component, component), half_spaces)
def test_nothing_is_approached_faster_than_allowed(
    wanted: tuple[float, float, float], constraints: list[Constraint]
) -> None:
    velocity = limit_velocity(wanted, constraints, SPEED_M_S, 0.5)
    assert math.hypot(velocity.x, velocity.y) <= SPEED_M_S + 1e-9
    assert abs(velocity.z) <= 0.5 + 1e-9
    for constraint in constraints:
        allowed = max(constraint[3], 0.0) + TOLERANCE_M_S
        assert towards(velocity, constraint) <= allowed + 1e-9
