"""File transfers: there are no files, and every request is told so at once.

Silence would cost ground stations seconds: they ask for parameters and descriptions as files first.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

FILE_TRANSFER_PROTOCOL = wire.message("FILE_TRANSFER_PROTOCOL")

_HEADER = struct.Struct("<HBBBBBxI")
"""Sequence number, session, opcode, size, opcode answered, burst complete, padding, offset."""
TERMINATE_SESSION, RESET_SESSIONS, LIST_DIRECTORY, OPEN_READING, READ = 1, 2, 3, 4, 5
CALCULATE_CRC, READ_BURST = 14, 15
ACK, NAK = 128, 129
FAILED_ERRNO, INVALID_SESSION, UNKNOWN_COMMAND, FILE_NOT_FOUND = 2, 4, 7, 10

REFUSALS: Mapping[int, bytes] = {
    LIST_DIRECTORY: bytes([FAILED_ERRNO, 0]),  # as ArduPilot was recorded to say
    OPEN_READING: bytes([FILE_NOT_FOUND]),
    CALCULATE_CRC: bytes([FILE_NOT_FOUND]),
    READ: bytes([INVALID_SESSION]),
    READ_BURST: bytes([INVALID_SESSION]),
}
"""What a NAK says to which opcode; UNKNOWN_COMMAND to all others."""


def on_request(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:  # noqa: ARG001
    """Close sessions that were never open, and refuse the rest."""
    v = frame.values
    if not autopilot.accepts_command(v.target_system, v.target_component, 0):
        return
    sequence, session, opcode, _, _, _, offset = _HEADER.unpack_from(v.payload)
    if opcode in {ACK, NAK}:
        return
    closes = opcode in {TERMINATE_SESSION, RESET_SESSIONS}
    data = b"" if closes else REFUSALS.get(opcode, bytes([UNKNOWN_COMMAND]))
    answer = ACK if closes else NAK
    sequence = sequence + 1 & 0xFFFF
    header = _HEADER.pack(sequence, session, answer, len(data), opcode, 0, offset)
    autopilot.send(FILE_TRANSFER_PROTOCOL, 0, frame.sysid, frame.compid, header + data)


MESSAGES: Mapping[int, Callable[..., None]] = {FILE_TRANSFER_PROTOCOL.id: on_request}
"""The file transfer microservice, by message id."""
