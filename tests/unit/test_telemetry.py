import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarm_ctl import wire
from swarm_ctl.autopilot.status import MOST_NEWS
from swarm_ctl.autopilot.telemetry import SUBSCRIBED, Scan, Telemetry

EAST = math.pi / 2


class Vehicle:
    """A vehicle's link as pymavlink would write it."""

    def __init__(self) -> None:
        self.telemetry = Telemetry(1)
        self._parser = wire.Parser(SUBSCRIBED)

    def says(self, message: Any, now: float = 1.0, component: int = 1) -> Telemetry:
        link = mavlink.MAVLink(None, srcSystem=1, srcComponent=component)
        for frame in self._parser.feed(bytes(message.pack(link))):
            self.telemetry.receive(frame, now)
        return self.telemetry


@pytest.fixture
def vehicle() -> Vehicle:
    return Vehicle()


def heartbeat(autopilot: int, base: int, custom: int, status: int = 4) -> Any:
    return mavlink.MAVLink_heartbeat_message(2, autopilot, base, custom, status, 3)


def distance(cm: int, orientation: int, sensor: int = 0, **more: Any) -> Any:
    return mavlink.MAVLink_distance_sensor_message(
        0, 10, 800, cm, 0, sensor, orientation, 255, **more
    )


def test_px4_and_ardupilot_are_told_apart_by_their_heartbeat(vehicle: Vehicle) -> None:
    px4 = vehicle.says(heartbeat(12, 128 + 17, 6 << 16))
    assert px4.autopilot is not None
    assert (px4.autopilot.name, px4.armed, px4.is_offboard) == ("px4", True, True)
    assert px4.mode_name == "OFFBOARD"
    guided = vehicle.says(heartbeat(3, 89, 4))
    assert guided.autopilot is not None
    assert (guided.autopilot.name, guided.armed, guided.is_offboard) == ("ardupilot", False, True)
    assert vehicle.says(heartbeat(3, 89, 6)).mode_name == "RTL"


def test_a_range_beyond_the_sensors_reach_means_nothing_there(vehicle: Vehicle) -> None:
    assert vehicle.says(distance(250, 0)).ranges_m[0] == pytest.approx(2.5)
    assert vehicle.says(distance(801, 0)).ranges_m[0] == math.inf


@pytest.mark.parametrize(
    ("orientation", "index"), [(0, 0), (4, 1), (12, 1), (6, 2), (2, 3), (24, 4), (25, 5)]
)
def test_each_rangefinder_has_its_place(vehicle: Vehicle, orientation: int, index: int) -> None:
    assert vehicle.says(distance(100, orientation)).ranges_m[index] == pytest.approx(1.0)


def test_a_rangefinder_that_speaks_for_itself_is_heard_and_is_no_sign_of_its_autopilot(
    vehicle: Vehicle,
) -> None:
    telemetry = vehicle.says(distance(150, 0), component=173)
    assert (telemetry.ranges_m[0], telemetry.ranges_s[0]) == (1.5, 1.0)
    assert telemetry.heard_s == -math.inf
    for component in (68, 191):
        vehicle.says(distance(900, 2), component=component)
    assert telemetry.ranges_s[3] == -math.inf, "neither the radio's nor our own"


def test_a_scanner_that_speaks_for_itself_is_heard(vehicle: Vehicle) -> None:
    scan = mavlink.MAVLink_obstacle_distance_message(0, 0, [200] * 72, 5, 10, 800, frame=12)
    assert vehicle.says(scan, component=196).scan_s == 1.0


def test_hits_that_are_too_far_off_are_left_out_and_the_others_stay_as_they_are() -> None:
    scan = Scan(0.3, math.radians(5.0), 10, 800, (5, 10, 120, 200, 201, 800, 65535) * 10)
    everywhere = scan.hits(8.0)
    assert len(everywhere) == 50
    near = [hit for hit in everywhere if math.hypot(*hit) < 2.005]
    assert len(near) == 30
    assert scan.hits(2.0) == near
    assert scan._replace(distances_cm=(201, 800, 65535)).hits(2.0) == []


