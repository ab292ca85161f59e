"""Commands with acknowledgement: one at a time, sent again until answered."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

NAV_LAND = 21
NAV_TAKEOFF = 22
DO_SET_MODE = 176
COMPONENT_ARM_DISARM = 400
RUN_PREARM_CHECKS = 401
SET_MESSAGE_INTERVAL = 511
REQUEST_MESSAGE = 512
COMMAND_NAMES = {
    NAV_LAND: "landing",
    NAV_TAKEOFF: "take-off",
    DO_SET_MODE: "the change of mode",
    COMPONENT_ARM_DISARM: "arming",
    RUN_PREARM_CHECKS: "a check before arming",
    SET_MESSAGE_INTERVAL: "a stream",
    REQUEST_MESSAGE: "a message",
}
"""What a controller asks for, by MAV_CMD."""
ASIDE = frozenset({RUN_PREARM_CHECKS, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE})
"""Commands that move nothing and are asked anew when it matters."""

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, IN_PROGRESS = 0, 1, 2, 3, 5
RESULT_NAMES = {
    0: "accepted",
    1: "temporarily rejected",
    2: "denied",
    3: "unsupported",
    4: "failed",
    5: "in progress",
    6: "cancelled",
    7: "accepted only as COMMAND_LONG",
    8: "accepted only as COMMAND_INT",
    9: "unsupported in this frame",
    10: "refused to who is not in control",
}
"""MAV_RESULT in words."""
UNKNOWN_PROGRESS = 255

PROGRESS_S = 2.0
"""What "in progress" adds to the wait."""
REJECTIONS, LATER_S = 3, 1.0
"""How often a command that was temporarily rejected is sent anew, and how much later."""
SECOND_THOUGHT_S = 0.5
"""PX4's link accepts a change of mode at once; its commander may refuse it 1 to 16 ms later."""


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


class Ack(NamedTuple):
    """One COMMAND_ACK that was meant for us."""

    command_id: int
    result: int
    """MAV_RESULT."""
    progress: int = UNKNOWN_PROGRESS
    """Percent, while the result is "in progress"."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What became of a command."""

    command: Command
    result: int | None
    """MAV_RESULT, or None when nobody answered."""
    progress: int = UNKNOWN_PROGRESS
    """Percent, while the result is "in progress"."""

    @property
    def is_accepted(self) -> bool:
        """Whether the autopilot took the command."""
        return self.result == ACCEPTED

    @property
    def is_in_progress(self) -> bool:
        """Whether the autopilot is still at it."""
        return self.result == IN_PROGRESS

    @property
    def reason(self) -> str:
        """Say the result in words."""
        if self.result is None:
            return "not answered"
        return RESULT_NAMES.get(self.result, f"answered by result {self.result}")

    @property
    def words(self) -> str:
        """Say what was asked for and how it was answered."""
        name = COMMAND_NAMES.get(self.command.id, f"command {self.command.id}")
        return f"{name} was {self.reason}"


@dataclass(slots=True)
class _Request:
    """A command on its way."""

    command: Command
    sent: int = 0
    next_s: float = -math.inf
    rejections: int = 0

    @property
    def is_a_stream(self) -> bool:
        return self.command.id == SET_MESSAGE_INTERVAL

    @property
    def is_aside(self) -> bool:
        return self.command.id in ASIDE


class CommandQueue:
    """Send one command at a time, repeat it until it is answered, then the next.

    One at a time because PX4 answers only four of a burst, and because an acknowledgement names
    the command but not the copy. What moves the vehicle goes before what only asks. A command
    that was temporarily rejected is sent again later; any other refusal is final.
    """

    def __init__(self, retry_s: float = 0.5, attempts: int = 5) -> None:
        self.retry_s = retry_s
        self.attempts = attempts
        self._waiting: list[_Request] = []
        self._current: _Request | None = None
        self._accepted: tuple[_Request, float] | None = None
        """The last one that was accepted, and until when that may be taken back."""

    def __len__(self) -> int:
        return len(self._all())

    def request(self, wanted: Command) -> None:
        """Queue a command unless the same one is already waiting."""
        if not any(waiting.command == wanted for waiting in self._all()):
            self._waiting.append(_Request(wanted))

    def clear(self) -> None:
        """Forget all that has not been answered, but not the streams that are asked for."""
        self._waiting = [request for request in self._waiting if request.is_a_stream]
        if self._current is not None and not self._current.is_a_stream:
            self._current = None
        self._accepted = None

    def forget(self, command_id: int) -> None:
        """Send a command no more: what it was to bring about has happened."""
        self._waiting = [one for one in self._waiting if one.command.id != command_id]
        if self._current is not None and self._current.command.id == command_id:
            self._current = None

    def is_waiting(self, command_id: int) -> bool:
        """Tell whether a command of this id is queued or on its way."""
        return any(waiting.command.id == command_id for waiting in self._all())

    def acknowledge(self, ack: Ack, now: float) -> Answer | None:
        """Take a COMMAND_ACK; None when it answers nothing that is on its way."""
        current = self._current
        if current is None or current.command.id != ack.command_id:
            return self._reconsider(ack, now)
        if ack.result == IN_PROGRESS:
            current.next_s = now + PROGRESS_S
            return Answer(current.command, ack.result, ack.progress)
        self._current = None
        if ack.result == ACCEPTED:
            self._accepted = (current, now + SECOND_THOUGHT_S)
        return self._refuse_or_accept(current, ack.result, now)

    def poll(self, now: float) -> tuple[tuple[Command, int] | None, Answer | None]:
        """Give the command to send now with its confirmation count, and one that timed out."""
        if self._current is None and not self._waiting:
            return None, None
        self._make_way(now)
        timed_out, current = None, self._current
        if current is not None and current.sent >= self.attempts and now >= current.next_s:
            timed_out, current = Answer(current.command, None), None
        current = self._current = current or self._next(now)
        if current is None or now < current.next_s:
            return None, timed_out
        current.sent += 1
        current.next_s = now + self.retry_s
        return (current.command, current.sent - 1), timed_out

    def _all(self) -> list[_Request]:
        return [*self._waiting, self._current] if self._current else self._waiting

    def _next(self, now: float) -> _Request | None:
        """Take the first that may be sent, those that only ask last."""
        due = [request for request in self._waiting if now >= request.next_s]
        first = min(due, key=lambda request: request.is_aside, default=None)
        if first is not None:
            self._waiting.remove(first)
        return first

    def _make_way(self, now: float) -> None:
        """Interrupt what only asks when there is something that moves the vehicle."""
        current = self._current
        moves = (now >= request.next_s and not request.is_aside for request in self._waiting)
        if current is not None and current.is_aside and any(moves):
            self._current = None
            self._put_off(current, current.next_s)

    def _put_off(self, request: _Request, until_s: float) -> None:
        request.sent, request.next_s = 0, until_s
        self._waiting.append(request)

    def _reconsider(self, ack: Ack, now: float) -> Answer | None:
        """Take the refusal of a command that was accepted a moment ago."""
        if self._accepted is None or ack.result in {ACCEPTED, IN_PROGRESS}:
            return None
        request, until_s = self._accepted
        if request.command.id != ack.command_id or now > until_s:
            return None
        self._accepted = None
        return self._refuse_or_accept(request, ack.result, now)

    def _refuse_or_accept(self, request: _Request, result: int, now: float) -> Answer:
        """End a command, or put it off when the autopilot says that it may do it later."""
        if result == TEMPORARILY_REJECTED and request.rejections < REJECTIONS:
            request.rejections += 1
            self._put_off(request, now + LATER_S)
        return Answer(request.command, result)
