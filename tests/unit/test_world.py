"""The world: rays, distances, sight, starts, slices, and files that are wrong."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mock_vehicle.errors import WorldError
from mock_vehicle.world import Ring, World, load_world
from mock_vehicle.world.schema import world_schema

Floats = NDArray[np.float64]
Build = Callable[..., World]
WORLDS = Path(__file__).parents[2] / "missions/worlds"
SHIPPED = sorted(WORLDS.glob("*.yaml"))
ROOM = {"name": "room", "size_m": [20, 10], "ceiling_m": 3.0}


def write(folder: Path, **keys: Any) -> Path:
    path = folder / "world.yaml"
    path.write_text(yaml.safe_dump({**ROOM, **keys}), encoding="utf-8")
    return path


@pytest.fixture
def build(tmp_path: Path) -> Build:
    return lambda **keys: load_world(write(tmp_path, **keys))


def ned(x: float, y: float, z: float = 1.0) -> Floats:
    return np.array([[y, x, -z]])


def cast(world: World, x: float, y: float, z: float, *, toward: tuple[float, ...]) -> float:
    """One ray from a place of the floor plan, `toward` east, north, up."""
    east, north, up = np.array(toward) / np.linalg.norm(toward)
    return float(world.cast(ned(x, y, z), np.array([[north, east, -up]]), 50.0)[0])


def refusal(folder: Path, **keys: Any) -> str:
    """The sentence with which a world file is refused, without its path."""
    path = write(folder, **keys)
    with pytest.raises(WorldError) as caught:
        load_world(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{path}: ")


def test_an_empty_room_is_seen_to_its_six_faces(build: Build) -> None:
    room = build()
    seen = [
        cast(room, 5, 4, 1, toward=way)
        for way in [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    ]
    assert seen == pytest.approx([15, 5, 6, 4, 2, 1])
    assert cast(room, 5, 4, 1, toward=(1, 0, -0.5)) == pytest.approx(math.hypot(2, 1))


def test_the_corner_of_the_room_may_be_anywhere(build: Build) -> None:
    room = build(origin_m=[-10, 30])
    np.testing.assert_allclose(room.low_ned_m, [30, -10, -3])
    np.testing.assert_allclose(room.high_ned_m, [40, 10, 0])
    assert cast(room, 0, 35, 1, toward=(1, 0, 0)) == pytest.approx(10)


def test_nothing_is_seen_beyond_the_range(build: Build) -> None:
    room = build()
    east = np.array([[0.0, 1.0, 0.0]])
    assert room.cast(ned(5, 5), east, 15.1)[0] == pytest.approx(15)
    assert room.cast(ned(5, 5), east, 14.9)[0] == math.inf


def test_open_ground_has_a_floor_and_nothing_else(build: Build) -> None:
    field = build(closed=False, ceiling_m=None)
    assert field.ceiling_m is None
    assert cast(field, 5, 5, 1, toward=(1, 0, 0)) == math.inf
    assert cast(field, 5, 5, 1, toward=(0, 0, 1)) == math.inf
    assert cast(field, 5, 5, 1, toward=(0, 0, -1)) == pytest.approx(1)
    assert not field.occupied(ned(-5, -5))[0]


def test_a_turned_box_meets_rays_where_geometry_says(build: Build) -> None:
    room = build(boxes=[{"center_m": [10, 5], "size_m": [4, 2], "yaw_deg": 30, "height_m": 1.2}])
    turn = math.radians(30)
    assert cast(room, 5, 5, 1, toward=(1, 0, 0)) == pytest.approx(5 - 1 / math.sin(turn))
    assert cast(room, 10, 1, 1, toward=(0, 1, 0)) == pytest.approx(4 - 1 / math.cos(turn))
    along = (math.cos(turn), math.sin(turn), 0)
    x, y = 10 - 4 * along[0], 5 - 4 * along[1]
    assert cast(room, x, y, 1, toward=along) == pytest.approx(2)
    assert cast(room, 10, 5, 2.5, toward=(0, 0, -1)) == pytest.approx(1.3)
    assert cast(room, 1, 5, 1.3, toward=(1, 0, 0)) == pytest.approx(19), "above the box"


def test_a_box_under_the_ceiling_is_hit_from_below(build: Build) -> None:
    room = build(boxes=[{"center_m": [10, 5], "size_m": [2, 2], "bottom_m": 2.0}])
    assert cast(room, 10, 5, 0.5, toward=(0, 0, 1)) == pytest.approx(1.5)
    assert cast(room, 5, 5, 1.0, toward=(1, 0, 0)) == pytest.approx(15)


def test_a_cylinder_has_a_mantle_and_a_lid(build: Build) -> None:
    room = build(cylinders=[{"center_m": [10, 5], "radius_m": 0.5, "height_m": 1.5}])
    assert cast(room, 5, 5, 1, toward=(1, 0, 0)) == pytest.approx(4.5)
    assert cast(room, 5, 5.3, 1, toward=(1, 0, 0)) == pytest.approx(4.6)
    assert cast(room, 5, 5.51, 1, toward=(1, 0, 0)) == pytest.approx(15)
    assert cast(room, 10.2, 5, 2.5, toward=(0, 0, -1)) == pytest.approx(1.0)
    assert cast(room, 5, 5, 1.6, toward=(1, 0, 0)) == pytest.approx(15)


def test_a_ray_that_begins_inside_reads_zero(build: Build) -> None:
    room = build(boxes=[{"center_m": [10, 5], "size_m": [2, 2]}])
    assert cast(room, 10.2, 5, 1, toward=(1, 0, 0)) == 0.0


def test_a_ray_that_leaves_a_face_does_not_see_it(build: Build) -> None:
    room = build(boxes=[{"center_m": [10, 5], "size_m": [2, 2]}])
    assert cast(room, 9, 5, 1, toward=(-1, 0, 0)) == pytest.approx(9)
    assert cast(room, 8.9995, 5, 1, toward=(-1, 0, 0)) == pytest.approx(8.9995)


def test_a_vehicle_on_the_floor_sees_walls_and_no_floor(build: Build) -> None:
    room = build(boxes=[{"center_m": [10, 5], "size_m": [2, 2]}])
    assert cast(room, 5, 5, 0, toward=(1, 0, 0)) == pytest.approx(4)
    assert cast(room, 5, 5, 0, toward=(0, 0, -1)) == 0.0


DOORS = [
    {"at_m": 2.0, "width_m": 1.0},
    {"at_m": 6.0, "width_m": 2.0, "height_m": 2.1},
]
WALL = {"from_m": [8, 0], "to_m": [8, 10], "thickness_m": 0.2, "doors": DOORS}


@pytest.mark.parametrize(
    ("y", "z", "expected"),
    [
        (1.49, 1.0, 2.9),
        (1.51, 1.0, 15.0),
        (2.49, 2.9, 15.0),
        (2.51, 1.0, 2.9),
        (5.01, 2.0, 15.0),
        (5.01, 2.2, 2.9),
        (6.99, 2.0, 15.0),
        (7.01, 2.0, 2.9),
    ],
)
def test_a_wall_is_open_at_its_doors_below_the_lintel(
    build: Build, y: float, z: float, expected: float
) -> None:
    assert cast(build(walls=[WALL]), 5, y, z, toward=(1, 0, 0)) == pytest.approx(expected)


def test_sight_goes_through_doors_and_not_through_walls(build: Build) -> None:
    room = build(walls=[WALL])
    a = np.vstack([ned(5, 2), ned(5, 4), ned(5, 6, 2.5), ned(5, 6), ned(3, 3)])
    b = np.vstack([ned(11, 2), ned(11, 4), ned(11, 6, 2.5), ned(11, 6), ned(3, 3)])
    assert room.line_of_sight(a, b).tolist() == [True, False, False, True, True]
    assert room.line_of_sight(b, a).tolist() == [True, False, False, True, True]
    assert room.line_of_sight(ned(5, 2), ned(5, 3, 0))[0], "a place on the floor is seen"
    assert room.line_of_sight(ned(5, 4), ned(7.9, 4))[0], "the face of a wall is seen"


@pytest.mark.parametrize(
    ("a", "b", "walls"),
    [
        ((5, 2, 1), (9, 2, 1), 0),
        ((5, 2, 1), (13, 2, 1), 1),
        ((15, 2, 1), (5, 2, 1), 2),  # the column too
        ((5, 6, 1), (15, 6, 1), 0),  # through the door
        ((5, 6, 2.5), (15, 6, 2.5), 1),  # above its lintel
        ((5, 4.3, 2.5), (15, 6.1, 2.5), 1),  # out of the wall's piece beside it into that above
        ((5, 2, 1), (19, 2, 1), 3),
        ((17, 2, 1), (19, 2, 1), 1),  # begins in the box
        ((5, 2, 1), (18, 2, 2.9), 1),  # over the box
    ],
)
def test_walls_between_two_are_counted(
    build: Build, a: tuple[float, ...], b: tuple[float, ...], walls: int
) -> None:
    room = build(
        walls=[
            {
                "from_m": [10, 0],
                "to_m": [10, 10],
                "doors": [{"at_m": 6, "width_m": 1.6, "height_m": 2.2}],
            }
        ],
        boxes=[{"center_m": [16.5, 2], "size_m": [2, 2], "height_m": 1.5}],
        cylinders=[{"center_m": [14, 2], "radius_m": 0.2, "height_m": 1.5}],
    )
    assert room.walls_between(ned(*a), ned(*b)).tolist() == [walls]


def test_walls_between_many_are_those_between_each_two() -> None:
    office = load_world(WORLDS / "office.yaml")
    chance = np.random.default_rng(1)
    a, b = (chance.uniform(office.low_ned_m, office.high_ned_m, (3000, 3)) for _ in range(2))
    together = office.walls_between(a, b)
    assert np.array_equal(together == 0, office.line_of_sight(a, b))
    alone = [int(office.walls_between(a[k : k + 1], b[k : k + 1])[0]) for k in range(100)]
    assert together[:100].tolist() == alone
    assert together.max() >= 6


def test_walls_of_a_map_are_counted_as_those_of_a_plan() -> None:
    office = load_world(WORLDS / "small_office_map.yaml")
    chance = np.random.default_rng(1)
    a, b = (chance.uniform(office.low_ned_m, office.high_ned_m, (2000, 3)) for _ in range(2))
    a[:, 2] = b[:, 2] = -1.0
    agree = (office.walls_between(a, b) == 0) == office.line_of_sight(a, b)
    assert agree.mean() > 0.995  # corners that are cut by less than half a cell


def test_clearance_is_positive_outside_and_negative_inside(build: Build) -> None:
    room = build(
        boxes=[{"center_m": [10, 5], "size_m": [4, 2], "yaw_deg": 90, "height_m": 1.0}],
        cylinders=[{"center_m": [15, 5], "radius_m": 0.5}],
    )
    places = np.vstack(
        [
            ned(8.5, 5),
            ned(8.5, 7.5, 0.5),
            ned(10.9, 5, 0.5),
            ned(10, 5, 1.2),
            ned(14.2, 5),
            ned(15.1, 5),
            ned(0.2, 5),
            ned(-0.2, 5),
            ned(3, 3, 2.9),
            ned(4, 4, 0.0),
        ]
    )
    expected = [0.5, math.hypot(0.5, 0.5), -0.1, 0.2, 0.3, -0.4, 0.2, -0.2, 0.1, 2.0]
    np.testing.assert_allclose(room.clearance(places), expected, atol=1e-9)
    assert room.occupied(places).tolist() == [value < 0 for value in expected]


Solid = Callable[[Floats, float], NDArray[Any]]


def between(z: Floats, shape: dict[str, Any], grow: float) -> NDArray[Any]:
    bottom = shape["bottom_m"]
    inside: NDArray[Any] = (z > bottom - grow) & (z < bottom + shape["height_m"] + grow)
    return inside


def solid_of(plan: dict[str, Any]) -> Solid:
    """An independent witness: which x, y, z are in something solid, grown by a margin."""

    def inside(points: Floats, grow: float) -> NDArray[Any]:
        x, y, z = points.T
        width, depth = plan["size_m"]
        solid: NDArray[Any] = (x < grow) | (x > width - grow) | (y < grow) | (y > depth - grow)
        solid |= (z < grow) | (z > plan["ceiling_m"] - grow)
        for box in plan["boxes"]:
            turn = np.exp(1j * math.radians(box["yaw_deg"]))
            local = (x + 1j * y - complex(*box["center_m"])) / turn
            along, aside = (edge / 2 + grow for edge in box["size_m"])
            hit = (abs(local.real) < along) & (abs(local.imag) < aside)
            solid |= hit & between(z, box, grow)
        for tube in plan["cylinders"]:
            hit = abs(x + 1j * y - complex(*tube["center_m"])) < tube["radius_m"] + grow
            solid |= hit & between(z, tube, grow)
        return solid

    return inside


places = st.tuples(st.floats(0.5, 9.5), st.floats(0.5, 7.5))
heights = {"bottom_m": st.sampled_from([0.0, 0.5, 1.0]), "height_m": st.floats(0.3, 1.5)}
plans = st.fixed_dictionaries(
    {
        "size_m": st.just([10.0, 8.0]),
        "ceiling_m": st.just(3.0),
        "boxes": st.lists(
            st.fixed_dictionaries(
                {
                    "center_m": places,
                    "size_m": st.tuples(st.floats(0.1, 3.0), st.floats(0.1, 3.0)),
                    "yaw_deg": st.floats(-180.0, 180.0),
                    **heights,
                }
            ),
            max_size=6,
        ),
        "cylinders": st.lists(
            st.fixed_dictionaries({"center_m": places, "radius_m": st.floats(0.1, 1.5), **heights}),
            max_size=4,
        ),
    }
)


@settings(max_examples=60, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(plan=plans, seed=st.integers(0, 1000))
def test_rays_end_where_a_patient_walker_meets_something(
    tmp_path_factory: pytest.TempPathFactory, plan: dict[str, Any], seed: int
) -> None:
    plain = json.loads(json.dumps(plan))
    world = load_world(write(tmp_path_factory.mktemp("plan"), **plain))
    solid, rng = solid_of(plain), np.random.default_rng(seed)
    origins = rng.uniform([0.1, 0.1, 0.1], [9.9, 7.9, 2.9], (20, 3))
    directions = rng.normal(size=(20, 3))
    directions[:5, 2] = 0.0
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    flip = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    measured = world.cast(origins @ flip, directions @ flip, 30.0)
    assert np.isfinite(measured).all()
    np.testing.assert_array_equal(world.occupied(origins @ flip), solid(origins, 0.0))
    for origin, way, distance in zip(origins, directions, measured, strict=True):
        before = np.arange(0.0, distance, 0.004)
        assert not solid(origin + before[:, None] * way, -1e-6).any()
        assert solid((origin + distance * way)[None], 1e-6).all()


def test_many_shapes_and_many_rays_agree_with_one_by_one(build: Build) -> None:
    rng = np.random.default_rng(5)
    boxes = [
        {"center_m": [x, y], "size_m": [0.3, 0.5]} for x, y in rng.uniform(1, 9, (60, 2)).tolist()
    ]
    room = build(boxes=boxes)
    origins = np.column_stack([rng.uniform(0.1, 9.9, (900, 2)), np.full(900, -1.0)])
    ways = rng.normal(size=(900, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    together = room.cast(origins, ways, 30.0)
    alone = [room.cast(o[None], d[None], 30.0)[0] for o, d in zip(origins, ways, strict=True)]
    np.testing.assert_allclose(together, alone)


@settings(max_examples=60, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(plan=plans, seed=st.integers(0, 1000))
def test_a_scan_reads_what_its_rays_cast_one_by_one_would(
    tmp_path_factory: pytest.TempPathFactory, plan: dict[str, Any], seed: int
) -> None:
    world = load_world(write(tmp_path_factory.mktemp("plan"), **json.loads(json.dumps(plan))))
    compare_scan_with_cast(world, np.random.default_rng(seed), 30)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_scan_of_a_shipped_world_reads_what_its_rays_would(path: Path) -> None:
    compare_scan_with_cast(load_world(path), np.random.default_rng(1), 100)


def compare_scan_with_cast(world: World, rng: np.random.Generator, n: int) -> None:
    """From anywhere, also from inside of solids, beyond the walls and below the floor."""
    low, high = world.low_ned_m - 0.3, world.high_ned_m + 0.3
    origins = rng.uniform(low, high, (n, 3))
    # along an axis it is a matter of taste whether a wall that one is beyond is in the way, or a
    # column that is just touched: these stand inside, and not where a rounded column ends
    origins[-4:] = np.clip(origins[-4:], low + 0.31234567, high - 0.31234567)
    noses = np.append(rng.uniform(-math.pi, math.pi, n - 4), [0.0, math.pi / 2, -math.pi, 3.0])
    ring = Ring(origins, noses, 72)
    world.scan(ring, 8.0)
    one_by_one = world.cast(np.repeat(origins, 72, axis=0), ring.directions(), 8.0)
    np.testing.assert_allclose(ring.ranges_m.ravel(), one_by_one, atol=1e-6)
    upright = np.tile([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], (n, 1))
    up_and_down = world.cast(np.repeat(origins, 2, axis=0), upright, 8.0)
    np.testing.assert_allclose(world.plumb(origins, 8.0).ravel(), up_and_down, atol=1e-6)


@settings(max_examples=60, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(plan=plans, seed=st.integers(0, 1000), n=st.integers(1, 30))
def test_compiled_loops_look_around_as_the_others_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, plan: dict[str, Any], seed: int, n: int
) -> None:
    path = write(tmp_path_factory.mktemp("plan"), **json.loads(json.dumps(plan)))
    compare_compiled_with_plain(path, np.random.default_rng(seed), n)


@pytest.mark.parametrize("name", ["office", "rubble"])
def test_compiled_loops_look_around_in_a_shipped_world_bit_for_bit(name: str) -> None:
    for n in (1, 2, 5, 100):
        compare_compiled_with_plain(WORLDS / f"{name}.yaml", np.random.default_rng(n), n)


def compare_compiled_with_plain(path: Path, rng: np.random.Generator, n: int) -> None:
    """From anywhere, many among others; some at the very corner of a world or of a grid."""
    pytest.importorskip("numba")
    plain, fast = load_world(path), load_world(path)
    fast.compile()
    origins = rng.uniform(plain.low_ned_m - 0.3, plain.high_ned_m + 0.3, (n, 3))
    origins[: n // 3] = np.round(origins[: n // 3], 1)
    origins[n // 2 :] = origins[n // 2] + rng.normal(0.0, 0.5, (n - n // 2, 3))
    noses = rng.choice([0.0, math.pi / 2, -math.pi, 1.0, 2.5], n)
    seer, seen = np.nonzero(~np.eye(n, dtype=bool))
    one, other = Ring(origins, noses, 72), Ring(origins, noses, 72)
    upright = plain.look(one, 8.0, (seer, seen), 0.3)
    np.testing.assert_array_equal(fast.look(other, 8.0, (seer, seen), 0.3), upright)
    np.testing.assert_array_equal(other.ranges_m, one.ranges_m)
    np.testing.assert_array_equal(fast.clearance(origins), plain.clearance(origins))
    ways = rng.normal(size=(n, 3))
    ways[::2] = np.round(ways[::2])
    ways /= np.maximum(np.linalg.norm(ways, axis=1), 1e-9)[:, None]
    np.testing.assert_array_equal(fast.cast(origins, ways, 9.0), plain.cast(origins, ways, 9.0))


def test_a_scan_in_a_row_with_walls_is_no_matter_of_division(build: Build) -> None:
    room = build(boxes=[{"center_m": [10, 5], "size_m": [2, 2]}])
    ring = Ring(np.vstack([ned(5, 3), ned(8, 1), ned(11, 5), ned(10, 5)]), np.zeros(4), 4)
    room.scan(ring, 50.0)
    expected = [[7, 15, 3, 5], [9, 12, 1, 8], [5, 9, 5, 0], [0, 0, 0, 0]]
    np.testing.assert_allclose(ring.ranges_m, expected, atol=1e-9)


def gaps(points: Floats) -> Floats:
    """Distances between all pairs of points."""
    first, second = np.triu_indices(len(points), 1)
    distances: Floats = np.linalg.norm(points[first] - points[second], axis=1)
    return distances


def test_listed_starts_keep_their_order_and_their_nose(build: Build) -> None:
    listed: list[dict[str, Any]] = [
        {"position_m": [2, 1], "yaw_deg": 90},
        {"position_m": [4, 1], "yaw_deg": 0},
        {"position_m": [6, 1], "yaw_deg": 225},
    ]
    places, yaw = build(starts=listed).starts(3, seed=1)
    np.testing.assert_allclose(places, [[1, 2, 0], [1, 4, 0], [1, 6, 0]])
    np.testing.assert_allclose(yaw, [0.0, math.pi / 2, -3 * math.pi / 4], atol=1e-12)


def test_grid_starts_fill_rows_to_the_north(build: Build) -> None:
    grid = {"grid": {"origin_m": [2, 1], "spacing_m": 1.5, "columns": 2, "yaw_deg": 0}}
    places, yaw = build(starts=grid).starts(3, seed=1)
    np.testing.assert_allclose(places, [[1.0, 2.0, 0.0], [1.0, 3.5, 0.0], [2.5, 2.0, 0.0]])
    np.testing.assert_allclose(yaw, math.pi / 2)


def test_random_starts_keep_apart_and_repeat_by_seed(build: Build) -> None:
    room = build(
        starts={"random": {"margin_m": 0.8, "spacing_m": 1.5}},
        boxes=[{"center_m": [10, 5], "size_m": [6, 4], "yaw_deg": 15}],
    )
    places, yaw = room.starts(20, seed=4)
    assert gaps(places).min() >= 1.5
    assert room.clearance(places).min() >= 0.8
    assert yaw.min() < -1 < 1 < yaw.max()
    again, _ = room.starts(20, seed=4)
    fewer, fewer_yaw = room.starts(7, seed=4)
    other, _ = room.starts(20, seed=5)
    np.testing.assert_array_equal(places, again)
    np.testing.assert_array_equal(places[:7], fewer)
    np.testing.assert_array_equal(yaw[:7], fewer_yaw)
    assert not np.allclose(places, other)


def test_too_many_vehicles_for_the_room_are_refused(build: Build) -> None:
    with pytest.raises(WorldError, match=r"starts\.random: there is room for \d+ vehicles"):
        build(starts={"random": {"spacing_m": 3.0}}).starts(60, seed=0)
    with pytest.raises(WorldError, match="starts: lists 1 places, not 2"):
        build(starts=[{"position_m": [2, 2]}]).starts(2, seed=0)
    grid = {"grid": {"origin_m": [2, 2], "columns": 30, "spacing_m": 1.5}}
    with pytest.raises(WorldError, match=r"starts\.grid: vehicle 13 at \(20, 2\) is inside"):
        build(starts=grid).starts(20, seed=0)


def test_a_slice_blocks_what_is_solid_at_its_height(build: Build) -> None:
    room = build(boxes=[{"center_m": [10, 5], "size_m": [4, 2], "height_m": 1.0}])
    low, high = room.occupancy(0.5, 0.5), room.occupancy(0.5, 1.5)
    assert low.blocked.shape == (20, 40)
    assert low.blocked[8:12, 16:24].all()
    assert low.blocked.sum() == 32
    assert high.blocked.sum() == 0
    np.testing.assert_allclose(low.origin_ne_m, [0, 0])


def test_a_slice_that_does_not_divide_the_room_blocks_the_rest(build: Build) -> None:
    grid = build(size_m=[2.2, 1.0]).occupancy(0.5, 1.0)
    assert grid.blocked.tolist() == [[False] * 4 + [True]] * 2


def test_what_cannot_be_reached_is_not_free(build: Build) -> None:
    wall = {"from_m": [8, 0], "to_m": [8, 10], "thickness_m": 0.1}
    seeds = np.vstack([ned(2, 2, 0), ned(-3, 2, 0)])
    shut = build(walls=[wall]).free_cells(0.5, 1.0, seeds)
    assert shut[:, :16].all()
    assert not shut[:, 16:].any(), "a wall thinner than a cell still holds"
    door = {"at_m": 3.2, "width_m": 1.2, "height_m": 2.0}
    ajar = build(walls=[{**wall, "doors": [door]}])
    assert ajar.free_cells(0.5, 1.0, seeds).all()
    assert not ajar.free_cells(0.5, 2.5, seeds)[:, 16:].any(), "the lintel is in the way"


def test_the_outline_is_json_and_holds_the_shapes(build: Build) -> None:
    outline = build(
        boxes=[{"center_m": [10, 5], "size_m": [4, 2], "height_m": 1.0}],
        cylinders=[{"center_m": [15, 5], "radius_m": 0.5}],
        victims=[{"name": "v1", "position_m": [1, 2, 0.3]}],
    ).outline()
    assert json.loads(json.dumps(outline)) == outline
    box, tube = outline["polygons"]
    assert {tuple(p) for p in box["points_ne_m"]} == {(4, 8), (4, 12), (6, 8), (6, 12)}
    assert (box["bottom_m"], box["top_m"], tube["top_m"]) == (0.0, 1.0, 3.0)
    radii = np.hypot(*(np.array(tube["points_ne_m"]) - [5, 15]).T)
    np.testing.assert_allclose(radii, 0.5, atol=2e-3)
    assert outline["victims"] == [{"name": "v1", "position_ned_m": [2.0, 1.0, -0.3]}]
    assert outline["high"] == [10.0, 20.0, 0.0]
    assert outline["map"] is None


BOX = {"center_m": [10, 5], "size_m": [4, 2]}


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"boxs": []}, "boxs: unknown key; did you mean boxes?"),
        (
            {"boxes": [{**BOX, "hight_m": 1}]},
            "boxes[0].hight_m: unknown key; did you mean height_m?",
        ),
        ({"radio": {"zzz": 1}}, "radio.zzz: unknown key; known: radius_m, delay_s"),
        ({"boxes": [BOX, BOX, {"center_m": [1, 1]}]}, "boxes[2].size_m: is required"),
        ({"boxes": [{**BOX, "size_m": [4]}]}, "boxes[0].size_m[1]: is required"),
        (
            {"boxes": [{**BOX, "size_m": [4, -2]}]},
            "boxes[0].size_m[1]: should be greater than 0, not -2",
        ),
        ({"boxes": 3}, "boxes: should be a list, not 3"),
        ({"boxes": [3]}, "boxes[0]: should hold keys, not 3"),
        ({"size_m": [20, 10, 3]}, "size_m: should have at most 2 items, not 3"),
        ({"size_m": [20, "wide"]}, "size_m[1]: should be a number, not 'wide'"),
        ({"size_m": [20, True]}, "size_m[1]: should be a number, not True"),
        ({"size_m": None}, "size_m: is required without a map"),
        ({"ceiling_m": math.inf}, "ceiling_m: should be a finite number"),
        ({"starts": "here"}, "starts: should be a list of positions, {grid: ...} or {random: ...}"),
        ({"starts": [{"position_m": [1]}]}, "starts[0].position_m[1]: is required"),
        (
            {"starts": {"grid": {"origin_m": [1, 1], "colums": 3}}},
            "starts.grid.colums: unknown key; did you mean columns?",
        ),
        (
            {"starts": {"random": {"spacing_m": -1}}},
            "starts.random.spacing_m: should be greater than or equal to 0",
        ),
        (
            {"coverage": {"footprint": "cone"}},
            "coverage.footprint: should be 'square', 'disc' or 'sphere', not 'cone'",
        ),
        (
            {"radio": {"loss_fraction": 1.5}},
            "radio.loss_fraction: should be less than or equal to 1, not 1.5",
        ),
        (
            {"radio": {"ranging": {"range_nois_m": 1}}},
            "radio.ranging.range_nois_m: unknown key; did you mean range_noise_m?",
        ),
        ({"radio": {"ranging": "well"}}, "radio.ranging: should hold keys, not 'well'"),
        ({"radio": {"delay_s": 61}}, "radio.delay_s: should be less than or equal to 60, not 61"),
        (
            {"radio": {"path_loss": {"wall_attenuation_db": 5}}},
            "radio.path_loss.wall_attenuation_db: unknown key; did you mean wall_db?",
        ),
        (
            {"radio": {"channel": {"queue_frames": 0}}},
            "radio.channel.queue_frames: should be greater than or equal to 1, not 0",
        ),
        (
            {"radio": {"partitions": [{"from_s": 5}]}},
            "radio.partitions[0]: should have either groups or line",
        ),
        (
            {"sensors": {"radio_range_noise_m": 0.1}},
            "sensors.radio_range_noise_m: unknown key; did you mean range_noise_m?",
        ),
        ({"sensors": {"bearing_noise_deg": 3}}, "sensors.bearing_noise_deg: unknown key"),
        ({"faults": [{"time_s": 60, "vehicle": 3}]}, "faults[0].kind: is required"),
        (
            {"boxes": [{**BOX, "center_m": [25, 5]}]},
            "boxes[0].center_m: (25, 5) is outside the world, x 0..20, y 0..10",
        ),
        ({"boxes": [{**BOX, "bottom_m": 3}]}, "boxes[0].bottom_m: 3 m is not below its top at 3 m"),
        (
            {"walls": [{"from_m": [1, 1], "to_m": [1, 11]}]},
            "walls[0].to_m: (1, 11) is outside the world",
        ),
        (
            {"walls": [{"from_m": [1, 1], "to_m": [1, 1]}]},
            "walls[0].to_m: is the same point as from_m",
        ),
        (
            {"walls": [{**WALL, "doors": [*DOORS, {"at_m": 9.8, "width_m": 1}]}]},
            "walls[0].doors[2].at_m: 9.8 m puts the door beyond",
        ),
        (
            {"walls": [{**WALL, "doors": [*DOORS, {"at_m": 2.7, "width_m": 1}]}]},
            "walls[0].doors[2].at_m: 2.7 m puts the door into another",
        ),
        (
            {"boxes": [BOX], "starts": [{"position_m": [1, 1]}, {"position_m": [10, 5]}]},
            "starts[1].position_m: (10, 5) is inside something solid",
        ),
        (
            {"starts": [{"position_m": [0.2, 5]}]},
            "starts[0].position_m: (0.2, 5) is only 0.20 m from something solid",
        ),
        (
            {"boxes": [BOX], "starts": {"grid": {"origin_m": [10, 5]}}},
            "starts.grid: vehicle 1 at (10, 5) is inside something solid",
        ),
        (
            {
                "victims": [
                    {"name": "a", "position_m": [1, 1, 0]},
                    {"name": "b", "position_m": [1, 11, 0]},
                ]
            },
            "victims[1].position_m: (1, 11, 0) is outside the world",
        ),
        (
            {"victims": [{"name": "a", "position_m": [1, 1, 3.5]}]},
            "victims[0].position_m: (1, 1, 3.5) is outside the world",
        ),
        (
            {"boxes": [BOX], "victims": [{"name": "a", "position_m": [10, 5, 0.3]}]},
            "victims[0].position_m: (10, 5, 0.3) is inside something solid",
        ),
        (
            {"victims": [{"name": "a", "position_m": [1, 1, 0]}] * 2},
            "victims[1].name: a is the name of another victim",
        ),
        ({"map": {"file": "maps/nowhere.yaml"}, "size_m": [1, 1]}, "size_m: cannot go with map"),
    ],
)
def test_a_wrong_file_is_refused_in_one_sentence(
    tmp_path: Path, keys: dict[str, Any], sentence: str
) -> None:
    assert refusal(tmp_path, **keys).startswith(sentence)


def test_the_schema_describes_every_key_of_the_radio() -> None:
    sections = world_schema()["$defs"]
    for name in ("RadioSpec", "RangingSpec", "SectorSpec", "PathLossSpec", "ChannelSpec"):
        assert all(key["description"] for key in sections[name]["properties"].values())
    ranging = sections["RadioSpec"]["properties"]["ranging"]["anyOf"]
    assert {"type": "boolean"} in ranging


def test_no_vehicle_starts_in_a_sealed_pocket(build: Build) -> None:
    seal = {"from_m": [13, 0], "to_m": [13, 10]}
    rule = {"random": {"margin_m": 0.3, "spacing_m": 0.8}}
    sealed = build(walls=[seal], starts=rule)
    for seed in range(5):
        assert (sealed.starts(20, seed)[0][:, 1] < 13.0).all()
    open_wall = {**seal, "doors": [{"at_m": 5.0, "width_m": 1.0}]}
    assert (build(walls=[open_wall], starts=rule).starts(20, 1)[0][:, 1] > 13.0).any()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("name: x\nsize_m: [1, 1]\nname: y\n", "name: is given twice, in lines 1 and 3"),
        ("name: x\nradio:\n  delay_s: 1\n  delay_s: 1\n", "delay_s: is given twice, in lines 3"),
        ("name: x\nradio: {delay_s: 1, delay_s: 2}", "delay_s: is given twice, in lines 2 and 2"),
    ],
)
def test_a_key_that_is_given_twice_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "twice.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(WorldError) as caught:
        load_world(path)
    assert str(caught.value).startswith(f"{path}: {sentence}")


def test_equal_keys_of_different_sections_and_merged_ones_are_fine(tmp_path: Path) -> None:
    path = tmp_path / "merged.yaml"
    path.write_text(
        "name: x\nsize_m: [20, 10]\n"
        "boxes:\n  - &box {center_m: [3, 3], size_m: [1, 1]}\n  - {<<: *box, center_m: [9, 5]}\n"
    )
    assert [box.center_m for box in load_world(path).spec.boxes] == [(3, 3), (9, 5)]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("name: [1, 2", "is not YAML: "),
        ("- 1", "should hold keys"),
        ("", "should hold keys"),
        ("name: x\nmap: {file: no.yaml}", "map.file: no.yaml does not exist"),
        ("name: x\nmap: {file: no.yaml}\norigin_m: [1, 1]", "origin_m: cannot go with map"),
    ],
)
def test_what_is_no_world_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "broken.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(WorldError) as caught:
        load_world(path)
    assert str(caught.value).startswith(f"{path}: {sentence}")


def test_a_file_that_is_not_there_or_not_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match=r"none\.yaml: cannot be read: No such file"):
        load_world(tmp_path / "none.yaml")
    (tmp_path / "bytes.yaml").write_bytes(b"name: \xff\xfe")
    with pytest.raises(WorldError, match=r"bytes\.yaml: is not UTF-8"):
        load_world(tmp_path / "bytes.yaml")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_world_has_room_for_ten_and_ways_to_all_victims(path: Path) -> None:
    world = load_world(path)
    assert world.name == path.stem
    places, _ = world.starts(10, seed=1)
    assert gaps(places).min() > 1.19
    cell = world.spec.coverage.cell_m
    reachable = world.free_cells(cell, 1.5, places)
    assert reachable.mean() > 0.85
    for victim in world.victims:
        north, east = (np.array(victim.position_ned_m[:2]) - world.low_ned_m[:2]) // cell
        assert reachable[int(north), int(east)], victim.name
