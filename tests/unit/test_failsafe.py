from typing import Any

import pytest

from swarm_ctl.agent.failsafe import Health, verdict
from swarm_ctl.agent.params import Limits
from swarm_ctl.agent.phases import Cause

WELL = Health(
    silent_s=0.1,
    position_age_s=0.1,
    range_age_s=0.1,
    plan_age_s=0.1,
    holding_s=0.0,
    mission_s=60.0,
    battery_fraction=0.9,
)


def test_a_healthy_vehicle_flies_on() -> None:
    assert verdict(WELL, Limits()) is None


@pytest.mark.parametrize(
    ("trouble", "value", "cause", "words"),
    [
        ("silent_s", 5.1, Cause.SILENT, "nothing heard from its autopilot for 5.1 s"),
        ("untold_s", 10.1, Cause.SILENT, "no heartbeat of its autopilot for 10.1 s"),
        ("battery_fraction", 0.1, Cause.LAND, "battery critical at 10%"),
        ("mission_s", 1801.0, Cause.LAND, "longest mission time reached at 1801 s"),
        ("holding_s", 11.0, Cause.LAND, "held for 11 s without recovery"),
        ("position_age_s", 1.2, Cause.HOLD, "no position for 1.2 s"),
        ("range_age_s", 0.7, Cause.HOLD, "no rangefinder for 0.7 s"),
        ("plan_age_s", 1.5, Cause.HOLD, "no plan for 1.5 s"),
        ("battery_fraction", 0.2, Cause.RETURN, "battery low at 20%, the way home takes 0%"),
        ("way_home_fraction", 0.7, Cause.RETURN, "battery low at 90%, the way home takes 70%"),
        ("outside_s", 11.0, Cause.LAND, "outside its fence for 11 s"),
        ("round_trip_s", 0.7, Cause.HOLD, "link slow: 0.7 s there and back"),
        ("estimate", "its position jumped", Cause.HOLD, "its position jumped"),
    ],
)
def test_each_trouble_has_its_answer(trouble: str, value: Any, cause: Cause, words: str) -> None:
    judged = verdict(WELL._replace(**{trouble: value}), Limits())
    assert judged == (cause, words)


def test_the_graver_trouble_wins() -> None:
    judged = verdict(WELL._replace(position_age_s=2.0, battery_fraction=0.05), Limits())
    assert judged is not None
    assert judged.cause is Cause.LAND
