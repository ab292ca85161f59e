import math

import numpy as np
import pytest

from swarm_ctl.explore.chance import Chance
from swarm_ctl.explore.levy import Walk, direction, even_length, levy_length

DRAWS = 200_000


def chance(seed: int, columns: int = 1) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.random.default_rng(seed).random((DRAWS, columns))


@pytest.mark.parametrize("beta", [0.5, 1.0, 1.5])
def test_lengths_follow_the_power_law(beta: float) -> None:
    lengths = levy_length(chance(1)[:, 0], 0.03, 1e9, beta)
    for quantile in (0.1, 0.5, 0.9, 0.99):
        closed_form = 0.03 * (1.0 - quantile) ** (-1.0 / beta)
        assert np.quantile(lengths, quantile) == pytest.approx(closed_form, rel=0.05 / beta)
    assert lengths.min() >= 0.03


def test_lengths_beyond_the_longest_are_cut_not_drawn_again() -> None:
    lengths = levy_length(chance(2)[:, 0], 0.5, 20.0, 1.0)
    assert lengths.max() == 20.0
    assert (lengths == 20.0).mean() == pytest.approx(0.5 / 20.0, abs=0.002)


def test_no_number_makes_an_endless_step() -> None:
    extremes = np.array([0.0, np.nextafter(1.0, 0.0)])
    assert levy_length(extremes, 0.03, 20.0, 1.0).tolist() == [0.03, 20.0]


def test_even_lengths_are_even() -> None:
    lengths = even_length(chance(3)[:, 0], 1.25)
    assert lengths.max() <= 1.25
    assert np.quantile(lengths, [0.25, 0.5, 0.75]) == pytest.approx(
        [0.3125, 0.625, 0.9375], abs=0.01
    )


def test_headings_are_even_over_the_circle() -> None:
    unit = direction(chance(4), 1.0)
    assert np.hypot(unit[:, 0], unit[:, 1]) == pytest.approx(np.ones(DRAWS))
    assert unit.mean(axis=0) == pytest.approx([0.0, 0.0], abs=0.01)
    assert (unit**2).mean(axis=0) == pytest.approx([0.5, 0.5], abs=0.01)


def test_climbs_are_even_in_the_sine_and_bounded() -> None:
    unit = direction(chance(5, 2), math.sin(math.radians(30.0)))
    assert (unit**2).sum(axis=1) == pytest.approx(np.ones(DRAWS))
    assert np.abs(unit[:, 2]).max() <= 0.5
    assert np.quantile(unit[:, 2], [0.25, 0.5, 0.75]) == pytest.approx([-0.25, 0, 0.25], abs=0.01)


def test_a_right_angle_of_climb_means_even_over_the_sphere() -> None:
    assert (direction(chance(6, 2), 1.0) ** 2).mean(axis=0) == pytest.approx([1 / 3] * 3, abs=0.01)


def walk(rows: int, length_m: float = 2.0, dimensions: int = 2) -> Walk:
    return Walk(
        Chance(range(rows)),
        np.arange(rows),
        dimensions,
        lambda chance: np.full(len(chance), length_m),
        0.5,
    )


def test_a_step_stands_until_its_length_has_been_flown() -> None:
    steps = walk(2)
    first = steps.vector_m.copy()
    for _ in range(3):
        steps.advance(np.array([0.5, 0.25]))
    assert (steps.vector_m == first).all()
    steps.advance(np.array([0.5, 0.25]))  # 2.0 m of 2.0 m, and 1.0 m
    assert (steps.vector_m[0] != first[0]).all()
    assert (steps.vector_m[1] == first[1]).all()


def test_a_turned_step_keeps_its_length_and_what_is_left_of_it() -> None:
    steps = walk(1)
    steps.advance(np.array([1.5]))
    steps.face(np.array([0]), np.array([math.pi / 2]))
    assert steps.vector_m[0] == pytest.approx([0.0, 2.0])  # east
    steps.advance(np.array([0.4]))
    assert steps.vector_m[0] == pytest.approx([0.0, 2.0])
    steps.advance(np.array([0.1]))
    assert steps.vector_m[0] != pytest.approx([0.0, 2.0])


def test_a_new_step_leaves_the_blocked_half_space() -> None:
    steps = walk(500, dimensions=3)
    blocked = np.tile([1.0, 0.0, 0.2], (500, 1))
    steps.leave(np.arange(500), blocked)
    assert ((steps.vector_m * blocked).sum(axis=1) <= 0.0).all()
    assert np.linalg.norm(steps.vector_m, axis=1) == pytest.approx(np.full(500, 2.0))
    assert steps.vector_m[:, 1].std() > 0.5  # all of that half, not one direction
