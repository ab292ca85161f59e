"""What radios measure of each other, and how wrong it is."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from radios import attitude, listen, radio

from mock_vehicle.radio import Radio
from mock_vehicle.sensors.readings import PeerFix
from mock_vehicle.world.radio import RadioSpec, RangingSpec


def test_a_radio_without_ranging_carries_frames_and_measures_nobody() -> None:
    air = radio(2, ranging=False)
    at = listen(air, [(0, 0, 0), (1.5, 0, 0)])
    air.send(0, b"beacon", 1.0)
    assert air.carry(1.02) == [(1, b"beacon")]
    assert air.fixes(at, attitude(2), 0.0) == [[], []]


@pytest.mark.parametrize(
    ("peer_ned_m", "yaw_deg", "expected_frd"),
    [
        ((-1, 0, 0), 90, (0, 1, 0)),  # facing east, south is to the right
        ((1, 0, 0), 90, (0, -1, 0)),
        ((0, 1, 0), 90, (1, 0, 0)),
        ((0, 0, -1), 30, (0, 0, -1)),
        ((1, 0, 0), 180, (-1, 0, 0)),
    ],
)
def test_bearings_turn_with_the_nose(
    peer_ned_m: tuple[float, float, float],
    yaw_deg: float,
    expected_frd: tuple[float, float, float],
) -> None:
    air = radio(2)
    at = listen(air, [(0, 0, 0), peer_ned_m])
    fix = air.fixes(at, attitude(2, yaw=math.radians(yaw_deg)), 0.0)[0][0]
    assert fix.range_m == pytest.approx(1.0)
    assert fix.direction_body == pytest.approx(expected_frd, abs=1e-9)


def test_bearings_tilt_with_the_body() -> None:
    air = radio(2)
    at = listen(air, [(0, 0, 0), (1, 0, 0)])
    nose_up = air.fixes(at, attitude(2, pitch=math.radians(30)), 0.0)[0][0]
    assert nose_up.direction_body == pytest.approx((math.cos(math.pi / 6), 0, 0.5))
    at = listen(air, [(0, 0, 0), (0, 1, 0)])
    right_down = air.fixes(at, attitude(2, roll=math.radians(30)), 0.0)[0][0]
    assert right_down.direction_body == pytest.approx((0, math.cos(math.pi / 6), -0.5))


def test_noise_is_repeatable_and_of_the_size_asked_for() -> None:
    def measure(seed: int) -> list[PeerFix]:
        air = radio(2, seed=seed, ranging={"range_noise_m": 0.1, "bearing_noise_deg": 3.0})
        at = listen(air, [(0, 0, 0), (1.5, 0, 0)])
        return [air.fixes(at, attitude(2), 0.0)[0][0] for _ in range(2000)]

    fixes = measure(1)
    assert fixes == measure(1)
    assert fixes != measure(2)
    assert np.std([fix.range_m for fix in fixes]) == pytest.approx(0.1, rel=0.1)
    assert np.std([fix.direction_body[1] for fix in fixes]) == pytest.approx(
        math.radians(3.0), rel=0.1
    )
    assert np.allclose(np.linalg.norm([fix.direction_body for fix in fixes], axis=1), 1.0)


def measured(n: int, times: int, **ranging: Any) -> tuple[Radio, list[list[list[PeerFix]]]]:
    """Let vehicles on a circle of 1 m radius measure each other every 0.1 s."""
    air = radio(n, ranging=ranging)
    turn = np.arange(n) * 2.0 * math.pi / n
    circle = [(math.cos(a), math.sin(a), 0.0) for a in turn.tolist()]
    fixes = []
    for tick in range(times):
        at = listen(air, circle, 0.1 * tick)
        fixes.append(air.fixes(at, attitude(n), 0.1 * tick))
    return air, fixes


def test_bias_differs_from_pair_to_pair_and_stays() -> None:
    _, (first, *others) = measured(40, 3, range_bias_m=0.2)
    assert all(
        [(fix.sysid, fix.range_m) for fix in heard] == [(fix.sysid, fix.range_m) for fix in again]
        for other in others
        for heard, again in zip(first, other, strict=True)
    )
    chord_m = [
        [2.0 * math.sin(math.pi * abs(fix.sysid - 1 - hearer) / 40) for fix in heard]
        for hearer, heard in enumerate(first)
    ]
    errors = {
        (hearer + 1, fix.sysid): fix.range_m - true_m
        for hearer, heard in enumerate(first)
        for fix, true_m in zip(heard, chord_m[hearer], strict=True)
        if true_m > 0.8  # nearer, a range would be below 0 and turn
    }
    assert np.std(list(errors.values())) == pytest.approx(0.2, rel=0.1)
    assert all(errors[a, b] == pytest.approx(errors[b, a]) for a, b in errors)


def test_bearings_are_bent_by_pair() -> None:
    _, (first, second) = measured(40, 2, bearing_bias_deg=5.0)
    assert [f.direction_body for f in first[0]] == [f.direction_body for f in second[0]]
    level = [fix.direction_body[2] for heard in first for fix in heard]
    assert np.std(level) == pytest.approx(math.radians(5.0), rel=0.1)


def test_outliers_are_only_ever_too_long() -> None:
    _, fixes = measured(2, 4000, outlier_fraction=0.1, outlier_m=1.5)
    errors = np.array([heard[0].range_m - 2.0 for tick in fixes for heard in tick])
    detours = errors[errors > 1e-9]
    assert errors.min() > -1e-9
    assert len(detours) / len(errors) == pytest.approx(0.1, abs=0.01)  # 3 sigma
    assert np.mean(detours) == pytest.approx(1.5, rel=0.15)
    assert np.std(detours) == pytest.approx(1.5, rel=0.2)  # exponential: as large as the mean


@pytest.mark.parametrize(
    ("sectors", "seen_deg"),
    [
        ([], [0, 90, 180, 270]),
        ([{"from_deg": 135, "to_deg": 225}], [0, 90, 270]),
        ([{"from_deg": -45, "to_deg": 45}], [90, 180, 270]),
        ([{"from_deg": 80, "to_deg": 100}, {"from_deg": 260, "to_deg": 280}], [0, 180]),
    ],
)
def test_nobody_is_measured_in_a_blind_sector(
    sectors: list[dict[str, float]], seen_deg: list[int]
) -> None:
    """The nose points east; peers stand ahead, right, behind and left."""
    air = radio(5, ranging={"blind": sectors})
    at = listen(air, [(0, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (1, 0, 0)])
    yaw = np.array([math.pi / 2, 0, 0, 0, 0])
    (fixes, *_) = air.fixes(at, (np.zeros(5), np.zeros(5), yaw), 0.0)
    assert [90 * (fix.sysid - 2) for fix in fixes] == seen_deg
    assert air.linked[0].sum() == 4


def test_fixes_come_late_and_say_when_they_were_taken() -> None:
    _, fixes = measured(2, 10, delay_s=0.3)
    assert [len(heard) for heard, _ in fixes] == [0, 0, 0, 1, 1, 1, 1, 1, 1, 1]
    taken = [heard[0].time_s for heard, _ in fixes[3:]]
    assert taken == pytest.approx([0.1 * tick for tick in range(7)])


def test_ranging_is_true_false_or_a_section() -> None:
    assert RadioSpec.model_validate({"ranging": True}).ranging == RangingSpec()
    assert RadioSpec.model_validate({"ranging": False}).ranging is None
    noisy = RadioSpec.model_validate({"ranging": {"range_noise_m": 0.05}}).ranging
    assert noisy == RangingSpec(range_noise_m=0.05)


@pytest.mark.parametrize("noisy", [False, True])
def test_compiled_radios_measure_as_the_others_bit_for_bit(*, noisy: bool) -> None:
    pytest.importorskip("numba")
    keys = {"range_noise_m": 0.1, "bearing_noise_deg": 3.0} if noisy else {}
    plain, fast = (radio(9, radius_m=50.0, ranging=keys) for _ in range(2))
    fast.compile()
    dice = np.random.default_rng(1)
    for _ in range(50):
        places = [(n, e, d) for n, e, d in dice.normal(0.0, 5.0, (9, 3)).tolist()]
        roll, pitch, yaw = dice.uniform(-math.pi, math.pi, (3, 9))
        fixes = [air.fixes(listen(air, places), (roll, pitch, yaw), 0.0) for air in (plain, fast)]
        assert fixes[0] == fixes[1]
        assert sum(map(len, fixes[0])) == 72
