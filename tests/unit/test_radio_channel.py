"""A channel that all radios share: bit rate, back-off, collisions, queues."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from radios import listen, radio

from mock_vehicle.radio import Radio
from mock_vehicle.radio.figures import Fate


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
