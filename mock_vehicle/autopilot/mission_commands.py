"""Commands that start a mission, interrupt it, and choose its next item."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mock_vehicle.autopilot.commands import Command, Result, acknowledge, whole
from mock_vehicle.autopilot.legs import change_speed, turn
from mock_vehicle.autopilot.progress import mission_current, set_current
from mock_vehicle.autopilot.traits import Manoeuvre

if TYPE_CHECKING:
    from mock_vehicle.autopilot.ardupilot import ArduPilot
    from mock_vehicle.autopilot.base import Autopilot
    from mock_vehicle.autopilot.px4 import Px4

CONDITION_YAW = 115
DO_CHANGE_SPEED = 178
DO_PAUSE_CONTINUE = 193
DO_SET_MISSION_CURRENT = 224
MISSION_START = 300


def start_px4(autopilot: Px4, command: Command, now: float) -> int:  # noqa: ARG001
    """Obey MISSION_START: choose the mode, and arm."""
    if not autopilot.can_fly_mission or not autopilot.is_ready(now):
        return Result.DENIED
    autopilot.enter(autopilot.mission_mode, now)
    if not autopilot.armed:
        autopilot.arm(now)
    return Result.ACCEPTED


def start_ardupilot(autopilot: ArduPilot, command: Command, now: float) -> int:
    """Obey MISSION_START: choose the mode, and leave the ground if armed."""
    if command.params[0] or command.params[1]:
        return Result.DENIED
    result = autopilot.choose(autopilot.mission_mode, now)
    autopilot.progress.may_leave_ground = result == Result.ACCEPTED
    return result


def set_mission_current(autopilot: ArduPilot, command: Command, now: float) -> int | None:
    """Go on with item param1, and tell so by MISSION_CURRENT."""
    sequence = whole(command.params[0])
    if sequence is None or not set_current(autopilot, sequence):
        return Result.DENIED
    acknowledge(autopilot, command, Result.ACCEPTED)
    mission_current(autopilot, now)
    return None


def pause(autopilot: ArduPilot, command: Command, now: float) -> int:
    """Obey DO_PAUSE_CONTINUE in AUTO and GUIDED: param1 0 holds, 1 goes on."""
    goes_on, progress = command.params[0] == 1.0, autopilot.progress
    if command.params[0] not in {0.0, 1.0}:
        return Result.DENIED
    if autopilot.mode == autopilot.mission_mode:
        progress.is_paused = not goes_on
        if progress.leg is not None and goes_on:
            progress.leg.is_begun = False
    if autopilot.flying and not goes_on:
        autopilot.begin(Manoeuvre.HOLD, now)
    return Result.ACCEPTED


def accept_speed(autopilot: Autopilot, command: Command, now: float) -> int:  # noqa: ARG001
    """Obey DO_CHANGE_SPEED as PX4, which accepts what it ignores."""
    change_speed(autopilot, command.params)
    return Result.ACCEPTED


def check_speed(autopilot: Autopilot, command: Command, now: float) -> int:  # noqa: ARG001
    """Obey DO_CHANGE_SPEED as ArduPilot."""
    return Result.ACCEPTED if change_speed(autopilot, command.params) else Result.FAILED


def condition_yaw(autopilot: Autopilot, command: Command, now: float) -> int:
    """Turn the nose."""
    if not turn(autopilot, command.params):
        return Result.FAILED
    autopilot.steer(now)
    return Result.ACCEPTED
