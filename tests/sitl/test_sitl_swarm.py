"""Two PX4s and two ArduCopters fly as one swarm among walls, with rangefinders and radios."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sitl.airfield import Report
from sitl.flown import MISSION, Flown
from sitl.rig import ORIENTATIONS, Rig
from sitl.simulators import Hangar

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(900)]

DURATION_S = 180.0
SECONDS_OF_BEACONS = 20
"""Frames that a vehicle carried to its companion while it was near a peer for some seconds."""
SENSORS = {
    f"RNGFND{number}_{name}": value
    for number, orientation in enumerate(ORIENTATIONS["ardupilot"], 1)
    for name, value in {"TYPE": 10, "ORIENT": orientation, "MIN": 0.1, "MAX": 8}.items()
}
"""Six rangefinders that speak MAVLink."""
INDOORS = {"EKF2_GPS_CTRL": 0, "EKF2_EV_CTRL": 15, "EKF2_HGT_REF": 3, "COM_ARM_WO_GPS": 1}
"""Without satellites: place, height, velocity and heading from outside."""


def test_a_mixed_swarm_explores_a_hall_and_touches_nothing(
    hangar: Hangar, tmp_path: Path, report: Report
) -> None:
    hangar.close()  # four simulators at a time
    swarm = [*hangar.have("px4", 2, **INDOORS), *hangar.have("ardupilot", 2, **SENSORS)]
    world = MISSION.parent / "worlds" / "open_3d.yaml"
    flight = Flown(tmp_path / "run", swarm, "--duration", DURATION_S)
    try:
        with Rig(world, swarm) as rig:
            code, said = flight.ends(DURATION_S + 300.0)
    finally:
        flight.killed()
        hangar.close()
    np.savez(tmp_path / "truth.npz", t=[t for t, _ in rig.track], p=[p for _, p in rig.track])
    report("seen", f"{rig.coverage.fraction:.0%}")
    report("nearest two, m", round(rig.apart_m, 2))
    report("nearest wall, m", round(rig.wall_m, 2))
    report("radio", dict(rig.carried))
    assert code == 0, said
    assert {phase for phase, _ in flight.results().values()} == {"done"}
    assert (rig.contacts, rig.wall_contacts) == (0, 0)
    met = {one.sysid for one in swarm if rig.carried[f"to {one.sysid}"] >= SECONDS_OF_BEACONS}
    heard = {event["sysid"] for event in flight.events("ContactsChanged")}
    assert len(met) >= 2, "nobody came near anybody"
    assert met <= heard, "whoever came near a peer heard it"
