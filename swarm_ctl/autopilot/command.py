"""Commands with acknowledgement: one at a time, sent again until answered."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

DO_SET_MODE = 176
NAV_LAND = 21
NAV_TAKEOFF = 22
COMPONENT_ARM_DISARM = 400
SET_MESSAGE_INTERVAL = 511

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, IN_PROGRESS = 0, 1, 2, 3, 5
RESULT_NAMES = {
    0: "accepted",
    1: "temporarily rejected",
    2: "denied",
    3: "unsupported",
    4: "failed",
    5: "in progress",
    6: "cancelled",
}


class Command(NamedTuple):
    """One COMMAND_LONG; unused parameters are 0, which both autopilots take."""

    id: int
    parameters: tuple[float, float, float, float, float, float, float]


def command(command_id: int, *parameters: float) -> Command:
    """Fill a command up to its seven parameters."""
    padded = (*parameters, *([0.0] * (7 - len(parameters))))
    if not all(math.isfinite(value) for value in padded):
        raise ValueError("command parameters must be finite: NaN stops a real ArduPilot")
    return Command(command_id, padded)  # type: ignore[arg-type]  # exactly seven by construction


@dataclass(frozen=True, slots=True)
class Answer:
    """How a command ended."""

    command: Command
    result: int | None
    """MAV_RESULT, or None when nobody answered."""

    @property
    def is_accepted(self) -> bool:
        """Whether the autopilot took the command."""
        return self.result == ACCEPTED

    @property
    def reason(self) -> str:
        """Say the result in words."""
        if self.result is None:
            return "no answer"
        return RESULT_NAMES.get(self.result, f"result {self.result}")


class CommandQueue:
    """Send one command at a time, repeat it until it is answered, then the next.

    One at a time because PX4 answers only four of a burst, and because an acknowledgement names
    the command but not the copy.
    """

    def __init__(self, retry_s: float = 0.5, attempts: int = 5) -> None:
        self.retry_s = retry_s
        self.attempts = attempts
        self._waiting: deque[Command] = deque()
        self._sent = 0
        self._next_s = 0.0

    def request(self, wanted: Command) -> None:
        """Queue a command unless the same one is already waiting."""
        if wanted not in self._waiting:
            self._waiting.append(wanted)

    def clear(self) -> None:
        """Forget everything that has not been answered."""
        self._waiting.clear()
        self._sent = 0

    def is_waiting(self, command_id: int) -> bool:
        """Tell whether a command of this id is queued or on its way."""
        return any(waiting.id == command_id for waiting in self._waiting)

    def acknowledge(self, command_id: int, result: int, now: float) -> Answer | None:
        """Take a COMMAND_ACK; None when it answers nothing that is on its way."""
        if not self._waiting or not self._sent or self._waiting[0].id != command_id:
            return None
        if result == IN_PROGRESS:
            self._next_s = now + 4 * self.retry_s
            return None
        return self._finish(result)

    def poll(self, now: float) -> tuple[tuple[Command, int] | None, Answer | None]:
        """Give the command to send now with its confirmation count, and one that timed out."""
        timed_out = None
        if self._sent >= self.attempts and now >= self._next_s and self._waiting:
            timed_out = self._finish(None)
        if not self._waiting or (self._sent and now < self._next_s):
            return None, timed_out
        self._sent += 1
        self._next_s = now + self.retry_s
        return (self._waiting[0], self._sent - 1), timed_out

    def _finish(self, result: int | None) -> Answer:
        self._sent = 0
        return Answer(self._waiting.popleft(), result)
