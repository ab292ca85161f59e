import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.agent.geofence import Guard, Motion
from swarm_ctl.agent.params import FlightParams, Limits
from swarm_ctl.agent.peer import Neighbour
from swarm_ctl.model import ZERO, Vec3

LIMITS = Limits(radius_m=10.0, floor_m=0.5, ceiling_m=4.0)
GUARD = Guard(LIMITS, FlightParams(speed_m_s=2.0, climb_m_s=1.0))
CLEAR = [math.inf] * 6
SPEED = st.floats(-5.0, 5.0)


def at_rest(yaw_rad: float = 0.0) -> Motion:
    return Motion(Vec3(0, 0, -2), ZERO, yaw_rad)


def test_a_velocity_that_breaks_nothing_is_left_alone() -> None:
    wanted = Vec3(1.0, 0.5, -0.2)
    assert GUARD.confine(wanted, at_rest(), CLEAR, []) == pytest.approx(wanted)


def test_the_wall_ahead_of_a_vehicle_that_faces_east_stops_flight_to_the_east() -> None:
    ranges = [0.5, *CLEAR[1:]]
    safe = GUARD.confine(Vec3(0.3, 1.0, 0.0), at_rest(math.pi / 2), ranges, [])
    assert safe.y == pytest.approx(0.0, abs=1e-6)
    assert safe.x == pytest.approx(0.3)


def test_a_wall_on_the_left_stops_flight_to_the_left_only() -> None:
    ranges = [math.inf, math.inf, 0.5, math.inf, math.inf, math.inf]
    assert GUARD.confine(Vec3(0, -1, 0), at_rest(), ranges, []).y >= -1e-6
    assert GUARD.confine(Vec3(0, 1, 0), at_rest(), ranges, []).y > 0.9


def test_who_is_very_near_a_wall_comes_off_it_though_its_wide_beams_see_it_on_both_sides() -> None:
    ranges = [0.47, 0.42, 0.31, 3.8, math.inf, math.inf]  # one wall, on the left
    safe = GUARD.confine(ZERO, at_rest(), ranges, [])
    assert safe.y == pytest.approx(0.38, abs=0.01)
    assert safe.x == pytest.approx(0.0, abs=0.01)


def test_a_wall_pushes_no_farther_than_there_is_room_behind() -> None:
    ranges = [0.3, 0.6, *CLEAR[2:]]
    assert GUARD.confine(ZERO, at_rest(), ranges, []).x == pytest.approx(-0.2, abs=0.01)


def test_a_vehicle_in_motion_brakes_earlier_than_one_at_rest() -> None:
    ranges, ahead = [1.2, *CLEAR[1:]], Vec3(1, 0, 0)
    moving = Motion(Vec3(0, 0, -2), Vec3(1, 0, 0), 0.0)
    at_rest_m_s = GUARD.confine(ahead, at_rest(), ranges, []).x
    assert GUARD.confine(ahead, moving, ranges, []).x < at_rest_m_s - 0.2


def test_behind_a_slow_link_a_vehicle_brakes_earlier() -> None:
    ranges, ahead = [1.6, *CLEAR[1:]], Vec3(1, 0, 0)
    moving = Motion(Vec3(0, 0, -2), Vec3(1, 0, 0), 0.0)
    usual_m_s = GUARD.confine(ahead, moving, ranges, []).x
    behind_m_s = GUARD.confine(ahead, moving._replace(late_s=0.4), ranges, []).x
    assert behind_m_s < usual_m_s - 0.2
    peer = Neighbour(Vec3(2.2, 0, 0), ZERO)
    usual_m_s = GUARD.confine(ahead, moving, CLEAR, [peer]).x
    assert GUARD.confine(ahead, moving._replace(late_s=0.4), CLEAR, [peer]).x < usual_m_s - 0.2


