import math
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.explore import kernels
from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.explorer import Explorer
from swarm_ctl.explore.one import make_planner
from swarm_ctl.explore.planner import Plan, Planner, PlannerParams

SIDE_M = 8.0
NOBODY = np.zeros((1, 0, 2))
CLEAR = np.full((1, 6), np.inf)


def paper_params(**changes: Any) -> PlannerParams:
    values: dict[str, Any] = {
        "kind": "explore",
        "period_s": 1.0,
        "avoid_distance_m": 0.35,
        "avoid_speed_fraction": 1.0,
        "stall_distance_m": 0.05,
    }
    return PlannerParams(**{**values, **changes})


class Field:
    """A walled square and vehicles in it, each with a frame of its own; nothing has dynamics."""

    def __init__(
        self, vehicles: int, seed: int = 1, *, hears: bool = True, speed: float = 0.2
    ) -> None:
        chance = np.random.default_rng(seed)
        self.start = chance.uniform(0.3, SIDE_M - 0.3, (vehicles, 2))
        self.place = self.start.copy()
        self.heading = np.zeros(vehicles)
        self.seen = np.zeros((80, 80), dtype=np.bool_)
        self.hears = hears
        self.speed = speed
        self.explorers = [
            Explorer(paper_params(), speed_m_s=speed, climb_m_s=speed, seed=[seed, i], sysid=i + 1)
            for i in range(vehicles)
        ]

    def fly(self, seconds: int) -> float:
        for now in range(seconds):
            for index in range(len(self.explorers)):
                self.step(index)
            if self.hears:
                self.talk(float(now))
        return 100.0 * float(self.seen.mean())

    def step(self, i: int) -> None:
        own = self.place[i] - self.start[i]
        turns = self.heading[i] + np.array([0.0, -math.pi / 2, math.pi / 2])
        units = np.stack([np.cos(turns), np.sin(turns)], axis=1) + 1e-12
        beams = (np.where(units > 0.0, SIDE_M - self.place[i], -self.place[i]) / units).min(axis=1)
        beams[beams > 1.0] = np.inf
        ranges = CLEAR.copy()
        ranges[0, [0, 2, 3]] = beams
        peers = np.array([p - self.place[i] for p in self.place[self.near(i)]]).reshape(1, -1, 2)
        plan = self.explorers[i].step(own[None], self.heading[i : i + 1], ranges, peers)
        hit = np.isfinite(beams)
        self.explorers[i].observe_hits(own + beams[hit, None] * units[hit])
        self.place[i] = np.clip(self.place[i] + plan.velocity_m_s[0], 0.3, SIDE_M - 0.3)
        self.heading[i] = plan.heading_rad[0]
        low, high = (
            np.ceil((self.place[i] + side) * 10.0 - 0.501).astype(int) for side in (-0.3, 0.3)
        )
        self.seen[max(0, low[0]) : high[0], max(0, low[1]) : high[1]] = True

    def near(self, i: int) -> list[int]:
        return [
            j
            for j, place in enumerate(self.place)
            if j != i and math.dist(place, self.place[i]) < 2.0
        ]

    def talk(self, now: float) -> None:
        for i, explorer in enumerate(self.explorers):
            for j in self.near(i):
                explorer.hear_peer(
                    j + 1,
                    now,
                    (self.place[j] - self.place[i]).tolist(),
                    (self.place[j] - self.start[j]).tolist(),
                    self.explorers[j].target_m,
                    own_position_m=(self.place[i] - self.start[i]).tolist(),
                )
                explorer.hear_summary(j + 1, self.explorers[j].summary())
        for i, explorer in enumerate(self.explorers):
            for payload in explorer.outbox(10):
                for j in self.near(i):
                    self.explorers[j].hear_chunk(i + 1, payload)


def lone(**changes: Any) -> Explorer:
    return Explorer(paper_params(**changes), speed_m_s=0.2, climb_m_s=0.2, seed=3, sysid=1)


def step(explorer: Explorer, place: Floats, heading: float = 0.0, front: float = math.inf) -> Plan:
    ranges = CLEAR.copy()
    ranges[0, 0] = front
    return explorer.step(place[None], np.array([heading]), ranges, NOBODY)


def test_two_vehicles_cover_a_room_and_each_knows_it() -> None:
    """64 m2 at 0.24 m2/s take 267 s without any overlap; measured 99.5 to 99.9 at 500 s."""
    covered = [Field(2, seed).fly(500) for seed in (1, 2, 3)]
    assert min(covered) > 98.0


