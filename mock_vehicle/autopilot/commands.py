"""Commands from the wire and their acknowledgements, arming, modes, setpoints."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import NamedTuple

from mock_vehicle.autopilot import clock
from mock_vehicle.autopilot.base import Autopilot
from mock_vehicle.autopilot.traits import Severity
from swarm_ctl import wire

COMMAND_ACK = wire.message("COMMAND_ACK")
COMMAND_INT = wire.message("COMMAND_INT")
COMMAND_LONG = wire.message("COMMAND_LONG")
HEARTBEAT = wire.message("HEARTBEAT")
SET_MODE = wire.message("SET_MODE")
SETPOINT = wire.message("SET_POSITION_TARGET_LOCAL_NED")

GCS = 6
"""MAV_TYPE of a ground station."""
FORCE = 21196
"""The magic number of arm and disarm."""
ARM_DISARM = 400
DO_SET_MODE = 176
NAV_LOITER_UNLIM = 17
NAV_RETURN_TO_LAUNCH = 20
NAV_LAND = 21
NAV_TAKEOFF = 22


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class Command(NamedTuple):
    """A COMMAND_LONG or COMMAND_INT that is for us."""

    number: int
    """MAV_CMD."""
    params: tuple[float, ...]
    """Seven; clients fill unused ones with NaN."""
    sysid: int
    compid: int
    """The sender, who gets the acknowledgement."""
    is_int: bool = False
    """Whether it came as a COMMAND_INT."""
    frame: int = 0
    """MAV_FRAME of a COMMAND_INT."""

    @property
    def place(self) -> tuple[float, float, float]:
        """Latitude and longitude, degrees, and altitude, m, of params 5 to 7."""
        x, y, z = self.params[4:7]
        return (x * 1e-7, y * 1e-7, z) if self.is_int else (x, y, z)


CommandHandler = Callable[..., int | None]
"""(autopilot, command, now) -> MAV_RESULT, or None for a handler that acknowledged itself."""
MessageHandler = Callable[..., None]
"""(autopilot, frame, now)."""


def whole(value: float) -> int | None:
    """Read an integer out of a float parameter; NaN, infinity and nonsense are None."""
    return int(value) if math.isfinite(value) and abs(value) < 2**31 else None


def acknowledge(autopilot: Autopilot, command: Command, result: int) -> None:
    """Send COMMAND_ACK to the sender, over every link: who asked may hear on another."""
    if not autopilot.acks_left:
        return
    autopilot.acks_left -= 1
    with autopilot.serving(*autopilot.links):
        autopilot.send(COMMAND_ACK, command.number, result, 0, 0, command.sysid, command.compid)


def execute(autopilot: Autopilot, command: Command, now: float) -> None:
    """Run a command through the personality's table and acknowledge it."""
    refusal = _forced_refusal(autopilot, command.number)
    if refusal is not None:
        acknowledge(autopilot, command, refusal)
        return
    handler = autopilot.command_table.get(command.number)
    result = Result.UNSUPPORTED if handler is None else handler(autopilot, command, now)
    if result is not None:
        acknowledge(autopilot, command, result)


def _forced_refusal(autopilot: Autopilot, number: int) -> int | None:
    """Give the result that a fault forces upon a command."""
    for trouble in autopilot.refusals:
        if trouble.fault["command"] in {None, number} and trouble.spend():
            return Result[trouble.fault["result"].replace("-", "_").upper()]
    return None


# Commands.


def arm_disarm(autopilot: Autopilot, command: Command, now: float) -> int | None:
    """Arm or disarm; param2 = 21196 forces."""
    wish, force = command.params[0], command.params[1] == FORCE
    if math.isnan(wish):
        return autopilot.traits.arm_nan_result
    if wish not in {0.0, 1.0}:
        return autopilot.traits.arm_other_result
    return _arm(autopilot, now, force=force) if wish else _disarm(autopilot, now, force=force)


def _arm(autopilot: Autopilot, now: float, *, force: bool) -> int:
    if autopilot.armed:
        return Result.ACCEPTED
    refusals = autopilot.arming_refusals(now, force=force)
    if refusals is None:
        autopilot.arm(now)
        return Result.ACCEPTED
    autopilot.refuse_to_arm(refusals, now)
    return autopilot.traits.denial


def _disarm(autopilot: Autopilot, now: float, *, force: bool) -> int:
    if autopilot.flying and not force:
        for text in autopilot.traits.not_landed_texts:
            autopilot.say(Severity.CRITICAL, text, now)
        return autopilot.traits.denial
    if autopilot.armed:
        autopilot.disarm(now)
    return Result.ACCEPTED


def mode_command(number: int) -> CommandHandler:
    """Make the handler of a command that is nothing but a mode."""

    def handler(autopilot: Autopilot, command: Command, now: float) -> int:  # noqa: ARG001
        autopilot.enter(number, now)
        return Result.ACCEPTED

    return handler


# Messages.


def on_command_long(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Execute a COMMAND_LONG."""
    v = frame.values
    if autopilot.accepts_command(v.target_system, v.target_component, v.command):
        params = (v.param1, v.param2, v.param3, v.param4, v.param5, v.param6, v.param7)
        execute(autopilot, Command(v.command, params, frame.sysid, frame.compid), now)


def on_command_int(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Execute a COMMAND_INT as the same COMMAND_LONG."""
    v = frame.values
    if autopilot.accepts_command(v.target_system, v.target_component, v.command):
        params = (v.param1, v.param2, v.param3, v.param4, float(v.x), float(v.y), v.z)
        sender = frame.sysid, frame.compid
        execute(autopilot, Command(v.command, params, *sender, is_int=True, frame=v.frame), now)


def on_setpoint(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Hand a setpoint to the personality, who knows its own rules."""
    v = frame.values
    if autopilot.accepts_setpoint(v.target_system, v.target_component):
        autopilot.receive_setpoint(v, now)


def on_heartbeat(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Note that a ground station listens on this link."""
    if frame.values.type == GCS:
        autopilot.to[0].gcs_seen_at = now


MESSAGES: Mapping[int, MessageHandler] = {
    COMMAND_LONG.id: on_command_long,
    COMMAND_INT.id: on_command_int,
    SETPOINT.id: on_setpoint,
    clock.TIMESYNC.id: clock.on_timesync,
    HEARTBEAT.id: on_heartbeat,
}
"""What both autopilots listen to, by message id."""

COMMANDS: Mapping[int, CommandHandler] = {
    ARM_DISARM: arm_disarm,
}
"""What both autopilots execute alike, by MAV_CMD."""
