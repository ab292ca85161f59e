from __future__ import annotations

import itertools
import math
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest

from mock_vehicle.coverage import Coverage
from mock_vehicle.referee import Contacts
from mock_vehicle.world import World, load_world

UP = np.array([True])


def world(tmp_path: Path, coverage: str, extra: str = "") -> World:
    file = tmp_path / "world.yaml"
    file.write_text(
        dedent(
            f"""
            name: hall
            size_m: [20, 10]
            ceiling_m: 3
            starts: [{{position_m: [2, 5]}}]
            coverage: {{{coverage}}}
            """
        )
        + extra
    )
    return load_world(file)


def fly(ground: Coverage, *way_xy: tuple[float, float], speed_m_s: float = 2.0) -> None:
    """Fly along straight legs 1.5 m high, looked at 5 times a second."""
    now = 0.0
    for start, end in itertools.pairwise(way_xy):
        steps = math.ceil(math.dist(start, end) / (speed_m_s * 0.2))
        for part in np.linspace(0.0, 1.0, steps + 1):
            x, y = np.array(start) + part * (np.array(end) - np.array(start))
            ground.cover(np.array([[y, x, -1.5]]), UP, now)
            now += 0.2


@pytest.mark.parametrize("speed_m_s", [0.5, 8.0])
@pytest.mark.parametrize(("footprint", "end_caps_m2"), [("square", 1.0), ("disc", math.pi * 0.25)])
def test_a_straight_flight_covers_the_swept_area(
    tmp_path: Path, footprint: str, end_caps_m2: float, speed_m_s: float
) -> None:
    hall = world(tmp_path, f"footprint: {footprint}, radius_m: 0.5, cell_m: 0.05")
    ground = Coverage(hall, hall.starts(1, 1)[0])
    fly(ground, (3.0, 5.0), (13.0, 5.0), speed_m_s=speed_m_s)
    assert ground.fraction * 200.0 == pytest.approx(10.0 + end_caps_m2, rel=0.02)


def test_cells_remember_when_they_were_first_seen(tmp_path: Path) -> None:
    hall = world(tmp_path, "footprint: square, radius_m: 0.5, cell_m: 0.1")
    ground = Coverage(hall, hall.starts(1, 1)[0])
    fly(ground, (3.0, 5.0), (13.0, 5.0), (3.0, 5.0))
    seen_s = ground.seen_s[0]
    assert seen_s[50, 80] == pytest.approx(2.4, abs=0.3)  # 8 m east, half a metre early
    assert np.isnan(seen_s[80, 80])
    assert np.nanmax(seen_s) < 5.5


def test_ground_that_two_have_seen_is_counted_twice(tmp_path: Path) -> None:
    hall = world(tmp_path, "footprint: square, radius_m: 0.5, cell_m: 0.1")
    ground = Coverage(hall, hall.starts(1, 1)[0])
    east = np.linspace(2.0, 12.0, 21)
    track = np.full((21, 3, 3), (5.0, 9.5, -1.5))
    track[:, 0, 1], track[:, 1, 1] = east, np.minimum(east, 7.0)
    airborne = np.array([[True, True, False]] * 21)  # the third stands in the first one's way
    seers = ground.seers(track, airborne)
    assert seers.max() == 2
    assert (seers > 0).sum() * 0.01 == pytest.approx(11.0, abs=0.6)
    assert (seers > 1).sum() * 0.01 == pytest.approx(6.0, abs=0.6)
    assert ground.fraction == 0.0, "looking back changes nothing"


def test_who_stands_on_the_ground_covers_nothing(tmp_path: Path) -> None:
    hall = world(tmp_path, "radius_m: 1.0")
    ground = Coverage(hall, hall.starts(1, 1)[0])
    ground.cover(np.array([[5.0, 5.0, 0.0]]), np.array([False]), 1.0)
    assert ground.fraction == 0.0


# The wall is thinner than a cell: no cell's centre lies in it.
WALL = """
walls:
  - from_m: [10.02, 0]
    to_m: [10.02, 10]
    thickness_m: 0.04
    doors: [{at_m: 8, width_m: 1}]
"""
ASLANT = "boxes: [{center_m: [10, 5], size_m: [0.04, 11.4], yaw_deg: 30}]\n"


@pytest.mark.parametrize("speed_m_s", [0.5, 8.0])
def test_nothing_is_seen_through_a_wall(tmp_path: Path, speed_m_s: float) -> None:
    sight = "footprint: disc, radius_m: 3.0, cell_m: 0.25, line_of_sight: true"
    hall = world(tmp_path, sight, WALL)
    ground = Coverage(hall, hall.starts(1, 1)[0])
    fly(ground, (9.0, 1.0), (9.0, 4.0), speed_m_s=speed_m_s)
    seen = ~np.isnan(ground.seen_s[0])
    assert seen[:, :40].sum() > 300
    assert not seen[:, 41:].any()
    fly(ground, (9.0, 4.0), (9.0, 8.0))
    assert not np.isnan(ground.seen_s[0, 31:33, 44]).any()  # through the door


