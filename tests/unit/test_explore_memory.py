import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.explore import kernels, memory, swath
from swarm_ctl.explore.frontier import NOBODY, Others, find_way, find_way_to
from swarm_ctl.explore.memory import GIVEN_UP, NEAR_WALL, TRODDEN, VISITED, WALL, VisitedMap

PLACE = st.floats(-4.0, 4.0).map(lambda value: round(value, 3) + 0.0007)
"""Off the lattice of cells, where rounding could go either way."""


def flat_map(footprint_m: float = 0.3, *, is_square: bool = True) -> VisitedMap:
    return VisitedMap(2, 0.2, footprint_m, is_square=is_square, dilation=1)


def hall_map() -> VisitedMap:
    return VisitedMap(3, 0.5, 1.0, is_square=False, dilation=1)


def visited(world: VisitedMap) -> set[tuple[int, ...]]:
    cells = np.argwhere(world.grid & VISITED != 0) + world.low
    return {tuple(map(int, cell)) for cell in cells}


@given(st.lists(PLACE, min_size=4, max_size=4), st.booleans())
@settings(max_examples=12, deadline=None)
def test_a_swept_footprint_is_every_cell_it_ever_covers(ends: list[float], square: bool) -> None:
    world = flat_map(is_square=square)
    start, end = np.array(ends[:2]), np.array(ends[2:])
    world.sweep(start, end)
    steps = 500
    path = start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start)
    slack = math.dist(start, end) / steps
    cells = np.array(list(itertools.product(range(-24, 25), repeat=2)))
    away = np.abs(path[None] - (cells[:, None] + 0.5) * 0.2)
    reach = (away.max(axis=2) if square else np.hypot(away[..., 0], away[..., 1])).min(axis=1)
    expected = {(*cell, 0) for cell in cells[reach <= 0.3].tolist()}
    doubtful = {(*cell, 0) for cell in cells[(reach > 0.3) & (reach <= 0.3 + slack)].tolist()}
    assert expected <= visited(world)
    assert visited(world) <= expected | doubtful


