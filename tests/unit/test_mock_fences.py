from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mock_client import (
    ACCEPTED,
    AP_BRAKE,
    AP_GUIDED,
    AP_LAND,
    AP_RTL,
    DENIED,
    FAILED,
    NAN,
    PX4_LAND,
    PX4_LOITER,
    PX4_OFFBOARD,
    PX4_RTL,
    REJECTED,
    Client,
    airborne,
    both,
)
from mock_planner import FENCE, GLOBAL, OK, RALLY, REL_INT, Item, Planner, waypoint

from mock_vehicle.autopilot.fences import Circle, Polygon, Zones
from mock_vehicle.vehicle import Personality

INCLUSION, EXCLUSION, CIRCLE_INCLUSION, CIRCLE_EXCLUSION, RALLY_POINT = 5001, 5002, 5003, 5004, 5100
SQUARE = ((-8.0, -8.0), (8.0, -8.0), (8.0, 8.0), (-8.0, 8.0))
FENCE_BIT = 0x100000


def corner(client: Client, command: int, north_m: float, east_m: float, p1: float) -> Item:
    there = client.vehicle.autopilot.origin.to_global(north_m, east_m, 0.0)
    x, y = round(there.latitude_deg * 1e7), round(there.longitude_deg * 1e7)
    frame = REL_INT if command == RALLY_POINT else GLOBAL
    return waypoint(frame=frame, command=command, x=x, y=y, z=0.0, p=(p1, 0.0, 0.0, 0.0))


def fenced(personality: Personality, *zones: tuple[int, float, Any]) -> Planner:
    """A ground station whose vehicle keeps zones: (command, param1, places)."""
    planner = Planner(personality)
    client = planner.client
    items = [corner(client, command, n, e, p1) for command, p1, area in zones for n, e in area]
    assert planner.upload(items, FENCE)[-1] == ("ACK", OK)
    if personality == "ardupilot":
        client.vehicle.autopilot.set_parameter("FENCE_ENABLE", 1.0)
    return planner


def fly_out(planner: Planner, seconds: float = 8.0, **velocity: float) -> None:
    """Take off, and fly on by setpoints until the mode is taken away."""
    client = planner.client
    client.take_off(5.0)
    client.go_offboard()
    chosen = client.vehicle.mode
    client.fly_until(lambda: client.vehicle.mode != chosen, seconds, **velocity)


def local(client: Client) -> list[float]:
    s = client.vehicle.autopilot.state
    return [s.north_m, s.east_m, -s.down_m]


# Geometry.


@given(st.floats(-20, 20), st.floats(-20, 20), st.integers(0, 3), st.booleans())
def test_a_square_contains_what_is_between_its_sides(
    north: float, east: float, start: int, mirrored: bool
) -> None:
    corners = [*SQUARE[start:], *SQUARE[:start]]
    polygon = Polygon(corners[::-1] if mirrored else corners)
    if abs(abs(north) - 8.0) > 1e-6 and abs(abs(east) - 8.0) > 1e-6:
        assert polygon.contains(north, east) == (abs(north) < 8.0 and abs(east) < 8.0)


def test_a_polygon_may_be_hollow_on_one_side() -> None:
    arrow = Polygon([(0.0, 0.0), (10.0, 5.0), (0.0, 10.0), (4.0, 5.0)])
    assert arrow.contains(6.0, 5.0)
    assert not arrow.contains(2.0, 5.0)


def test_zones_join_or_cut_each_other() -> None:
    zones = Zones([Circle((0.0, 0.0), 5.0), Circle((6.0, 0.0), 5.0)])
    assert zones.allow(-3.0, 0.0, any_will_do=True)
    assert not zones.allow(-3.0, 0.0, any_will_do=False)
    assert zones.allow(3.0, 0.0, any_will_do=False)
    assert not Zones(exclusions=[Circle((0.0, 0.0), 1.0)]).allow(0.0, 0.0, any_will_do=True)
    assert Zones().allow(1e9, NAN, any_will_do=False)
    assert not Zones([Polygon(SQUARE)]).allow(NAN, NAN, any_will_do=False)


# Breaches.


ZONES = [
    ((INCLUSION, 4.0, SQUARE),),
    ((CIRCLE_INCLUSION, 8.0, [(0.0, 0.0)]),),
    ((EXCLUSION, 4.0, [(8.0, -8.0), (8.0, 8.0), (30.0, 8.0), (30.0, -8.0)]),),
    ((CIRCLE_EXCLUSION, 12.0, [(20.0, 0.0)]),),
]


@pytest.mark.parametrize("zones", ZONES)
@both
def test_who_leaves_its_zone_is_stopped(personality: Personality, zones: Any) -> None:
    planner = fenced(personality, *zones)
    fly_out(planner, vx=2.0)
    client = planner.client
    assert client.vehicle.mode == (PX4_LOITER if personality == "px4" else AP_RTL)
    assert local(client)[0] == pytest.approx(8.0, abs=1.0)
    client.fly(20.0 if personality == "ardupilot" else 5.0, vx=2.0)
    assert local(client)[0] < 10.0


@pytest.mark.parametrize(
    ("action", "mode"), [(1, AP_RTL), (2, AP_LAND), (3, 21), (4, AP_BRAKE), (0, None)]
)
def test_ardupilot_acts_as_fence_action_says(action: int, mode: int | None) -> None:
    planner = fenced("ardupilot", (CIRCLE_INCLUSION, 5.0, [(0.0, 0.0)]))
    planner.client.vehicle.autopilot.set_parameter("FENCE_ACTION", float(action))
    planner.client.take_off()
    planner.client.fly(6.0, vx=2.0)
    assert planner.client.vehicle.mode == (AP_GUIDED if mode is None else mode)
    assert planner.client.texts[-1] == "Polygon fence breached"


