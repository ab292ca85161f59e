import itertools
import math
import tracemalloc
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.agent.homing import CELL_M, ROUTE_S, Homeward, Route, Trail
from swarm_ctl.model import Vec3


def fly(trail: Trail, *corners: tuple[float, float]) -> None:
    for (n0, e0), (n1, e1) in itertools.pairwise(corners):
        steps = max(1, int(math.dist((n0, e0), (n1, e1)) / 0.1))
        for k in range(steps + 1):
            share = k / steps
            trail.mark(Vec3(n0 + (n1 - n0) * share, e0 + (e1 - e0) * share, -1.5))


def test_the_way_home_leads_around_the_wall_the_vehicle_flew_around() -> None:
    trail = Trail()
    fly(trail, (0, 0), (5, 0), (5, 4), (0, 4))  # a U around a wall; straight home is blocked
    way = trail.way_home()
    assert max(place.x for place in way) == pytest.approx(5.0, abs=0.5)
    assert math.dist(way[-1], (0, 0, -1.5)) < 0.5


def test_a_loop_is_cut_where_the_vehicle_crossed_its_own_trail() -> None:
    trail = Trail()
    fly(trail, (0, 0), (10, 0), (10, 10), (4, 10), (4, 0), (4, -3))
    length = sum(itertools.starmap(math.dist, itertools.pairwise(trail.way_home())))
    assert length < 9.0  # home is 4 + 3 m away along the crossing, 37 m the way it came


def test_two_lanes_on_either_side_of_a_wall_are_not_joined() -> None:
    trail = Trail()
    fly(trail, (0, 0), (8, 0), (8, 0.95), (0, 0.95))  # a wall at 0.475 m between the lanes
    way = trail.way_home()
    assert max(place.x for place in way) == pytest.approx(8.0, abs=0.5)


def test_a_vehicle_that_never_moved_is_home() -> None:
    trail = Trail()
    assert trail.way_home() == []
    trail.mark(Vec3(0, 0, 0))
    assert trail.way_home() == []


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), max_size=60))
def test_ways_that_are_kept_up_are_those_that_are_found_anew(cells: list[tuple[int, int]]) -> None:
    kept = Trail()
    kept.fresh = []
    for north, east in cells:
        kept.mark(Vec3(CELL_M * north, CELL_M * east, 0.0))
        anew = Trail()
        for place in kept.fresh:
            anew.mark(place)
        assert kept.way_home() == anew.way_home()


def first_of_the_shortest_ways(places: list[Vec3]) -> list[Vec3]:
    """Find the way home breadth first, neighbours in the order of their cells."""
    cells = [tuple(math.floor(part / CELL_M + 0.5) for part in place) for place in places]
    entered: dict[tuple[int, ...], Vec3] = {}
    for cell, place in zip(cells, places, strict=True):
        entered.setdefault(cell, place)
    ways, queue = {cells[0]: [entered[cells[0]]]}, [cells[0]]
    for cell in queue:
        pairs = {*itertools.pairwise(cells), *itertools.pairwise(reversed(cells))}
        for neighbour in sorted(b for a, b in pairs if a == cell and b not in ways):
            ways[neighbour] = [entered[neighbour], *ways[cell]]
            queue.append(neighbour)
    return ways[cells[-1]][1:]


@given(st.lists(st.tuples(*[st.floats(-1.2, 1.2)] * 3).map(Vec3._make), min_size=1, max_size=40))
def test_of_ways_with_as_few_cells_the_first_is_flown(places: list[Vec3]) -> None:
    trail = Trail()
    for place in places:
        trail.mark(place)
    assert trail.way_home() == first_of_the_shortest_ways(places)


def test_an_estimate_gone_wild_leaves_the_way_home_as_it_was() -> None:
    trail = Trail()
    fly(trail, (0, 0), (4, 0))
    way = trail.way_home()
    for wild_m in (1e9, -3e38, 6e5, 7e5):
        trail.mark(Vec3(wild_m, 0.0, -wild_m))
    fly(trail, (4, 0), (4, 0.1))
    assert trail.way_home() == way


def test_a_cell_takes_less_than_eighty_bytes() -> None:
    trail = Trail()
    tracemalloc.start()
    fly(trail, (0, 0), (1000, 0), (0, 0))
    assert not trail.way_home()
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert taken < 80 * 1000 / CELL_M


def test_a_route_is_flown_place_by_place_and_ends() -> None:
    route, place = Route([Vec3(1, 0, -1), Vec3(1, 2, -1)]), Vec3(0, 0, -1)
    for _ in range(100):
        velocity = route.velocity(place, 1.0)
        assert math.hypot(*velocity) <= 1.0 + 1e-9
        place = Vec3(*(p + 0.1 * v for p, v in zip(place, velocity, strict=True)))
        if route.is_done():
            break
    assert route.is_done()
    assert math.dist(place, (1, 2, -1)) < 0.4


def ways_asked_for(places: Iterable[tuple[float, Vec3]]) -> list[bool]:
    """Fly home by places at times, in turns of ROUTE_S; tell which ways were on own ground."""
    asked: list[bool] = []

    def way(own: bool) -> list[Vec3]:
        asked.append(own)
        return [Vec3(9, 0, -1)]

    homeward = Homeward()
    for turn, place in places:
        homeward.route(place, turn * ROUTE_S, way)
    return asked


@pytest.mark.parametrize(("moved_m", "own"), [(0.1, [0, 0, 1, 1]), (1.0, [0, 0, 0, 0])])
def test_a_way_home_that_leads_nowhere_is_left_for_the_own_trail(
    moved_m: float, own: list[bool]
) -> None:
    turns = (0.0, 0.5, 1.0, 2.0, 3.5)
    asked = ways_asked_for((turn, Vec3(turn * moved_m, 0, -1)) for turn in turns)
    assert asked == list(map(bool, own))


def test_ways_home_that_lead_round_in_a_circle_are_left_for_the_own_trail() -> None:
    places = ((turn, Vec3(turn % 3, 0.1 * (turn % 2), -1)) for turn in range(8))
    assert ways_asked_for(places) == [False] * 4 + [True] * 2 + [False] * 2


def test_own_ground_that_leads_nowhere_either_is_left_again() -> None:
    asked = ways_asked_for((turn, Vec3(0, 0, -1)) for turn in range(11))
    assert asked == [False] * 2 + [True] * 2 + [False] * 2 + [True] * 2 + [False] * 2 + [True]


def test_behind_the_corner_that_was_in_the_way_the_shorter_way_is_tried_again() -> None:
    norths = [0.0, 0.0, 0.0, 2.0, 4.0, 4.0, 4.0, 6.0, 8.0, 10.0, 12.0]
    asked = ways_asked_for((turn, Vec3(north, 0, -1)) for turn, north in enumerate(norths))
    assert asked == [False] * 2 + [True] * 2 + [False] * 2 + [True] * 4 + [False]
