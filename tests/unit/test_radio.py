from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mock_vehicle.radio import Radio
from mock_vehicle.sensors.readings import PeerFix

Floats = NDArray[np.float64]


def radio(n: int, *, seed: int = 1, **options: Any) -> Radio:
    rng = np.random.default_rng(seed)
    return Radio(range(1, n + 1), radius_m=2.0, rng=rng, **options)


def listen(air: Radio, positions: list[tuple[float, float, float]]) -> Floats:
    """Update the links for vehicles that stand there, all alive."""
    at = np.array(positions)
    gaps = np.linalg.norm(at[None] - at[:, None], axis=2)
    air.update(gaps, np.ones(len(at), dtype=bool))
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
    assert air.fixes(at, attitude(2)) == [[], []]


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
    assert [fix.sysid for fix in air.fixes(at, attitude(2))[1]] == [1]


def test_the_dead_are_not_heard() -> None:
    air = radio(2)
    air.update(np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([True, False]))
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
    fix = air.fixes(at, attitude(2, yaw=math.radians(yaw_deg)))[0][0]
    assert fix.range_m == pytest.approx(1.0)
    assert fix.direction_body == pytest.approx(expected_frd, abs=1e-9)


def test_bearings_tilt_with_the_body() -> None:
    air = radio(2)
    at = listen(air, [(0, 0, 0), (1, 0, 0)])
    nose_up = air.fixes(at, attitude(2, pitch=math.radians(30)))[0][0]
    assert nose_up.direction_body == pytest.approx((math.cos(math.pi / 6), 0, 0.5))
    at = listen(air, [(0, 0, 0), (0, 1, 0)])
    right_down = air.fixes(at, attitude(2, roll=math.radians(30)))[0][0]
    assert right_down.direction_body == pytest.approx((0, math.cos(math.pi / 6), -0.5))


def test_noise_is_repeatable_and_of_the_size_asked_for() -> None:
    def measure(seed: int) -> list[PeerFix]:
        air = radio(2, seed=seed, range_noise_m=0.1, bearing_noise_rad=0.05)
        at = listen(air, [(0, 0, 0), (1.5, 0, 0)])
        return [air.fixes(at, attitude(2))[0][0] for _ in range(2000)]

    fixes = measure(1)
    assert fixes == measure(1)
    assert fixes != measure(2)
    assert np.std([fix.range_m for fix in fixes]) == pytest.approx(0.1, rel=0.1)
    assert np.std([fix.direction_body[1] for fix in fixes]) == pytest.approx(0.05, rel=0.1)
    assert np.allclose(np.linalg.norm([fix.direction_body for fix in fixes], axis=1), 1.0)
