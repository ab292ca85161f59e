from __future__ import annotations

import math
from pathlib import Path
from textwrap import dedent
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mock_vehicle.sensors.battery import HOVER_W, Batteries
from mock_vehicle.sensors.infrared import Infrared
from mock_vehicle.sensors.rangefinder import RING, Rangefinders, Ranges
from mock_vehicle.world import World, load_world

FRONT, BACK, LEFT, RIGHT, UP, DOWN = range(6)
NORTH, EAST = 0.0, math.pi / 2
NOBODY = (np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp))

WORLD = """
name: room
size_m: [20, 10]
ceiling_m: 4
walls: [{from_m: [10, 0], to_m: [10, 6], thickness_m: 0.1}]
victims:
  - {name: near, position_m: [5, 8, 0.5]}
  - {name: behind, position_m: [11, 3, 0.5]}
starts: [{position_m: [5, 5]}]
infrared: {range_m: 3.0}
"""


@pytest.fixture
def room(tmp_path: Path) -> World:
    file = tmp_path / "room.yaml"
    file.write_text(dedent(WORLD))
    return load_world(file)


def look(
    world: World,
    *positions: tuple[float, float, float],
    yaw: float = NORTH,
    noise_m: float = 0.0,
    near: tuple[Any, Any] = NOBODY,
    range_max_m: float = 20.0,
) -> NDArray[np.float64]:
    return look_around(
        world, *positions, yaw=yaw, noise_m=noise_m, near=near, range_max_m=range_max_m
    ).sensors_m


def look_around(
    world: World,
    *positions: tuple[float, float, float],
    yaw: float = NORTH,
    noise_m: float = 0.0,
    near: tuple[Any, Any] = NOBODY,
    range_max_m: float = 20.0,
) -> Ranges:
    eyes = Rangefinders(range_max_m=range_max_m, noise_m=noise_m, rng=np.random.default_rng(1))
    at = np.array(positions)
    return eyes.measure(world, at, np.full(len(at), yaw), near)


def test_ranges_come_front_back_left_right_up_down(room: World) -> None:
    # 5 m east, 4 m north, 1 m high: walls north 6, south 4, west 5; the inner wall 4.95 east.
    ranges = look(room, (4.0, 5.0, -1.0))[0]
    assert ranges == pytest.approx([6.0, 4.0, 5.0, 4.95, 3.0, 1.0], abs=1e-6)


def test_ranges_turn_with_the_nose(room: World) -> None:
    ranges = look(room, (4.0, 5.0, -1.0), yaw=EAST)[0]
    assert ranges == pytest.approx([4.95, 5.0, 6.0, 4.0, 3.0, 1.0], abs=1e-6)


def test_a_cone_sees_beside_its_axis(room: World) -> None:
    # Facing east past the end of the inner wall (6 m north): the ray 40 deg to the right hits it.
    ranges = look(room, (7.5, 8.0, -1.0), yaw=EAST)[0]
    assert ranges[FRONT] == pytest.approx(1.95 / math.cos(math.radians(40)), abs=1e-6)
    beside = look(room, (8.2, 8.0, -1.0), yaw=EAST)[0]  # here the north wall is what it sees
    assert beside[FRONT] == pytest.approx(1.8 / math.sin(math.radians(45)), abs=1e-6)


def test_what_stands_between_two_cones_is_seen_by_both(room: World) -> None:
    # 45 deg between front (north) and left (west): the corner 6 m north and 6 m west of (4, 6).
    ranges = look(room, (4.0, 6.0, -1.0), yaw=math.radians(15))[0]
    assert ranges[FRONT] < math.inf
    assert ranges[LEFT] < math.inf


def test_nothing_in_range_is_inf_and_contact_is_the_least_range(room: World) -> None:
    ranges = look(room, (4.0, 5.0, 0.0), range_max_m=4.5)[0]
    assert ranges[FRONT] == math.inf
    assert ranges[DOWN] == pytest.approx(0.1)


def test_noise_is_repeatable_and_of_the_size_asked_for(room: World) -> None:
    at = [(4.0, 5.0, -1.0)] * 2000
    ranges = look(room, *at, noise_m=0.05)
    assert np.array_equal(ranges, look(room, *at, noise_m=0.05))
    assert ranges.std(axis=0) == pytest.approx([0.05] * 6, rel=0.1)


