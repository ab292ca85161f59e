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

    `udpout://host:port` speaks to a vehicle that listens there; `udpin://host:port` listens and
    answers whoever spoke last. Connections are lost silently in UDP: sending never raises.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        scheme, host, port = _parse(url)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        self._peer: tuple[str, int] | None = None
        try:
            if scheme == "udpout":
                self._peer = (host, port)
                self._socket.bind(("", 0))
            else:
                self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise SwarmError(f"{url}: {error.strerror or error}") from error

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
            if self.url.startswith("udpin"):
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
    if parts.scheme not in {"udpin", "udpout"} or not parts.hostname or not port:
        raise SwarmError(f"{url}: expected udpin://HOST:PORT or udpout://HOST:PORT")
    return parts.scheme, parts.hostname, port
