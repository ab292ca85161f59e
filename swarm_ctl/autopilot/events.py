"""What PX4 says by EVENT: why it would not arm, and what its failsafes do.

PX4 sends STATUSTEXT only to ground stations, EVENT to everybody. An event is a number, made of
its name; its words are in a file of its firmware. Those that keep a vehicle on the ground or
take it away from its controller are said here in our own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from struct import Struct
from typing import Any

from swarm_ctl.autopilot.texts import Text

FNV_OFFSET, FNV_PRIME = 0x811C9DC5, 0x01000193
AUTOPILOT_EVENTS = 1 << 24
"""The component in an event's number: the autopilot itself."""
OFFBOARD_GROUP = 1 << 14
"""Bit of offboard in navigation_mode_group_t, the modes that a check keeps from arming."""
ERROR = 3
"""Least level, as of MAV_SEVERITY, of what is worth a line though nobody knows it here."""
_MAY_ARM = Struct("<9xI").unpack_from
"""Of a report's first event: chunk, errors, warnings, then the modes it may be armed in."""
_BARRED = Struct("<I").unpack_from
"""Of a check: the modes it bars."""


def number_of(name: str) -> int:
    """Give an event's number: 24 bits of FNV-1a of its name, and the component."""
    value = FNV_OFFSET
    for octet in name.encode():
        value = (value ^ octet) * FNV_PRIME & 0xFFFFFFFF
    return value & 0xFFFFFF | AUTOPILOT_EVENTS


def _numbered(sentences: dict[str, str]) -> dict[int, str]:
    return {number_of(name): sentence for name, sentence in sentences.items()}


REPORT_BEGINS = number_of("commander_arming_check_summary")
REPORT_ENDS = number_of("commander_health_summary")

