import math
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.planner import Plan, Planner, PlannerParams

NAN = float("nan")
Kind = Literal["lf-pso", "levy", "pso"]
KINDS: tuple[Kind, ...] = ("lf-pso", "levy", "pso")


class Flight:
    """Vehicles that go exactly where their planner says, in a world that a test may disturb."""

    def __init__(self, vehicles: int = 1, *, speed_m_s: float = 1.0, **params: Any) -> None:
        self.params = PlannerParams(**params)
        self.planner = Planner(
            self.params, speed_m_s=speed_m_s, climb_m_s=0.5, seeds=[[9, i] for i in range(vehicles)]
        )
        self.position_m = np.zeros((vehicles, self.params.dimensions))
        self.heading_rad = np.zeros(vehicles)

    def step(
        self, *, wall: str = "", peer: tuple[float, ...] | None = None, held: bool = False
    ) -> Plan:
        n, d = self.position_m.shape
        ranges_m = np.full((n, 6), np.inf)
        if wall:
            ranges_m[:, ("front", "back", "left", "right", "up", "down").index(wall)] = 0.5
        peers_m = np.empty((n, 0, d)) if peer is None else np.tile(peer, (n, 1, 1))
        plan = self.planner.step(self.position_m, self.heading_rad, ranges_m, peers_m)
        if not held:
            self.position_m = self.position_m + plan.velocity_m_s * self.params.period_s
        self.heading_rad = plan.heading_rad
        return plan

    def local_best(self, plan: Plan, came_from: Floats) -> Floats:
        return plan.target_m - came_from


def recorded_world(steps: int, vehicles: int, dimensions: int) -> list[tuple[Floats, Floats]]:
    chance = np.random.default_rng(3)
    world = []
    for _ in range(steps):
        ranges_m = np.where(chance.random((vehicles, 6)) < 0.1, 0.5, np.inf)
        peers_m = chance.normal(0.0, 2.0, (vehicles, 3, dimensions))
        peers_m[chance.random((vehicles, 3)) < 0.7] = NAN
        world.append((ranges_m, peers_m))
    return world


def fly(planner: Planner, world: list[tuple[Floats, Floats]], rows: slice, d: int) -> Floats:
    position_m = np.zeros((len(range(10)[rows]), d))
    heading_rad = np.zeros(len(position_m))
    track = []
    for ranges_m, peers_m in world:
        plan = planner.step(position_m, heading_rad, ranges_m[rows], peers_m[rows])
        position_m = position_m + plan.velocity_m_s * planner.params.period_s
        heading_rad = plan.heading_rad
        track.append(np.column_stack([position_m, heading_rad, plan.avoiding, plan.target_m]))
    return np.array(track)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_vehicle_flies_alone_as_it_does_in_a_batch(kind: Kind, dimensions: Literal[2, 3]) -> None:
    params = PlannerParams(kind=kind, dimensions=dimensions, levy_min_m=0.5)
    world = recorded_world(300, 10, dimensions)

    def planner(seeds: list[int]) -> Planner:
        return Planner(params, speed_m_s=1.0, climb_m_s=0.5, seeds=seeds)

    batch = fly(planner(list(range(10))), world, slice(0, 10), dimensions)
    for row in range(10):
        alone = fly(planner([row]), world, slice(row, row + 1), dimensions)
        assert (alone[:, 0] == batch[:, row]).all()
    assert (batch[:, 0] != batch[:, 1]).any()


@settings(derandomize=True, max_examples=40)
@given(
    st.sampled_from(KINDS),
    st.sampled_from([2, 3]),
    st.floats(0.05, 5.0),
    st.floats(0.05, 3.0),
    st.floats(0.05, 1.5),
)
def test_no_plan_exceeds_the_speeds(
    kind: Kind, dimensions: Literal[2, 3], speed_m_s: float, climb_m_s: float, period_s: float
) -> None:
    params = PlannerParams(kind=kind, dimensions=dimensions, period_s=period_s)
    planner = Planner(params, speed_m_s=speed_m_s, climb_m_s=climb_m_s, seeds=range(10))
    position_m, heading_rad = np.zeros((10, dimensions)), np.zeros(10)
    for ranges_m, peers_m in recorded_world(15, 10, dimensions):
        plan = planner.step(position_m, heading_rad, ranges_m, peers_m)
        ground = np.hypot(plan.velocity_m_s[:, 0], plan.velocity_m_s[:, 1])
        assert ground.max() <= speed_m_s * (1.0 + 1e-9)
        assert np.abs(plan.velocity_m_s[:, 2:]).max(initial=0.0) <= climb_m_s * (1.0 + 1e-9)
        faced = plan.heading_rad[ground > 0.05 * speed_m_s * (1.0 + 1e-9)]
        flown = np.arctan2(plan.velocity_m_s[:, 1], plan.velocity_m_s[:, 0])
        assert faced == pytest.approx(flown[ground > 0.05 * speed_m_s * (1.0 + 1e-9)])
        position_m, heading_rad = position_m + plan.velocity_m_s * period_s, plan.heading_rad