def test_peers_are_obstacles(room: World) -> None:
    pair = (np.array([0, 1]), np.array([1, 0]))
    ranges = look(room, (4.0, 5.0, -1.0), (6.0, 5.0, -1.0), near=pair)
    assert ranges[0, FRONT] == pytest.approx(1.7)
    assert ranges[1, BACK] == pytest.approx(1.7)
    assert ranges[0, BACK] == pytest.approx(4.0)
    # Level beams pass over a peer that stands 0.5 m lower.
    assert look(room, (4.0, 5.0, -1.0), (6.0, 5.0, -0.5), near=pair)[0, FRONT] > 5.0


def test_peers_straight_above_and_below_are_seen_too(room: World) -> None:
    pair = (np.array([0, 1]), np.array([1, 0]))
    ranges = look(room, (4.0, 5.0, -1.0), (4.0, 5.1, -2.5), near=pair)
    reach = 1.5 - math.sqrt(0.3**2 - 0.1**2)
    assert ranges[0, UP] == pytest.approx(reach)
    assert ranges[1, DOWN] == pytest.approx(reach)
    assert ranges[0, DOWN] == pytest.approx(1.0)
    assert ranges[1, UP] == pytest.approx(1.5)


def test_the_ring_holds_every_level_ray_clockwise_from_the_nose(room: World) -> None:
    seen = look_around(room, (4.0, 5.0, -1.0), yaw=EAST)
    assert seen.ring_m.shape == (1, RING)
    right, back, left = (seen.ring_m[0, quarter * RING // 4] for quarter in (1, 2, 3))
    assert [seen.ring_m[0, 0], right, back, left] == pytest.approx([4.95, 4.0, 5.0, 6.0])
    assert seen.ring_m[0, 1] == pytest.approx(4.95 / math.cos(math.radians(5)))
    np.testing.assert_array_equal(seen.sensors_m[0, :4].min(), seen.ring_m.min())


def test_a_victim_is_reported_in_the_body_frame(room: World) -> None:
    camera, at = Infrared(room), np.array([[7.0, 5.0, -1.5]])
    flat = np.zeros(1)
    sightings = camera.see(at, np.array([True]))
    (fix,) = camera.fixes(sightings, at, (flat, flat, np.array([EAST])))[0]
    # One metre north of a nose that points east is one metre to the left.
    assert fix == pytest.approx((0, 0.0, -1.0, 1.0))


def test_a_victim_needs_range_and_line_of_sight(room: World) -> None:
    camera, up = Infrared(room), np.array([True])
    assert len(camera.see(np.array([[4.0, 5.0, -1.0]]), up)[0]) == 0  # too far
    assert len(camera.see(np.array([[3.0, 9.0, -0.5]]), up)[0]) == 0  # 2 m away, behind the wall
    assert camera.see(np.array([[3.0, 12.5, -0.5]]), up)[1].tolist() == [1]


def test_a_vehicle_on_the_ground_sees_no_victim(room: World) -> None:
    assert len(Infrared(room).see(np.array([[7.0, 5.0, 0.0]]), np.array([False]))[0]) == 0


def hover(batteries: Batteries, minutes: float, speed_m_s: float = 0.0) -> None:
    n = len(batteries.fraction)
    yes = np.ones(n, dtype=bool)
    velocity = np.tile([speed_m_s, 0.0, 0.0], (n, 1))
    for _ in range(round(minutes * 600)):
        batteries.step(0.1, velocity, airborne=yes, powered=yes, spinning=yes)


def test_a_battery_hovers_for_about_25_minutes() -> None:
    assert pytest.approx(178, abs=1) == HOVER_W
    batteries = Batteries(1)
    hover(batteries, 20)
    assert 0.1 < batteries.fraction[0] < 0.3
    assert 13.5 < batteries.voltage_v[0] < 15.0
    hover(batteries, 6)
    assert batteries.fraction[0] == 0.0
    assert batteries.current_a[0] == 0.0


def test_speed_costs_energy() -> None:
    slow, fast = Batteries(1), Batteries(1)
    hover(slow, 1)
    hover(fast, 1, speed_m_s=10.0)
    assert slow.energy_j[0] == pytest.approx((HOVER_W + 6) * 60, rel=1e-6)
    assert fast.energy_j[0] > 1.2 * slow.energy_j[0]


def test_a_battery_only_discharges() -> None:
    batteries = Batteries(2)
    batteries.discharge_to(0, 0.1)
    batteries.discharge_to(0, 0.5)
    assert batteries.fraction.tolist() == [0.1, 1.0]