NO_SETPOINTS = "no offboard setpoints"
CHECKS = _numbered(
    {
        "check_accel_missing": "no accelerometer",
        "check_accel_no_data": "no data from an accelerometer",
        "check_accel_not_calibrated": "accelerometer not calibrated",
        "check_armable_configuration": "the vehicle is in its safety configuration",
        "check_avionics_power_high": "avionics voltage too high",
        "check_avionics_power_low": "avionics voltage too low",
        "check_avionics_power_missing": "no word of the avionics voltage",
        "check_baro_missing": "no barometer",
        "check_baro_no_data": "no data from a barometer",
        "check_battery_critical": "battery critical",
        "check_battery_disconnected": "battery disconnected",
        "check_battery_emergency": "battery empty",
        "check_battery_fault": "battery faulty",
        "check_battery_low": "battery low",
        "check_battery_missing": "no battery",
        "check_battery_rem_flight_time_low": "too little flight time left",
        "check_battery_unhealthy": "battery not healthy",
        "check_cpuload_too_high": "processor overloaded",
        "check_distance_sensor_invalid": "no data from a distance sensor",
        "check_distance_sensor_missing": "no distance sensor",
        "check_escs_fault": "motor controller faulty",
        "check_escs_offline": "motor controller offline",
        "check_escs_telem_missing": "no word from the motor controllers",
        "check_estimator_gps_fix_too_low": "no GNSS fix",
        "check_estimator_gps_generic": "poor GNSS quality",
        "check_estimator_gps_hor_pos_drift_too_high": "GNSS position drifts sideways",
        "check_estimator_gps_hor_pos_err_too_high": "GNSS position too inexact",
        "check_estimator_gps_hor_speed_drift_too_high": "GNSS speed drifts sideways",
        "check_estimator_gps_jamming_critical": "GNSS jammed",
        "check_estimator_gps_not_fusing": "the estimator does not use GNSS",
        "check_estimator_gps_num_sats_too_low": "too few GNSS satellites",
        "check_estimator_gps_pdop_too_high": "GNSS geometry too poor",
        "check_estimator_gps_speed_acc_too_low": "GNSS speed too inexact",
        "check_estimator_gps_spoofed": "GNSS spoofed",
        "check_estimator_gps_vert_pos_drift_too_high": "GNSS height drifts",
        "check_estimator_gps_vert_pos_err_too_high": "GNSS height too inexact",
        "check_estimator_gps_vert_speed_drift_too_high": "GNSS vertical speed drifts",
        "check_estimator_heading_not_stable": "heading estimate not stable",
        "check_estimator_hgt_not_stable": "height estimate not stable",
        "check_estimator_high_accel_bias": "accelerometer bias too high",
        "check_estimator_high_gyro_bias": "gyroscope bias too high",
        "check_estimator_hor_pos_not_stable": "horizontal position not stable",
        "check_estimator_hor_vel_not_stable": "horizontal velocity not stable",
        "check_estimator_low_position_accuracy": "position estimate too inexact",
        "check_estimator_mag_fault": "compass faulty",
        "check_estimator_mag_interference": "strong magnetic interference",
        "check_estimator_missing_data": "the estimator is not running yet",
        "check_estimator_vert_vel_not_stable": "vertical velocity not stable",
        "check_failure_detector_alt": "altitude failure",
        "check_failure_detector_arm_esc": "motor controller failure",
        "check_failure_detector_ext": "failure triggered from outside",
        "check_failure_detector_imbalanced_prop": "imbalanced propeller",
        "check_failure_detector_motor": "motor failure",
        "check_failure_detector_pitch": "attitude failure (pitch)",
        "check_failure_detector_roll": "attitude failure (roll)",
        "check_flight_time_limit": "longest flight time reached",
        "check_gf_no_home": "a geofence needs a home",
        "check_gf_violation_custom_gf": "outside the geofence",
        "check_gf_violation_max_alt": "above the geofence",
        "check_gf_violation_max_hor_dist": "too far away for the geofence",
        "check_gyro_missing": "no gyroscope",
        "check_gyro_no_data": "no data from a gyroscope",
        "check_gyro_not_calibrated": "gyroscope not calibrated",
        "check_hardfault_present": "a crash of the firmware is on record",
        "check_imu_accel_inconsistent": "accelerometers inconsistent",
        "check_imu_gyro_inconsistent": "gyroscopes inconsistent",
        "check_mag_consistency": "compasses inconsistent",
        "check_mag_fault": "compass faulty",
        "check_mag_missing": "no compass",
        "check_mag_no_data": "no data from a compass",
        "check_mag_not_calibrated": "compass not calibrated",
        "check_mag_sys_has_mag_missing": "fewer compasses than configured",
        "check_man_control_kill_engaged": "kill switch engaged",
        "check_man_control_rtl_engaged": "return switch engaged",
        "check_missing_cpuload": "no word of the processor load",
        "check_missing_fmu_sdcard": "no SD card",
        "check_missing_system_power": "no word of the system's power",
        "check_modes_angular_velocity": "no valid angular velocity",
        "check_modes_attitude": "no valid attitude estimate",
        "check_modes_cannot_takeoff": "its mode is not one to arm in",
        "check_modes_global_pos": "no valid global position",
        "check_modes_home_position": "no home position",
        "check_modes_local_alt": "no valid height estimate",
        "check_modes_local_pos": "no valid position estimate",
        "check_modes_manual_control": "no manual control",
        "check_modes_mission": "no mission",
        "check_modes_offboard_signal": NO_SETPOINTS,
        "check_open_drone_id_missing": "no remote identification",
        "check_open_drone_id_unhealthy": "remote identification not ready",
        "check_optical_flow_sensor_invalid": "no data from the optical flow sensor",
        "check_optical_sensor_missing": "no optical flow sensor",
        "check_parachute_missing": "no parachute",
        "check_parachute_unhealthy": "parachute not ready",
        "check_power_oc_hipower": "overcurrent of a high-power port",
        "check_power_oc_periph": "overcurrent of a peripheral",
        "check_ram_usage_too_high": "memory nearly used up",
        "check_rc_dl_no_dllink": "no ground station",
        "check_system_arm_auth_failed": "arming not authorised",
        "check_system_flight_term_active": "flight termination active",
        "check_system_no_global_pos": "global position required",
        "check_system_no_home_pos": "home position required",
        "check_system_safety_button": "safety button not pressed",
        "check_system_usb_connected": "USB connected",
        "check_wind_too_high": "too much wind",
    }
)
"""Checks before arming, told in a report: arguments are the modes they bar, and a component."""

ESTIMATES = frozenset(
    map(number_of, ("check_modes_local_alt", "check_modes_local_pos", "check_modes_attitude"))
)
"""Velocities need these, though PX4 counts them against offboard only as missing setpoints."""

