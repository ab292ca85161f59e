"""Commands about the machine itself: checks, calibration, reboot, and what it has no parts for."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from mock_vehicle.autopilot import parameters
from mock_vehicle.autopilot.commands import Command, CommandHandler, Result, acknowledge
from mock_vehicle.autopilot.traits import Severity

if TYPE_CHECKING:
    from mock_vehicle.autopilot.ardupilot import ArduPilot
    from mock_vehicle.autopilot.base import Autopilot

DO_SET_SERVO = 183
DO_FLIGHTTERMINATION = 185
DO_SET_ROI_LOCATION = 195
DO_SET_ROI_NONE = 197
DO_PARACHUTE = 208
DO_MOTOR_TEST = 209
DO_GRIPPER = 211
DO_AUX_FUNCTION = 218
PREFLIGHT_CALIBRATION = 241
PREFLIGHT_STORAGE = 245
PREFLIGHT_REBOOT_SHUTDOWN = 246
RUN_PREARM_CHECKS = 401
IMAGE_START_CAPTURE = 2000
SET_EKF_SOURCE_SET = 42007
DO_SEND_BANNER = 42428

GYRO_CALIBRATION_S = 0.527
REBOOT_S = 0.3
"""Until the acknowledgement has left."""
ERASE = 2.0


def always(result: int) -> CommandHandler:
    """Make the handler of a command that has one answer and no effect."""

    def handler(autopilot: Autopilot, command: Command, now: float) -> int:  # noqa: ARG001
        return result

    return handler


def reboot(autopilot: Autopilot, command: Command, now: float) -> int:
    """Start again (param1 = 1), unless the motors run."""
    if autopilot.armed:
        return autopilot.traits.reboot_refusal
    if command.params[0] == 1.0:
        autopilot.later(now + REBOOT_S, autopilot.reboot)
    return Result.ACCEPTED


def terminate(autopilot: Autopilot, command: Command, now: float) -> int:
    """Switch the motors off for good (param1 = 1)."""
    if command.params[0] != 1.0:
        return autopilot.traits.request_refusal
    autopilot.disarm(now)
    return Result.ACCEPTED


def calibrate_px4(autopilot: Autopilot, command: Command, now: float) -> int:  # noqa: ARG001
    """Calibrate at once; not while armed."""
    return Result.TEMPORARILY_REJECTED if autopilot.armed else Result.ACCEPTED


def store_px4(autopilot: Autopilot, command: Command, now: float) -> int:  # noqa: ARG001
    """Store parameters, which are stored anyhow; not while armed."""
    return Result.DENIED if autopilot.armed else Result.ACCEPTED


def calibrate_ardupilot(autopilot: Autopilot, command: Command, now: float) -> int | None:
    """Calibrate gyros (param1), which takes its time, or barometers (param3)."""
    if autopilot.armed:
        autopilot.say(Severity.CRITICAL, "Disarm to allow calibration", now)
        return Result.FAILED
    if command.params[0] == 1.0:
        autopilot.say(Severity.INFO, "Initialising ArduPilot", now)
        autopilot.later(
            now + GYRO_CALIBRATION_S, partial(_end_gyro_calibration, autopilot, command)
        )
        return None
    if command.params[2] == 1.0:
        _tell(autopilot, parameters.BAROMETERS)
        autopilot.say(Severity.INFO, "Updating barometer calibration", now)
        autopilot.say(Severity.INFO, "Barometer calibration complete", now)
        return Result.ACCEPTED
    return Result.UNSUPPORTED


def _end_gyro_calibration(autopilot: Autopilot, command: Command, now: float) -> None:  # noqa: ARG001
    acknowledge(autopilot, command, Result.ACCEPTED)
    _tell(autopilot, parameters.GYROSCOPES)


def _tell(autopilot: Autopilot, names: str) -> None:
    """Tell parameters that were measured."""
    for name in names.split() if autopilot.is_talkative else ():
        autopilot.parameter_service.tell(autopilot, name)


def store_ardupilot(autopilot: Autopilot, command: Command, now: float) -> int:  # noqa: ARG001
    """Refuse to do what happens anyhow; erasing all is accepted, and not done."""
    return Result.ACCEPTED if command.params[0] == ERASE else Result.DENIED


def check_ardupilot(autopilot: ArduPilot, command: Command, now: float) -> int:  # noqa: ARG001
    """Say why it would not arm."""
    if autopilot.armed:
        return Result.TEMPORARILY_REJECTED
    autopilot.check(now)
    return Result.ACCEPTED


def run_motor(autopilot: Autopilot, command: Command, now: float) -> int:
    """Say that a motor turns for param4 s; it is not seen."""
    if autopilot.armed:
        return Result.FAILED
    autopilot.say(Severity.INFO, "starting motor test", now)
    duration_s = command.params[3]
    over_at = now + duration_s if 0.0 < duration_s < 600.0 else now
    finish = partial(autopilot.say, Severity.INFO, "finished motor test")
    autopilot.later(over_at, finish)
    return Result.ACCEPTED


def send_banner(autopilot: Autopilot, command: Command, now: float) -> int:  # noqa: ARG001
    """Say what it is."""
    for text in autopilot.banner:
        autopilot.say(Severity.INFO, text, now)
    return Result.ACCEPTED


PX4_COMMANDS: Mapping[int, CommandHandler] = {
    DO_FLIGHTTERMINATION: terminate,
    PREFLIGHT_CALIBRATION: calibrate_px4,
    PREFLIGHT_STORAGE: store_px4,
    PREFLIGHT_REBOOT_SHUTDOWN: reboot,
}
ARDUPILOT_COMMANDS: Mapping[int, CommandHandler] = {
    DO_SET_SERVO: always(Result.ACCEPTED),
    DO_FLIGHTTERMINATION: terminate,
    DO_SET_ROI_LOCATION: always(Result.ACCEPTED),
    DO_SET_ROI_NONE: always(Result.ACCEPTED),
    DO_PARACHUTE: always(Result.ACCEPTED),
    DO_MOTOR_TEST: run_motor,
    DO_GRIPPER: always(Result.FAILED),
    DO_AUX_FUNCTION: always(Result.ACCEPTED),
    PREFLIGHT_CALIBRATION: calibrate_ardupilot,
    PREFLIGHT_STORAGE: store_ardupilot,
    PREFLIGHT_REBOOT_SHUTDOWN: reboot,
    RUN_PREARM_CHECKS: check_ardupilot,
    IMAGE_START_CAPTURE: always(Result.FAILED),
    SET_EKF_SOURCE_SET: always(Result.ACCEPTED),
    DO_SEND_BANNER: send_banner,
}
