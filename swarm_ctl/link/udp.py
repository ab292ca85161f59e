"""UDP between a controller and its autopilot."""

from __future__ import annotations

import asyncio
import contextlib
import select
import socket
import zlib

from swarm_ctl.errors import SwarmError, plain
from swarm_ctl.link.base import Heard, Source
from swarm_ctl.link.url import parse

DATAGRAM_BYTES = 2048
"""Larger than any datagram a vehicle sends; a small buffer is several times faster to receive."""
BUFFER_BYTES = 1 << 18
ATTEMPTS, ATTEMPT_S = 3, 0.005
FIRST_LOCAL, LOCAL_PORTS = 10_000, 4_000
"""Where ports are taken to speak from: below those that systems and simulators give."""


class UdpLink:
    """One non-blocking UDP socket.

    `udpout://host:port` speaks to a vehicle that listens there; `udpin://host:port` listens (on a
    free port when it is 0) and answers whoever spoke last. Connections are lost silently in UDP:
    sending never raises.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        scheme, host, port = parse(url)
        self._is_listening = scheme == "udpin"
        self._peer: Source | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        try:
            address = (
                socket.gethostbyname(host),
                port,
            )  # here, never while flying: it may take long
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        except (OSError, UnicodeError) as error:
            raise SwarmError(f"{url}: {plain(error)}") from None
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        if not self._is_listening:
            self._peer = address
            self._bind_as_before(address)
            return
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise SwarmError(f"{url}: {plain(error)}") from None

    def _bind_as_before(self, address: Source) -> None:
        """Speak from the same port whenever it is free: PX4 answers who spoke first, for good."""
        port = FIRST_LOCAL + zlib.crc32(f"{address}".encode()) % LOCAL_PORTS
        try:
            self._socket.bind(("", port))
        except OSError:
            self._socket.bind(("", 0))

    def fileno(self) -> int:
        """Give the descriptor of the socket, -1 when it is closed."""
        return self._socket.fileno()

    def watch(self, heard: Heard) -> None:
        """Let the running event loop give every datagram to `heard`, until the link is closed."""
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._socket.fileno(), self._read, heard)

    def send(self, data: bytes, to: Source | None = None) -> bool:
        """Send one datagram; False when it could not leave (nobody known yet, buffer full)."""
        address = to or self._peer
        if address is None:
            return False
        try:
            self._socket.sendto(data, address)
        except OSError:
            return False
        return True

    def receive(self) -> tuple[bytes, Source] | None:
        """Give a datagram that has arrived and who sent it; None when there is none."""
        try:
            arrived: tuple[bytes, Source] = self._socket.recvfrom(DATAGRAM_BYTES)
        except OSError:  # also when the port that we sent to is closed: counted nowhere
            return None
        if self._is_listening:
            self._peer = arrived[1]
        return arrived

    def reach(self, to: Source | None = None) -> str:
        """Give the address of who is spoken to, and behind it the own port, which it may insist on.

        An autopilot that calls us hears nobody but the port that it calls.
        """
        peer = to or self._peer
        return f"udpout://{peer[0]}:{peer[1]}/{self._socket.getsockname()[1]}" if peer else ""

    def close(self) -> None:
        """Close the socket."""
        if self._loop is not None:
            self._loop.remove_reader(self._socket)
            self._loop = None
        self._socket.close()

    def _read(self, heard: Heard) -> None:
        """Take one datagram: to learn that there is no other costs another call of the kernel."""
        arrived = self.receive()
        if arrived is not None:
            heard(*arrived)


def _bind(listener: socket.socket, address: Source) -> None:
    """Take a port; a guardian may have it for a fraction of a millisecond, ten times a second."""
    for _ in range(ATTEMPTS):
        with contextlib.suppress(OSError):
            listener.bind(address)
            return
        select.select([], [], [], ATTEMPT_S)
    listener.bind(address)