FAILSAFES = _numbered(
    {
        "commander_failsafe_enter": "failsafe: {cause}, {action}",
        "commander_failsafe_enter_autopilot_disengaged": "failsafe: {action}",
        "commander_failsafe_enter_generic": "failsafe: {action}",
        "commander_failsafe_enter_generic_hold": "failsafe: holds, then {action}",
        "commander_failsafe_enter_hold": "failsafe: {late_cause}, holds, then {action}",
    }
)
"""Arguments are the mode chosen before, the action, for holds the delay, and the cause."""
CAUSES = (
    "an unnamed cause",
    "manual control lost",
    "ground station lost",
    "battery low",
    "battery critical",
    "battery empty",
    "little flight time left",
)
ACTIONS = (
    "nothing",
    "a warning",
    "position mode",
    "altitude mode",
    "stabilized mode",
    "hold",
    "return",
    "land",
    "descend",
    "disarm",
    "terminate",
)

OTHERS = _numbered(
    {
        "commander_arm_denied_calibrating": "arming denied: calibrating",
        "commander_arm_denied_not_manual": "arming denied: not in a manual mode",
        "commander_arm_denied_resolve_failures": "arming denied: system health failures",
        "commander_arm_denied_throttle_center": "arming denied: throttle above centre",
        "commander_arm_denied_throttle_high": "arming denied: throttle high",
        "commander_disarm_denied_not_landed": "disarming denied: not landed",
        "commander_failsafe_enter_crit_bat_warn": "battery critical",
        "commander_failsafe_enter_crit_low_bat_warn": "battery empty",
        "commander_failsafe_enter_low_bat": "battery low",
        "commander_failsafe_enter_low_flight_time_warn": "little flight time left",
        "commander_gcs_lost": "ground station lost",
        "commander_modeswitch_not_avail": "this mode is not available now",
        "commander_rc_lost": "manual control lost",
        "commander_rc_override": "the pilot moved the sticks",
        "commander_unsupported_arm_disarm_param": "arming asked for wrongly",
        "commander_unsupported_auto_mode": "unknown mode asked for",
    }
)


@dataclass(slots=True)
class _Report:
    """One report on the checks before arming, while it is told."""

    may_arm: bool
    found: list[tuple[int, str]] = field(default_factory=list)

    def barriers(self) -> tuple[str, ...]:
        """Give what keeps it from arming; advice, too, when nothing graver is found."""
        if self.may_arm:
            return ()
        errors = [words for level, words in self.found if level <= ERROR]
        words = dict.fromkeys(errors or [words for _, words in self.found])
        if len(words) > 1:
            words.pop(NO_SETPOINTS, None)  # they come with the take-off
        return tuple(words)


class Events:
    """Turn one PX4's events into words, and keep what its last report holds against arming."""

    def __init__(self) -> None:
        self.barriers: tuple[str, ...] = ()
        """What kept it from arming in offboard when it told last."""
        self.may_arm: bool | None = None
        """Whether it would arm in offboard once setpoints stream; None when it did not tell."""
        self._report: _Report | None = None

    def hear(self, values: Any) -> Text | None:
        """Take an EVENT; give it in words if it is worth a line by itself, as checks are not."""
        number, level, report = values.id, values.log_levels & 0xF, self._report
        if number == REPORT_BEGINS:
            self._report = _Report(may_arm=bool(_MAY_ARM(values.arguments)[0] & OFFBOARD_GROUP))
        elif number == REPORT_ENDS and report is not None:
            self.barriers, self._report = report.barriers(), None
            self.may_arm = self.barriers in {(), (NO_SETPOINTS,)}
        elif number in CHECKS or (report is not None and level <= ERROR):
            bars = number in ESTIMATES or _BARRED(values.arguments)[0] & OFFBOARD_GROUP
            if report is not None and bars:
                report.found.append((level, CHECKS.get(number) or f"check {number} of PX4"))
        elif number in FAILSAFES:
            return Text(level, _failsafe(FAILSAFES[number], values.arguments))
        elif number in OTHERS or level <= ERROR:
            return Text(level, OTHERS.get(number) or f"event {number} of PX4")
        return None


def _failsafe(sentence: str, arguments: bytes) -> str:
    action, late_cause = arguments[4], arguments[7]
    return sentence.format(
        action=_named(ACTIONS, action),
        cause=_named(CAUSES, arguments[5]),
        late_cause=_named(CAUSES, late_cause),
    )


def _named(names: tuple[str, ...], number: int) -> str:
    return names[number] if number < len(names) else f"number {number}"
