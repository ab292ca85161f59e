"""UDP between a controller and its autopilot; addresses as MAVSDK writes them."""

from __future__ import annotations

import socket
from urllib.parse import urlsplit

from swarm_ctl.errors import SwarmError

DATAGRAM_BYTES = 2048
"""Larger than any datagram a vehicle sends; a small buffer is several times faster to receive."""
BUFFER_BYTES = 1 << 18
MOST_PER_WAKE_UP = 64


class UdpLink:
    """One non-blocking UDP socket.

    `udpout://host:port` speaks to a vehicle that listens there; `udpin://host:port` listens (on a
    free port when it is 0) and answers whoever spoke last. Connections are lost silently in UDP:
    sending never raises.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        scheme, host, port = _parse(url)
        self._is_listening = scheme == "udpin"
        self._peer: tuple[str, int] | None = None
        try:
            address = (
                socket.gethostbyname(host),
                port,
            )  # here, never while flying: it may take long
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        except (OSError, UnicodeError) as error:
            raise SwarmError(f"{url}: {getattr(error, 'strerror', None) or error}") from None
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        try:
            self._socket.bind(address if self._is_listening else ("", 0))
        except OSError as error:
            self._socket.close()
            raise SwarmError(f"{url}: {error.strerror or error}") from None
        if not self._is_listening:
            self._peer = address

    def fileno(self) -> int:
        """Give the descriptor an event loop watches."""
        return self._socket.fileno()

    def send(self, data: bytes) -> bool:
        """Send one datagram; False when it could not leave (nobody known yet, buffer full)."""
        if self._peer is None:
            return False
        try:
            self._socket.sendto(data, self._peer)
        except OSError:
            return False
        return True

    def drain(self) -> list[bytes]:
        """Give the datagrams that arrived, a bounded number at a time."""
        datagrams = []
        for _ in range(MOST_PER_WAKE_UP):
            try:
                data, sender = self._socket.recvfrom(DATAGRAM_BYTES)
            except BlockingIOError:
                break
            except OSError:
                continue  # the port we sent to is closed: told here by the kernel, counted nowhere
            if self._is_listening:
                self._peer = sender
            datagrams.append(data)
        return datagrams

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _parse(url: str) -> tuple[str, str, int]:
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise SwarmError(f"{url}: {error}") from error
    is_bare = parts.path in {"", "/"} and not parts.query
    if parts.scheme not in {"udpin", "udpout"} or not parts.hostname or port is None or not is_bare:
        raise SwarmError(f"{url}: expected udpin://HOST:PORT or udpout://HOST:PORT")
    if parts.scheme == "udpout" and not port:
        raise SwarmError(f"{url}: nobody listens on port 0")
    return parts.scheme, parts.hostname, port
