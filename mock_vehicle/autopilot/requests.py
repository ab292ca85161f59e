"""Requests for messages: once, at intervals, and for versions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.commands import Command, CommandHandler, Result, acknowledge, whole
from mock_vehicle.autopilot.link import Encoder
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

AUTOPILOT_VERSION = wire.message("AUTOPILOT_VERSION")
MESSAGE_INTERVAL = wire.message("MESSAGE_INTERVAL")
PROTOCOL_VERSION = wire.message("PROTOCOL_VERSION")
REQUEST_DATA_STREAM = wire.message("REQUEST_DATA_STREAM")

GET_MESSAGE_INTERVAL = 510
SET_MESSAGE_INTERVAL = 511
REQUEST_MESSAGE = 512
REQUEST_PROTOCOL_VERSION = 519
REQUEST_AUTOPILOT_CAPABILITIES = 520

LONGEST_INTERVAL_S = 60.0
"""ArduPilot clamps to it; PX4 was not asked."""


def autopilot_version(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send AUTOPILOT_VERSION."""
    traits = autopilot.traits
    autopilot.send(
        AUTOPILOT_VERSION,
        traits.capabilities,
        traits.flight_sw_version,
        *traits.other_versions,
        b"",
        0,
        0,
        autopilot.uid & 0xFFFFFFFFFFFFFFFF,
        (autopilot.uid & (1 << 144) - 1).to_bytes(18, "big"),
    )


COMPONENT_INFORMATION_ID = 395
COMPONENT_METADATA_ID = 397
AVAILABLE_MODES_ID = 435
"""Messages that the dialect does not know: acknowledged as recorded, and never sent."""


def protocol_version(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send PROTOCOL_VERSION: MAVLink 2.0, 1.0 at least, 2.3 at most, as PX4 does."""
    autopilot.send(PROTOCOL_VERSION, 200, 100, 203, b"", b"")


def nothing(autopilot: Autopilot, now: float) -> None:
    """Send nothing: the message is known, and there is nothing to say."""


def set_message_interval(autopilot: Autopilot, command: Command, now: float) -> int:
    """Let a message flow at an interval in microseconds; -1 stops it, 0 restores the default."""
    number, interval_us = whole(command.params[0]), whole(command.params[1])
    refusal = autopilot.traits.interval_refusal
    if number is None or number not in autopilot.streamable:
        return refusal
    is_fixed = number in autopilot.traits.fixed_streams
    if is_fixed or interval_us is None or interval_us < -1:
        return refusal
    streams = autopilot.to[0].streams
    if interval_us == -1:
        streams.stop(number)
    elif interval_us == 0:
        streams.restore(number, now)
    else:
        streams.start(number, min(interval_us * 1e-6, LONGEST_INTERVAL_S), now)
    return Result.ACCEPTED


def send_message_interval(autopilot: Autopilot, number: int | None) -> bool:
    """Send MESSAGE_INTERVAL and tell whether the message is known."""
    known = number in autopilot.streamable
    interval_s = autopilot.to[0].streams.interval_s(number) if number is not None else None
    off_us = -1 if known else autopilot.traits.unknown_interval_us
    interval_us = off_us if interval_s is None else round(interval_s * 1e6)
    autopilot.send(MESSAGE_INTERVAL, (number or 0) & 0xFFFF, interval_us)
    return known


def get_message_interval(autopilot: Autopilot, command: Command, now: float) -> int:  # noqa: ARG001
    """Send MESSAGE_INTERVAL."""
    known = send_message_interval(autopilot, whole(command.params[0]))
    return Result.ACCEPTED if known else autopilot.traits.unknown_interval_result


def request_message(autopilot: Autopilot, command: Command, now: float) -> int | None:
    """Send a message once."""
    number = whole(command.params[0])
    if number == MESSAGE_INTERVAL.id:
        send_message_interval(autopilot, whole(command.params[1]))
        return Result.ACCEPTED
    if number is None or number not in autopilot.requestable:
        return autopilot.traits.request_refusal
    return _answer(autopilot, command, autopilot.requestable[number], now)


def request_capabilities(autopilot: Autopilot, command: Command, now: float) -> int | None:
    """Send AUTOPILOT_VERSION (the old way to ask)."""
    return _answer(autopilot, command, autopilot_version, now)


def request_protocol_version(autopilot: Autopilot, command: Command, now: float) -> int | None:
    """Send PROTOCOL_VERSION (the old way to ask)."""
    return _answer(autopilot, command, protocol_version, now)


def _answer(autopilot: Autopilot, command: Command, encode: Encoder, now: float) -> int | None:
    """Send a message and acknowledge, in the order of the autopilot."""
    if autopilot.traits.acknowledges_first:
        acknowledge(autopilot, command, Result.ACCEPTED)
        encode(autopilot, now)
        return None
    encode(autopilot, now)
    return Result.ACCEPTED


def on_request_data_stream(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Start or stop a group of streams without a word, as ArduPilot does."""
    v = frame.values
    if not autopilot.accepts_setpoint(v.target_system, v.target_component):
        return
    streams = autopilot.to[0].streams
    for number in autopilot.stream_groups.get(v.req_stream_id, ()):
        if v.start_stop and v.req_message_rate:
            streams.start(number, 1.0 / v.req_message_rate, now)
        else:
            streams.stop(number)


COMMANDS: Mapping[int, CommandHandler] = {
    GET_MESSAGE_INTERVAL: get_message_interval,
    SET_MESSAGE_INTERVAL: set_message_interval,
    REQUEST_MESSAGE: request_message,
    REQUEST_AUTOPILOT_CAPABILITIES: request_capabilities,
}
"""What both autopilots answer alike, by MAV_CMD."""

MESSAGES: Mapping[int, Encoder] = {AUTOPILOT_VERSION.id: autopilot_version}
"""What both give when asked, and never at an interval, by message id."""
