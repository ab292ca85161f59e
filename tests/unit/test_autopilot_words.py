"""What autopilots say of themselves: texts in chunks, events, sensors, complaints."""

import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl import wire
from swarm_ctl.autopilot.complaints import SENSORS, Complaints, unhealthy
from swarm_ctl.autopilot.events import CHECKS, FAILSAFES, OTHERS, Events, number_of
from swarm_ctl.autopilot.texts import Text, Texts

TEXT, EVENT = wire.message("STATUSTEXT"), wire.message("EVENT")
LONG = "Requested rate for message ID 32 too fast. Increase SCHED_LOOP_RATE"
ALL_BUT_OFFBOARD, ALL, NONE_OF_THEM = 0xFFFFFFFF & ~(1 << 14), 0xFFFFFFFF, 0


def text(words: str, severity: int = 6, number: int = 0, chunk: int = 0) -> Any:
    return TEXT.values(severity, words, number, chunk)


def chunks(words: str, number: int) -> list[Any]:
    return [text(words[at : at + 50], 6, number, at // 50) for at in range(0, len(words), 50)]


# Texts.


def test_a_short_text_is_said_at_once() -> None:
    assert Texts().hear(text("Arming motors\t"), 0.0) == [Text(6, "Arming motors")]


def test_a_long_text_is_said_when_its_last_chunk_is_there() -> None:
    texts, (first, second) = Texts(), chunks(LONG, 7)
    assert texts.hear(first, 0.0) == []
    assert texts.hear(text("in between", 4), 0.1) == [Text(4, "in between")]
    assert texts.hear(second, 0.2) == [Text(6, LONG)]


def test_chunks_may_come_in_any_order() -> None:
    texts, (first, second) = Texts(), chunks(LONG, 7)
    assert texts.hear(second, 0.0) == []
    assert texts.hear(first, 0.1) == [Text(6, LONG)]


def test_two_texts_in_chunks_are_kept_apart() -> None:
    texts, one, other = Texts(), chunks("a" * 60, 1), chunks("b" * 60, 2)
    assert texts.hear(one[0], 0.0) == texts.hear(other[0], 0.0) == []
    assert texts.hear(other[1], 0.1) == [Text(6, "b" * 60)]
    assert texts.hear(one[1], 0.1) == [Text(6, "a" * 60)]


def test_a_text_whose_rest_is_lost_is_said_with_a_gap() -> None:
    texts = Texts()
    texts.hear(chunks("a" * 120, 3)[2], 0.0)
    assert texts.hear(text("later"), 1.1) == [Text(6, "......" + "a" * 20), Text(6, "later")]


# Events.


def event(name: str | int, level: int = 3, arguments: bytes = b"") -> Any:
    number = name if isinstance(name, int) else number_of(name)
    return EVENT.values(0, 0, number, 0, 0, 0x10 | level, arguments.ljust(40, b"\0"))


def report(events: Events, *checks: tuple[str | int, int, int], may_arm: int) -> None:
    summary = struct.pack("<BIIII", 0, 0, 0, may_arm, may_arm)
    events.hear(event("commander_arming_check_summary", 8, summary))
    for name, level, barred in checks:
        assert events.hear(event(name, level, struct.pack("<IB", barred, 20))) is None
    events.hear(event("commander_health_summary", 8))


def test_an_event_is_numbered_by_its_name() -> None:  # reference/px4/behaviour.json
    assert number_of("commander_armed_by") == 26266355
    assert number_of("commander_failsafe_enter_generic") == 31382480
    assert number_of("commander_disarm_denied_not_landed") == 25868725


def test_no_event_means_two_things() -> None:
    tables = (CHECKS, FAILSAFES, OTHERS)
    assert len({number for table in tables for number in table}) == 104 + 5 + 16


def test_a_report_names_what_bars_arming_in_offboard_and_nothing_else() -> None:
    events = Events()
    report(
        events,
        ("check_modes_local_pos", 3, ALL),
        ("check_modes_offboard_signal", 3, 1 << 14),
        ("check_modes_mission", 6, 1 << 3),
        ("check_modes_manual_control", 4, ALL),
        ("check_modes_global_pos", 3, ALL_BUT_OFFBOARD),
        (12345678, 3, ALL),
        may_arm=NONE_OF_THEM,
    )
    assert events.barriers == ("no valid position estimate", "check 12345678 of PX4")
    assert events.may_arm is False


def test_want_of_setpoints_alone_bars_nothing_that_the_take_off_does_not_bring() -> None:
    events = Events()
    report(events, ("check_modes_offboard_signal", 3, 1 << 14), may_arm=ALL_BUT_OFFBOARD)
    assert events.barriers == ("no offboard setpoints",)
    assert events.may_arm


def test_advice_is_a_barrier_when_there_is_no_graver_one() -> None:
    events = Events()
    advice = (("check_system_safety_button", 6, ALL), ("check_rc_dl_no_dllink", 6, ALL))
    report(events, *advice, may_arm=NONE_OF_THEM)
    assert events.barriers == ("safety button not pressed", "no ground station")
    report(events, *advice, may_arm=ALL)
    assert not events.barriers


def test_a_failsafe_says_why_and_what_it_does() -> None:
    generic = event("commander_failsafe_enter_generic", 2, bytes.fromhex("0000060002"))
    assert Events().hear(generic) == Text(2, "failsafe: position mode")
    battery = struct.pack("<IBB", 6 << 16, 6, 4)
    low = event("commander_failsafe_enter", 2, battery)
    assert Events().hear(low) == Text(2, "failsafe: battery critical, return")
    late = event("commander_failsafe_enter_hold", 2, struct.pack("<IBHB", 6 << 16, 7, 5, 2))
    assert Events().hear(late) == Text(2, "failsafe: ground station lost, holds, then land")
    odd = event("commander_failsafe_enter", 2, struct.pack("<IBB", 6 << 16, 60, 70))
    assert Events().hear(odd) == Text(2, "failsafe: number 70, number 60")


def test_an_unknown_event_is_told_by_its_number_if_it_is_grave() -> None:
    assert Events().hear(event(17000001, 3)) == Text(3, "event 17000001 of PX4")
    assert Events().hear(event(17000001, 6)) is None


# Sensors.


def test_a_sensor_that_is_not_there_or_not_used_may_be_what_it_likes() -> None:
    assert unhealthy(present=4, enabled=4, health=0) == ["compass not healthy"]
    assert unhealthy(present=0, enabled=4, health=0) == []
    assert unhealthy(present=4, enabled=0, health=0) == []
    assert unhealthy(present=0x12000004, enabled=0x12000004, health=0) == [
        "compass not healthy",
        "battery not healthy",
    ]


def test_the_sensors_stand_where_mavlink_has_them() -> None:
    for bit, name in (
        (mavlink.MAV_SYS_STATUS_SENSOR_GPS, "GNSS"),
        (mavlink.MAV_SYS_STATUS_SENSOR_OPTICAL_FLOW, "optical flow"),
        (mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER, "radio control"),
        (mavlink.MAV_SYS_STATUS_AHRS, "attitude estimate"),
        (mavlink.MAV_SYS_STATUS_SENSOR_BATTERY, "battery"),
        (mavlink.MAV_SYS_STATUS_SENSOR_PROPULSION, "propulsion"),
    ):
        assert SENSORS[bit.bit_length() - 1] == name


# Complaints.


def test_complaints_are_told_once_each_and_forgotten() -> None:
    complaints = Complaints()
    for now in (0.0, 2.0):
        complaints.hear(Text(2, "PreArm: Gyros inconsistent"), now)
        complaints.hear(Text(2, "Arm: Need Position Estimate"), now)
        complaints.hear(Text(2, "Arm: Gyros inconsistent"), now)
    complaints.hear(Text(6, "EKF3 IMU0 is using GPS"), 2.0)
    assert complaints.recent(7.0) == ["Gyros inconsistent", "Need Position Estimate"]
    assert complaints.recent(7.1) == []


@pytest.mark.parametrize("severity", range(8))
def test_a_warning_is_a_complaint_and_a_notice_is_none(severity: int) -> None:
    complaints = Complaints()
    complaints.hear(Text(severity, "GCS Failsafe"), 0.0)
    assert bool(complaints.recent(0.0)) == (severity <= mavlink.MAV_SEVERITY_WARNING)
