from __future__ import annotations

import hashlib
import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from mock_vehicle.radio import Radio
from mock_vehicle.radio.figures import Fate
from mock_vehicle.sensors.readings import PeerFix
from mock_vehicle.world.radio import RadioSpec, RangingSpec

Floats = NDArray[np.float64]


def radio(n: int, *, seed: int = 1, **keys: Any) -> Radio:
    spec = RadioSpec.model_validate({"radius_m": 2.0, **keys})
    return Radio(range(1, n + 1), spec, np.random.default_rng(seed))


def listen(air: Radio, positions: list[tuple[float, float, float]], now: float = 0.0) -> Floats:
    """Update the links for vehicles that stand there, all alive."""
    at = np.array(positions)
    gaps = np.linalg.norm(at[None] - at[:, None], axis=2)
    air.update(gaps, np.ones(len(at), dtype=bool), at, now)
    return at


def attitude(
    n: int, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0
) -> tuple[Floats, Floats, Floats]:
    return np.full(n, roll), np.full(n, pitch), np.full(n, yaw)


def test_the_radius_is_a_sphere() -> None:
    air = radio(3)
    listen(air, [(0, 0, 0), (2.0, 0, 0), (1.2, 0, -1.7)])
    assert air.linked.tolist() == [
        [False, True, False],
        [True, False, True],
        [False, True, False],
    ]


def test_a_frame_reaches_only_who_is_in_the_radius() -> None:
    air = radio(3)
    listen(air, [(0, 0, 0), (1.5, 0, 0), (3.0, 0, 0)])
    air.send(0, b"beacon", 1.0)
    air.send(1, b"answer", 1.0)
    assert air.carry(1.02) == [(1, b"beacon"), (0, b"answer"), (2, b"answer")]
    assert air.carry(1.04) == []


def test_frames_arrive_in_the_order_of_their_senders() -> None:
    air = radio(3)
    listen(air, [(0, 0, 0)] * 3)
    for sender in (2, 0, 1):
        air.send(sender, bytes([sender]), 1.0)
    assert [frame for hearer, frame in air.carry(1.02) if hearer == 1] == [b"\x00", b"\x02"]


def test_delay_holds_a_frame_back() -> None:
    air = radio(2, delay_s=0.25)
    listen(air, [(0, 0, 0), (1, 0, 0)])
    air.send(0, b"beacon", 1.0)
    assert air.carry(1.24) == []
    assert air.carry(1.26) == [(1, b"beacon")]


def test_loss_takes_its_share() -> None:
    air = radio(2, loss_fraction=0.3)
    listen(air, [(0, 0, 0), (1, 0, 0)])
    for _ in range(2000):
        air.send(0, b"beacon", 1.0)
    assert len(air.carry(1.0)) / 2000 == pytest.approx(0.7, abs=0.03)  # 3 sigma


def test_a_radio_without_ranging_carries_frames_and_measures_nobody() -> None:
    air = radio(2, ranging=False)
    at = listen(air, [(0, 0, 0), (1.5, 0, 0)])
    air.send(0, b"beacon", 1.0)
    assert air.carry(1.02) == [(1, b"beacon")]
    assert air.fixes(at, attitude(2), 0.0) == [[], []]


def test_a_silenced_radio_is_off_the_air_until_restored() -> None:
    air = radio(2)
    listen(air, [(0, 0, 0), (1, 0, 0)])
    air.send(0, b"beacon", 1.0)
    air.silence(1)
    assert air.carry(1.02) == []
    listen(air, [(0, 0, 0), (1, 0, 0)])
    assert not air.linked.any()
    air.restore(1)
    at = listen(air, [(0, 0, 0), (1, 0, 0)])
    assert [fix.sysid for fix in air.fixes(at, attitude(2), 0.0)[1]] == [1]


def test_the_dead_are_not_heard() -> None:
    air = radio(2)
    at = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    air.update(np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([True, False]), at, 0.0)
    assert not air.linked.any()


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


