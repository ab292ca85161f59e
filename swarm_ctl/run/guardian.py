"""A process that stops vehicles whose controller has died or hangs, until somebody takes over.

`python -m swarm_ctl.run.guardian JOURNALS HANG_S` is started by `swarm-ctl fly` and imports next to
nothing. It is told, as JSON lines on its input, the setpoint that would stop each vehicle that is
being steered, and sends it only when its time has come: no other frame, to nobody else.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

PERIOD_S = 0.1
HELD_S = 10.0
"""Longest time, by the clock, that a vehicle is held: then its autopilot's own failsafe has it."""
READ_BYTES = 1 << 16
LINK_ID = 1
"""Of its signatures: a stream of its own beside the controller's, which is 0."""


@dataclass(slots=True)
class Ward:
    """A vehicle to look after."""

    reach: str = ""
    """How it is reached, as `Link.reach` gives it."""
    frame: bytes = b""
    """The setpoint that stops it; empty while it is not steered."""
    stamp: int = 0
    """Timestamp of the last signature."""
    held_s: float | None = None
    """Since when it has been held; None while it is not."""
    written: int = 0
    """Bytes of its journal when that began."""
    is_released: bool = False
    """Whether somebody else has it, or nobody any more."""


class Guardian:
    """Decide who is to be stopped; clock, files and ports are the caller's."""

    def __init__(self, hang_s: float, written: Callable[[int], int]) -> None:
        """Take a controller that is silent for `hang_s` for one that hangs.

        `written` gives the bytes of a vehicle's journal: when it grows, somebody else steers.
        """
        self.wards: dict[int, Ward] = {}
        self.is_bereft = False
        """Whether the controllers' process is dead."""
        self._hang_s = hang_s
        self._heard_s = 0.0
        self._written = written

    def hear(self, line: bytes, now: float) -> None:
        """Take what a controller says of its vehicle; an empty line says that all is as it was."""
        self._heard_s = now
        for ward in self.wards.values():
            ward.held_s, ward.is_released = None, False
        if line:
            told = json.loads(line)
            ward = Ward(told["reach"], bytes.fromhex(told["frame"]), told["stamp"])
            self.wards[told["sysid"]] = ward

    @property
    def is_done(self) -> bool:
        """Whether nobody is left to look after."""
        held = (ward.frame and not ward.is_released for ward in self.wards.values())
        return self.is_bereft and not any(held)

    def due(self, now: float) -> list[Ward]:
        """Give those that are to be sent their frame now."""
        return [ward for sysid, ward in self.wards.items() if self._is_due(sysid, ward, now)]

    def _is_due(self, sysid: int, ward: Ward, now: float) -> bool:
        is_alone = self.is_bereft or now - self._heard_s > self._hang_s
        if not ward.frame or not is_alone or ward.is_released:
            return False
        if ward.held_s is None:
            ward.held_s, ward.written = now, self._written(sysid)
        written = self._written(sysid)
        ward.is_released = written > ward.written or now - ward.held_s > HELD_S
        ward.written = min(ward.written, written)  # a torn line is cut off before anybody steers
        return not ward.is_released


class Ways:
    """Ports opened when they are needed, and never read."""

    def __init__(self) -> None:
        self._serial: dict[str, int] = {}

    def send(self, reach: str, data: bytes) -> None:
        """Send to where a link leads; what cannot be reached is not."""
        scheme, _, where = reach.partition("://")
        host, _, port = where.rpartition(":")
        with contextlib.suppress(OSError, ValueError, ImportError):
            if scheme == "udpout":
                port, _, own = port.partition("/")
                with _speaker(int(own)) as speaker:
                    speaker.sendto(data, (host, int(port)))
            elif scheme == "serial":
                os.write(self._port(host, port), data)

    def _port(self, device: str, baud: str) -> int:
        """Open a serial port as it was left, without locking out who is to take over."""
        if device not in self._serial:
            import termios  # noqa: PLC0415 - seldom needed
            import tty  # noqa: PLC0415

            port = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            tty.setraw(port)
            attributes = termios.tcgetattr(port)
            attributes[4] = attributes[5] = getattr(termios, f"B{baud}", attributes[5])
            termios.tcsetattr(port, termios.TCSANOW, attributes)
            self._serial[device] = port
        return self._serial[device]


def _speaker(own: int) -> socket.socket:
    """Speak from the port that the vehicle knows, for so short that a successor can have it.

    A controller that hangs has it still; then from another, which not every vehicle hears.
    """
    speaker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    speaker.setblocking(False)
    with contextlib.suppress(OSError):
        speaker.bind(("", own))
    return speaker


def main() -> None:
    """Watch over the controllers whose lines come in on standard input."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends by itself, at most HELD_S after them
    journals, hang_s = Path(sys.argv[1]), float(sys.argv[2])
    guardian = Guardian(hang_s, lambda sysid: _size(journals / f"vehicle-{sysid:03d}.jsonl"))
    ways, seal, rest, due_s = Ways(), _sealer(), b"", 0.0
    while not guardian.is_done:
        rest = _listen(guardian, rest, PERIOD_S)
        if (now := time.monotonic()) >= due_s:
            due_s = now + PERIOD_S
            for ward in guardian.due(now):
                ways.send(ward.reach, seal(ward))


def _listen(guardian: Guardian, rest: bytes, within_s: float) -> bytes:
    """Hear what comes, until the other end is closed; give the line that is not whole yet."""
    if guardian.is_bereft:
        time.sleep(within_s)  # noqa: TID251 - there is nothing else that it could do
        return b""
    if not select.select([0], [], [], within_s)[0]:
        return rest
    data = os.read(0, READ_BYTES)
    guardian.is_bereft = not data
    *lines, rest = (rest + data).split(b"\n")
    for line in lines:
        with contextlib.suppress(ValueError, KeyError, TypeError):
            guardian.hear(line, time.monotonic())
    return rest


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _sealer() -> Callable[[Ward], bytes]:
    """Give what makes a ward's frame ready to send: signed, if there is a key."""
    key = os.environ.get("SWARM_SIGNING_KEY")
    if not key:
        return lambda ward: ward.frame
    from swarm_ctl.signing import Signer, key_of  # noqa: PLC0415 - half of its memory

    def seal(ward: Ward) -> bytes:
        signer = Signer(key_of(key), ward.stamp)
        frame = signer.sign(ward.frame, LINK_ID)
        ward.stamp = signer.timestamp
        return frame

    return seal


if __name__ == "__main__":
    main()
