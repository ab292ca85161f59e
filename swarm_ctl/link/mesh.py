"""What companions tell one another without a radio: UDP multicast on a network that they share."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import re
import socket
from collections.abc import Iterable
from typing import NamedTuple

from swarm_ctl import wire
from swarm_ctl.errors import SwarmError
from swarm_ctl.link.base import MESH, Heard, Link, Source

EXPECTED = (
    "expected a multicast group and a port, as udp://239.255.42.42:14700, with ?interface=IP "
    "behind it where the machine has several networks"
)
_URL = re.compile(
    r"udp://(?P<group>[\d.]+):(?P<port>\d{1,5})/?(\?interface=(?P<interface>[\d.]+))?"
)
COMPANION_COMPONENT = 191
DATAGRAM_BYTES, BUFFER_BYTES, MOST_PER_WAKE_UP = 2048, 1 << 20, 256
PORT_MAX = 0xFFFF
HOPS = 1
"""Routers are not crossed: a mesh is one network."""
_CARRIED = ("HEARTBEAT", "TUNNEL")
_TUNNEL_ID = wire.message("TUNNEL").id


class Mesh:
    """One multicast socket for all the vehicles of a process.

    It carries what a vehicle's radio would: HEARTBEAT and TUNNEL of companions (compid 191) to
    everybody (target system 0). All on it hear one another, also those of one process.
    """

    def __init__(self, url: str) -> None:
        """Join; SwarmError when the address is none, or the network knows no multicast."""
        place = _parse(url)
        self.refused = 0
        """Datagrams that held something else."""
        self._group = (place.group, place.port)
        self._members: list[MeshedLink] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        try:
            self._socket = _open(place)
        except OSError as error:
            raise SwarmError(f"{url}: {error.strerror or error}; {EXPECTED}") from None

    def join(self, link: Link, sysid: int) -> MeshedLink:
        """Give a vehicle's link that hears and tells by the mesh, too."""
        return MeshedLink(self, link, sysid)

    def watch(self, member: MeshedLink) -> None:
        """Let the running event loop give a member what its peers tell, until it leaves."""
        self._members.append(member)
        if self._loop is None:
            self._loop = asyncio.get_running_loop()
            self._loop.add_reader(self._socket, self._read)

    def leave(self, member: MeshedLink) -> None:
        """Give a member nothing any more."""
        if member in self._members:
            self._members.remove(member)

    def tell(self, data: bytes) -> bool:
        """Send what of a controller's datagram is for everybody; False when nothing left."""
        told = _joined(_broadcasts(data))
        try:
            return bool(told) and self._socket.sendto(told, self._group) > 0
        except OSError:  # the network is down or its buffer full: the next beacon is near
            return False

    def close(self) -> None:
        """Leave the network."""
        if self._loop is not None:
            self._loop.remove_reader(self._socket)
            self._loop = None
        self._socket.close()

    def _read(self) -> None:
        for _ in range(MOST_PER_WAKE_UP):
            try:
                data, _ = self._socket.recvfrom(DATAGRAM_BYTES)
            except OSError:
                return
            frames = _broadcasts(data)
            self.refused += len(_joined(frames)) != len(data)
            for member in self._members:
                member.hear([frame for frame in frames if frame.sysid != member.sysid])


class MeshedLink:
    """A vehicle's own link, and the mesh beside it."""

    def __init__(self, mesh: Mesh, link: Link, sysid: int) -> None:
        self.url = link.url
        self.sysid = sysid
        self._mesh = mesh
        self._link = link
        self._heard: Heard | None = None

    def watch(self, heard: Heard) -> None:
        """Let the running event loop give all that arrives to `heard`."""
        self._heard = heard
        self._link.watch(heard)
        self._mesh.watch(self)

    def send(self, data: bytes, to: Source | None = None) -> bool:
        """Send to the vehicle, and what is for everybody to the mesh as well."""
        self._mesh.tell(data)
        return self._link.send(data, to)

    def hear(self, frames: Iterable[wire.Frame]) -> None:
        """Take what peers told."""
        data = _joined(frames)
        if data and self._heard is not None:
            self._heard(data, MESH)

    def reach(self, to: Source | None = None) -> str:
        """Give an address by which another process reaches the vehicle; empty if none can."""
        return self._link.reach(to)

    def close(self) -> None:
        """Hear nothing any more; the mesh stays open for the others."""
        self._mesh.leave(self)
        self._link.close()


class _Place(NamedTuple):
    """Where a mesh is."""

    group: str
    port: int
    interface: str
    """Address of the machine on the network; 0.0.0.0 leaves the choice to the kernel."""


def _broadcasts(data: bytes) -> list[wire.Frame]:
    """Give the frames by which a companion speaks to everybody."""
    frames = wire.Parser(_CARRIED).feed(data)
    return [
        frame
        for frame in frames
        if frame.compid == COMPANION_COMPONENT
        and (frame.id != _TUNNEL_ID or frame.values.target_system == 0)
    ]


def _joined(frames: Iterable[wire.Frame]) -> bytes:
    return b"".join(frame.raw for frame in frames)


def _parse(url: str) -> _Place:
    found = _URL.fullmatch(url)
    if found is not None:
        group, port, interface = found["group"], int(found["port"]), found["interface"]
        with contextlib.suppress(ValueError):
            is_group = ipaddress.IPv4Address(group).is_multicast
            chosen = ipaddress.IPv4Address(interface or 0)
            if is_group and 0 < port <= PORT_MAX:
                return _Place(group, port, str(chosen))
    raise SwarmError(f"{url}: {EXPECTED}")


def _open(place: _Place) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.setblocking(False)
        for option in ("SO_REUSEADDR", "SO_REUSEPORT"):  # several processes of one machine
            opened.setsockopt(socket.SOL_SOCKET, getattr(socket, option), 1)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        opened.bind((place.group, place.port))
        group, interface = socket.inet_aton(place.group), socket.inet_aton(place.interface)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, HOPS)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group + interface)
    except OSError:
        opened.close()
        raise
    return opened
