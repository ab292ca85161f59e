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
    assert air.figures.totals().fates[Fate.RANGE, 0, 2] == 200


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


def crowd(n: int, linked: list[tuple[int, int]] | None = None, **channel: Any) -> Radio:
    """Put radios into one cell, or let only some hear each other."""
    air = radio(n, channel=channel)
    listen(air, [(0, 0, 0)] * n)
    if linked is not None:
        gaps = np.full((n, n), 9.0)
        for a, b in linked:
            gaps[a, b] = gaps[b, a] = 1.0
        air.update(gaps, np.ones(n, dtype=bool), np.zeros((n, 3)), 0.0)
    return air


def talk(air: Radio, senders: list[int], seconds: float, frame: bytes = bytes(100)) -> None:
    """Let senders always have something to say."""
    for step in range(round(seconds / 0.01)):
        for sender in senders:
            for _ in range(5):
                air.send(sender, frame, 0.01 * step)
        air.carry(0.01 * step)


def lost(air: Radio, fate: Fate, sender: int, hearer: int) -> float:
    """Give the share of what was on the air that ended so at a hearer."""
    fates = air.figures.totals().fates[:, sender, hearer]
    on_air = fates[[Fate.HEARD, Fate.COLLISION, Fate.LOSS]].sum()
    return float(fates[fate] / on_air)


def test_a_channel_carries_its_bit_rate_less_the_back_off() -> None:
    """A frame takes 800 bits / 100 kbit/s = 8 ms, and 15.5 slots of 0.1 ms until the next."""
    air = crowd(2, bit_rate_bit_s=100_000.0, slot_s=1e-4, window_slots=32)
    talk(air, [0], 60.0)
    assert air.figures.totals().delivered[0, 1] / 60.0 == pytest.approx(
        1.0 / (0.008 + 15.5e-4), rel=0.01
    )


def test_two_that_hear_each_other_collide_once_in_as_many_slots() -> None:
    """Both draw one of W slots after each burst: the same with p = 1 / W, and then both are lost.

    Of 1 + p bursts, 2 p are.
    """
    air = crowd(3, bit_rate_bit_s=2.5e5, slot_s=1e-4, window_slots=8)
    talk(air, [0, 1], 40.0)
    p = 1.0 / 8.0
    assert lost(air, Fate.COLLISION, 0, 2) == pytest.approx(2.0 * p / (1.0 + p), abs=0.02)
    shares = air.figures.totals().delivered[[0, 1], 2]
    assert shares[0] == pytest.approx(shares[1], rel=0.05)


def test_a_larger_window_collides_less() -> None:
    shares = []
    for window in (4, 16, 64):
        air = crowd(6, bit_rate_bit_s=2.5e5, slot_s=1e-4, window_slots=window)
        talk(air, [0, 1, 2, 3, 4], 5.0)
        shares.append(lost(air, Fate.COLLISION, 0, 5))
    assert shares[0] > 1.5 * shares[1] > 3.0 * shares[2] > 0.0


def test_hidden_nodes_collide_at_the_one_between_them() -> None:
    exposed = crowd(3, bit_rate_bit_s=1e5)
    hidden = crowd(3, [(0, 1), (1, 2)], bit_rate_bit_s=1e5)
    for air in (exposed, hidden):
        talk(air, [0, 2], 20.0)
    assert lost(hidden, Fate.COLLISION, 0, 1) > 0.9
    assert lost(exposed, Fate.COLLISION, 0, 1) < 0.1


def test_who_sends_hears_nothing_meanwhile() -> None:
    """Two that do not hear each other's beginning within a slot are deaf to each other."""
    air = crowd(2, bit_rate_bit_s=1e5, slot_s=1e-4, window_slots=1)
    talk(air, [0, 1], 1.0)
    assert lost(air, Fate.COLLISION, 0, 1) > 0.95


def test_a_full_queue_loses_what_comes_and_is_counted() -> None:
    air = crowd(2, bit_rate_bit_s=8_000.0, queue_frames=3)
    for _ in range(10):
        air.send(0, bytes(100), 0.0)
    assert air.figures.totals().fates[Fate.QUEUE, 0, 1] == 7
    for step in range(100):
        air.carry(0.01 * step)
    (link,) = air.figures.report()["links"]
    assert (link["sent"], link["delivered"], link["lost"]) == (10, 3, {"queue": 7})
    assert 0.3 < link["delay_max_s"] < 0.4  # three bursts of 0.1 s and some slots


def test_cells_apart_do_not_share() -> None:
    air = crowd(4, [(0, 1), (2, 3)], bit_rate_bit_s=1e5, slot_s=1e-4)
    talk(air, [0, 2], 20.0)
    assert air.figures.totals().fates[Fate.COLLISION].sum() == 0
    alone = crowd(2, bit_rate_bit_s=1e5, slot_s=1e-4)
    talk(alone, [0], 20.0)
    assert air.figures.totals().delivered[0, 1] == pytest.approx(
        alone.figures.totals().delivered[0, 1], rel=0.01
    )
