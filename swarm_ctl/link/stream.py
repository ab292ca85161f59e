"""A stream of bytes that is made again when it breaks, without ever holding up the event loop."""

from __future__ import annotations

import asyncio
import os
from abc import ABC, abstractmethod

from swarm_ctl.link.base import STREAM, Heard, Source

AGAIN_S = 1.0
"""Wall time between two attempts to connect."""
READ_BYTES = 1 << 14


class StreamLink(ABC):
    """What TCP and serial ports share; each says how its descriptor is opened and closed."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._fd = -1
        """The descriptor; -1 while there is no connection."""
        self._heard: Heard | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._unsent = b""

    def watch(self, heard: Heard) -> None:
        """Let the running event loop give what arrives to `heard`, and connect when it must."""
        self._loop = asyncio.get_running_loop()
        self._heard = heard
        if self._fd >= 0:
            self._loop.add_reader(self._fd, self._read)
        else:
            self._connect_later(0.0)

    def send(self, data: bytes, to: Source | None = None) -> bool:  # noqa: ARG002 - it has one end
        """Send what fits at once; no frame is torn: what is over leaves before anything else."""
        self._unsent = self._unsent[self._write(self._unsent) :]
        if self._unsent:
            return False
        done = self._write(data)
        self._unsent = data[done:] if done else b""
        return done > 0

    def reach(self, _to: Source | None = None) -> str:
        """Give nothing: most who are connected to hear one client alone."""
        return ""

    def close(self) -> None:
        """Disconnect, and stay so."""
        if self._timer is not None:
            self._timer.cancel()
        self._disconnect()
        self._loop = None

    @abstractmethod
    def _connect(self) -> None:
        """Begin to open the descriptor, and call `_connected` when it is; never block."""

    @abstractmethod
    def _shut(self) -> None:
        """Close what `_connect` opened."""

    def _connected(self, descriptor: int) -> None:
        self._fd = descriptor
        if self._loop is not None:
            self._loop.add_reader(descriptor, self._read)

    def _lost(self) -> None:
        """Forget a connection that broke or never came about, and try again in a while."""
        self._disconnect()
        self._connect_later(AGAIN_S)

    def _connect_later(self, delay_s: float) -> None:
        if self._loop is not None:
            self._timer = self._loop.call_later(delay_s, self._connect)

    def _disconnect(self) -> None:
        if self._loop is not None and self._fd >= 0:
            self._loop.remove_reader(self._fd)
        self._fd, self._unsent = -1, b""
        self._shut()

    def _read(self) -> None:
        try:
            data = os.read(self._fd, READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._lost()
        elif self._heard is not None:
            self._heard(data, STREAM)

    def _write(self, data: bytes) -> int:
        """Give how many bytes left; a connection that broke takes none."""
        if self._fd < 0 or not data:
            return 0
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except OSError:
            self._lost()
            return 0
