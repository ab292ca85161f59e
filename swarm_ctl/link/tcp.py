"""TCP to an autopilot, or to a router or simulator that speaks for one."""

from __future__ import annotations

import asyncio
import errno
import socket

from swarm_ctl.errors import SwarmError, plain
from swarm_ctl.link.stream import StreamLink
from swarm_ctl.link.url import parse

PATIENCE_S = 5.0
"""An attempt to connect, and data that nobody acknowledges, are given up after this time."""


class TcpLink(StreamLink):
    """`tcpout://host:port`: connects to who listens there, and again whenever that is lost."""

    def __init__(self, url: str) -> None:
        super().__init__(url)
        _, host, port = parse(url)
        self._socket: socket.socket | None = None
        self._attempt: asyncio.TimerHandle | None = None
        try:
            self._address = (socket.gethostbyname(host), port)  # here, never while flying
        except (OSError, UnicodeError) as error:
            raise SwarmError(f"{url}: {plain(error)}") from None

    def _connect(self) -> None:
        if self._loop is None:
            return
        self._socket = attempt = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        attempt.setblocking(False)
        attempt.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if (option := getattr(socket, "TCP_USER_TIMEOUT", None)) is not None:  # Linux has it
            attempt.setsockopt(socket.IPPROTO_TCP, option, int(PATIENCE_S * 1000))
        if attempt.connect_ex(self._address) not in {0, errno.EINPROGRESS}:
            self._lost()
            return
        self._loop.add_writer(attempt.fileno(), self._decided, attempt)
        self._attempt = self._loop.call_later(PATIENCE_S, self._lost)

    def _decided(self, attempt: socket.socket) -> None:
        self._end_attempt()
        if attempt.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self._lost()
        else:
            self._connected(attempt.fileno())

    def _end_attempt(self) -> None:
        if self._attempt is not None:
            self._attempt.cancel()
            self._attempt = None
        if self._loop is not None and self._socket is not None:
            self._loop.remove_writer(self._socket)

    def _shut(self) -> None:
        self._end_attempt()
        if self._socket is not None:
            self._socket.close()
            self._socket = None