def test_a_vehicle_starts_along_its_local_best() -> None:
    flight = Flight(200, dimensions=3, levy_min_m=2.0)
    plan = flight.step()
    fast = np.linalg.norm(plan.velocity_m_s, axis=1) > 0.1
    bearing_rad = np.arctan2(plan.target_m[:, 1], plan.target_m[:, 0])
    assert fast.mean() > 0.9
    assert plan.heading_rad[fast] == pytest.approx(bearing_rad[fast])
    climb = -plan.target_m[:, 2] / np.linalg.norm(plan.target_m, axis=1)
    assert np.abs(climb).max() <= 0.5 + 1e-9  # 30 degrees


def test_a_step_is_flown_to_its_length_before_the_next() -> None:
    flight = Flight(levy_min_m=2.0, levy_max_m=2.0)
    path_m, came_from = 0.0, flight.position_m
    first = flight.local_best(flight.step(), came_from)
    while True:
        path_m += float(np.linalg.norm(flight.position_m - came_from))
        came_from = flight.position_m
        if flight.local_best(flight.step(), came_from) != pytest.approx(first):
            break
    assert 2.0 <= path_m <= 2.0 + 0.3


def test_the_path_of_an_avoidance_does_not_count() -> None:
    flight = Flight(levy_min_m=2.0, levy_max_m=2.0)
    for _ in range(30):  # 6.3 m along walls
        flight.step(wall="front")
    released_at = flight.position_m
    released = flight.local_best(flight.step(), released_at)
    flown = flight.position_m
    for _ in range(5):
        assert flight.local_best(flight.step(), flown) == pytest.approx(released)
        flown = flight.position_m


def test_after_an_avoidance_the_step_goes_on_along_the_turned_heading() -> None:
    flight = Flight(levy_min_m=3.0, levy_max_m=3.0)
    flight.heading_rad = np.array([0.4])
    avoiding = flight.step(wall="left")
    assert avoiding.avoiding[0]
    assert avoiding.heading_rad[0] == pytest.approx(0.4 + math.pi / 2)
    came_from = flight.position_m
    clear = flight.step()
    assert not clear.avoiding[0]
    turned = 3.0 * np.array([math.cos(0.4 + math.pi / 2), math.sin(0.4 + math.pi / 2)])
    assert flight.local_best(clear, came_from)[0] == pytest.approx(turned)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_peer_in_the_north_pushes_south(dimensions: Literal[2, 3]) -> None:
    flight = Flight(100, dimensions=dimensions, cognitive=0.0)
    peer = (0.5, 0.0) if dimensions == 2 else (0.5, 0.0, 0.0)
    plan = flight.step(peer=peer)
    assert (plan.velocity_m_s[:, 0] < 0.0).all()
    assert plan.velocity_m_s[:, 1:] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("kind", "keep", "goes_on"),
    [("lf-pso", True, True), ("lf-pso", False, False), ("pso", True, False)],
)
def test_the_push_outlives_its_contact_if_it_is_kept(kind: Kind, keep: bool, goes_on: bool) -> None:
    flight = Flight(kind=kind, keep_repulsion=keep, cognitive=0.0)
    flight.step(peer=(1.0, 0.0))
    speeds = [float(np.linalg.norm(flight.step().velocity_m_s)) for _ in range(40)]
    assert (max(speeds[-10:]) > 0.5) == goes_on
    assert flight.position_m[0, 0] < 0.0


def test_levy_vehicles_take_no_notice_of_peers() -> None:
    alone, met = Flight(kind="levy"), Flight(kind="levy")
    for _ in range(50):
        alone.step()
        met.step(peer=(0.3, 0.1))
    assert (alone.position_m == met.position_m).all()


def test_steps_of_kind_pso_are_short() -> None:
    flight = Flight(500, kind="pso")
    came_from = flight.position_m
    length_m = np.linalg.norm(flight.local_best(flight.step(), came_from), axis=1)
    assert length_m.max() <= 1.25
    assert length_m.mean() == pytest.approx(0.625, abs=0.05)


