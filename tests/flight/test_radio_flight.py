"""Flights whose radios are as they are in buildings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import yaml
from flight_log import Flight

from mock_vehicle.radio.figures import Fate

Launch = Callable[..., Flight]
WING = Path(__file__).parents[2] / "missions/worlds/wing.yaml"


def test_four_explore_a_wing_of_offices_on_a_radio_that_walls_weaken(launch: Launch) -> None:
    flight = launch(
        world=yaml.safe_load(WING.read_text()),
        vehicles=4,
        duration_s=40.0,
        planner={"kind": "explore"},
        limits={"ceiling_m": 2.5, "radius_m": 50.0},
    )
    flight.fly_to_the_end()
    assert flight.all_in("done")
    assert flight.arena.fleet.referee.collisions == 0
    figures = flight.arena.fleet.radio.figures.totals()
    for fate in (Fate.HEARD, Fate.WALLS, Fate.COLLISION, Fate.LOSS):
        assert figures.fates[fate].sum() > 0, fate.name
    assert figures.duplicates.sum() > 0
    delivered = figures.delivered > 0
    assert 0.02 < (figures.delay_s[delivered] / figures.delivered[delivered]).mean() < 0.2