def told(air: Radio, steps: int = 500) -> str:
    """Hash all that a radio of six vehicles does while they wander, fail and come back."""
    chance, digest = np.random.default_rng(3), hashlib.sha256()
    at = chance.uniform(0, 4, (6, 3))
    for step in range(1, steps + 1):
        now = 0.02 * step
        for hearer, frame in air.carry(now):
            digest.update(b"%d" % hearer + frame)
        if step % 5:
            continue
        at = at + chance.normal(0, 0.1, at.shape)
        gaps = np.linalg.norm(at[None] - at[:, None], axis=2)
        air.update(gaps, np.arange(6) != step // 100, at, now)
        roll, pitch, yaw = chance.uniform(-1, 1, (3, 6))
        for fix in itertools.chain(*air.fixes(at, (roll, pitch, yaw), now)):
            x, y, z = fix.direction_body
            digest.update(f"{fix.sysid} {fix.range_m:.6f} {x:.6f} {y:.6f} {z:.6f};".encode())
        for sender in range(6):
            air.send(sender, bytes([sender, step % 256]), now)
        if step == 250:
            air.extra_loss[1] = 0.7
        if step == 300:
            air.silence(3)
        if step == 400:
            air.restore(3)
    return digest.hexdigest()


@pytest.mark.parametrize(
    ("keys", "recorded"),
    [
        ({}, "13c8480c1207048cdccd91aaaea535bc7e02a36b736191874cee2888fa6707e0"),
        (
            {
                "delay_s": 0.05,
                "loss_fraction": 0.2,
                "ranging": {"range_noise_m": 0.1, "bearing_noise_deg": math.degrees(0.05)},
            },
            "1ff23c97b25428882bfed01fa5cdf97055629601901e486671048ce371c04b14",
        ),
    ],
)
def test_the_disc_draws_and_tells_what_it_did_before_radios_were_worse(
    keys: dict[str, Any], recorded: str
) -> None:
    assert told(radio(6, **keys)) == recorded


def carried(air: Radio, frames: int, *, spacing_s: float = 0.1) -> list[tuple[float, int]]:
    """Send numbered frames from the first to the second; list (seconds late, number)."""
    listen(air, [(0, 0, 0), (1, 0, 0)])
    arrived, step_s = [], 0.002
    for step in range(round((frames * spacing_s + 1.0) / step_s)):
        now = step * step_s
        number, rest = divmod(step, round(spacing_s / step_s))
        if rest == 0 and number < frames:
            air.send(0, number.to_bytes(4, "little"), now)
        for _, frame in air.carry(now):
            number = int.from_bytes(frame, "little")
            arrived.append((now - number * spacing_s, number))
    return arrived


def test_jitter_is_even_beyond_the_delay() -> None:
    late = [s for s, _ in carried(radio(2, delay_s=0.1, jitter_s=0.06), 500)]
    assert 0.1 <= min(late) < 0.105
    assert 0.155 < max(late) <= 0.162
    assert np.mean(late) == pytest.approx(0.13, abs=0.003)
    assert np.std(late) == pytest.approx(0.06 / math.sqrt(12.0), rel=0.1)


def test_duplicates_come_in_their_share_and_never_thrice() -> None:
    numbers = [number for _, number in carried(radio(2, duplicate_fraction=0.25), 500)]
    counts = np.bincount(numbers)
    assert set(counts) == {1, 2}
    assert np.mean(counts == 2) == pytest.approx(0.25, abs=0.06)  # 3 sigma


def test_held_back_frames_are_overtaken_and_none_is_lost() -> None:
    air = radio(2, reorder_fraction=0.1, reorder_hold_s=0.25)
    numbers = [number for _, number in carried(air, 500)]
    assert sorted(numbers) == list(range(500))
    overtaken = np.diff(numbers) < 0
    assert np.mean(overtaken) == pytest.approx(0.09, abs=0.04)


def test_frames_stay_in_order_where_nothing_holds_them() -> None:
    numbers = [number for _, number in carried(radio(2, delay_s=0.1), 100)]
    assert numbers == list(range(100))


SQUARE: list[tuple[float, float, float]] = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]


