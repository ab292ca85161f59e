from __future__ import annotations

from pathlib import Path

from swarm_ctl.controller import Controller
from swarm_ctl.flight import controllers_for
from swarm_ctl.mission import load_mission
from swarm_ctl.record.unrecorded import Unrecorded

MISSION = Path(__file__).parents[2] / "missions" / "open_3d.yaml"


def controller() -> Controller:
    (one,) = controllers_for(load_mission(MISSION, vehicles=1), Unrecorded())
    return one


def test_ticks_in_time_miss_no_deadline() -> None:
    one = controller()
    assert [one.keep_time(late_s) for late_s in (0.0, 0.0004, -0.001, 0.019)] == [0, 0, 0, 0]
    assert (one.ticks_due, one.ticks_late) == (4, 0)


def test_a_late_tick_has_missed_its_deadline_and_so_have_those_left_out() -> None:
    one = controller()
    assert [one.keep_time(late_s) for late_s in (0.03, 0.35)] == [0, 3]
    assert (one.ticks_due, one.ticks_late) == (5, 5)
    assert (one.result().ticks_due, one.result().ticks_late) == (5, 5)