@given(st.lists(PLACE, min_size=6, max_size=6), st.sampled_from([2, 3]), st.booleans())
@settings(max_examples=60, deadline=None)
def test_loops_and_arrays_paint_the_same(ends: list[float], d: int, square: bool) -> None:
    world = hall_map() if d == 3 else flat_map(is_square=square)
    world.sweep(ends[:d], ends[3 : 3 + d])
    start, end = world.cells(ends[:d]), world.cells(ends[3 : 3 + d])
    one, other = np.zeros_like(world.grid), np.zeros_like(world.grid)
    half, is_square = (2.0, False) if d == 3 else (1.5, square)
    seen = kernels.VISITED
    assert kernels.paint(one, start, end, half, is_square, seen)
    assert memory._paint(other, start, end, half, seen, is_square=is_square)
    assert (one == other).all()
    assert (one == world.grid).all()
    beside = end + 2.0
    one[one.shape[0] // 2 :] |= kernels.NEAR_WALL
    other[:] = one
    for to, mark in ((beside, seen), (end, seen | kernels.OWN), (end, seen | kernels.OWN)):
        is_new = kernels.paint(one, end, to, half, is_square, mark)
        assert is_new == memory._paint(other, end, to, half, mark, is_square=is_square)
        assert (one == other).all()
    assert not is_new


def test_ground_is_news_once_to_all_and_once_to_oneself() -> None:
    world = flat_map()
    way = [0.1, 0.1], [1.1, 0.1]
    assert world.sweep(*way)
    assert not world.sweep(*way)
    assert world.sweep(*way, is_own=True)
    assert not world.sweep(*way, is_own=True)
    assert not world.sweep(*way)
    assert world.sweep([1.1, 0.1], [1.3, 0.1])


def test_a_way_through_ground_seen_before_is_news_where_a_wall_is_near() -> None:
    world = flat_map()
    world.sweep([0.1, 0.1], [1.1, 0.1], is_own=True)
    beside = [0.1, 0.3], [1.1, 0.3]
    world.sweep([0.1, 0.5], [1.1, 0.5], is_own=True)
    assert not world.sweep(*beside, is_own=True)
    world = flat_map()
    world.sweep([0.1, 0.1], [1.1, 0.1], is_own=True)
    world.sweep([0.1, 0.5], [1.1, 0.5], is_own=True)
    world.wall([0.5, 0.5])
    assert world.sweep(*beside, is_own=True)
    assert not world.sweep(*beside, is_own=True)


@given(st.lists(PLACE, min_size=3, max_size=3), st.sampled_from([2, 3]), st.integers(0, 2))
@settings(max_examples=60, deadline=None)
def test_loops_and_arrays_mark_the_same(point: list[float], d: int, axis: int) -> None:
    grids = []
    for is_compiled in (True, False):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(kernels, "IS_COMPILED", is_compiled)
            world = hall_map() if d == 3 else flat_map()
            assert world.wall(point[:d], axis)
            world.give_up([-40.0] * d, 1.0)  # outside of the map so far
            world.block(world.metres([-0.5, 0.5, 0.5]))  # outside, which is not remembered
            world.block(point[:d])
            grids.append(world.grid)
    assert (grids[0] == grids[1]).all()
    assert len(np.unique(grids[0])) >= 4


def test_the_map_grows_and_forgets_nothing() -> None:
    world = flat_map()
    world.sweep([0.0, 0.0], [3.0, 0.0])
    before = visited(world)
    world.sweep([-40.0, 25.0], [-40.0, 26.0])
    assert before <= visited(world)
    assert world.flags([-40.0, 25.5]) == VISITED | TRODDEN
    assert world.flags([300.0, 0.0]) == 0


def test_a_map_is_little_larger_than_what_is_known_and_grows_seldom_when_it_is_large() -> None:
    world = flat_map()
    world.sweep([0.0, 0.0], [0.0, 0.0])
    shapes = set()
    for step in range(1000):
        world.sweep([0.1 * step, 0.0], [0.1 * step + 0.1, 0.0])
        shapes.add(world.grid.shape)
    known = np.argwhere(world.grid)
    spare = np.array(world.grid.shape) - 1 - np.ptp(known, axis=0)
    assert (spare <= [2 * (world.grid.shape[0] // 32 + 2), 8, 0]).all()
    assert len(shapes) < 100


def test_what_is_given_up_at_the_edge_of_the_map_is_so_beyond_it() -> None:
    world = flat_map()
    world.sweep([0.1, 0.1], [0.1, 0.1])
    edge_m = world.metres([0.5, 0.5, 0.5])
    world.give_up(edge_m, 0.2)
    assert all(world.flags([edge_m[0] + x, edge_m[1]]) & GIVEN_UP for x in (-0.2, 0.0, 0.2))


def test_a_map_beyond_all_reason_is_not_drawn() -> None:
    world = flat_map()
    world.sweep([0.0, 0.0], [1e6, 1e6])
    assert world.grid.size <= memory.MOST_CELLS


def test_ground_that_was_walked_on_is_no_wall() -> None:
    world = flat_map()
    assert world.wall([1.0, 0.1])
    assert not world.wall([1.0, 0.1])
    world.sweep([0.1, 0.1], [2.1, 0.1])
    assert world.flags([1.1, 0.1]) & (WALL | TRODDEN) == WALL | TRODDEN
    assert world.flags([1.1, 0.3]) & NEAR_WALL
    assert kernels.is_line_free(world.grid, world.cells([0.1, 0.1]), world.cells([2.1, 0.1]))


def test_a_wall_in_three_dimensions_is_a_patch_across_its_beam() -> None:
    world = hall_map()
    world.wall([2.1, 0.1, 0.1], axis=0)
    walls = np.argwhere(world.grid & WALL != 0)
    assert len(walls) == 9
    assert np.ptp(walls[:, 0]) == 0


@pytest.mark.parametrize("north", [-1.0, 1.0])
def test_a_wall_is_new_once_however_far_away_it_is(north: float) -> None:
    world = flat_map()
    far_m = north * world.cell_m * (memory.MOST_CELLS // 16 - 64)
    assert world.wall([far_m, 0.1])
    assert not world.wall([far_m, 0.1])
    assert world.wall([far_m, 0.3])


@given(st.lists(st.tuples(*[st.integers(-3, 3)] * 3, st.integers(0, 2)), max_size=30))
def test_a_wall_may_be_seen_again_after_any_others(
    walls: list[tuple[int, int, int, int]],
) -> None:
    once, often = hall_map(), hall_map()
    for wall in dict.fromkeys(walls):
        once.wall([0.5 * part + 0.25 for part in wall[:3]], wall[3])
    for wall in walls:
        often.wall([0.5 * part + 0.25 for part in wall[:3]], wall[3])
    assert len(once._walls) == len(often._walls) == len(set(walls))
    assert np.array_equal(once.grid, often.grid)


def room_with_a_door() -> VisitedMap:
    """Two rooms 3 m deep; the wall between them, at x = 3, is open from y = 2 to 3."""
    world = flat_map()
    for y in np.arange(0.3, 3.0, 0.2):
        world.sweep([0.3, y], [2.5, y])
    for y in np.arange(-0.1, 3.2, 0.1):
        if not 2.0 < y < 3.0:
            world.wall([3.05, y])
    for x in np.arange(-0.1, 3.2, 0.1):
        world.wall([x, -0.1])
        world.wall([x, 3.3])
    for y in np.arange(-0.1, 3.4, 0.1):
        world.wall([-0.1, y])
    world.sweep([2.5, 2.5], [4.5, 2.5])
    return world


def test_a_way_back_leads_over_known_ground_and_ends_where_it_should() -> None:
    world = room_with_a_door()
    world.sweep([1.0, 2.5], [5.0, 2.5])  # through the door and on
    way = find_way_to(world, [5.0, 2.5], [0.5, 0.5])
    assert way[-1] == [0.5, 0.5]
    assert any(2.1 < corner[1] < 2.9 for corner in way[:-1])
    assert find_way_to(world, [5.0, 2.5], [50.0, 50.0]) == []


def test_a_way_back_ends_also_where_a_wall_was_seen_close_by() -> None:
    world = room_with_a_door()
    way = find_way_to(world, [2.5, 2.5], [0.15, 0.15])
    assert way[-1] == [0.15, 0.15]
    assert find_way_to(world, [2.5, 2.5], [4.5, 0.5]) == []  # nobody has been near it


def test_a_way_leads_around_the_wall_and_through_the_door() -> None:
    world = room_with_a_door()
    way = find_way(world, [0.5, 0.5], NOBODY, 0)
    assert way
    assert way[-1][0] > 2.9
    last = [0.5, 0.5]
    for corner in way:
        for t in np.linspace(0.0, 1.0, 20):
            place = [a + t * (b - a) for a, b in zip(last, corner, strict=True)]
            if 2.95 < place[0] < 3.15:
                assert 2.1 < place[1] < 2.9
        last = corner


def test_a_frontier_near_somebody_elses_target_is_left_to_it() -> None:
    world = flat_map()
    world.sweep([0.0, 0.0], [6.0, 0.0])
    alone = find_way(world, [3.0, 0.0], NOBODY, 0)[-1]
    shared = find_way(world, [3.0, 0.0], Others((), [[3.0, 0.7]], 2.5), 0)[-1]
    assert math.dist(alone, [3.0, 0.0]) < 1.0
    assert math.dist(shared, [3.0, 0.0]) > 1.5
    assert find_way(world, [3.0, 0.0], Others((), [[3.0, 0.7]], 50.0), 0)


def room_with_islands(*islands: tuple[float, float, int], gap: int = 0) -> VisitedMap:
    """A walled room of 12 m, seen but for `size` cells in a row at each (x, y); a gap in a wall."""
    world = flat_map()
    for step in range(121):
        for side in (-6.1, 6.1):
            world.wall([-6.1 + 0.1 * step + 0.05, side])
            if side < 0.0 or not 0.0 <= -6.1 + 0.1 * step + 0.05 < 0.2 * gap:
                world.wall([side, -6.1 + 0.1 * step + 0.05])
    world.wall([6.1, 6.1])
    i, j, _ = (int(cell) for cell in world.cells([-5.9, -5.9]))
    world.grid[i : i + 60, j : j + 60, 0] |= kernels.VISITED
    for x, y, size in islands:
        i, j, _ = (int(cell) for cell in world.cells([x, y]))
        world.grid[i : i + size, j, 0] = 0
    return world


def test_a_sliver_far_away_waits_for_larger_ground_farther_away() -> None:
    world = room_with_islands((2.5, 0.1, 3), (-5.1, 0.1, 8))
    assert find_way(world, [0.1, 0.1], NOBODY, 2)[-1][0] < 0.0
    assert find_way(world, [1.9, 0.1], NOBODY, 2)[-1][0] > 0.0, "it is on the way"
    assert find_way(room_with_islands((2.5, 0.1, 3)), [0.1, 0.1], NOBODY, 2)[-1][0] > 0.0


def test_a_pocket_that_a_peer_is_after_comes_last() -> None:
    world = room_with_islands((2.1, 0.1, 8), (-5.1, 0.1, 3))
    assert find_way(world, [0.1, 0.1], NOBODY, 2)[-1][0] > 0.0
    claimed = Others((), [[2.3, 0.1]], 0.0)
    assert find_way(world, [0.1, 0.1], claimed, 2)[-1][0] < 0.0


def test_who_has_peers_closer_to_a_frontier_takes_another_one() -> None:
    world = room_with_islands((2.1, 0.1, 8), (-5.1, 0.1, 8))
    assert find_way(world, [0.1, 0.1], NOBODY, 2)[-1][0] > 0.0
    assert find_way(world, [0.1, 0.1], Others([[2.0, 0.1]], (), 0.0), 2)[-1][0] < 0.0
    assert find_way(world, [0.1, 0.1], Others([[-4.0, 0.1], [2.0, 0.1]], (), 0.0), 2)[-1][0] > 0.0


@pytest.mark.parametrize(("gap", "is_door"), [(2, False), (3, True)])
def test_a_gap_too_narrow_for_a_body_is_no_frontier(gap: int, is_door: bool) -> None:
    world = room_with_islands(gap=gap)
    i, j, _ = (int(cell) for cell in world.cells([5.9, 0.1]))
    world.grid[i, j : j + gap, 0] |= kernels.TRODDEN
    assert find_way(world, [0.1, 0.1], NOBODY, 0)
    assert bool(find_way(world, [0.1, 0.1], NOBODY, 2)) is is_door


def test_what_is_supposed_to_be_swept_is_forgotten_again() -> None:
    world = flat_map()
    world.sweep([0.1, 0.1], [1.1, 0.1])
    before = np.argwhere(world.grid) + world.low
    with world.supposed([([0.1, 0.1], [1.1, 2.1])]):
        assert world.flags([1.1, 2.1]) & kernels.KNOWN
    assert not world.flags([1.1, 2.1])
    assert np.array_equal(np.argwhere(world.grid) + world.low, before)
    with world.supposed([([0.1, 0.1], [90.1, 0.1])]):
        assert world.flags([50.1, 0.1]) & kernels.KNOWN, "the map grows for it"
    assert world.flags([0.5, 0.1]) & kernels.KNOWN
    assert not world.flags([50.1, 0.1])


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2]), st.sampled_from([2, 3]))
@settings(max_examples=40, deadline=None)
def test_loops_and_arrays_rate_the_same(seed: int, stride: int, d: int) -> None:
    chance = np.random.default_rng(seed)
    world = flat_map() if d == 2 else hall_map()
    weights = [0.7, 0.2, 0.02, 0.04, 0.02, 0.02]
    flags = chance.choice([0, 1, 2, 5, 7, 37], size=world.grid.shape, p=weights)
    world.grid[:] = flags.astype(np.uint8)
    directions = chance.normal(size=(16, 3))
    directions[:, 2] *= d == 3
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    sides = chance.normal(size=(16, 5, 3)) * [1.0, 1.0, float(d == 3)]
    lengths = chance.uniform(0.5, 60.0, 16)
    one, other = np.zeros((16, 4)), np.zeros((16, 4))
    place = world.cells(chance.uniform(-5.0, 5.0, 3))
    question = (world.grid, place, directions, sides, 2, 3, lengths, 1.3, stride)
    kernels.rate(*question, one)
    swath._rate_side_by_side(*question, other)
    assert one.tolist() == other.tolist()


def test_no_frontier_gives_no_way() -> None:
    world = flat_map()
    world.sweep([0.1, 0.1], [0.1, 0.1])
    world.give_up([0.1, 0.1], 1.0)
    assert find_way(world, [0.1, 0.1], NOBODY, 0) == []
    assert find_way(world, [99.0, 0.1], NOBODY, 0) == []


@pytest.mark.parametrize("turn", range(4))
def test_a_candidate_counts_new_ground_up_to_the_wall(turn: int) -> None:
    world = flat_map()
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[turn]
    world.sweep([0.1, 0.1], [0.1, 0.1])
    world.wall([0.1 + 2.0 * c, 0.1 + 2.0 * s])
    sides = np.array([[[0.0, 0.0, 0.0], [-s, c, 0.0], [s, -c, 0.0]]], dtype=float)
    rated = np.zeros((1, 4))
    unit = np.array([[c, s, 0.0]], dtype=float)
    kernels.rate(
        world.grid, world.cells([0.1, 0.1]), unit, sides, 3, 3, np.array([20.0]), 1.0, 1, rated
    )
    new, beside, last, free = rated[0]
    assert (new, beside, last, free) == (24.0, 0.0, 9.0, 9.0)
