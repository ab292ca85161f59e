import math

import numpy as np
import pytest

from swarm_ctl.explore.avoidance import (
    RANGE_ORDER,
    TABLE,
    Avoidance,
    OneAvoidance,
    OneStallWatch,
    StallWatch,
    table_row,
)
from swarm_ctl.explore.chance import Chance, Floats
from swarm_ctl.explore.planner import Plan, Planner, PlannerParams

NORTH, EAST, SOUTH, WEST = 0.0, math.pi / 2, math.pi, -math.pi / 2
SPEED_M_S, CLIMB_M_S = 1.0, 0.5

# The table of the paper (left, front, right -> action), typed again from its page.
PAPER_TABLE_I = {
    (0, 1, 0): "turn pi/4 left/right",
    (0, 1, 1): "turn pi/2 left",
    (1, 1, 0): "turn pi/2 right",
    (1, 1, 1): "turn pi",
    (1, 0, 0): "turn pi/2 right",
    (0, 0, 1): "turn pi/2 left",
    (1, 0, 1): "keep heading",
    (0, 0, 0): "equation 6",
}
NORTHBOUND = {  # where a vehicle that faces north flies then: left is west, right is east
    "turn pi/4 left/right": {-45, 45},
    "turn pi/2 left": {-90},
    "turn pi/2 right": {90},
    "turn pi": {180},
    "keep heading": {0},
}
UP_DOWN = {(1, 0): "descend", (0, 1): "climb", (1, 1): "level"}


def ranges(*triggered: str, rows: int = 1) -> Floats:
    row = [0.5 if name in triggered else np.inf for name in RANGE_ORDER]
    return np.tile(np.array(row), (rows, 1))


def plan(*triggered: str, heading_rad: float, dimensions: int = 3, seed: int = 0) -> Plan:
    params = PlannerParams(dimensions=3 if dimensions == 3 else 2)
    planner = Planner(params, speed_m_s=SPEED_M_S, climb_m_s=CLIMB_M_S, seeds=[seed])
    nobody = np.empty((1, 0, dimensions))
    position_m = np.zeros((1, dimensions))
    return planner.step(position_m, np.array([heading_rad]), ranges(*triggered), nobody)


@pytest.mark.parametrize("row", range(32))
def test_every_row_of_the_table_does_what_the_paper_says(row: int) -> None:
    policy = TABLE[row]
    front, left, right, up, down = policy[:5]
    assert row == front * 16 + left * 8 + right * 4 + up * 2 + down
    names = zip(("front", "left", "right", "up", "down"), policy[:5], strict=True)
    triggered = [name for name, on in names if on]

    flown = [plan(*triggered, heading_rad=NORTH, seed=seed) for seed in range(20)]

    action = PAPER_TABLE_I[left, front, right]
    if action != "equation 6":
        degrees = {round(math.degrees(p.heading_rad[0])) for p in flown}
        assert {abs(d) if action == "turn pi" else d for d in degrees} == NORTHBOUND[action]
        speeds = [np.hypot(*p.velocity_m_s[0, :2]) for p in flown]
        assert speeds == pytest.approx([0.7 * SPEED_M_S] * 20)
    default = {"equation 6": "planner", "keep heading": "planner", "turn pi": "climb"}
    vertical = UP_DOWN.get((up, down)) or default.get(action, "level")
    assert policy.vertical == vertical
    if vertical != "planner":
        wanted = {"climb": -0.25, "descend": 0.25, "level": 0.0}[vertical]
        assert [p.velocity_m_s[0, 2] for p in flown] == pytest.approx([wanted] * 20)
    assert all(p.avoiding[0] == (row != 0) for p in flown)


@pytest.mark.parametrize(
    ("facing", "wall_on_its", "flies"),
    [
        (NORTH, "left", EAST),  # a wall in the west: away from it is east
        (NORTH, "right", WEST),  # a wall in the east
        (EAST, "left", SOUTH),  # a wall in the north
        (EAST, "right", NORTH),  # a wall in the south
        (SOUTH, "left", WEST),  # a wall in the east
        (SOUTH, "right", EAST),  # a wall in the west
        (WEST, "left", NORTH),  # a wall in the south
        (WEST, "right", SOUTH),  # a wall in the north
    ],
)
@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_wall_at_the_side_is_left_at_a_right_angle(
    facing: float, wall_on_its: str, flies: float, dimensions: int
) -> None:
    velocity = plan(wall_on_its, heading_rad=facing, dimensions=dimensions).velocity_m_s[0]
    wanted = [0.7 * math.cos(flies), 0.7 * math.sin(flies)]
    assert velocity[:2] == pytest.approx(wanted, abs=1e-9)


def test_the_floor_sends_a_vehicle_up_and_the_ceiling_down() -> None:
    assert plan("down", heading_rad=NORTH).velocity_m_s[0, 2] == -0.25  # up is -down
    assert plan("up", heading_rad=NORTH).velocity_m_s[0, 2] == 0.25


def test_after_the_floor_a_step_climbs() -> None:
    for seed in range(20):
        assert plan("down", heading_rad=NORTH, seed=seed).target_m[0, 2] <= 0.0
        assert plan("up", heading_rad=NORTH, seed=seed).target_m[0, 2] >= 0.0