def test_what_the_radio_tells_late_was_so_in_the_attitude_of_then(vehicle: Vehicle) -> None:
    for boot_ms, yaw in ((1000, 0.0), (1300, EAST)):
        now = boot_ms / 1000.0 + 5.0
        vehicle.says(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, yaw, 0, 0, 0), now)
        place = mavlink.MAVLink_local_position_ned_message(boot_ms, now, 0, 0, 1.0, 0, 0)
        vehicle.says(place, now)
    ahead = distance(200, 100, 7, quaternion=[1.0, 0.0, 0.0, 0.0])
    ahead.time_boot_ms = 1100
    (fix,) = vehicle.says(ahead, 6.35, component=68).peer_fixes
    assert fix.offset_ned_m == pytest.approx((2.0, 0.0, 0.0))
    assert fix.measured_s == pytest.approx(6.1)


@pytest.mark.parametrize("boot_ms", [0, 5, 900_000])
def test_a_radio_with_a_clock_of_its_own_tells_of_now(vehicle: Vehicle, boot_ms: int) -> None:
    place = mavlink.MAVLink_local_position_ned_message(60_000, 0, 0, 0, 1.0, 0, 0)
    vehicle.says(place, 6.0)
    ahead = distance(200, 100, 7, quaternion=[1.0, 0.0, 0.0, 0.0])
    ahead.time_boot_ms = boot_ms
    (fix,) = vehicle.says(ahead, 6.0, component=68).peer_fixes
    assert fix.measured_s == 6.0


def test_what_something_newer_has_overtaken_is_no_news(vehicle: Vehicle) -> None:
    for boot_ms, ahead_cm in ((60_200, 90), (60_000, 140)):
        seen = distance(ahead_cm, 0)
        seen.time_boot_ms = boot_ms
        vehicle.says(seen)
        vehicle.says(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, ahead_cm / 100, 0, 0, 0))
        place = mavlink.MAVLink_local_position_ned_message(boot_ms, ahead_cm, 0, 0, 1.0, 0, 0)
        telemetry = vehicle.says(place)
    assert telemetry.ranges_m[0] == pytest.approx(0.9)
    assert telemetry.yaw_rad == pytest.approx(0.9)
    assert telemetry.position_ned_m.x == 90.0


def test_an_autopilot_that_has_begun_anew_is_heard_though_its_clock_says_less(
    vehicle: Vehicle,
) -> None:
    for boot_ms, ahead_cm in ((60_000, 90), (1_000, 140)):
        seen = distance(ahead_cm, 0)
        seen.time_boot_ms = boot_ms
        telemetry = vehicle.says(seen)
    assert telemetry.ranges_m[0] == pytest.approx(1.4)


def test_a_peer_to_the_right_of_a_vehicle_that_faces_east_is_south(vehicle: Vehicle) -> None:
    vehicle.says(mavlink.MAVLink_attitude_message(0, 0.0, 0.0, EAST, 0, 0, 0))
    to_the_right = [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]
    seen = distance(200, 100, sensor=7, quaternion=to_the_right)
    (fix,) = vehicle.says(seen, component=68).peer_fixes
    assert fix.sysid == 7
    assert fix.offset_ned_m == pytest.approx((-2.0, 0.0, 0.0), abs=1e-6)


def test_a_rangefinder_of_the_radio_is_no_rangefinder_of_the_vehicle(vehicle: Vehicle) -> None:
    assert vehicle.says(distance(100, 0), component=68).ranges_m[0] == math.inf


def test_a_victim_ahead_is_placed_in_the_local_frame(vehicle: Vehicle) -> None:
    vehicle.says(mavlink.MAVLink_attitude_message(0, 0.0, 0.0, EAST, 0, 0, 0))
    vehicle.says(mavlink.MAVLink_local_position_ned_message(0, 3.0, 4.0, -1.5, 0, 0, 0))
    target = mavlink.MAVLink_landing_target_message(
        0, 2, 12, 0, 0, 1.5, 0, 0, 1.0, 0.0, 1.2, [1, 0, 0, 0], 0, 1
    )
    (fix,) = vehicle.says(target).victim_fixes
    assert fix.number == 2
    assert fix.position_ned_m == pytest.approx((3.0, 5.0, -0.3), abs=1e-5)


def test_of_what_a_hung_link_lets_go_at_once_the_latest_is_kept(vehicle: Vehicle) -> None:
    for number in range(1000):
        target = mavlink.MAVLink_landing_target_message(
            0, number % 256, 12, 0, 0, 1.5, 0, 0, float(number), 0.0, 1.2, [1, 0, 0, 0], 0, 1
        )
        fixes = vehicle.says(target).victim_fixes
    assert len(fixes) == MOST_NEWS
    assert fixes[-1].number == 999 % 256


