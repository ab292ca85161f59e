"""What a second of flight costs, against a fixed piece of Python that runs at the same time."""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import machine
import pytest

from swarm_ctl.experiment.arena import Arena
from swarm_ctl.mission import load_mission
from swarm_ctl.record.unrecorded import Unrecorded

MISSION = Path(__file__).parents[2] / "missions" / "open_3d.yaml"
VEHICLES, CLIMB_S, FLOWN_S = 10, 15.0, 12
USUAL = {"explore": 1.1, "lf-pso": 0.95}
"""Calibrations per vehicle-second; written down anew whenever flights have become cheaper."""
MOST = 1.3


@pytest.mark.parametrize("planner", USUAL)
def test_a_second_of_flight_costs_no_third_more_than_it_did(planner: str) -> None:
    arena = Arena(load_mission(MISSION, vehicles=VEHICLES, planner=planner), Unrecorded())
    arena.fly(until_s=CLIMB_S)
    costs = []
    for second in range(1, FLOWN_S + 1):
        unit_s = machine.calibrate_s()
        began_s = time.process_time()
        arena.fly(until_s=CLIMB_S + second)
        spent_s = time.process_time() - began_s
        costs.append(spent_s / VEHICLES / (0.5 * (unit_s + machine.calibrate_s())))
    cost = statistics.median(costs)
    assert cost < MOST * USUAL[planner], f"{cost:.2f} calibrations per vehicle-second"