def test_in_2d_floor_ceiling_and_what_is_behind_trigger_nothing() -> None:
    assert table_row(ranges("up", "down", "back"), 0.9, 2).tolist() == [0]
    assert table_row(ranges("up", "down", "back"), 0.9, 3).tolist() == [3]
    assert not plan("up", "down", "back", heading_rad=NORTH, dimensions=2).avoiding[0]


def test_a_sensor_triggers_below_the_distance_only() -> None:
    at = np.full((3, 6), np.inf)
    at[:, 0] = 0.899, 0.9, np.nan
    assert table_row(at, 0.9, 3).tolist() == [16, 0, 0]


def test_the_coin_is_fair_and_the_vehicles_own() -> None:
    watch, chance = Avoidance(1000, 0.9, 2), Chance(range(1000))
    watch.update(np.zeros(1000), ranges("front", rows=1000), chance)
    assert set(np.round(np.degrees(watch.heading_rad))) == {-45.0, 45.0}
    assert (watch.heading_rad > 0).mean() == pytest.approx(0.5, abs=0.05)


def commanded(watch: Avoidance, heading_deg: float, *triggered: str) -> int:
    watch.update(np.radians([heading_deg]), ranges(*triggered), Chance([0]))
    return round(math.degrees(watch.heading_rad[0]))


def test_a_commanded_heading_stands_until_the_vehicle_has_turned_there() -> None:
    watch = Avoidance(1, 0.9, 2)
    assert commanded(watch, 0, "front", "right") == -90
    assert commanded(watch, -30, "front", "right") == -90  # still turning
    assert commanded(watch, -69, "front", "right") == -90  # 21 degrees to go
    assert commanded(watch, -71, "front", "right") == -161  # there, and no better: again


def test_a_new_row_is_answered_at_once_while_turning() -> None:
    watch = Avoidance(1, 0.9, 3)
    assert commanded(watch, 0, "front", "right") == -90
    assert commanded(watch, -30, "front", "right", "down") == -90  # height is no new row
    assert commanded(watch, -30, "right") == -120


def test_a_vehicle_that_turns_at_once_asks_the_table_at_every_step() -> None:
    watch = Avoidance(1, 0.9, 2)
    assert commanded(watch, 0, "left") == 90
    assert commanded(watch, 90, "left") == 180


def test_who_comes_free_is_told_once() -> None:
    watch, chance = Avoidance(2, 0.9, 2), Chance([0, 1])
    heading = np.zeros(2)
    assert watch.update(heading, ranges("left", rows=2), chance).size == 0
    one_free = np.vstack([ranges(), ranges("left")])
    assert watch.update(heading, one_free, chance).tolist() == [0]
    assert watch.update(heading, one_free, chance).tolist() == []


def test_a_stall_is_noticed_at_the_end_of_its_window_only() -> None:
    watch = StallWatch(3, steps=4, distance_m=0.2)
    moved, sent = np.array([0.04, 0.06, 0.0]), np.array([0.3, 0.3, 0.05])
    answers = [watch.update(moved, sent).tolist() for _ in range(8)]
    assert answers == [[], [], [], [0]] * 2  # the second moves, the third was hardly sent


def test_one_vehicle_stalls_when_it_would_among_many() -> None:
    chance = np.random.default_rng(0)
    one, many = OneStallWatch(4, 0.2), StallWatch(1, 4, 0.2)
    paths = [(chance.uniform(0.0, 0.1), chance.uniform(0.0, 0.2)) for _ in range(400)]
    told = [one.update(moved_m, sent_m) for moved_m, sent_m in paths]
    among = [many.update(np.array([moved_m]), np.array([sent_m])).size for moved_m, sent_m in paths]
    assert told == [size > 0 for size in among]
    assert 10 < sum(told) < 90


@pytest.mark.parametrize("dimensions", [2, 3])
def test_one_vehicle_turns_when_and_where_it_would_among_many(dimensions: int) -> None:
    chance = np.random.default_rng(0)
    one, many = OneAvoidance(0.9, dimensions), Avoidance(1, 0.9, dimensions)
    dealt, among = Chance([7]), Chance([7])
    rows, came_free = set(), 0
    near = np.zeros(6)
    heading_rad = 0.0
    for _ in range(4000):
        near = np.where(chance.uniform(size=6) < 0.1, chance.uniform(size=6) < 0.4, near)
        if chance.uniform() < 0.5:  # it turns as it was told, or does not
            heading_rad = one.heading_rad if chance.uniform() < 0.5 else chance.uniform(-4.0, 4.0)
        ranges_m = np.where(near, 0.5, chance.choice([2.0, np.inf, np.nan], 6))
        is_free = one.update(heading_rad, ranges_m.tolist(), dealt)
        free = many.update(np.array([heading_rad]), ranges_m[None], among)
        assert is_free == (free.size > 0)
        assert (one.is_active, one.suspends) == (many.is_active[0], many.suspends[0])
        assert not one.suspends or one.heading_rad == many.heading_rad[0]
        rules, down = many.vertical
        assert one.vertical == (down[0] if rules[0] else None)
        rows.add(int(many._row[0]))
        came_free += is_free
    assert len(rows) == (32 if dimensions == 3 else 8)
    assert came_free > 50
    assert dealt.draw(0, 1) == among.draw(0, 1)