def test_groups_hear_only_themselves_for_their_time() -> None:
    air = radio(4, partitions=[{"from_s": 10, "until_s": 20, "groups": [[1, 3]]}])
    for now, apart in ((9.9, False), (10.0, True), (19.9, True), (20.0, False)):
        listen(air, SQUARE, now)
        assert air.linked[0, 2]
        assert air.linked[1, 3]
        assert air.linked[0, 1] != apart
        assert air.linked[2, 3] != apart


def test_a_line_parts_who_is_on_its_two_sides() -> None:
    line = {"from_m": [0.5, 0.0], "to_m": [0.5, 9.0]}  # along y: between east 0 and east 1
    air = radio(4, partitions=[{"from_s": 0, "line": line}])
    listen(air, SQUARE, 1e6)
    assert [air.linked[0, other] for other in (1, 2, 3)] == [True, False, False]


def test_partitions_add_up() -> None:
    halves = [{"from_s": 0, "groups": [[1, 2]]}, {"from_s": 5, "groups": [[1, 3]]}]
    air = radio(4, partitions=halves)
    listen(air, SQUARE, 1.0)
    assert air.linked.sum() == 4
    listen(air, SQUARE, 6.0)
    assert not air.linked.any()


@pytest.mark.parametrize(
    ("partition", "sentence"),
    [
        ({"from_s": 1}, "should have either groups or line"),
        ({"from_s": 5, "until_s": 5, "groups": [[1]]}, "should have until_s after from_s"),
        ({"from_s": 5, "groups": [[1], [1, 2]]}, "should have no sysid in groups twice"),
        ({"from_s": 5, "grups": [[1]]}, "did you mean groups?"),
    ],
)
def test_a_partition_that_cannot_be_is_one_sentence(
    partition: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ValidationError, match=sentence):
        RadioSpec.model_validate({"partitions": [partition]})


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


def test_figures_account_for_every_frame_of_every_link() -> None:
    parted = [{"from_s": 5, "until_s": 10, "groups": [[1]]}]
    air = radio(4, delay_s=0.05, loss_fraction=0.2, partitions=parted)
    at: list[tuple[float, float, float]] = [(0, 0, 0), (1, 0, 0), (9, 0, 0), (10, 0, 0)]
    for tick in range(201):
        now = 0.1 * tick
        listen(air, at, now)
        air.carry(now)
        if tick < 200:
            air.send(0, bytes(50), now)
    report = air.figures.report()
    assert report["vehicles"][0] == {"sysid": 1, "sent": 200}
    (link,) = report["links"]
    assert (link["from"], link["to"], link["sent"]) == (1, 2, 200)
    assert link["lost"]["partition"] == 50
    assert link["lost"]["loss"] == pytest.approx(0.2 * 150, abs=15)
    assert link["delivered"] == 200 - sum(link["lost"].values())
    assert link["bytes"] == 50 * link["delivered"]
    assert link["delay_mean_s"] == link["delay_max_s"] == pytest.approx(0.1)
    assert air.figures.fates[Fate.RANGE, 0, 2] == 200


def test_figures_count_duplicates_apart() -> None:
    air = radio(2, duplicate_fraction=0.5)
    arrived = carried(air, 200)
    (link,) = air.figures.report()["links"]
    assert (link["sent"], link["delivered"]) == (200, 200)
    assert link["duplicates"] == len(arrived) - 200 > 50


def test_ranging_is_true_false_or_a_section() -> None:
    assert RadioSpec.model_validate({"ranging": True}).ranging == RangingSpec()
    assert RadioSpec.model_validate({"ranging": False}).ranging is None
    noisy = RadioSpec.model_validate({"ranging": {"range_noise_m": 0.05}}).ranging
    assert noisy == RangingSpec(range_noise_m=0.05)
