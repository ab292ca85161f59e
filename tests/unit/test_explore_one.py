"""What is worked out for one vehicle with plain numbers is what the arrays give."""

import numpy as np
import pytest

from swarm_ctl.explore import kernels
from swarm_ctl.explore.chance import Chance
from swarm_ctl.explore.explorer import Explorer
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.explore.pso import fly, fly_one
from swarm_ctl.explore.repulsion import FEW, repel, repulsion
from swarm_ctl.explore.swath import Swath

BOTH = np.arange(2, dtype=np.intp)


def test_a_draw_for_one_vehicle_deals_the_same_numbers() -> None:
    arrays, plain = Chance([7, 8]), Chance([7])
    counts = np.random.default_rng(1).integers(1, 60, 100).tolist()
    for count in counts:
        expected = arrays.uniform(BOTH, count)[0].tolist()
        assert plain.draw(0, count) == expected
    assert plain.uniform(BOTH[:1], 5).tolist() == arrays.uniform(BOTH, 5)[:1].tolist()


@pytest.mark.parametrize("d", [2, 3])
def test_one_vehicle_flies_as_one_among_arrays(d: int) -> None:
    chance = np.random.default_rng(d)
    weights = (0.6, 2.0, 0.5)
    for _ in range(2000):
        motion, best, away = chance.normal(0.0, 1.0, (3, d))
        numbers = chance.random(2)
        expected, _ = fly(motion[None], best[None], away[None], numbers[None], weights, 0.3, 0.2)
        plain = fly_one(
            motion.tolist(), best.tolist(), away.tolist(), numbers.tolist(), weights, 0.3, 0.2
        )
        assert plain == expected[0].tolist()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_is_no_number_shows_in_all_of_a_motion(axis: int) -> None:
    motion = [0.1, 0.1, 0.1]
    motion[axis] = np.nan
    still = [0.0, 0.0, 0.0]
    plain = fly_one(motion, still, still, [0.5, 0.5], (0.6, 2.0, 0.0), 0.3, 0.2)
    expected, _ = fly(
        np.array([motion]), np.array([still]), np.array([still]), np.full((1, 2), 0.5),
        (0.6, 2.0, 0.0), 0.3, 0.2,
    )  # fmt: skip
    assert plain == pytest.approx(expected[0].tolist(), nan_ok=True)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("longest_m", [None, 2.0])
def test_peers_repel_one_vehicle_as_they_do_among_arrays(d: int, longest_m: float | None) -> None:
    chance = np.random.default_rng(d)
    for count in list(range(1, FEW + 3)) * 50:
        peers = chance.normal(0.0, 3.0, (count, d))
        peers[chance.random(count) < 0.2] = np.nan
        expected, _ = repulsion(peers[None], 0.8, longest_m)
        assert repel(peers.tolist(), 0.8, longest_m) == pytest.approx(
            expected[0].tolist(), rel=1e-12
        )


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("is_compiled", [kernels.IS_COMPILED, False])
def test_the_lanes_of_one_direction_are_those_of_many(
    d: int, is_compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernels, "IS_COMPILED", is_compiled)
    swath = Swath(PlannerParams(kind="explore", dimensions=d))
    directions = np.random.default_rng(d).normal(0.0, 1.0, (500, 3))
    for direction, lanes in zip(directions, swath.lanes(directions), strict=True):
        assert (swath._lanes_across(*direction.tolist())[0] == lanes).all()


@pytest.mark.parametrize("d", [2, 3])
def test_the_table_need_not_be_asked_where_it_has_nothing_to_say(
    d: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    params = PlannerParams(kind="explore", dimensions=d)
    asking, quick = (Explorer(params, speed_m_s=1.0, climb_m_s=1.0, seed=3) for _ in range(2))
    asked = 0

    def always(heading_rad: float, ranges_m: list[float]) -> bool:
        nonlocal asked
        asked += 1
        return asking._avoidance.update(heading_rad, asking._reflex(ranges_m), asking._chance)

    monkeypatch.setattr(asking, "_consult", always)
    chance = np.random.default_rng(d)
    place, nobody = np.zeros((1, d)), np.zeros((1, 0, d))
    for _ in range(300):
        ranges = np.where(chance.random((1, 6)) < 0.15, chance.uniform(0.2, 2.0, (1, 6)), np.inf)
        heading = chance.uniform(-3.0, 3.0, 1)
        one = asking.step(place, heading, ranges, nobody)
        other = quick.step(place, heading, ranges, nobody)
        for expected, told in zip(one, other, strict=True):
            np.testing.assert_array_equal(told, expected)
        place = place + one.velocity_m_s * params.period_s
    assert asked == 300