@pytest.mark.parametrize(
    ("action", "mode"), [(2, PX4_LOITER), (3, PX4_RTL), (5, PX4_LAND), (1, None), (0, None)]
)
def test_px4_acts_as_gf_action_says(action: int, mode: int | None) -> None:
    planner = fenced("px4", (CIRCLE_INCLUSION, 5.0, [(0.0, 0.0)]))
    planner.client.vehicle.autopilot.set_parameter("GF_ACTION", float(action))
    planner.client.take_off()
    planner.client.go_offboard()
    planner.client.gcs_heartbeat()
    planner.client.before_tick = planner.client.gcs_heartbeat
    planner.client.fly(12.0, vx=1.0)
    assert planner.client.vehicle.mode == (PX4_OFFBOARD if mode is None else mode)
    assert ("Geofence violation\t" in planner.client.texts) == (action != 0)


def test_the_pilot_flies_on_after_a_breach() -> None:
    planner = fenced("ardupilot", (CIRCLE_INCLUSION, 5.0, [(0.0, 0.0)]))
    fly_out(planner, vx=2.0)
    assert planner.client.set_mode(AP_GUIDED) == [(176, ACCEPTED)]
    planner.client.fly(4.0, vx=2.0)
    assert planner.client.vehicle.mode == AP_GUIDED


@both
def test_height_and_distance_are_limited_by_parameters(personality: Personality) -> None:
    top, radius = {
        "px4": ("GF_MAX_VER_DIST", "GF_MAX_HOR_DIST"),
        "ardupilot": ("FENCE_ALT_MAX", "FENCE_RADIUS"),
    }[personality]
    for name, velocity in ((top, {"vz": -1.0}), (radius, {"vx": 2.0})):
        planner = fenced(personality)
        planner.client.vehicle.autopilot.set_parameter(name, 10.0)
        fly_out(planner, 15.0, **velocity)
        north, _, height = local(planner.client)
        assert max(north, height) == pytest.approx(10.0, abs=1.0)


@both
def test_nobody_arms_outside_a_fence(personality: Personality) -> None:
    planner = fenced(personality, (CIRCLE_INCLUSION, 5.0, [(30.0, 0.0)]))
    planner.client.fly(1.5)
    planner.client.gcs_heartbeat()
    if personality == "px4":
        assert planner.client.command(400, 1) == [(400, REJECTED)]
    else:
        assert planner.client.command(400, 1) == [(400, FAILED)]
        assert planner.client.texts[-1] == "Arm: Vehicle breaching Polygon fence"
        assert planner.client.command(207, 0) == [(207, ACCEPTED)]
        assert planner.client.command(400, 1) == [(400, ACCEPTED)]


def test_ardupilot_tells_of_its_fence() -> None:
    client = airborne("ardupilot")
    client.command(511, 162, 100_000)
    client.command(511, 1, 100_000)
    client.fly(1.0)
    assert not client.times("FENCE_STATUS")
    assert not client.last("SYS_STATUS").onboard_control_sensors_enabled & FENCE_BIT
    client.vehicle.autopilot.set_parameter("FENCE_RADIUS", 6.0)
    assert client.command(207, 1) == [(207, ACCEPTED)]
    client.fly(0.5)
    status = client.last("FENCE_STATUS")
    assert (status.breach_status, status.breach_count) == (0, 0)
    assert client.last("SYS_STATUS").onboard_control_sensors_health & FENCE_BIT
    client.fly(6.0, vx=2.0)
    breached = next(
        m for _, m in client.heard if m.get_type() == "FENCE_STATUS" and m.breach_status
    )
    assert (breached.breach_count, breached.breach_type) == (1, 3)
    assert "Circle fence breached" in client.texts
    assert client.command(207, 5) == [(207, FAILED)]


@both
def test_half_a_polygon_is_no_fence(personality: Personality) -> None:
    planner = fenced(personality, (INCLUSION, 4.0, SQUARE[:2]), (EXCLUSION, 9.0, [(0.0, 0.0)]))
    planner.client.take_off()
    planner.client.fly(6.0)
    assert planner.client.height_m == pytest.approx(5.0, abs=0.5)


# Rally points.


@both
def test_it_returns_to_a_rally_point_that_is_nearer_than_home(personality: Personality) -> None:
    planner = Planner(personality)
    client = planner.client
    client.take_off()
    client.go_offboard()
    client.fly(12.0, vx=3.0)
    distance_m = local(client)[0]
    points = [(distance_m - 8.0, 4.0), (500.0, 0.0)]
    items = [corner(client, RALLY_POINT, n, e, 0.0) for n, e in points]
    assert planner.upload(items, RALLY)[-1] == ("ACK", OK)
    client.set_mode(PX4_RTL if personality == "px4" else AP_RTL)
    client.fly_until(lambda: not client.vehicle.armed, 200.0)
    assert math.dist(local(client)[:2], points[0]) < 1.5


def test_px4_does_not_fly_a_mission_that_leaves_its_fence() -> None:
    planner = Planner("px4")
    client = planner.client
    client.fly(1.5)
    planner.upload([corner(client, 22, 0.0, 0.0, 0.0), corner(client, 16, 20.0, 0.0, 0.0)])
    items = [corner(client, INCLUSION, n, e, 4.0) for n, e in SQUARE]
    planner.upload(items, FENCE)
    client.command(512, 42)
    assert client.last("MISSION_CURRENT").mission_state == 1
    assert client.command(300) == [(300, DENIED)]
    planner.upload([], FENCE)
    client.command(512, 42)
    assert client.last("MISSION_CURRENT").mission_state == 2
    assert client.command(300) == [(300, ACCEPTED)]