def test_two_that_turn_towards_each_other_at_once_stay_apart_though_they_obey_late() -> None:
    guard = Guard(Limits(separation_m=1.3), FlightParams(speed_m_s=1.2))
    apart_m, speed_m_s, obeyed = 1.9, 0.0, [0.0] * 5
    for _ in range(40):  # each sees the same of the other; 0.5 s late, at 2 m/s2
        peer = Neighbour(Vec3(apart_m, 0, 0), Vec3(-speed_m_s, 0, 0))
        moving = Motion(Vec3(0, 0, -2), Vec3(speed_m_s, 0, 0), 0.0)
        obeyed.append(guard.confine(Vec3(1.2, 0, 0), moving, CLEAR, [peer]).x)
        speed_m_s += max(-0.2, min(0.2, obeyed.pop(0) - speed_m_s))
        apart_m -= 2.0 * 0.1 * speed_m_s
        assert apart_m > 1.1


def test_a_peer_too_close_pushes_away() -> None:
    peer = Neighbour(Vec3(0.7, 0, 0), ZERO)
    assert GUARD.confine(Vec3(0, 0, 0), at_rest(), CLEAR, [peer]).x < -0.3
    nearly = Neighbour(Vec3(0.95, 0, 0), ZERO)
    assert GUARD.confine(Vec3(0, 0, 0), at_rest(), CLEAR, [nearly]).x == pytest.approx(-0.1)


def test_between_a_wall_and_a_peer_a_vehicle_comes_off_the_wall_unless_the_peer_is_too_near() -> (
    None
):
    ranges = [0.35, *CLEAR[1:]]  # ahead; a vehicle that stood still would be blown there
    behind = Neighbour(Vec3(-1.0, 0, 0), ZERO)
    assert GUARD.confine(ZERO, at_rest(), ranges, [behind]).x == pytest.approx(-0.15, abs=0.02)
    nearer = Neighbour(Vec3(-0.8, 0, 0), ZERO)
    assert GUARD.confine(ZERO, at_rest(), ranges, [nearer]).x == pytest.approx(0.0, abs=0.01)
    assert GUARD.confine(ZERO, at_rest(), CLEAR, [nearer]).x > 0.2, "without a wall it gives way"
    in_doubt = Neighbour(Vec3(-1.4, 0, 0), ZERO, 1.0)
    assert GUARD.confine(ZERO, at_rest(), ranges, [in_doubt]).x < -0.1
    assert GUARD.confine(ZERO, at_rest(), CLEAR, [in_doubt]).x > 0.2


def test_beside_a_wall_that_is_about_to_be_touched_a_vehicle_flies_on_slowly() -> None:
    nearly, beside = [0.45, *CLEAR[1:]], [0.35, *CLEAR[1:]]
    along = Vec3(0.0, 1.0, 0.0)
    assert GUARD.confine(along, at_rest(), nearly, []).y == pytest.approx(1.0)
    assert GUARD.confine(along, at_rest(), beside, []).y == pytest.approx(0.3)
    near_the_ground = [*CLEAR[:5], 0.3]
    assert GUARD.confine(along, at_rest(), near_the_ground, []).y > 0.9, "it flies off it freely"


def test_a_pillar_between_two_beams_is_braked_for_and_does_not_push() -> None:
    between = [1.2, math.inf, math.inf, 1.2, math.inf, math.inf]  # ahead on the right
    half = math.sqrt(0.5)
    moving = Motion(Vec3(0, 0, -2), Vec3(half, half, 0.0), 0.0)
    safe = GUARD.confine(Vec3(half, half, 0.0), moving, between, [])
    assert half * (safe.x + safe.y) == pytest.approx(0.44, abs=0.02), "0.78 along the two beams"
    assert GUARD.confine(ZERO, at_rest(), [0.5, *CLEAR[1:3], 0.5, *CLEAR[4:]], []) == ZERO


def test_two_that_meet_head_on_pass_each_other_on_the_right() -> None:
    north, south = Vec3(1, 0, 0), Vec3(-1, 0, 0)
    ahead, behind = Neighbour(Vec3(1.0, 0, 0), ZERO), Neighbour(Vec3(-1.0, 0, 0), ZERO)
    assert GUARD.confine(north, at_rest(), CLEAR, [ahead]).y > 0.3  # north-bound: east is right
    assert GUARD.confine(south, at_rest(), CLEAR, [behind]).y < -0.3
    assert GUARD.confine(north, at_rest(), CLEAR, [behind]).y == pytest.approx(0.0, abs=1e-6)


