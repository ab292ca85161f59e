"""`make fuzz` in small: what is thrown, and what is asked of the vehicles, stands in `fuzzing`."""

from __future__ import annotations

from fuzzing import Range
from mutations import KINDS


def test_vehicles_fly_and_answer_whatever_frames_arrive() -> None:
    report = Range(seed=11).fuzz(20_000)
    assert report.frames >= 20_000
    assert set(report.sent) == set(KINDS)
    assert report.heard > 10_000
    assert report.strayed_m < 0.5
    assert report.flights >= 4


def test_a_signed_fleet_hovers_whatever_strangers_send() -> None:
    firing = Range(seed=12, signed=True)
    report = firing.fuzz(10_000)
    assert report.strayed_m < 0.5
    assert firing.fleet.refused > 5_000
