import numpy as np
import pytest

from swarm_ctl.experiment.batch import has_numba
from swarm_ctl.experiment.hot import compiled, interpreted
from swarm_ctl.explore.chance import Floats

LOW, HIGH, HALF_M = (0.0, 0.0), (12.0, 10.0), 0.3
BOXES: Floats = np.array([[3.0, 3.0, 5.0, 4.0], [4.5, 4.5, 6.0, 8.0], [7.0, 1.0, 7.2, 9.0]])
"""The first two leave a gap that is narrower than a body."""
WAYS = [False, pytest.param(True, marks=pytest.mark.skipif(not has_numba(), reason="no numba"))]


def moves(rows: int, reach_m: float) -> tuple[Floats, Floats]:
    """Give places (rows, 2) clear of walls and boxes, and where they would go."""
    chance = np.random.default_rng(4)
    tools = interpreted()
    low, high = np.add(LOW, HALF_M), np.subtract(HIGH, HALF_M)
    anywhere = chance.uniform(low, high, (4 * rows, 2))
    taken = tools.near(anywhere, (-99.0, -99.0), (99.0, 99.0), BOXES, HALF_M)
    last_m = np.delete(anywhere, taken, axis=0)[:rows]
    return last_m, last_m + chance.uniform(-reach_m, reach_m, last_m.shape)


@pytest.mark.parametrize("fast", WAYS)
def test_nobody_ends_in_a_wall_or_a_box(fast: bool) -> None:
    tools = compiled() if fast else interpreted()
    last_m, wanted_m = moves(5000, 0.5)
    place_m, moved_m, stopped = tools.slide(last_m, wanted_m, LOW, HIGH, BOXES, HALF_M)
    assert (place_m >= np.add(LOW, HALF_M)).all()
    assert (place_m <= np.subtract(HIGH, HALF_M)).all()
    assert tools.near(place_m, (-99.0, -99.0), (99.0, 99.0), BOXES, HALF_M - 1e-9).size == 0
    assert stopped.sum() > 200
    assert (place_m[~stopped] == wanted_m[~stopped]).all()
    assert moved_m == pytest.approx(np.linalg.norm(place_m - last_m, axis=1))


@pytest.mark.skipif(not has_numba(), reason="no numba")
@pytest.mark.parametrize("reach_m", [0.2, 3.0])
@pytest.mark.parametrize("boxes", [BOXES, BOXES[:0]], ids=["boxes", "none"])
def test_compiled_and_interpreted_walls_give_the_same_bits(reach_m: float, boxes: Floats) -> None:
    last_m, wanted_m = moves(5000, reach_m)
    ways = interpreted(), compiled()
    for _ in range(3):  # also along a side that is touched already
        slides = [way.slide(last_m, wanted_m, LOW, HIGH, boxes, HALF_M) for way in ways]
        assert all(np.array_equal(a, b) for a, b in zip(*slides, strict=True))
        last_m, wanted_m = slides[0][0], slides[0][0] + 1.1 * (wanted_m - last_m)
    one, other = (way.near(wanted_m, LOW, HIGH, boxes, 0.9) for way in ways)
    assert np.array_equal(one, other)
    assert 0 < one.size < 5000
