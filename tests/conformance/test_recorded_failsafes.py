"""Recorded autopilots take themselves away from a controller that explores."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from airborne import EXPLORES, PILOTS, SETPOINT, TICK_S, Airborne
from transcript import FAILSAFES

from swarm_ctl.agent.phases import Phase
from swarm_ctl.autopilot.px4 import PX4
from swarm_ctl.model import Operator

CASES: dict[str, Any] = {case["case"]: case for case in json.loads(FAILSAFES.read_text("utf-8"))}
REPEAT_S, AFTER_S = 1.0, 8.0
"""The last heartbeat of a case goes on so long."""
OWN = "its autopilot's own failsafe chose"


class Ending(NamedTuple):
    """What a case must come to."""

    phase: Phase
    words: str
    """In the reason for leaving, or empty."""
    told: str = ""
    """What the vehicle says itself, as it stands in the record of the flight."""


GONE, DOWN = Phase.YIELDED, Phase.DONE
EXPECTED = {
    "ardupilot/battery low: LAND": Ending(GONE, f"{OWN} LAND", "Battery Failsafe"),
    "ardupilot/satellites lost: LAND": Ending(DOWN, f"{OWN} LAND", "EKF Failsafe"),
    "ardupilot/ground station lost: RTL": Ending(GONE, f"{OWN} RTL", "GCS Failsafe"),
    "ardupilot/ground station lost: LAND": Ending(GONE, f"{OWN} LAND", "GCS Failsafe"),
    "ardupilot/sticks lost: RTL": Ending(GONE, f"{OWN} RTL", "Radio Failsafe"),
    "px4/setpoints lost, no sticks": Ending(DOWN, f"{OWN} POSCTL", "failsafe: position mode"),
    "px4/setpoints lost and found": Ending(Phase.EXPLORING, "", "failsafe: position mode"),
    "px4/default": Ending(DOWN, f"{OWN} POSCTL", "failsafe: position mode"),
    "px4/default_gcs_heartbeat": Ending(DOWN, f"{OWN} POSCTL", "failsafe: position mode"),
    "px4/OBL4_land": Ending(DOWN, f"{OWN} AUTO.LAND", "failsafe: land"),
    "px4/OBL5_hold": Ending(GONE, f"{OWN} AUTO.LOITER", "failsafe: hold"),
    "px4/OBL3_rtl": Ending(GONE, f"{OWN} AUTO.RTL", "failsafe: return"),
    "px4/T3s_hold": Ending(GONE, f"{OWN} AUTO.LOITER", "failsafe: hold"),
    "px4/OBL6_terminate": Ending(GONE, f"{OWN} TERMINATION", "failsafe: terminate"),
    "px4/OBL7_disarm": Ending(Phase.FAILED, "the vehicle disarmed in flight", "failsafe: disarm"),
    "px4/failact0_hold": Ending(GONE, f"{OWN} AUTO.LOITER", "failsafe: hold"),
    "px4/failact0_default": Ending(DOWN, f"{OWN} POSCTL", "failsafe: position mode"),
    "px4/gcs_loss_NAV_DLL_ACT_1_in_OFFBOARD": Ending(GONE, f"{OWN} AUTO.LOITER"),
    "px4/gcs_loss_NAV_DLL_ACT_2_in_OFFBOARD": Ending(GONE, f"{OWN} AUTO.RTL"),
    "px4/gcs_loss_NAV_DLL_ACT_3_in_OFFBOARD": Ending(GONE, f"{OWN} AUTO.LAND"),
}


class Replay:
    """A case, said to a controller that explores."""

    def __init__(self, folder: Path, case: dict[str, Any]) -> None:
        self.flight = Airborne(folder, PILOTS[case["case"].partition("/")[0]])
        self.begun_s = self.flight.now
        self.left_s: float | None = None
        """When the controller stopped steering."""
        self.words = ""
        self.told: list[str] = []
        self._case = case
        self._run()

    def _run(self) -> None:
        flight, said = self.flight, list(self._case["said"])
        beats = [line for line in said if line[1] == "HEARTBEAT"]
        end_s = said[-1][0]
        said += [[end_s + k * REPEAT_S, *beats[-1][1:]] for k in range(1, round(AFTER_S) + 1)]
        lost_s = self._case["position_until_s"]
        while said and flight.agent.phase not in {Phase.DONE, Phase.FAILED}:
            passed_s = flight.now + TICK_S - self.begun_s
            flight.is_told_where = lost_s is None or passed_s <= lost_s
            while said and said[0][0] <= passed_s:
                _, name, fields = said.pop(0)
                flight.say(name, **_values(fields))
            flight.tick()
            self._note()

    def _note(self) -> None:
        flight = self.flight
        for event in flight.agent.drain_events():
            if event.name == "StatusText":
                self.told.append(event.data["text"])
            elif event.data.get("after") in {Phase.YIELDED, Phase.FAILED} and self.left_s is None:
                self.left_s, self.words = event.time_s, event.data["reason"]


def _values(fields: dict[str, Any]) -> dict[str, Any]:
    arguments = fields.get("arguments")
    return fields if arguments is None else {**fields, "arguments": bytes.fromhex(arguments)}


def test_every_recorded_failsafe_has_an_ending() -> None:
    assert CASES.keys() == EXPECTED.keys()


@pytest.mark.parametrize("name", EXPECTED)
def test_a_controller_yields_to_a_recorded_failsafe(tmp_path: Path, name: str) -> None:
    replay, ending = Replay(tmp_path, CASES[name]), EXPECTED[name]
    agent = replay.flight.agent
    assert agent.phase is ending.phase, agent.reason
    assert ending.words in replay.words
    assert any(ending.told in text for text in replay.told) or not ending.told
    if replay.left_s is not None:
        assert not replay.flight.sent_since(replay.left_s)


def test_setpoints_go_on_while_px4_may_take_them_up_again(tmp_path: Path) -> None:
    replay = Replay(tmp_path, CASES["px4/setpoints lost and found"])
    sent_s = [at_s for at_s, name in replay.flight.sent if name == SETPOINT]
    during = [at_s for at_s in sent_s if at_s > replay.begun_s]
    assert max(b - a for a, b in pairwise(during)) < 2 * TICK_S
    assert replay.flight.agent.phase in EXPLORES
    assert replay.flight.sent_since(replay.begun_s) <= {SETPOINT, "a stream"}


@pytest.mark.parametrize("name", [name for name in EXPECTED if name.startswith("ardupilot")])
def test_ardupilot_is_left_alone_at_once(tmp_path: Path, name: str) -> None:
    replay = Replay(tmp_path, CASES[name])
    beats = [(at_s, v) for at_s, what, v in CASES[name]["said"] if what == "HEARTBEAT"]
    told_s = next(at_s for at_s, v in beats if v["custom_mode"] != 4)
    assert replay.left_s is not None
    assert replay.left_s - replay.begun_s - told_s < 2 * TICK_S


def test_a_px4_that_has_landed_is_not_told_to_land_again(tmp_path: Path) -> None:
    flight = Airborne(tmp_path, PX4)  # reference/px4/flight_basic.tlog, 55 s: the mode goes first
    flight.agent.order(Operator.LAND, flight.now)
    flight.tick()
    landing = {"custom_mode": PX4.land_mode, "intended_custom_mode": PX4.land_mode}
    offboard = {"custom_mode": PX4.offboard_mode, "intended_custom_mode": PX4.offboard_mode}
    for _ in range(30):
        flight.say("CURRENT_MODE", **landing)
        flight.say("HEARTBEAT", autopilot=12, base_mode=157, custom_mode=PX4.land_mode)
        flight.tick(0.0)
    landed_s = flight.now
    for _ in range(8):
        flight.say("CURRENT_MODE", **offboard)
        flight.tick(0.0)
    flight.say("HEARTBEAT", autopilot=12, base_mode=17, custom_mode=PX4.offboard_mode)
    flight.tick(0.0)
    assert flight.agent.phase is Phase.DONE
    assert "landing" in flight.sent_since(0.0)
    assert "landing" not in flight.sent_since(landed_s)
