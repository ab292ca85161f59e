"""Who hears whom, and what becomes of frames."""

from __future__ import annotations

import hashlib
import itertools
import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from radios import attitude, listen, radio

from mock_vehicle.radio import Radio
from mock_vehicle.radio.figures import Fate
from mock_vehicle.world.radio import RadioSpec


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
