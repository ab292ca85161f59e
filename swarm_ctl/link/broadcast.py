"""UDP to everybody on a network that companions share: by multicast, or by broadcast."""

from __future__ import annotations

import asyncio
import socket

from swarm_ctl.errors import SwarmError
from swarm_ctl.link.mesh import Arrived
from swarm_ctl.link.url import NETWORK_EXPECTED, Network

DATAGRAM_BYTES, BUFFER_BYTES, MOST_PER_WAKE_UP = 2048, 1 << 20, 256
HOPS = 1
"""Routers are not crossed: a mesh is one network."""


class Broadcast:
    """One socket that all the processes of a network share an address with."""

    def __init__(self, network: Network) -> None:
        """Join; SwarmError when this machine is not on such a network."""
        self.unsent = 0
        """Datagrams that the network did not take."""
        self._address = (network.host, network.port)
        try:
            self._socket = _open(network)
        except OSError as error:
            reason = error.strerror or error
            raise SwarmError(f"{network.url}: {reason}; {NETWORK_EXPECTED}") from None

    def send(self, sysid: int, data: bytes) -> bool:  # noqa: ARG002 - frames name their sender
        """Send to all; False when it did not leave."""
        try:
            return self._socket.sendto(data, self._address) > 0
        except OSError:  # the network is down or its buffer full: the next beacon is near
            self.unsent += 1
            return False

    async def carry(self, arrived: Arrived) -> None:
        """Give what arrives to `arrived` until cancelled."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._socket, self._read, arrived)
        try:
            await loop.create_future()
        finally:
            loop.remove_reader(self._socket)

    def account(self) -> list[str]:
        """Say what did not leave."""
        return [f"{self.unsent} datagrams did not leave for the mesh"] if self.unsent else []

    def close(self) -> None:
        """Leave the network."""
        self._socket.close()

    def _read(self, arrived: Arrived) -> None:
        for _ in range(MOST_PER_WAKE_UP):
            try:
                data, _ = self._socket.recvfrom(DATAGRAM_BYTES)
            except OSError:
                return
            arrived(data, None)


def _open(network: Network) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.setblocking(False)
        for option in ("SO_REUSEADDR", "SO_REUSEPORT"):  # several processes of one machine
            opened.setsockopt(socket.SOL_SOCKET, getattr(socket, option), 1)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        if network.is_group:
            _join_group(opened, network)
        else:
            _check_broadcast(network)
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        opened.bind((network.host, network.port))
    except OSError:
        opened.close()
        raise
    return opened


def _join_group(opened: socket.socket, network: Network) -> None:
    group, interface = socket.inet_aton(network.host), socket.inet_aton(network.interface)
    opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
    opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, HOPS)
    opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group + interface)


def _check_broadcast(network: Network) -> None:
    """Refuse an address of a single machine: the kernel lets everybody speak to one of these."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((network.host, network.port))
        except PermissionError:
            return
    raise OSError("it is no broadcast address of this machine's networks")