def test_of_what_waits_to_be_taken_note_of_the_latest_is_kept(vehicle: Vehicle) -> None:
    for number in range(MOST_NEWS + 10):
        vehicle.says(mavlink.MAVLink_statustext_message(6, b"%d" % number))
        telemetry = vehicle.says(mavlink.MAVLink_command_ack_message(number, 0))
    kept = range(10, MOST_NEWS + 10)
    assert [text.words for text in telemetry.texts] == [str(number) for number in kept]
    assert [ack.command_id for ack in telemetry.acks] == list(kept)


def test_numbers_that_are_none_change_nothing(vehicle: Vehicle) -> None:
    nan = math.nan
    vehicle.says(mavlink.MAVLink_local_position_ned_message(0, 1.0, 2.0, -3.0, 0, 0, 0))
    after = vehicle.says(mavlink.MAVLink_local_position_ned_message(0, nan, 0, 0, 0, 0, 0), 9.0)
    assert after.position_ned_m == (1.0, 2.0, -3.0)
    assert after.position_s == 1.0
    after = vehicle.says(mavlink.MAVLink_attitude_message(0, nan, 0, 0, 0, 0, 0), 9.0)
    assert after.attitude_s == -math.inf


def test_a_battery_that_is_not_measured_is_not_empty(vehicle: Vehicle) -> None:
    def status(percent: int) -> Any:
        return mavlink.MAVLink_sys_status_message(
            0, 0, 0x10000000, 0, 12000, 100, percent, 0, 0, 0, 0, 0, 0
        )

    assert vehicle.says(status(-1)).battery_fraction is None
    assert vehicle.says(status(80)).battery_fraction == pytest.approx(0.8)
    assert vehicle.telemetry.prearm_ok


def mode(custom: int, intended: int) -> Any:
    class CurrentMode:  # pymavlink does not know it
        def pack(self, _link: Any) -> bytes:
            return wire.message("CURRENT_MODE").pack(0, 1, 1, 0, custom, intended)

    return CurrentMode()


def estimator(flags: int) -> Any:
    return mavlink.MAVLink_estimator_status_message(0, flags, *[0.0] * 8)


def ekf(flags: int) -> Any:
    return mavlink.MAVLink_ekf_status_report_message(flags, *[0.0] * 5)


@pytest.mark.parametrize(
    ("flags", "is_ok"), [(831, True), (37, False), (167, False), (1024, False)]
)
def test_ardupilots_estimator_tells_when_it_is_lost(
    vehicle: Vehicle, flags: int, is_ok: bool
) -> None:
    assert vehicle.telemetry.estimate_ok is None
    assert vehicle.says(ekf(flags), 3.0).estimate_ok is is_ok
    assert vehicle.telemetry.estimate_s == 3.0


@pytest.mark.parametrize(
    ("flags", "is_ok"), [(1023, True), (895, True), (831, True), (164, False), (229, False)]
)
def test_px4s_estimator_tells_when_it_is_lost(vehicle: Vehicle, flags: int, is_ok: bool) -> None:
    assert vehicle.says(estimator(flags)).estimate_ok is is_ok


OFFBOARD, POSCTL, RTL = 6 << 16, 3 << 16, 4 << 16 | 5 << 24


def test_px4s_failsafe_is_told_from_a_pilot_by_what_was_intended(vehicle: Vehicle) -> None:
    vehicle.says(heartbeat(12, 128 + 17, OFFBOARD))
    assert not vehicle.says(mode(OFFBOARD, OFFBOARD)).is_failsafe
    failsafe = vehicle.says(mode(POSCTL, OFFBOARD))
    assert failsafe.is_failsafe
    assert not failsafe.is_offboard
    pilot = vehicle.says(mode(POSCTL, POSCTL))
    assert not pilot.is_failsafe
    assert pilot.mode_name == "POSCTL"


def test_a_pilot_may_choose_what_a_failsafe_would_while_another_one_is_on(
    vehicle: Vehicle,
) -> None:
    vehicle.says(heartbeat(12, 128 + 17, OFFBOARD))
    assert not vehicle.says(mode(RTL, RTL)).is_failsafe
    assert not vehicle.says(heartbeat(12, 128 + 29, RTL, status=5), 1.5).is_failsafe