def test_in_a_level_mission_peers_push_sideways_only() -> None:
    level = Guard(LIMITS, FlightParams(speed_m_s=2.0, climb_m_s=1.0), is_level=True)
    aslant = Neighbour(Vec3(0.7, 0, 0.3), ZERO)
    assert level.confine(ZERO, at_rest(), CLEAR, [aslant]).z == 0.0
    assert level.confine(ZERO, at_rest(), CLEAR, [aslant]).x < -0.3
    far_below = Neighbour(Vec3(0.1, 0, 1.5), ZERO)
    assert level.confine(Vec3(1, 0, 0), at_rest(), CLEAR, [far_below]).x == pytest.approx(1.0)


def test_a_peer_that_comes_closer_stops_a_vehicle_sooner() -> None:
    ahead, offset = Vec3(1, 0, 0), Vec3(1.8, 0, 0)
    still = GUARD.confine(ahead, at_rest(), CLEAR, [Neighbour(offset, ZERO)])
    coming = GUARD.confine(ahead, at_rest(), CLEAR, [Neighbour(offset, Vec3(-1, 0, 0))])
    assert coming.x < still.x - 0.1


@settings(derandomize=True, max_examples=60, deadline=None)
@given(st.lists(st.tuples(SPEED, SPEED, SPEED), min_size=5, max_size=20))
def test_no_setpoint_leads_out_of_the_fence(wanted: list[tuple[float, float, float]]) -> None:
    place, flown = Vec3(0.0, 0.0, -2.0), ZERO
    for velocity in wanted:
        for _ in range(50):  # five seconds each, a vehicle that follows with a lag of 0.3 s
            safe = GUARD.confine(Vec3(*velocity), Motion(place, flown, 0.0), CLEAR, [])
            assert math.hypot(safe.x, safe.y) <= 2.0 + 1e-6
            assert abs(safe.z) <= 1.0 + 1e-6
            flown = Vec3(*(v + (s - v) * 0.1 / 0.3 for v, s in zip(flown, safe, strict=True)))
            place = Vec3(*(p + 0.1 * v for p, v in zip(place, flown, strict=True)))
            assert math.hypot(place.x, place.y) <= LIMITS.radius_m + 0.1
            assert LIMITS.floor_m - 0.1 <= -place.z <= LIMITS.ceiling_m + 0.1


@pytest.mark.parametrize("distance_m", [0.8, 1.2, 1.6])
def test_a_doubtful_peer_is_kept_as_far_off_as_one_that_is_so_much_nearer(
    distance_m: float,
) -> None:
    wanted = Vec3(1.0, 0.9, 0.0)
    doubtful = Neighbour(Vec3(0.0, distance_m, 0.0), ZERO, 0.3)
    nearer = Neighbour(Vec3(0.0, distance_m - 0.3, 0.0), ZERO)
    kept = GUARD.confine(wanted, at_rest(), CLEAR, [doubtful])
    assert kept == pytest.approx(GUARD.confine(wanted, at_rest(), CLEAR, [nearer]))
    assert kept.y < GUARD.confine(wanted, at_rest(), CLEAR, [doubtful._replace(doubt_m=0.0)]).y


def test_on_one_level_a_peer_on_the_ground_is_flown_over_and_one_that_takes_off_is_not() -> None:
    guard = Guard(LIMITS, FlightParams(), is_level=True)
    below, ahead = Vec3(0.6, 0.0, 1.4), Vec3(1.0, 0.0, 0.0)
    stands, rises = Neighbour(below, ZERO), Neighbour(below, Vec3(0.0, 0.0, -0.8))
    assert guard.confine(ahead, at_rest(), CLEAR, [stands]).x > 0.9
    assert guard.confine(ahead, at_rest(), CLEAR, [rises]).x < 0.1
