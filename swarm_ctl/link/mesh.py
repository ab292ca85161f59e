"""What companions tell one another beside their vehicles' radios, whatever carries it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

from swarm_ctl import wire
from swarm_ctl.link.base import MESH, Heard, Link, Source

COMPANION_COMPONENT = 191
_CARRIED = ("HEARTBEAT", "TUNNEL")
_TUNNEL_ID = wire.message("TUNNEL").id

Arrived = Callable[[bytes, int | None], None]
"""Takes what arrived, and the sysid that the transport knows it to be from, if it knows."""


class Transport(Protocol):
    """Carries whole frames between processes; it never blocks, and never raises in flight."""

    def send(self, sysid: int, data: bytes) -> bool:
        """Send what a vehicle tells everybody; False when it did not leave."""

    async def carry(self, arrived: Arrived) -> None:
        """Give what arrives to `arrived` until cancelled; it may come back to its sender."""

    def account(self) -> list[str]:
        """Say in sentences what went wrong, for the summary of a run."""

    def close(self) -> None:
        """Leave the network."""


class Mesh:
    """All the vehicles of a process, and the transport to those of others.

    It carries what a vehicle's radio would: HEARTBEAT and TUNNEL of companions (compid 191) to
    everybody (target system 0). Vehicles of one process hear one another also while the
    transport is down.
    """

    def __init__(self, transport: Transport) -> None:
        self.refused = 0
        """Datagrams that held something else."""
        self._transport = transport
        self._members: list[MeshedLink] = []

    def join(self, link: Link, sysid: int) -> MeshedLink:
        """Give a vehicle's link that hears and tells by the mesh, too."""
        return MeshedLink(self, link, sysid)

    def enter(self, member: MeshedLink) -> None:
        """Give a member what its peers tell, until it leaves."""
        self._members.append(member)

    def leave(self, member: MeshedLink) -> None:
        """Give a member nothing any more."""
        if member in self._members:
            self._members.remove(member)

    def tell(self, sysid: int, data: bytes) -> bool:
        """Send what of a controller's datagram is for everybody; False when nothing left."""
        frames = _broadcasts(data)
        if not frames:
            return False
        self._pass_on(frames)
        return self._transport.send(sysid, _joined(frames))

    async def run(self) -> None:
        """Hear the others until cancelled."""
        await self._transport.carry(self._arrived)

    def account(self) -> list[str]:
        """Say in sentences what went wrong, for the summary of a run."""
        words = f"{self.refused} datagrams on the mesh were no companion's"
        return [*([words] if self.refused else []), *self._transport.account()]

    def close(self) -> None:
        """Leave the network."""
        self._transport.close()

    def _arrived(self, data: bytes, sysid: int | None) -> None:
        """Pass on what peers of other processes told; what was told here has been heard here."""
        frames = [one for one in _broadcasts(data) if sysid in {None, one.sysid}]
        self.refused += len(_joined(frames)) != len(data)
        ours = {member.sysid for member in self._members}
        self._pass_on([frame for frame in frames if frame.sysid not in ours])

    def _pass_on(self, frames: Iterable[wire.Frame]) -> None:
        for member in self._members:
            member.hear(frame for frame in frames if frame.sysid != member.sysid)


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
        self._mesh.enter(self)

    def send(self, data: bytes, to: Source | None = None) -> bool:
        """Send to the vehicle first, then what is for everybody to the mesh as well."""
        is_sent = self._link.send(data, to)
        self._mesh.tell(self.sysid, data)
        return is_sent

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
