"""Wind, in which a place is held."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from flight_log import Flight

from swarm_ctl.agent.phases import Phase


def test_a_px4_that_takes_off_in_wind_goes_back_to_where_it_stood(
    launch: Callable[..., Flight],
) -> None:
    """Told to go back with 0.3 m/s only, it was 1.01 m off: walls are a metre away."""
    flight = launch(world={"wind": {"from_deg": 0, "speed_m_s": 2.5}}, vehicles=1)
    dynamics = flight.arena.fleet.dynamics
    start = dynamics.position_ned_m[0].copy()
    away_m = [0.0]
    flight.fly_until(lambda: flight.agent(1).phase is Phase.TAKEOFF)

    def is_up() -> bool:
        away_m.append(float(np.linalg.norm((dynamics.position_ned_m[0] - start)[:2])))
        return flight.agent(1).phase is not Phase.TAKEOFF

    flight.fly_until(is_up)
    assert 0.3 < max(away_m) < 0.9
