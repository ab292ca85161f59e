"""Real autopilots in simulation fly a whole mission; pilots and stations take their vehicles."""

from __future__ import annotations

import math
import time

import pytest
from sitl.airfield import Airfield, Report
from sitl.flown import Flown
from sitl.station import Station

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(600)]

DURATION_S = 120.0
LONG_S = 600.0
HOVER_S, HOVER_M = 15.0, 2.0
NAV_RETURN_TO_LAUNCH, NAV_LAND, PAUSE_CONTINUE, MISSION_START = 20, 21, 193, 300
ACCEPTED = 0
PEACEFUL = {"HEARTBEAT", "TUNNEL", "COMMAND_ACK"}
"""What a controller that has yielded still says: that it lives, where it is, and yes or no."""


def test_two_vehicles_fly_the_open_hall_for_two_minutes_and_come_home(
    airfield: Airfield, autopilot: str, report: Report
) -> None:
    pair = airfield.ready(autopilot)
    flight = airfield.flies(pair, "--open-air", "--duration", DURATION_S)
    code, said = flight.ends(DURATION_S + 180.0)
    assert code == 0, said
    assert set(flight.results().values()) == {("done", "")}
    for station in pair:
        flown = flight.track(station.sysid)
        assert math.dist(flown[0][:2], flown[-1][:2]) < 2.0, "at home"
        highest_m = max(flown[0][2] - place[2] for place in flown)
        assert 2.0 < highest_m < 6.2, "in three dimensions, and below the mission's ceiling"
    summary = flight.summary()
    assert summary["exploration_s"] > DURATION_S - 1.0
    report("flown_m", [one["path_length_m"] for one in summary["per_vehicle"]])
    report("duration_s", summary["duration_s"])


@pytest.mark.parametrize(
    ("autopilot", "mode"), [("px4", "AUTO.LOITER"), ("px4", "POSCTL"), ("ardupilot", "LOITER")]
)
def test_a_pilot_takes_over_and_the_vehicle_hovers_until_it_is_given_back(
    airfield: Airfield, autopilot: str, mode: str, report: Report
) -> None:
    (alpha,) = airfield.ready(autopilot, 1)
    flight = airfield.flies([alpha], "--open-air", "--duration", LONG_S)
    flight.waits_for("exploring")
    alpha.holds_sticks = True
    flight.rests(5.0)
    alpha.chooses(mode)
    report("yielded after, s", flight.waits_for("yielded", within_s=5.0))
    assert flight.reason(alpha.sysid) == f"the pilot chose {mode}"
    flight.rests(3.0)
    stopped = alpha.place
    farthest_m = max(math.dist(stopped, place) for place in watched(flight, alpha, HOVER_S))
    report("drifted, m", farthest_m)
    assert farthest_m < HOVER_M
    assert alpha.is_armed
    assert alpha.mode == mode
    assert alpha.orders(MISSION_START) == ACCEPTED
    report("flies on after, s", flight.waits_for("exploring", within_s=15.0))
    assert alpha.orders(NAV_RETURN_TO_LAUNCH) == ACCEPTED
    assert flight.ends()[0] == 0
    assert flight.said_while(alpha.sysid, "yielded") <= PEACEFUL
    assert flight.phase(alpha.sysid) == "done"


@pytest.mark.parametrize(
    ("away_s", "farthest_m"), [(1.0, 2.0), (13.0, 8.0)], ids=["guarded", "abandoned"]
)
def test_a_killed_controller_that_is_started_again_takes_its_vehicles_over(
    airfield: Airfield, autopilot: str, away_s: float, farthest_m: float, report: Report
) -> None:
    pair = airfield.ready(autopilot)
    flight = airfield.flies(pair, "--open-air", "--duration", 60.0)
    flight.waits_for("exploring")
    flight.rests(10.0)
    before = [station.place for station in pair]
    flight.killed()
    began = time.monotonic()
    time.sleep(away_s)  # noqa: TID251 - real vehicles live in real time
    flight.starts()
    flight.waits(lambda: len(flight.events("ControllerRestarted")) == len(pair), "restarted")
    flight.waits_for("exploring", within_s=20.0)
    report("out of control, s", round(time.monotonic() - began, 1))
    moved = [math.dist(place, station.place) for place, station in zip(before, pair, strict=True)]
    report("moved meanwhile, m", [round(metres, 1) for metres in moved])
    assert max(moved) < farthest_m
    code, said = flight.ends(180.0)
    assert code == 0, said
    assert {phase for phase, _ in flight.results().values()} == {"done"}


def test_a_station_orders_the_controller_to_pause_go_on_and_land(
    airfield: Airfield, autopilot: str, report: Report
) -> None:
    (alpha,) = airfield.ready(autopilot, 1)
    flight = airfield.flies([alpha], "--open-air", "--duration", LONG_S)
    flight.waits_for("exploring")
    assert alpha.orders(PAUSE_CONTINUE, 0.0) == ACCEPTED
    flight.waits_for("holding", within_s=2.0)
    flight.rests(3.0)
    held = alpha.place
    drift_m = max(math.dist(held, place) for place in watched(flight, alpha, 5.0))
    report("drifted, m", drift_m)
    assert drift_m < HOVER_M
    assert alpha.orders(PAUSE_CONTINUE, 1.0) == ACCEPTED
    flight.waits_for("exploring", within_s=2.0)
    assert alpha.orders(NAV_LAND) == ACCEPTED
    assert flight.ends()[0] == 0
    assert not alpha.is_armed
    assert flight.results() == {alpha.sysid: ("done", "land ordered by the operator")}


def test_a_stations_return_to_the_autopilot_itself_is_not_fought(
    airfield: Airfield, autopilot: str, report: Report
) -> None:
    (alpha,) = airfield.ready(autopilot, 1)
    flight = airfield.flies([alpha], "--open-air", "--duration", LONG_S)
    flight.waits_for("exploring")
    flight.rests(5.0)
    alpha.command(NAV_RETURN_TO_LAUNCH)
    report("yielded after, s", flight.waits_for("yielded", within_s=5.0))
    assert flight.reason(alpha.sysid) in {"the pilot chose AUTO.RTL", "the pilot chose RTL"}
    flight.ends()
    assert not alpha.is_armed
    assert flight.said_while(alpha.sysid, "yielded") <= PEACEFUL


def watched(flight: Flown, station: Station, seconds: float) -> list[tuple[float, float, float]]:
    """Give where a vehicle says it is, for a while."""
    places = []
    for _ in range(round(seconds / 0.1)):
        flight.rests(0.1)
        places.append(station.place)
    return places
