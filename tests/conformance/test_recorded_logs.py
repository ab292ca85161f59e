"""Whole recordings, frame by frame, heard by a controller; where the record is at hand."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from airborne import TICK_S, agent_of
from transcript import CLIENT

from swarm_ctl import wire
from swarm_ctl.agent.agent import Agent
from swarm_ctl.autopilot.telemetry import SUBSCRIBED

REFERENCE = Path(os.environ.get("SWARM_REFERENCE", "reference"))
LOGS = sorted(REFERENCE.glob("*/*.tlog"))
NEEDS_RECORD = pytest.mark.skipif(
    not LOGS, reason="wants the record: SWARM_REFERENCE=/path/to/reference"
)

NOT_NEEDED = {
    "the same as ATTITUDE or LOCAL_POSITION_NED, in other words": {
        "ATTITUDE_QUATERNION",
        "GLOBAL_POSITION_INT",
        "ODOMETRY",
        "VFR_HUD",
        "ALTITUDE",
    },
    "what the autopilot's own loops want of each other": {
        "ATTITUDE_TARGET",
        "POSITION_TARGET_LOCAL_NED",
        "POSITION_TARGET_GLOBAL_INT",
        "NAV_CONTROLLER_OUTPUT",
        "SERVO_OUTPUT_RAW",
        "RC_CHANNELS",
    },
    "raw sensors, which its estimator has already weighed": {
        "GPS_RAW_INT",
        "HIGHRES_IMU",
        "SCALED_PRESSURE",
        "VIBRATION",
    },
    "home, which is where the controller saw it stand": {"HOME_POSITION"},
    "its clock: mission time is the controller's own": {"SYSTEM_TIME", "PING"},
    "its own missions, which nobody here flies": {
        "MISSION_ACK",
        "MISSION_COUNT",
        "MISSION_CURRENT",
        "MISSION_ITEM",
        "MISSION_ITEM_INT",
        "MISSION_ITEM_REACHED",
        "MISSION_REQUEST",
        "MISSION_REQUEST_INT",
    },
    "answers to questions that only the doctor asks": {
        "AUTOPILOT_VERSION",
        "FILE_TRANSFER_PROTOCOL",
        "MESSAGE_INTERVAL",
        "PARAM_VALUE",
    },
    "whether it flies: told by the heartbeat and the height": {"EXTENDED_SYS_STATE"},
    "for others: gimbals, remote identification": {
        "COMMAND_LONG",
        "OPEN_DRONE_ID_LOCATION",
        "OPEN_DRONE_ID_SYSTEM",
    },
    "the truth, which no real vehicle tells": {"SIM_STATE", "SIMSTATE"},
}
"""What recorded vehicles said that a controller hears and leaves."""
UNKNOWN = {
    8: "LINK_NODE_STATUS",
    380: "TIME_ESTIMATE_TO_TARGET",
    411: "CURRENT_EVENT_SEQUENCE",
    435: "AVAILABLE_MODES",
    437: "AVAILABLE_MODES_MONITOR",
    441: "GNSS_INTEGRITY",
}
"""Messages outside the dialect, by id: how a link does, how long a flight will take, modes by
name, events by number, a receiver's honesty. Nothing that a controller decides by."""


def frames(path: Path) -> Iterator[tuple[float, bytes]]:
    """Read what the vehicle sent, and when, from 0."""
    data, at, first_us = path.read_bytes(), 0, None
    while at + 8 < len(data):
        frame = data[at + 8 : at + 8 + data[at + 9] + (12 if data[at + 8] == 0xFD else 8)]
        at_us = int.from_bytes(data[at : at + 8], "big")
        first_us = at_us if first_us is None else first_us
        if (frame[5], frame[6]) != CLIENT:
            yield (at_us - first_us) * 1e-6, frame
        at += 8 + len(frame)


def number_of(frame: bytes) -> int:
    """Give the id of a MAVLink 2 frame."""
    return int.from_bytes(frame[7:10], "little")


