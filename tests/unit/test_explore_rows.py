"""The planner's loops for many rows: compiled or side by side, the same numbers to the bit."""

from typing import Any

import numpy as np
import pytest

from swarm_ctl.experiment.batch import has_numba
from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.planner import Planner, PlannerParams
from swarm_ctl.explore.rows import NUMPY, Kernels, compiled

pytestmark = pytest.mark.skipif(not has_numba(), reason="no numba")


def flown(kernels: Kernels, peers: int, **params: Any) -> list[Floats]:
    """Fly 200 vehicles past obstacles, peers and dead ends that chance puts in their way."""
    rows, world = 200, np.random.default_rng(1)
    planner = Planner(
        PlannerParams.model_validate(params),
        speed_m_s=1.0,
        climb_m_s=0.5,
        seeds=range(rows),
        kernels=kernels,
    )
    d = planner.params.dimensions
    place_m, heading_rad = world.normal(size=(rows, d)), world.uniform(-3.0, 3.0, rows)
    answers: list[Floats] = []
    for _ in range(150):
        ranges_m = np.where(world.random((rows, 6)) < 0.1, world.random((rows, 6)), np.inf)
        peers_m = 2.0 * world.normal(size=(rows, peers, d))
        peers_m[world.random((rows, peers)) < 0.9] = np.nan
        plan = planner.step(place_m, heading_rad, ranges_m, peers_m)
        answers += [np.asarray(answer, dtype=np.float64) for answer in plan]
        is_stuck = world.random((rows, 1)) < 0.1
        place_m = place_m + np.where(is_stuck, 0.0, plan.velocity_m_s * planner.params.period_s)
        heading_rad = plan.heading_rad
    return answers


@pytest.mark.parametrize("kind", ["lf-pso", "levy", "pso"])
@pytest.mark.parametrize("peers", [0, 3, 30])
@pytest.mark.parametrize(
    "params",
    [
        {},
        {"period_s": 1.0, "keep_repulsion": False, "repulsion_max": 2.0, "levy_beta": 1.5},
        {"inertia": 0.7, "cognitive": 1.7, "social": 1.3},
        {"dimensions": 3, "repulsion_vertical": 0.5},
    ],
    ids=["defaults", "others", "weights", "3-D"],
)
def test_loops_plan_the_same_bits(kind: str, peers: int, params: dict[str, Any]) -> None:
    one, other = (flown(way, peers, kind=kind, **params) for way in (NUMPY, compiled()))
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