def test_a_slow_vehicle_keeps_facing_where_it_did() -> None:
    flight = Flight(cognitive=0.0)
    flight.heading_rad = np.array([1.2])
    assert flight.step().heading_rad[0] == 1.2
    flight.step(wall="right")
    for _ in range(20):
        plan = flight.step()
    assert plan.heading_rad[0] == pytest.approx(1.2 - math.pi / 2)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_vehicle_that_is_held_turns_away(dimensions: Literal[2, 3]) -> None:
    flight = Flight(100, dimensions=dimensions, levy_min_m=5.0)
    tries = [flight.step(held=True) for _ in range(5)]  # 1.2 s, and the step that notices
    before, after = tries[3].velocity_m_s, tries[4].velocity_m_s
    assert (tries[3].target_m == tries[0].target_m).all()
    towards = (before * tries[4].target_m).sum(axis=1)
    assert (towards <= 0.0).all()
    assert ((before * after).sum(axis=1) <= 1e-9).mean() > 0.85  # rand bends some


def test_a_held_vehicle_forgets_the_peer_that_pushed_it_into_the_wall() -> None:
    flight = Flight(cognitive=0.0)
    flight.step(peer=(1.0, 0.0), held=True)
    for _ in range(3):
        assert flight.step(held=True).velocity_m_s[0, 0] < -0.1
    assert flight.step(held=True).velocity_m_s[0, 0] == 0.0


def test_a_vehicle_that_moves_never_stalls_and_nor_does_the_papers_robot() -> None:
    free = Flight(20, levy_min_m=20.0)
    papers = Flight(20, levy_min_m=20.0, period_s=1.0, speed_m_s=0.2)
    for flight, held in ((free, False), (papers, True)):
        came_from = flight.position_m
        first = flight.local_best(flight.step(held=held), came_from)
        for _ in range(30):
            came_from = flight.position_m
            assert flight.local_best(flight.step(held=held), came_from) == pytest.approx(first)


def test_a_stall_breaks_the_hold_of_a_heading_that_is_never_reached() -> None:
    planner = Planner(PlannerParams(), speed_m_s=1.0, climb_m_s=0.5, seeds=[0])
    ranges_m = np.full((1, 6), np.inf)
    ranges_m[0, 3] = 0.5  # a wall at its right: turn left, to the west
    nobody = np.empty((1, 0, 2))
    for heading_rad, faced in ((0.0, -90), (0.5, -90), (0.5, -90), (0.5, -90), (0.5, -61)):
        plan = planner.step(np.zeros((1, 2)), np.array([heading_rad]), ranges_m, nobody)
        assert round(math.degrees(plan.heading_rad[0])) == faced


def test_equal_seeds_repeat_and_others_differ() -> None:
    def track(seed: int) -> Floats:
        planner = Planner(PlannerParams(), speed_m_s=1.0, climb_m_s=0.5, seeds=[seed])
        return fly(planner, recorded_world(50, 10, 2), slice(0, 1), 2)

    assert (track(1) == track(1)).all()
    assert (track(1) != track(2)).any()


def test_a_planner_leaves_its_inputs_alone() -> None:
    inputs = (np.ones((2, 2)), np.ones(2), np.full((2, 6), 0.5), np.full((2, 1, 2), 0.5))
    copies = [array.copy() for array in inputs]
    planner = Planner(PlannerParams(), speed_m_s=1.0, climb_m_s=0.5, seeds=[0, 1])
    for _ in range(5):
        planner.step(*inputs)
    assert all((array == copy).all() for array, copy in zip(inputs, copies, strict=True))


@pytest.mark.parametrize(
    "wrong",
    [
        {"period_s": 0.0},
        {"levy_min_m": -1.0},
        {"levy_min_m": 5.0, "levy_max_m": 2.0},
        {"levy_beta": 0.0},
        {"inertia": 1.0},
        {"dimensions": 4},
        {"kind": "snake"},
        {"avoid_speed_fraction": 1.5},
        {"repulsion_max": 0.0},
        {"period_s": NAN},
        {"unknown": 1},
    ],
)
def test_parameters_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        PlannerParams(**wrong)


def test_every_parameter_is_documented() -> None:
    assert all(field.description for field in PlannerParams.model_fields.values())


@pytest.mark.parametrize(("dimensions", "speed", "climb"), [(2, 0.0, 1.0), (3, 1.0, 0.0)])
def test_a_planner_needs_speed(dimensions: Literal[2, 3], speed: float, climb: float) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        Planner(PlannerParams(dimensions=dimensions), speed_m_s=speed, climb_m_s=climb, seeds=[0])


@pytest.mark.parametrize("wrong", range(4))
def test_arrays_of_other_shapes_are_refused(wrong: int) -> None:
    inputs = [np.zeros((2, 2)), np.zeros(2), np.ones((2, 6)), np.zeros((2, 1, 2))]
    inputs[wrong] = inputs[wrong][:1]
    planner = Planner(PlannerParams(), speed_m_s=1.0, climb_m_s=0.5, seeds=[0, 1])
    with pytest.raises(ValueError, match="2 vehicles in 2-D"):
        planner.step(*inputs)
