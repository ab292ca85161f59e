"""Real autopilots in simulation on the ground: what the doctor says, and why they will not arm."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import pytest
from sitl.airfield import Airfield
from sitl.flown import MISSION
from sitl.station import Station

from swarm_ctl.autopilot.complaints import FRESH_S

pytestmark = [pytest.mark.sitl, pytest.mark.timeout(300)]

BITES = {
    "px4": {"COM_OF_LOSS_T": 5.0, "COM_OBL_RC_ACT": 0.0, "RTL_RETURN_ALT": 60.0},
    "ardupilot": {"GUID_TIMEOUT": 3.0, "BATT_FS_LOW_ACT": 0.0, "FS_EKF_ACTION": 2.0},
}
"""Settings that would bite in the air, and that `--fix` may change."""
RATES = {"LOCAL_POSITION_NED", "ATTITUDE"}
REBOOT = 246


def test_the_doctor_finds_what_would_bite_and_mends_what_it_may(
    airfield: Airfield, autopilot: str
) -> None:
    pair = airfield.ready(autopilot)
    for station in pair:
        for name, value in BITES[autopilot].items():
            station.sets(name, value)
    code, found = doctor(pair)
    assert (code, found["fit"]) == (1, False)
    for vehicle in found["vehicles"]:
        assert set(BITES[autopilot]) <= {finding["check"] for finding in vehicle["findings"]}
        assert vehicle["changed"] == {}, "nothing without being told"
    code, mended = doctor(pair, "--fix")
    assert (code, mended["fit"]) == (0, True)
    assert [set(vehicle["changed"]) for vehicle in mended["vehicles"]] == [
        set(BITES[autopilot])
    ] * len(pair)
    code, again = doctor(pair)
    assert code == 0
    assert not any(vehicle["changed"] for vehicle in again["vehicles"])
    assert not {f["check"] for v in again["vehicles"] for f in v["findings"]} & set(
        BITES[autopilot]
    )


def test_the_doctor_measures_who_is_there_and_how_well_it_is_heard(
    airfield: Airfield, autopilot: str
) -> None:
    pair = airfield.ready(autopilot)
    _, found = doctor(pair)
    assert [vehicle["sysid"] for vehicle in found["vehicles"]] == [one.sysid for one in pair]
    uids = [uid for vehicle in found["vehicles"] for uid in vehicle["uids"]]
    assert len(uids) == len(set(uids)) == len(pair)
    for vehicle in found["vehicles"]:
        assert (vehicle["autopilot"], vehicle["armed"]) == (autopilot, False)
        assert all(vehicle["streams_hz"][stream] > 8.0 for stream in RATES)
        assert vehicle["clock_rate"] == pytest.approx(1.0, abs=0.1)


def test_an_arducopter_without_a_position_says_what_it_waits_for(airfield: Airfield) -> None:
    (alpha,) = airfield.ready("ardupilot", 1)
    assert alpha.asks(REBOOT, 1.0) == 0
    alpha.latest.clear()
    alpha.waits(lambda: "HEARTBEAT" in alpha.latest, "restarted")
    flight = airfield.flies([alpha], "--open-air", ready_timeout_s=25.0)
    code, said = flight.ends()
    assert code == 1, said
    ((phase, reason),) = flight.results().values()
    assert phase == "failed"
    texts = flight.events("StatusText")
    until_s = flight.events("PhaseChanged")[-1]["time_s"] - FRESH_S
    said_last = [event["data"]["text"] for event in texts if event["time_s"] > until_s]
    own = [text.removeprefix("PreArm: ") for text in said_last if text.startswith("PreArm: ")]
    why = f" ({'; '.join(dict.fromkeys(own))})" if own else ""
    assert reason == f"not ready after 25 s: no local position{why}"


def test_a_px4_that_a_check_keeps_on_the_ground_says_which(airfield: Airfield) -> None:
    (alpha,) = airfield.ready("px4", 1)
    with alpha.settings({"NAV_DLL_ACT": 2}):
        flight = airfield.flies([alpha], "--open-air", ready_timeout_s=25.0)
        code, said = flight.ends()
    assert code == 1, said
    ((phase, reason),) = flight.results().values()
    assert phase == "failed"
    assert reason == "not ready after 25 s: no readiness to arm (no ground station)"


def doctor(stations: Sequence[Station], *options: str) -> tuple[int, dict[str, Any]]:
    """Have vehicles examined; give the exit status and what is said."""
    links = [word for one in stations for word in ("--connect", one.vehicle.url)]
    fixed = ("--mission", str(MISSION), "--open-air", "--json")
    done = subprocess.run(
        [sys.executable, "-m", "swarm_ctl", "doctor", *links, *fixed, *options],
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert done.stderr == ""
    return done.returncode, json.loads(done.stdout)