class Listening:
    """A controller that has heard a whole log, and ticked at its times."""

    def __init__(self, folder: Path, log: Path) -> None:
        self.agent = agent_of(folder, ready_timeout_s=3600.0)
        self.numbers: Counter[int] = Counter()
        self.texts: list[str] = []
        self.estimates: list[tuple[float, bool | None]] = []
        self.modes: list[str] = []
        tick = 0
        for at_s, frame in frames(log):
            while tick * TICK_S < at_s:
                self.agent.tick(tick * TICK_S)
                tick += 1
            self.numbers[number_of(frame)] += 1
            self.agent.receive(frame, at_s)
            self._note(self.agent, at_s)

    def _note(self, agent: Agent, at_s: float) -> None:
        telemetry = agent.telemetry
        self.texts += [text.words for text in telemetry.texts]
        telemetry.texts.clear()
        if not self.estimates or self.estimates[-1][1] != telemetry.estimate_ok:
            self.estimates.append((at_s, telemetry.estimate_ok))
        if telemetry.autopilot and (not self.modes or self.modes[-1] != telemetry.mode_name):
            self.modes.append(telemetry.mode_name)


def listening(folder: Path, name: str) -> Listening:
    """Hear a log by its name."""
    return Listening(folder, REFERENCE / name)


def test_nothing_is_both_heard_and_left() -> None:
    left = [name for names in NOT_NEEDED.values() for name in names]
    assert len(left) == len(set(left))
    assert not {wire.message(name).name for name in left} & set(SUBSCRIBED)
    for number in UNKNOWN:
        with pytest.raises(ValueError, match="no message"):
            wire.message(number)


@NEEDS_RECORD
@pytest.mark.parametrize("log", LOGS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_frame_is_heard_or_left_for_a_reason(tmp_path: Path, log: Path) -> None:
    listened = Listening(tmp_path, log)
    unknown = {number: n for number, n in listened.numbers.items() if number in UNKNOWN}
    known = {wire.message(n).name for n in listened.numbers if n not in UNKNOWN}
    left = {name for names in NOT_NEEDED.values() for name in names}
    assert known <= left | set(SUBSCRIBED)
    stats = listened.agent.parser.stats
    assert stats.frames == sum(listened.numbers.values()) - sum(unknown.values())
    assert stats.unknown == sum(unknown.values())
    assert (stats.bad_crc, stats.bad_flags, stats.skipped_bytes) == (0, 0, 0)


@NEEDS_RECORD
def test_a_text_in_two_chunks_is_one(tmp_path: Path) -> None:
    texts = listening(tmp_path, "ardupilot/requests.tlog").texts
    assert texts.count("Requested rate for message ID 32 too fast. Increase SCHED_LOOP_RATE") == 3


@NEEDS_RECORD
def test_ardupilots_estimate_is_trusted_until_its_satellites_are_gone(tmp_path: Path) -> None:
    listened = listening(tmp_path, "ardupilot/fail_gps_loss.tlog")
    assert [ok for _, ok in listened.estimates] == [None, False, True, False]
    (_, (began_s, _), (trusted_s, _), (lost_s, _)) = listened.estimates
    assert (began_s, trusted_s, lost_s) == pytest.approx((1.8, 20.8, 31.9), abs=0.1)
    assert listened.agent.telemetry.is_failsafe


@NEEDS_RECORD
def test_px4s_estimate_is_trusted_three_seconds_after_power_up(tmp_path: Path) -> None:
    listened = listening(tmp_path, "px4/flight_basic.tlog")
    assert [ok for _, ok in listened.estimates] == [None, False, True]
    assert listened.estimates[-1][0] == pytest.approx(3.0, abs=0.1)


@NEEDS_RECORD
def test_a_flights_modes_are_told_in_order(tmp_path: Path) -> None:
    px4 = listening(tmp_path, "px4/flight_basic.tlog")
    assert px4.modes == ["AUTO.LOITER", "OFFBOARD", "POSCTL", "AUTO.LAND", "OFFBOARD"]
    ardupilot = listening(tmp_path, "ardupilot/flight.tlog")
    assert ardupilot.modes == ["STABILIZE", "GUIDED", "LAND"]


@NEEDS_RECORD
def test_px4s_reports_tell_what_bars_arming(tmp_path: Path) -> None:
    agent, log = agent_of(tmp_path), REFERENCE / "px4/failsafe_default.tlog"
    told: list[tuple[str, ...]] = []
    for at_s, frame in frames(log):
        agent.receive(frame, at_s)
        barriers = agent.telemetry.events.barriers
        if not told or told[-1] != barriers:
            told.append(barriers)
    assert told == [
        (),
        ("no valid attitude estimate", "no valid position estimate"),
        ("no valid position estimate",),
        ("no offboard setpoints",),
        (),  # they stream
        ("no offboard setpoints",),  # they stopped, which began the failsafe
        (),
    ]