def test_nothing_is_seen_through_a_slanted_wall(tmp_path: Path) -> None:
    sight = "footprint: disc, radius_m: 3.0, cell_m: 0.25, line_of_sight: true"
    hall = world(tmp_path, sight, ASLANT)
    ground = Coverage(hall, hall.starts(1, 1)[0])
    fly(ground, (9.0, 5.0), (11.0, 1.5))
    north, east = np.nonzero(~np.isnan(ground.seen_s[0]))
    x, y = (east + 0.5) * 0.25 - 10.0, (north + 0.5) * 0.25 - 5.0
    across = x * math.cos(math.radians(30)) + y * math.sin(math.radians(30))
    assert len(across) > 200
    assert across.max() < 0.0


def test_without_line_of_sight_walls_hide_nothing(tmp_path: Path) -> None:
    through = "footprint: disc, radius_m: 3.0, cell_m: 0.25, line_of_sight: false"
    hall = world(tmp_path, through, WALL)
    ground = Coverage(hall, hall.starts(1, 1)[0])
    fly(ground, (9.0, 1.0), (9.0, 4.0))
    assert not np.isnan(ground.seen_s[0, 8, 42])


def test_a_sphere_covers_its_volume(tmp_path: Path) -> None:
    hall = world(tmp_path, "footprint: sphere, radius_m: 1.0, cell_m: 0.1")
    ground = Coverage(hall, hall.starts(1, 1)[0])
    ground.cover(np.array([[5.0, 10.0, -1.5]]), UP, 1.0)
    assert ground.fraction * 600.0 == pytest.approx(4.0 / 3.0 * math.pi, rel=0.03)
    assert ground.free.shape == (30, 100, 200)
    level, _, _ = np.nonzero(~np.isnan(ground.seen_s))
    assert (level.min(), level.max()) == (5, 24)


@pytest.mark.parametrize("radius_m", [0.3, 0.62, 1.0])
@pytest.mark.parametrize("footprint", ["square", "disc", "sphere"])
def test_all_cells_within_the_footprint_are_seen(
    tmp_path: Path, footprint: str, radius_m: float
) -> None:
    sight = f"footprint: {footprint}, radius_m: {radius_m}, cell_m: 0.25"
    hall = world(tmp_path, f"{sight}, line_of_sight: false")
    level, north, east = (np.indices((12, 40, 80)) + 0.5) * 0.25
    rng = np.random.default_rng(1)
    corner = np.array([1.25, 5.0, 10.0])
    for down, y, x in (corner, corner + 0.125, *rng.uniform((1, 2, 2), (2, 8, 18), (20, 3))):
        ground = Coverage(hall, hall.starts(1, 1)[0])
        ground.cover(np.array([[y, x, -down]]), UP, 1.0)
        aside, above = np.array([north - y, east - x]), level - down
        away = np.abs(aside).max(axis=0)
        if footprint != "square":
            away = np.sqrt(np.square(aside).sum(axis=0) + (footprint == "sphere") * above**2)
        seen = ~np.isnan(ground.seen_s)
        expected = (away <= radius_m + 1e-9)[: len(seen)]
        assert (seen == expected).all()


@pytest.mark.parametrize("footprint", ["square", "disc", "sphere"])
def test_a_footprint_may_be_smaller_than_a_cell(tmp_path: Path, footprint: str) -> None:
    hall = world(tmp_path, f"footprint: {footprint}, radius_m: 0.1, cell_m: 0.25")
    ground = Coverage(hall, hall.starts(1, 1)[0])
    ground.cover(np.array([[5.125, 10.125, -1.125]]), UP, 1.0)
    (seen,) = np.argwhere(~np.isnan(ground.seen_s)).tolist()
    assert seen[-2:] == [20, 40]


def test_a_ceiling_between_hides_what_is_above(tmp_path: Path) -> None:
    shelf = "boxes: [{center_m: [10, 5], size_m: [6, 6], height_m: 1.2}]\n"
    sight = "footprint: sphere, radius_m: 1.5, cell_m: 0.25, line_of_sight: true"
    hall = world(tmp_path, sight, shelf)
    ground = Coverage(hall, hall.starts(1, 1)[0])
    ground.cover(np.array([[5.0, 10.0, -2.0]]), UP, 1.0)
    seen = ~np.isnan(ground.seen_s)
    assert seen[6:12, 20, 40].all()
    assert not seen[:5, 15:25, 35:45].any()


def test_a_vehicle_outside_the_world_covers_nothing(tmp_path: Path) -> None:
    hall = world(tmp_path, "radius_m: 1.0")
    ground = Coverage(hall, hall.starts(1, 1)[0])
    ground.cover(np.array([[-50.0, 400.0, -1.5]]), UP, 1.0)
    assert ground.fraction == 0.0


def test_a_contact_counts_once_until_they_part() -> None:
    contacts = Contacts(1)

    def gap(metres: float, *, may_begin: bool = True) -> int:
        contacts.observe(np.array([metres]), 0.3, np.array([may_begin]))
        return contacts.count

    assert gap(1.0) == 0
    assert gap(0.29, may_begin=False) == 0
    assert gap(0.29) == 1
    assert gap(0.31) == 1
    assert gap(0.28) == 1
    assert gap(0.5) == 1
    assert gap(0.2) == 2
