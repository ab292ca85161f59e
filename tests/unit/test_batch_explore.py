"""The batch engine with explorers, and in three dimensions."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from swarm_ctl.experiment import batch, walls
from swarm_ctl.experiment.batch import Case, Field, Outcome, has_numba, simulate
from swarm_ctl.experiment.hot import compiled, interpreted
from swarm_ctl.experiment.minds import Explorers
from swarm_ctl.experiment.odometry import Odometry
from swarm_ctl.experiment.room import Room
from swarm_ctl.experiment.sweep import run_experiment
from swarm_ctl.explore.explorer import Explorer
from swarm_ctl.explore.kernels import WALL
from swarm_ctl.explore.planner import RANGE_ORDER, PlannerParams

SQUARE = Field((0.0, 0.0), (20.0, 20.0))
ROOMS = Field((0.0, 0.0), (12.0, 9.0), boxes_m=((4.0, 0.0, 4.3, 6.0), (7.0, 5.0, 9.0, 6.5)))
HALL = Field(
    (0.0, 0.0, -4.0),
    (8.0, 8.0, 0.0),
    boxes_m=((3.0, 3.0, -1.0, 5.0, 5.0, 0.0), (6.0, 0.0, -4.0, 6.5, 5.0, -2.0)),  # table, beam
    cell_m=0.25,
)
PLACE = (2.0, 10.0)  # the paper's (10, 2), x being east
WAYS = [False, pytest.param(True, marks=pytest.mark.skipif(not has_numba(), reason="no numba"))]
FLAT = {"kind": "explore", "period_s": 1.0, "avoid_distance_m": 0.35, "stall_distance_m": 0.05}
DEEP = {"kind": "explore", "dimensions": 3, "avoid_distance_m": 0.35}


def case(field: Field = SQUARE, **changes: Any) -> Case:
    params = dict(FLAT if len(field.low_m) == 2 else DEEP)
    params.update({k: changes.pop(k) for k in list(changes) if k in PlannerParams.model_fields})
    settings = {"robots": 4, "steps": 60, "sample_steps": 20} | changes
    return Case(field, PlannerParams.model_validate(params), **settings)


class Flight:
    """One trial, step by step, with a look into the minds."""

    def __init__(self, given: Case) -> None:
        self.batch = batch._Batch(given, Room(given), 1, range(1), interpreted())
        self.start_m = self.batch.position_m
        for _ in range(given.steps):
            self.batch.step()

    @property
    def minds(self) -> Explorers:
        minds = self.batch._minds
        assert isinstance(minds, Explorers)
        return minds

    @property
    def explorers(self) -> list[Explorer]:
        return self.minds._explorers

    def known_of_others(self) -> int:
        """Count the log entries of others that anybody has."""
        sysids = [explorer.trails.sysid for explorer in self.explorers]
        return sum(
            e.trails.length(i) for e in self.explorers for i in sysids if i != e.trails.sysid
        )


def same(one: Outcome, other: Outcome) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("start", [None, PLACE])
def test_a_shared_memory_covers_what_no_memoryless_walk_does(
    start: tuple[float, float] | None,
) -> None:
    """97.5 % in our study (ALGORITHM 2.3: 97.6 and 97.5); two trials of 0.7 points each."""
    outcome = simulate(case(robots=10, steps=600, sample_steps=600, start_m=start), 1, range(2))
    assert 100.0 * outcome.coverage[:, -1].mean() == pytest.approx(97.5, abs=2.5)


def test_the_memoryless_hybrid_covers_a_hall_as_in_our_study() -> None:
    """ALGORITHM 3.3: 90.0 +- 0.8 with the safety filter on, which the engine does not have."""
    hall = Field((0.0, 0.0, -6.0), (20.0, 20.0, 0.0), cell_m=0.25)
    given = case(
        hall, kind="lf-pso", avoid_distance_m=0.75, levy_min_m=2.0, repulsion_max=2.0, robots=10,
        steps=1000, sample_steps=1000, speed_m_s=1.0,
    )  # fmt: skip
    given = replace(given, footprint_m=1.0)
    assert 100.0 * simulate(given, 1, range(8)).coverage.mean() == pytest.approx(91.0, abs=2.0)


LOSSY = case(ROOMS, message_loss=0.3, odometry_drift=0.01, position_noise_m=0.05, failures=1)


@pytest.mark.parametrize("given", [LOSSY, case(HALL, speed_m_s=1.0)], ids=["rooms", "hall"])
def test_a_trial_does_not_depend_on_those_beside_it(
    given: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    together = simulate(given, 3, range(5), tracks=True)
    monkeypatch.setattr(batch, "TOGETHER", 2)
    assert same(together, simulate(given, 3, range(5), tracks=True))
    last = simulate(given, 3, range(4, 5), tracks=True)
    assert np.array_equal(last.tracks_m[0], together.tracks_m[4])
    assert not np.array_equal(together.tracks_m[0], together.tracks_m[4])


@pytest.mark.skipif(not has_numba(), reason="no numba")
@pytest.mark.parametrize("given", [LOSSY, case(HALL, speed_m_s=1.0)], ids=["rooms", "hall"])
@pytest.mark.parametrize("kind", ["explore", "lf-pso"])
def test_compiled_and_interpreted_parts_give_the_same_bits(given: Case, kind: str) -> None:
    params = {"kind": kind, "dimensions": given.dimensions, "period_s": given.planner.period_s}
    given = replace(given, planner=PlannerParams.model_validate(params))
    numpy = simulate(given, 5, range(3), fast=False, tracks=True)
    assert same(numpy, simulate(given, 5, range(3), fast=True, tracks=True))


def test_one_worker_or_two_write_the_same_bytes(tmp_path: Path) -> None:
    world = Path(__file__).resolve().parents[2] / "missions" / "worlds" / "open_2d.yaml"
    path = tmp_path / "short.yaml"
    cell = {"name": "explore", "planner": FLAT, "message_loss": 0.5, "odometry_drift": 0.02}
    keys = {"world": str(world), "vehicles": 3, "duration_s": 20, "failures": 1}
    content = {"trials": 6, "pictures": False, "cells": [cell | keys]}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    for workers in (1, 2):
        run_experiment(path, workers=workers, out=tmp_path / str(workers))
    one, two = ((tmp_path / str(workers) / "trials.csv").read_bytes() for workers in (1, 2))
    assert one == two


def test_who_hears_nothing_learns_nothing() -> None:
    near = case(start_m=PLACE, steps=20)
    deaf = Flight(replace(near, message_loss=1.0))
    assert deaf.known_of_others() == 0
    assert not any(explorer.company for explorer in deaf.explorers)
    half, all_ears = Flight(replace(near, message_loss=0.5)), Flight(near)
    assert 0 < half.known_of_others() <= all_ears.known_of_others()
    assert all(len(explorer.company) == 3 for explorer in all_ears.explorers)
    # beacons alone, with nothing else lost, would pass on more than half of it
    assert (
        Flight(replace(near, message_loss=0.9)).known_of_others() < 0.3 * all_ears.known_of_others()
    )


def test_peers_are_heard_from_where_they_are_give_or_take_the_noise() -> None:
    near = case(start_m=PLACE, steps=1, jitter_m=0.3)
    exact, noisy = Flight(near), Flight(replace(near, position_noise_m=0.05))
    for flight, least, most in ((exact, 0.0, 1e-9), (noisy, 1e-3, 0.3)):
        place_m = flight.batch.position_m
        own = flight.explorers[0].company._peers[2][1:3]
        error = np.array(own) - (place_m[1] - flight.start_m[0])
        assert least <= np.abs(error).max() <= most


def test_odometry_without_drift_is_exact_and_with_drift_it_is_not() -> None:
    given = case(ROOMS, steps=100)
    for drift, least, most in ((0.0, 0.0, 1e-9), (0.02, 0.01, 2.0)):
        flight = Flight(replace(given, odometry_drift=drift))
        true_m = flight.batch.position_m - flight.start_m
        error_m = np.abs(flight.minds._odometry.position_m - true_m).max(axis=1)
        assert (error_m >= least).all()
        assert (error_m <= most).all()


def test_odometry_loses_its_heading_and_its_way_but_not_its_height() -> None:
    """1 % over 10 m: 1 degree of heading, and 0.1 m of bias in the direction that it turns to."""
    odometry = Odometry(0.01, 3, [(1, robot) for robot in range(500)])
    for _ in range(100):
        odometry.move(np.tile([0.1, 0.0, -0.02], (500, 1)))
    assert np.degrees(odometry._turn_rad).std() == pytest.approx(1.0, rel=0.1)
    error_m = odometry.position_m - [10.0, 0.0, -2.0]
    assert np.abs(error_m[:, 2]).max() < 1e-9
    assert np.abs(error_m[:, :2].mean(axis=0)).max() < 0.03
    assert np.hypot(*error_m[:, :2].T).mean() == pytest.approx(0.14, abs=0.03)


@pytest.mark.parametrize("kind", ["explore", "lf-pso"])
def test_who_fails_stays_where_it_is_and_is_not_heard(kind: str) -> None:
    given = case(ROOMS, kind=kind, robots=5, steps=80, failures=2)
    tracks = simulate(given, 1, range(6), tracks=True).tracks_m
    moved = np.asarray(np.diff(tracks, axis=1).any(axis=3))
    last = moved.shape[1] - moved[:, ::-1].argmax(axis=1)
    failed = last < 70  # who lives is never still for so long
    assert failed.sum(axis=1).tolist() == [2] * 6
    assert last[failed].min() >= 8
    assert last[failed].max() <= 60
    assert len({tuple(who) for who in failed.tolist()}) > 1  # each trial draws its own
    flight = Flight(replace(given, field=SQUARE, start_m=PLACE, speed_m_s=1e-6, jitter_m=0.1))
    heard = np.isfinite(flight.batch._peers_m[:, :, 0])
    alive = flight.batch._alive
    assert np.array_equal(heard, alive[:, None] & alive[None, :] & ~np.eye(5, dtype=bool))


def test_the_memory_sees_walls_that_table_i_does_not() -> None:
    """A robot 2.5 m from three walls: the beams of 3 m show them, those of 1 m nothing."""
    room = Field((0.0, 0.0), (5.0, 5.0))
    still = case(room, robots=1, steps=2, start_m=(2.5, 2.5), speed_m_s=1e-6, jitter_m=0.0)
    for beam_m, hit in ((3.0, 3), (None, 0)):
        grid = Flight(replace(still, beam_m=beam_m)).explorers[0].memory.grid
        assert np.count_nonzero(grid & WALL) == hit


@pytest.mark.parametrize("fast", WAYS)
def test_level_beams_pass_over_a_table_and_under_a_beam(fast: bool) -> None:
    tools = compiled() if fast else interpreted()
    place = np.array([[4.0, 2.0, -0.5], [4.0, 2.0, -1.5], [4.0, 4.0, -3.0], [4.0, 4.0, -1.5]])
    heading = np.array([math.pi / 2, math.pi / 2, 0.0, 0.0])  # east, east, north, north
    boxes = case(HALL).boxes
    cast = tools.cast(place, np.cos(heading), np.sin(heading), HALL.low_m, HALL.high_m, boxes)
    front_left_right = [[1.0, 4.0, 4.0], [6.0, 4.0, 4.0], [2.0, 4.0, 4.0], [4.0, 4.0, 4.0]]
    assert cast == pytest.approx(np.array(front_left_right))


def test_beams_up_and_down_meet_ceiling_floor_and_what_is_between() -> None:
    place = np.array([[1.0, 1.0, -1.5], [4.0, 4.0, -1.5], [6.2, 2.0, -1.5], [6.2, 6.0, -1.5]])
    up, down = walls.plumb(place, HALL.low_m, HALL.high_m, case(HALL).boxes)
    assert up.tolist() == [2.5, 2.5, 0.5, 2.5]  # the third is under the beam
    assert down.tolist() == [1.5, 0.5, 1.5, 1.5]  # the second over the table
    empty = replace(HALL, boxes_m=())
    up, down = walls.plumb(place, HALL.low_m, HALL.high_m, case(empty).boxes)
    assert (up.tolist(), down.tolist()) == ([2.5] * 4, [1.5] * 4)


def test_sensors_look_in_the_order_of_the_ranges() -> None:
    still = case(
        HALL, kind="lf-pso", avoid_distance_m=1.2, robots=1, start_m=(1.0, 1.0), jitter_m=0.0,
        start_height_m=0.5,
    )  # fmt: skip
    flight = batch._Batch(still, Room(still), 1, range(1), interpreted())
    flight._heading_rad[:] = math.pi  # south
    ranges = dict(zip(RANGE_ORDER, flight._sense()[0].tolist(), strict=True))
    assert ranges["front"] == pytest.approx(1.0)
    assert ranges["right"] == pytest.approx(1.0)
    assert ranges["back"] == math.inf
    assert (ranges["up"], ranges["down"]) == (3.5, 0.5)


@pytest.mark.parametrize("fast", WAYS)
def test_a_vehicle_covers_the_voxels_within_its_sphere(fast: bool) -> None:
    for place_m in ((3.3, 4.1, -2.05), (0.4, 0.5, -0.5), (3.375, 4.125, -2.125)):
        still = case(
            replace(HALL, boxes_m=()), robots=1, steps=1, sample_steps=1, start_m=place_m[:2],
            start_height_m=-place_m[2], jitter_m=0.0, speed_m_s=1e-9,
        )  # fmt: skip
        axes = [low + (np.arange(n) + 0.5) * 0.25 for low, n in ((0, 32), (0, 32), (-4, 16))]
        north, east, down = np.meshgrid(*axes, indexing="ij")
        far2 = (north - place_m[0]) ** 2 + (east - place_m[1]) ** 2 + (down - place_m[2]) ** 2
        share = simulate(replace(still, footprint_m=1.0), 1, range(2), fast=fast).coverage
        assert share == pytest.approx(np.full((2, 1), (far2 <= 1.0).mean()), abs=1e-12)


def test_vehicles_stay_inside_the_hall_and_out_of_what_stands_in_it() -> None:
    given = case(HALL, kind="levy", avoid_distance_m=0.35, speed_m_s=1.0, steps=600, robots=6)
    outcome = simulate(given, 1, range(6), tracks=True)
    north, east, down = np.moveaxis(outcome.tracks_m, -1, 0)
    for along, low, high in ((north, 0.3, 7.7), (east, 0.3, 7.7), (down, -3.7, -0.3)):
        assert along.min() >= low
        assert along.max() <= high
    for box in given.boxes:
        low, high = box[:3] - 0.299, box[3:] + 0.299
        inside = (outcome.tracks_m > low) & (outcome.tracks_m < high)
        assert not inside.all(axis=3).any()
    assert outcome.bumps.sum() > 0
    over_the_table = (abs(north - 4.0) < 1.0) & (abs(east - 4.0) < 1.0)
    assert over_the_table.any()


def test_in_three_dimensions_chains_and_contacts_count_the_height() -> None:
    line = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.9], [0.0, 0.0, -3.8]])[None]
    for tools in [interpreted(), *([compiled()] if has_numba() else [])]:
        for is_chained, heard in ((True, [2, 2, 2]), (False, [1, 2, 1])):
            peers, touching = np.zeros((1, 3, 3, 3)), np.zeros((1, 3, 3), dtype=bool)
            contacts = np.zeros(1, dtype=np.int64)
            tools.meet(line, 4.0, 0.36, peers, touching, contacts, is_chained)
            assert np.isfinite(peers[0, :, :, 0]).sum(axis=1).tolist() == heard
            assert peers[0, 0, 1].tolist() == [0.0, 0.0, -1.9]
            assert contacts.tolist() == [0]
