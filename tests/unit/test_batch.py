"""The batch engine: the paper's experiment, the same numbers whichever way they are computed."""

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from swarm_ctl.experiment.batch import Case, Field, Outcome, has_numba, simulate
from swarm_ctl.experiment.hot import compiled, interpreted
from swarm_ctl.explore.planner import PlannerParams

SQUARE = Field((0.0, 0.0), (20.0, 20.0))
ROOMS = Field(
    (0.0, 0.0),
    (12.0, 9.0),
    boxes_m=((4.0, 0.0, 4.3, 6.0), (7.0, 5.0, 9.0, 6.5), (1.0, 3.0, 2.5, 4.5)),
    victims_m=((11.0, 1.0), (2.0, 8.0)),
)
PLACE = (2.0, 10.0)  # the paper's (10, 2), x being east
WAYS = [False, pytest.param(True, marks=pytest.mark.skipif(not has_numba(), reason="no numba"))]


def case(kind: str = "lf-pso", field: Field = SQUARE, **changes: Any) -> Case:
    params = {"kind": kind, "period_s": 1.0, "avoid_speed_fraction": 1.0}
    params.update({k: changes.pop(k) for k in list(changes) if k in PlannerParams.model_fields})
    settings = {"robots": 10, "steps": 600, "sample_steps": 600} | changes
    return Case(field, PlannerParams.model_validate(params), **settings)


def same(one: Outcome, other: Outcome) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize(
    ("kind", "start", "percent", "tolerance"),
    [
        # Row C1 of our study; the tolerance is three standard errors of 60 trials, and a bit.
        # Its last figure is 52.6: 3 of its own standard errors above its other two rows of the same
        # reading (51.6, 51.2) and above ours (51.5 from 3000 trials), which stands here.
        ("lf-pso", None, 72.8, 1.5),
        ("pso", None, 63.1, 2.0),
        ("levy", None, 58.7, 2.0),
        ("lf-pso", PLACE, 72.9, 1.5),
        ("pso", PLACE, 51.1, 2.3),
        ("levy", PLACE, 51.5, 2.3),
    ],
)
def test_ten_robots_cover_what_our_study_of_the_paper_found(
    kind: str, start: tuple[float, float] | None, percent: float, tolerance: float
) -> None:
    outcome = simulate(case(kind, start_m=start), 1, range(60))
    assert 100.0 * outcome.coverage[:, -1].mean() == pytest.approx(percent, abs=tolerance)


def test_the_hybrid_rarely_touches_and_levy_flight_alone_often() -> None:
    hybrid = simulate(case(), 2, range(40)).collisions.mean()
    levy = simulate(case("levy"), 2, range(40)).collisions.mean()
    assert hybrid == pytest.approx(1.2, abs=0.7)  # the study's figures
    assert levy == pytest.approx(16.8, abs=4.0)


@pytest.mark.skipif(not has_numba(), reason="no numba")
@pytest.mark.parametrize("kind", ["lf-pso", "levy", "pso"])
@pytest.mark.parametrize("field", [SQUARE, ROOMS], ids=["square", "rooms"])
@pytest.mark.parametrize("footprint", ["square", "disc"])
def test_compiled_and_interpreted_parts_give_the_same_bits(
    kind: str, field: Field, footprint: str
) -> None:
    given = case(kind, field, steps=200, sample_steps=40, footprint=footprint)
    numpy = simulate(given, 5, range(8), fast=False, tracks=True)
    compiled = simulate(given, 5, range(8), fast=True, tracks=True)
    assert same(numpy, compiled)


@pytest.mark.parametrize("fast", WAYS)
def test_a_trial_does_not_depend_on_those_beside_it(fast: bool) -> None:
    given = case(field=ROOMS, steps=150, sample_steps=50)
    together = simulate(given, 3, range(7), fast=fast, tracks=True)
    alone = [simulate(given, 3, range(t, t + 1), fast=fast, tracks=True) for t in range(7)]
    assert same(together, Outcome(*(np.concatenate(parts) for parts in zip(*alone, strict=True))))


def test_trials_and_seeds_differ() -> None:
    given = case(steps=20, sample_steps=20)
    first = simulate(given, 3, range(3), tracks=True).tracks_m
    other = simulate(given, 4, range(3), tracks=True).tracks_m
    starts = [*first[:, 0].reshape(-1, 2).tolist(), *other[:, 0].reshape(-1, 2).tolist()]
    assert len({tuple(start) for start in starts}) == 60


