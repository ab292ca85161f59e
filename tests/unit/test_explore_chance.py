import numpy as np
import pytest

from swarm_ctl.explore.chance import BLOCK, Chance


def test_a_vehicle_draws_the_same_alone_and_in_any_company() -> None:
    alone, crowd = Chance([7]), Chance([1, 7, 3])
    schedule = np.random.default_rng(0)
    for _ in range(500):
        count = int(schedule.integers(1, 9))
        others = np.flatnonzero(schedule.random(3) < 0.5)
        crowd.uniform(others[others != 1], count)
        together = np.array([1, 2]) if schedule.random() < 0.5 else np.array([0, 1])
        mine = crowd.uniform(together, count)[together == 1]
        assert (alone.uniform(np.array([0]), count) == mine).all()


def test_numbers_are_uniform_and_used_once() -> None:
    chance = Chance([[5, row] for row in range(50)])
    numbers = np.hstack([chance.uniform(np.arange(50), 7) for _ in range(200)])
    assert len(np.unique(numbers)) == numbers.size
    assert numbers.min() >= 0.0
    assert numbers.max() < 1.0
    assert numbers.mean() == pytest.approx(0.5, abs=0.01)
    assert np.corrcoef(numbers[0], numbers[1])[0, 1] == pytest.approx(0.0, abs=0.1)


def test_every_kind_of_seed_is_taken() -> None:
    chance = Chance([3, [3], np.random.SeedSequence(3), np.random.SeedSequence([3, 1])])
    first = chance.uniform(np.arange(4), 3)
    assert (first[0] == first[2]).all()
    assert (first[0] != first[3]).all()


@pytest.mark.parametrize("count", [0, BLOCK + 1])
def test_a_draw_that_no_block_holds_is_refused(count: int) -> None:
    with pytest.raises(ValueError, match="a draw takes"):
        Chance([0]).uniform(np.array([0]), count)
