"""Read and set parameters by name: several at a time, and again until they are answered.

Neither autopilot answers a name that it does not know; who stays silent has no such parameter.
https://mavlink.io/en/services/parameter.html
"""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Iterable, Iterator, Mapping

from swarm_ctl import wire

IN_FLIGHT = 4
"""PX4 answers no more of a burst."""
RETRY_S = 0.3
"""ArduPilot takes up to 0.1 s."""
ATTEMPTS = 3
REAL32 = 9
_FORMATS = {1: "<B3x", 2: "<b3x", 3: "<H2x", 4: "<h2x", 5: "<I", 6: "<i"}
_PAYLOAD = {0xFD: 10, 0xFE: 6}
"""Where a payload begins, by the first byte of a frame."""


class Parameters:
    """What is known of one vehicle's parameters, and what is still to be asked and set."""

    def __init__(self, *, is_bytewise: bool) -> None:
        """Begin for an autopilot that hides integers in a float's bytes (PX4), or does not."""
        self.values: dict[str, float] = {}
        self.missing: set[str] = set()
        """Names that were asked for in vain."""
        self._is_bytewise = is_bytewise
        self._kinds: dict[str, int] = {}
        self._waiting: deque[tuple[str, float | None]] = deque()
        self._flying: dict[str, tuple[float | None, int, float]] = {}
        """What is on its way: the value to set, attempts, when to try again."""

    @property
    def is_idle(self) -> bool:
        """Whether all that was asked for is answered or given up."""
        return not self._waiting and not self._flying

    def read(self, names: Iterable[str]) -> None:
        """Ask for parameters; what is known of them is forgotten."""
        for name in names:
            self.values.pop(name, None)
            self._waiting.append((name, None))

    def set(self, values: Mapping[str, float]) -> None:
        """Set parameters that have been read."""
        self._waiting += values.items()

    def give_up(self) -> None:
        """Ask for nothing more."""
        self._waiting.clear()
        self._flying.clear()

    def poll(self, now: float) -> Iterator[tuple[wire.Message, tuple[object, ...]]]:
        """Give the messages to send now, without their target."""
        for name, (value, attempts, due_s) in [*self._flying.items()]:
            if now >= due_s:
                del self._flying[name]
                if attempts < ATTEMPTS:
                    yield self._send(name, value, attempts + 1, now)
                elif value is None:
                    self.missing.add(name)
        while self._waiting and len(self._flying) < IN_FLIGHT:
            if self._waiting[0][0] in self._flying:
                break
            name, value = self._waiting.popleft()
            yield self._send(name, value, 1, now)

    def receive(self, frame: wire.Frame) -> None:
        """Take a PARAM_VALUE."""
        name, kind = frame.values.param_id, frame.values.param_type
        if name not in self._flying:
            return
        value = self._decode(frame, kind)
        wanted = self._flying[name][0]
        if wanted is None or math.isclose(value, wanted, rel_tol=1e-5):
            del self._flying[name]
        self.values[name] = value
        self._kinds[name] = kind

    def _send(
        self, name: str, value: float | None, attempt: int, now: float
    ) -> tuple[wire.Message, tuple[object, ...]]:
        self._flying[name] = value, attempt, now + RETRY_S
        if value is None:
            return wire.message("PARAM_REQUEST_READ"), (name, -1)
        kind = self._kinds.get(name, REAL32)
        return wire.message("PARAM_SET"), (name, self._encode(value, kind), kind)

    def _decode(self, frame: wire.Frame, kind: int) -> float:
        if not self._is_bytewise or kind not in _FORMATS:
            return float(frame.values.param_value)
        start = _PAYLOAD[frame.raw[0]]  # a float would not keep all bits of what looks like a NaN
        return float(struct.unpack_from(_FORMATS[kind], frame.raw, start)[0])

    def _encode(self, value: float, kind: int) -> float:
        if not self._is_bytewise or kind not in _FORMATS:
            return value
        hidden = struct.pack(_FORMATS[kind], round(value))
        return float(struct.unpack("<f", hidden)[0])