def test_robots_stay_inside_and_out_of_boxes() -> None:
    given = case("levy", ROOMS, levy_min_m=1.0, steps=400, avoid_distance_m=0.35)
    outcome = simulate(given, 1, range(10), tracks=True)
    north, east = np.moveaxis(outcome.tracks_m, -1, 0)
    assert north.min() >= 0.3
    assert north.max() <= 11.7
    assert east.min() >= 0.3
    assert east.max() <= 8.7
    for low_n, low_e, high_n, high_e in ROOMS.boxes_m:
        over = (north > low_n - 0.299) & (north < high_n + 0.299)
        over &= (east > low_e - 0.299) & (east < high_e + 0.299)
        assert not over.any()
    assert outcome.bumps.sum() > 0
    steps = np.sqrt((np.diff(outcome.tracks_m, axis=1) ** 2).sum(axis=3))
    assert steps.max() < 0.2 + 1e-9
    assert outcome.path_m == pytest.approx(steps.sum(axis=(1, 2)))


@pytest.mark.parametrize("fast", WAYS)
@pytest.mark.parametrize(("footprint", "cells"), [("square", 36), ("disc", 32)])
def test_a_body_that_does_not_move_covers_its_own_ground(
    fast: bool, footprint: Literal["square", "disc"], cells: int
) -> None:
    still = case(robots=1, steps=1, speed_m_s=1e-9, start_m=(5.0, 5.0), jitter_m=0.0)
    outcome = simulate(replace(still, footprint=footprint), 1, range(2), fast=fast)
    assert outcome.coverage == pytest.approx(np.full((2, 1), cells / 200**2), abs=7 / 200**2)


@pytest.mark.parametrize("fast", WAYS)
def test_what_is_covered_counts_of_the_free_ground(fast: bool) -> None:
    corridor = Field((0.0, 0.0), (0.6, 4.0), boxes_m=((0.0, 2.0, 0.6, 4.0),))
    still = case(field=corridor, robots=1, steps=1, speed_m_s=1e-9, start_m=(0.3, 0.3))
    share = simulate(replace(still, jitter_m=0.0), 1, range(1), fast=fast).coverage[0, -1]
    assert share == pytest.approx(0.6 / 2.0)


@pytest.mark.parametrize("fast", WAYS)
def test_who_hears_nobody_is_not_pushed_and_a_chain_of_links_is_one_cluster(fast: bool) -> None:
    """A line of robots 1.9 m apart: all in one cluster with a radio of 2 m, none with 1.8 m."""
    tools = compiled() if fast else interpreted()
    line = np.stack([np.arange(5) * 1.9, np.zeros(5)], axis=1)[None]
    for radio_m, heard in ((2.0, 4), (1.8, 0)):
        peers = np.zeros((1, 5, 5, 2))
        touching = np.zeros((1, 5, 5), dtype=bool)
        tools.meet(line, radio_m**2, 0.36, peers, touching, np.zeros(1, dtype=np.int64))
        assert (~np.isnan(peers[0, :, :, 0])).sum(axis=1).tolist() == [heard] * 5
        assert np.isnan(peers[0, range(5), range(5)]).all()
    assert math.isclose(line[0, 4, 0], 7.6)


@pytest.mark.parametrize("fast", WAYS)
def test_three_beams_look_ahead_left_and_right(fast: bool) -> None:
    tools = compiled() if fast else interpreted()
    boxes = np.array([[4.0, 4.0, 5.0, 5.0]])
    place = np.array([[4.5, 3.5], [4.5, 3.5], [1.0, 2.0]])
    heading = np.array([math.pi / 2, 0.0, math.pi])  # east, north, south
    beams = tools.cast(place, np.cos(heading), np.sin(heading), (0.0, 0.0), (20.0, 20.0), boxes)
    expected = [[0.5, 15.5, 4.5], [15.5, 3.5, 0.5], [1.0, 18.0, 2.0]]
    assert beams == pytest.approx(np.array(expected))


def test_a_victim_is_found_from_a_metre_but_not_through_a_wall() -> None:
    victim = (5.0, 5.8)
    still = case(robots=1, steps=3, speed_m_s=1e-9, start_m=(5.0, 5.0), jitter_m=0.0)
    open_field = replace(SQUARE, victims_m=(victim, (5.0, 6.2)))
    walled = replace(open_field, boxes_m=((4.0, 5.5, 6.0, 5.6),))
    assert simulate(replace(still, field=open_field), 1, range(1)).found_step.tolist() == [[0, -1]]
    assert simulate(replace(still, field=walled), 1, range(1)).found_step.tolist() == [[-1, -1]]


def test_robots_that_start_in_one_place_have_not_collided_yet() -> None:
    still = case("levy", speed_m_s=1e-9, start_m=PLACE, steps=5, sample_steps=5)
    assert simulate(still, 1, range(3)).collisions.tolist() == [0, 0, 0]