def test_without_word_of_the_intention_the_status_tells(vehicle: Vehicle) -> None:
    assert vehicle.says(heartbeat(3, 217, 9, status=5)).is_failsafe  # LAND, critical
    assert not vehicle.says(heartbeat(3, 217, 9, status=4)).is_failsafe
    assert not vehicle.says(heartbeat(3, 217, 5, status=5)).is_failsafe  # a pilot's LOITER
    vehicle.says(mode(OFFBOARD, OFFBOARD), 1.0)
    assert vehicle.says(heartbeat(12, 209, POSCTL, status=5), 9.0).is_failsafe
    assert vehicle.says(heartbeat(12, 209, 10 << 16, status=8), 9.0).is_failsafe


@pytest.mark.parametrize(
    ("autopilot", "custom", "name"),
    [
        (12, 4 << 16 | 9 << 24, "AUTO.PRECLAND"),
        (12, 3 << 16 | 1 << 24, "POSCTL.ORBIT"),
        (12, 10 << 16, "TERMINATION"),
        (12, 4 << 16 | 18 << 24, "AUTO.EXTERNAL8"),
        (12, 99 << 16, "mode 0x630000"),
        (3, 27, "AUTO_RTL"),
        (3, 18, "THROW"),
        (3, 99, "mode 0x63"),
    ],
)
def test_every_mode_has_a_name(vehicle: Vehicle, autopilot: int, custom: int, name: str) -> None:
    assert vehicle.says(heartbeat(autopilot, 0, custom)).mode_name == name


def test_answers_to_others_are_not_ours(vehicle: Vehicle) -> None:
    def ack(*target: int) -> Any:
        return mavlink.MAVLink_command_ack_message(400, 4, 0, 0, *target)

    assert not vehicle.says(ack(255, 190)).acks
    assert not vehicle.says(ack(1, 195)).acks
    assert not vehicle.says(ack(2, 191)).acks
    assert list(vehicle.says(ack(1, 191)).acks) == [(400, 4, 0)]
    assert len(vehicle.says(ack(0, 0)).acks) == 2


def test_the_charge_comes_from_whatever_tells_it(vehicle: Vehicle) -> None:
    def battery(percent: int, number: int = 0) -> Any:
        return mavlink.MAVLink_battery_status_message(
            number, 1, 1, 0, [0xFFFF] * 10, 0, 0, 0, percent
        )

    assert vehicle.says(battery(-1)).battery_fraction is None
    assert vehicle.says(battery(73)).battery_fraction == pytest.approx(0.73)
    assert vehicle.says(battery(5, number=1)).battery_fraction == pytest.approx(0.73)


def test_readiness_is_the_checks_where_they_are_told(vehicle: Vehicle) -> None:
    def status(present: int, health: int) -> Any:
        return mavlink.MAVLink_sys_status_message(
            present, present, health, 0, 12000, 100, 50, 0, 0, 0, 0, 0, 0
        )

    prearm = 0x10000000
    vehicle.says(heartbeat(3, 81, 0, status=3))
    assert vehicle.telemetry.is_ready  # all that is known is STANDBY
    assert not vehicle.says(status(prearm, 0)).is_ready  # ArduPilot: STANDBY, and not ready
    assert vehicle.says(status(prearm, prearm)).is_ready
    assert not vehicle.says(status(0, 0)).is_ready  # PX4 shows the bit only while it is well


def test_a_reason_whose_end_is_lost_is_told_all_the_same(vehicle: Vehicle) -> None:
    words = b"PreArm: Compasses inconsistent by an angle of more than"[:50]
    vehicle.says(mavlink.MAVLink_statustext_message(2, words, 9, 0), 1.0)
    assert vehicle.telemetry.why_not(1.5) == ""
    assert vehicle.telemetry.why_not(2.1).startswith("Compasses inconsistent by an angle")


def test_why_not_tells_all_that_the_vehicle_has_against_it(vehicle: Vehicle) -> None:
    assert vehicle.telemetry.why_not(0.0) == ""
    for words in ("Arm: Gyros inconsistent", "Arm: Need Position Estimate"):
        vehicle.says(mavlink.MAVLink_statustext_message(2, words.encode()))
    vehicle.says(
        mavlink.MAVLink_sys_status_message(
            0x2000000, 0x2000000, 0, 0, 12000, 100, 50, 0, 0, 0, 0, 0, 0
        )
    )
    assert vehicle.telemetry.why_not(2.0) == (
        "Gyros inconsistent; Need Position Estimate; battery not healthy"
    )
