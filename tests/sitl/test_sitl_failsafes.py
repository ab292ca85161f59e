"""Real autopilots in simulation: their own failsafes take the vehicle and are not fought."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from sitl.airfield import Airfield, Report
from sitl.flown import Flown
from sitl.station import Settings, Station

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(300)]

LONG_S, DOWN_S = 600.0, 90.0
PEACEFUL = {"HEARTBEAT", "TUNNEL"}

BATTERY: Mapping[str, tuple[Settings, Settings]] = {
    "px4": (
        {"COM_LOW_BAT_ACT": 2, "BAT_LOW_THR": 0.9, "BAT_CRIT_THR": 0.8},
        {"SIM_BAT_DRAIN": 20, "SIM_BAT_MIN_PCT": 60},
    ),
    "ardupilot": ({"BATT_FS_LOW_ACT": 1}, {"BATT_LOW_VOLT": 20}),
}
"""What is set on the ground, so that it lands early, and in the air, so that it is low."""
SATELLITES: Mapping[str, Settings] = {
    "px4": {"SIM_GPS_USED": 0},
    "ardupilot": {"SIM_GPS1_ENABLE": 0, "SIM_GPS_DISABLE": 1},
}
STATION_LOST: Mapping[str, Settings] = {
    "px4": {"NAV_DLL_ACT": 2, "COM_DL_LOSS_T": 5},
    "ardupilot": {"FS_GCS_ENABLE": 1},
}


def test_a_low_battery_lands_the_vehicle_by_its_own_failsafe(
    airfield: Airfield, autopilot: str, report: Report
) -> None:
    before, then = BATTERY[autopilot]
    (alpha,) = airfield.ready(autopilot, 1)
    airfield.retire(alpha)
    with alpha.settings(before):
        flight = exploring(airfield, alpha)
        with alpha.settings(then):
            report("yielded after, s", flight.waits_for("yielded", within_s=60.0))
            assert "its autopilot's own failsafe chose" in flight.reason(alpha.sysid)
            flight.ends(DOWN_S)
    assert not alpha.is_armed
    assert was_left_alone(flight, alpha)


def test_lost_satellites_bring_the_vehicle_down(
    airfield: Airfield, autopilot: str, report: Report
) -> None:
    (alpha,) = airfield.ready(autopilot, 1)
    flight = exploring(airfield, alpha)
    with alpha.settings(SATELLITES[autopilot]):
        steering = ("exploring", "holding")
        took_s = flight.waits(lambda: flight.phase(alpha.sysid) not in steering, "given up", 60.0)
        report("ended after, s", round(took_s, 2))
        report("by", flight.reason(alpha.sysid))
        flight.ends(DOWN_S)
    assert not alpha.is_armed
    assert was_left_alone(flight, alpha)


def test_a_lost_ground_station_sends_the_vehicle_home_by_its_own_failsafe(
    airfield: Airfield, autopilot: str, report: Report
) -> None:
    (alpha,) = airfield.ready(autopilot, 1)
    alpha.beats = True
    with alpha.settings(STATION_LOST[autopilot]):
        alpha.stands_ready()
        flight = exploring(airfield, alpha)
        alpha.beats = False
        report("yielded after, s", flight.waits_for("yielded", within_s=30.0))
        assert "its autopilot's own failsafe chose" in flight.reason(alpha.sysid)
        flight.ends(DOWN_S)
        assert not alpha.is_armed
        alpha.beats = True  # ArduCopter forgets this failsafe only while the parameter is set
        alpha.stands_ready()
    assert was_left_alone(flight, alpha)


def exploring(airfield: Airfield, alpha: Station) -> Flown:
    """Give a flight that explores."""
    flight = airfield.flies([alpha], "--open-air", "--duration", LONG_S)
    flight.waits_for("exploring")
    flight.rests(3.0)
    return flight


def was_left_alone(flight: Flown, alpha: Station) -> bool:
    """Whether nothing was said to the vehicle any more after the controller had yielded."""
    return flight.said_while(alpha.sysid, "yielded") <= PEACEFUL
