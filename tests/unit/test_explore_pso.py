import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.explore.pso import limit_motion, next_motion


def test_a_motion_is_the_weighted_sum_of_equation_6() -> None:
    motion_m = next_motion(
        np.array([[1.0, -1.0]]),
        np.array([[3.0, 4.0]]),
        np.array([[-5.0, 0.5]]),
        np.array([[0.5, 0.25, 0.1, 1.0]]),  # local best north, east; global best north, east
        (0.6, 2.0, 2.0),
    )
    assert motion_m[0] == pytest.approx([0.6 + 3.0 - 1.0, -0.6 + 2.0 + 1.0])


def test_one_number_per_term_keeps_the_direction_of_the_term() -> None:
    step = np.array([[3.0, 4.0, -2.0]])
    zero = np.zeros((1, 3))
    motion_m = next_motion(zero, step, step, np.array([[0.5, 0.25]]), (0.6, 2.0, 2.0))
    assert motion_m == pytest.approx(1.5 * step)


@settings(derandomize=True)
@given(
    st.sampled_from([2, 3]).flatmap(
        lambda d: st.lists(st.floats(-50.0, 50.0), min_size=d, max_size=d)
    ),
    st.floats(0.01, 5.0),
    st.floats(0.01, 5.0),
)
def test_limited_motions_keep_their_direction(
    motion: list[float], level_m: float, climb_m: float
) -> None:
    motion_m = np.array([motion])
    limited_m, ground_m = limit_motion(motion_m, level_m, climb_m)
    assert ground_m[0] == pytest.approx(np.hypot(*limited_m[0, :2]))
    assert ground_m[0] <= level_m * (1.0 + 1e-9)
    assert np.abs(limited_m[0, 2:]).max(initial=0.0) <= climb_m * (1.0 + 1e-9)
    size = np.linalg.norm(motion_m)
    assert limited_m @ motion_m[0] == pytest.approx(np.linalg.norm(limited_m) * size)
    if math.hypot(*motion[:2]) <= level_m and np.abs(motion[2:]).max(initial=0.0) <= climb_m:
        assert (limited_m == motion_m).all()
