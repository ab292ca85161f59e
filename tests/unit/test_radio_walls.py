"""How far a radio reaches: the log-distance law, walls, shadowing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from radios import Floats, listen

from mock_vehicle.radio import Radio
from mock_vehicle.radio.figures import Fate
from mock_vehicle.world.radio import RadioSpec


def walled(a_m: Floats, b_m: Floats) -> NDArray[np.intp]:
    """Count walls of which one stands at every whole metre of east but 0."""
    walls: NDArray[np.intp] = np.trunc(np.abs(b_m[:, 1] - a_m[:, 1])).astype(np.intp)
    return walls


def behind_walls(n: int, seed: int = 1, **path_loss: Any) -> Radio:
    spec = RadioSpec.model_validate({"radius_m": 10.0, "path_loss": path_loss})
    return Radio(range(1, n + 1), spec, np.random.default_rng(seed), walled)


def reach_m(air: Radio, east: float, north: float) -> float:
    """Find how far away in a direction the second is still heard by the first."""
    away_m = np.arange(0.05, 30.0, 0.1)
    heard = []
    for far_m in away_m.tolist():
        listen(air, [(0, 0, 0), (north * far_m, east * far_m, 0)])
        heard.append(bool(air.linked[0, 1]))
    return float(away_m[heard][-1])


def test_the_radius_is_the_range_in_the_open_whatever_the_exponent() -> None:
    for exponent in (2.0, 3.0):
        air = behind_walls(2, exponent=exponent, wall_db=6.0)
        assert reach_m(air, east=0, north=1) == pytest.approx(10.0, abs=0.1)


@pytest.mark.parametrize(("exponent", "wall_db"), [(2.0, 5.0), (3.0, 5.0), (2.0, 6.9)])
def test_walls_shorten_the_range_by_the_log_distance_law(exponent: float, wall_db: float) -> None:
    """Behind w walls d metres away: 10 n log10(10 / d) >= w L; here w is d, rounded down."""
    far_m = np.arange(0.05, 30.0, 0.1)
    margin_db = 10.0 * exponent * np.log10(10.0 / far_m) - np.trunc(far_m) * wall_db
    expected_m = far_m[margin_db >= 0.0][-1]
    air = behind_walls(2, exponent=exponent, wall_db=wall_db)
    assert reach_m(air, east=1, north=0) == pytest.approx(expected_m)


def test_what_a_wall_takes_is_told_from_what_the_distance_takes() -> None:
    air = behind_walls(3, wall_db=20.0)
    at = [(0.0, 0.0, 0.0), (0.0, 1.5, 0.0), (11.0, 0.0, 0.0)]
    listen(air, at)
    air.send(0, b"beacon", 0.0)
    assert air.carry(0.0) == []
    assert (
        air.figures.totals().fates[Fate.WALLS, 0, 1]
        == air.figures.totals().fates[Fate.RANGE, 0, 2]
        == 1
    )


def test_shadowing_lets_half_of_the_links_through_at_the_radius() -> None:
    """At distance d a share Q(-10 n log10(R / d) / sigma) of all links holds (Rappaport 4.9)."""
    n, sigma_db = 80, 6.0
    air = behind_walls(n, shadowing_db=sigma_db, exponent=3.0, wall_db=0.0)
    pairs = n * (n - 1)
    at = np.zeros((n, 3))
    for apart_m in (7.0, 10.0, 14.0):
        gaps = np.full((n, n), apart_m)
        air.update(gaps, np.ones(n, dtype=bool), at, 0.0)
        margin = 30.0 * math.log10(10.0 / apart_m) / sigma_db
        expected = 0.5 * (1.0 + math.erf(margin / math.sqrt(2.0)))
        assert air.linked.sum() / pairs == pytest.approx(expected, abs=0.03)  # 3 sigma
        assert np.array_equal(air.linked, air.linked.T)


def correlation(way_m: float, seconds: float, **keys: Any) -> float:
    """Compare which links hold before and after all have flown a way or let time pass."""
    n = 80
    air = behind_walls(n, shadowing_db=6.0, wall_db=0.0, **keys)
    gaps, alive, at = np.full((n, n), 10.0), np.ones(n, dtype=bool), np.zeros((n, 3))
    air.update(gaps, alive, at, 0.0)
    before = air.linked[np.triu_indices(n, 1)]
    for step in range(1, 11):
        place = at + np.array([way_m * step / 10.0, 0.0, 0.0])
        air.update(gaps, alive, place, seconds * step / 10.0)
    agree = float(np.mean(before == air.linked[np.triu_indices(n, 1)]))
    return math.sin(math.pi * (agree - 0.5))  # of two Gaussians, by how often their signs agree


@pytest.mark.parametrize(
    ("way_m", "seconds", "keys", "expected"),
    [
        (0.0, 100.0, {}, 1.0),
        (1.0, 0.0, {"shadowing_m": 4.0}, math.exp(-2.0 / 4.0)),  # both ends have flown 1 m
        (4.0, 0.0, {"shadowing_m": 4.0}, math.exp(-8.0 / 4.0)),
        (0.0, 10.0, {"shadowing_s": 20.0}, math.exp(-10.0 / 20.0)),
        (1.0, 10.0, {"shadowing_m": 4.0, "shadowing_s": 20.0}, math.exp(-1.0)),
    ],
)
def test_shadowing_is_forgotten_over_way_and_time(
    way_m: float, seconds: float, keys: dict[str, float], expected: float
) -> None:
    assert correlation(way_m, seconds, **keys) == pytest.approx(expected, abs=0.07)  # 3 sigma