def test_what_is_told_is_not_searched_again() -> None:
    told = np.mean([Field(3, seed).fly(150) for seed in (1, 2, 3, 4)])
    silent = np.mean([Field(3, seed, hears=False).fly(150) for seed in (1, 2, 3, 4)])
    assert told > silent + 3.0


def test_a_flight_repeats_bit_for_bit() -> None:
    one, other = Field(3, 7), Field(3, 7)
    one.fly(120)
    other.fly(120)
    assert one.place.tobytes() == other.place.tobytes()
    assert one.explorers[0].memory.grid.tobytes() == other.explorers[0].memory.grid.tobytes()


def test_a_step_over_ground_that_became_known_ends_early() -> None:
    explorer, place = lone(), np.zeros(2)
    plan = step(explorer, place)
    for _ in range(3):
        place = place + plan.velocity_m_s[0]
        plan = step(explorer, place)
        assert not plan.is_new[0]
    target = plan.target_m[0]
    far = place + 3.0 * (target - place)
    side = 0.5 * np.array([target[1] - place[1], place[0] - target[0]])
    for offset in (-1.0, -0.6, -0.3, 0.0, 0.3, 0.6, 1.0):
        lane = offset * side / np.hypot(*side)
        explorer.memory.sweep(place + lane, far + lane)
    plan = step(explorer, place + plan.velocity_m_s[0])
    assert plan.is_new[0]
    assert math.dist(plan.target_m[0], target) > 0.5


def test_the_strip_a_peer_is_about_to_fly_is_left_to_it_for_a_while() -> None:
    def heading_deg(heard_s: float | None) -> float:
        explorer = lone(peer_weight=0.0, social=0.0)
        step(explorer, np.zeros(2))
        for x in range(1, 40):  # seven of the eight headings lead over known ground
            for turn in range(1, 8):
                angle = turn * math.pi / 4.0
                explorer.memory.sweep(
                    [0.0, 0.0], [0.2 * x * math.cos(angle), 0.2 * x * math.sin(angle)]
                )
        if heard_s is not None:
            explorer.hear_peer(2, 1.0, [0.7, 0.0], [0.0, 0.0], [9.0, 0.0])
            explorer.hear_summary(2, b"\x01")
            explorer._now += heard_s
        explorer.decide()
        assert explorer.target_m is not None
        return math.degrees(math.atan2(explorer.target_m[1], explorer.target_m[0]))

    assert abs(heading_deg(None)) < 1.0
    assert abs(heading_deg(5.0)) > 10.0
    assert abs(heading_deg(61.0)) < 1.0


def test_a_front_beam_that_the_map_explains_is_left_to_the_map() -> None:
    explorer = lone(avoid_distance_m=0.9)
    step(explorer, np.zeros(2))
    assert step(explorer, np.zeros(2), front=0.6).avoiding[0]
    explorer = lone(avoid_distance_m=0.9)
    step(explorer, np.zeros(2))
    explorer.observe_hits(np.array([[0.6, 0.0]]))
    plan = step(explorer, np.zeros(2), front=0.6)
    assert not plan.avoiding[0]
    assert plan.velocity_m_s[0, 0] < 0.1


def test_a_vehicle_that_is_held_up_by_what_it_cannot_see_goes_elsewhere() -> None:
    explorer = lone()
    directions = set()
    for _ in range(40):
        plan = step(explorer, np.zeros(2))
        directions.add(round(math.degrees(plan.heading_rad[0]) / 45.0) % 8)
    assert len(directions) > 3


def test_a_vehicle_that_knows_everything_still_moves() -> None:
    explorer, place = lone(), np.zeros(2)
    step(explorer, place)
    explorer.memory.grid[:] = 1
    far = 0.0
    for _ in range(30):
        plan = step(explorer, place)
        place = place + plan.velocity_m_s[0]
        far += math.hypot(*plan.velocity_m_s[0])
    assert far > 3.0


