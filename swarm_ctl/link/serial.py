"""A serial port to an autopilot: USB, a TELEM port, a telemetry radio; wants the extra `serial`."""

from __future__ import annotations

import errno
import os
import termios
from typing import TYPE_CHECKING

from swarm_ctl.errors import SwarmError
from swarm_ctl.link.base import Source
from swarm_ctl.link.stream import StreamLink
from swarm_ctl.link.url import parse

if TYPE_CHECKING:
    import serial

HINTS = {
    errno.ENOENT: "; is it plugged in? /dev/serial/by-id has what is",
    errno.EACCES: "; its group, often dialout, may use it",
    errno.EAGAIN: "; another program uses it",
}
_ERRORS = (OSError, ValueError, termios.error)


class SerialLink(StreamLink):
    """`serial:///dev/ttyACM0:57600`; a port that is unplugged is opened again when it is back."""

    def __init__(self, url: str) -> None:
        super().__init__(url)
        _, self._device, self._baud = parse(url)
        self._port: serial.Serial | None = None
        try:
            self._open()
        except ModuleNotFoundError:
            reason = "this needs pyserial, which is missing: pip install 'swarm-ctl[serial]'"
            raise SwarmError(f"{url}: {reason}") from None
        except _ERRORS as error:
            raise SwarmError(f"{url}: {_words(error)}") from None

    def reach(self, _to: Source | None = None) -> str:
        """Give the port, which another process may open while nobody has it."""
        return f"serial://{self._device}:{self._baud}"

    def _open(self) -> None:
        import serial  # noqa: PLC0415 - an extra

        # with a timeout of 0 it opens without blocking; reading and writing is up to StreamLink
        self._port = serial.Serial(self._device, self._baud, timeout=0.0, exclusive=True)
        self._connected(self._port.fileno())

    def _connect(self) -> None:
        try:
            self._open()
        except _ERRORS:
            self._lost()

    def _shut(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None


def _words(error: Exception) -> str:
    """Say in the system's words why a port could not be opened."""
    number = getattr(error, "errno", None)
    if number:
        return os.strerror(number) + HINTS.get(number, "")
    return "this is no serial port" if "configure" in str(error) else str(error)