@given(st.lists(st.floats(-50.0, 50.0), min_size=30, max_size=30), st.sampled_from([2, 3]))
@settings(max_examples=30, deadline=None)
def test_no_plan_is_faster_than_the_vehicle(numbers: list[float], d: int) -> None:
    params = paper_params(dimensions=d, cell_m=0.5, footprint_m=1.0, footprint_shape="disc")
    explorer = Explorer(params, speed_m_s=1.0, climb_m_s=0.5, seed=1, sysid=1)
    for at in range(0, 30, d):
        place = np.array([numbers[at : at + d]])
        plan = explorer.step(place, np.zeros(1), CLEAR, np.zeros((1, 0, d)))
        assert math.hypot(*plan.velocity_m_s[0, :2]) <= 1.0 + 1e-9
        assert d == 2 or abs(plan.velocity_m_s[0, 2]) <= 0.5 + 1e-9
        assert plan.target_m.shape == (1, d)


def test_lengths_follow_the_footprint() -> None:
    paper, flight = paper_params(), paper_params(footprint_m=0.9)
    assert (paper.levy_min_m, paper.levy_max_m) == pytest.approx((2.0, 5.0))
    assert (flight.levy_min_m, flight.levy_max_m) == pytest.approx((6.0, 15.0))
    assert paper_params(levy_min_m=1.0).levy_min_m == 1.0
    assert PlannerParams().social == 2.0
    hall = PlannerParams(kind="explore", dimensions=3, candidates=12)
    assert (hall.levy_min_m, hall.levy_max_m, hall.cell_m) == pytest.approx((1.0, 6.0, 0.5))
    assert (hall.candidates, hall.footprint_shape) == (12, "disc")


def test_the_factory_builds_what_the_mission_asks_for() -> None:
    plain = make_planner(PlannerParams(), speed_m_s=1.0, climb_m_s=1.0, seeds=[1])
    clever = make_planner(paper_params(), speed_m_s=1.0, climb_m_s=1.0, seeds=[1], sysid=4)
    assert isinstance(plain, Planner)
    assert isinstance(clever, Explorer)
    with pytest.raises(ValueError, match="one vehicle"):
        make_planner(paper_params(), speed_m_s=1.0, climb_m_s=1.0, seeds=[1, 2])
    with pytest.raises(ValueError, match="make_planner"):
        Planner(paper_params(), speed_m_s=1.0, climb_m_s=1.0, seeds=[1])
    with pytest.raises(ValueError, match="has no memory"):
        Explorer(PlannerParams(), speed_m_s=1.0, climb_m_s=1.0, seed=1)
    with pytest.raises(ValueError, match="one vehicle in 2-D"):
        clever.step(np.zeros((2, 2)), np.zeros(2), np.zeros((2, 6)), np.zeros((2, 0, 2)))


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_contact_that_makes_no_sense_is_none(value: float) -> None:
    explorer = lone()
    step(explorer, np.zeros(2))
    explorer.hear_peer(2, 1.0, (value, 0.0), (0.0, 0.0))
    explorer.observe_hits(np.array([[value, 0.0]]))
    assert explorer.trails.length(2) == 0
    assert explorer.outbox(5) == []


FLOWN_WARM = """
import sys
from pathlib import Path
from swarm_ctl.experiment.arena import Arena
from swarm_ctl.explore import kernels
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.mission import load_mission
from swarm_ctl.record.unrecorded import Unrecorded

loops = {loop for loop in vars(kernels).values() if hasattr(loop, "signatures")}
mission = load_mission(Path(sys.argv[1]), vehicles=4, planner="explore")
if sys.argv[2] == "defaults":
    planner = PlannerParams(kind="explore", dimensions=mission.planner.dimensions)
    mission = mission.model_copy(update={"planner": planner})
arena = Arena(mission, Unrecorded())
before = {loop: len(loop.signatures) for loop in loops}
arena.fly(until_s=60.0)
late = {loop.__name__ for loop in loops if len(loop.signatures) != before[loop] or not before[loop]}
print(len(loops), "loops,", "late:", *late - {"in_swept_square", "is_passable"})  # parts of others
"""


@pytest.mark.skipif(not kernels.IS_COMPILED, reason="numba is not installed")
@pytest.mark.parametrize("planner", ["its own", "defaults"])
@pytest.mark.parametrize("mission", ["usar_office", "open_3d"])
def test_after_warming_up_nothing_is_compiled_in_flight(mission: str, planner: str) -> None:
    missions = Path(__file__).parents[2] / "missions"
    flown = subprocess.run(  # a process of its own: what others have flown is compiled here
        [sys.executable, "-c", FLOWN_WARM, missions / f"{mission}.yaml", planner],
        capture_output=True,
        text=True,
        check=True,
    )
    assert re.fullmatch(r"[1-9]\d loops, late:\n", flown.stdout)
