"""The socket on which the shards of one mission hear one another."""

from __future__ import annotations

import contextlib
import logging
import socket
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from mock_vehicle.errors import MockVehicleError
from mock_vehicle.fleet import TICK_S, Fleet
from mock_vehicle.shards import Address, divide
from mock_vehicle.shards.letter import write_frames, write_rows

LOG = logging.getLogger(__name__)

AHEAD_S = 0.3
"""Mission time that a shard may be ahead of the slowest one; beyond, it waits."""
LOST_S = 2.0
"""Wall time of silence after which a shard and its vehicles are gone."""
OTHER = ", which has another world, seed, --vehicles or --shards"
DRAIN = 256
DATAGRAM_BYTES = 2048
BUFFER_BYTES = 1 << 20
"""A second of what 250 vehicles tell."""


class PortError(MockVehicleError):
    """A port that cannot be listened on."""

    def __init__(self, bind: Address, reason: str) -> None:
        self.bind = bind
        self.reason = reason
        super().__init__(f"cannot listen on {bind[0]}:{bind[1]}: {reason}")


@dataclass(slots=True)
class _Neighbour:
    """Another shard."""

    shard: int
    vehicles: range
    is_of_group: bool
    """Whether its vehicles are in the same MAVLink network."""
    heard_s: float | None = None
    """When it was last heard, wall clock."""
    is_other: bool = False
    """Whether what it last told is of another mission."""


@dataclass(slots=True)
class Traffic:
    """Datagrams and bytes since the beginning."""

    sent: int = 0
    sent_bytes: int = 0
    arrived: int = 0
    arrived_bytes: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    """Datagrams and frames not taken, by why."""


class Border:
    """Tells the other shards of a fleet, and a fleet of the other shards."""

    def __init__(self, fleet: Fleet, addresses: Sequence[Address]) -> None:
        """Listen on the shard's own one of the addresses; PortError when that cannot be."""
        if fleet.abroad is None:
            raise ValueError("a fleet that flies alone has no border")
        parts = divide(fleet.part.vehicles, len(addresses))
        self._fleet, self._abroad = fleet, fleet.abroad
        self._neighbours = {
            address: _Neighbour(part.shard, part.own, part.group == fleet.part.group)
            for address, part in zip(addresses, parts, strict=True)
            if part.shard != fleet.part.shard
        }
        self.traffic = Traffic(refused=fleet.abroad.refused)
        self._told_s = self._told_wall_s = -TICK_S
        self.socket = listen(addresses[fleet.part.shard - 1], BUFFER_BYTES)

    @property
    def limit_s(self) -> float:
        """Mission time up to which this shard may fly now."""
        return self._abroad.slowest_s() + AHEAD_S

    @property
    def latest_s(self) -> float:
        """Mission time of the shard that is farthest, of those that are heard."""
        return max(self._abroad.latest_s.values(), default=0.0)

    def missing(self) -> list[str]:
        """Name the shards that are not heard, as a person finds them."""
        return [
            f"shard {one.shard} at {host}:{port}{OTHER if one.is_other else ''}"
            for (host, port), one in self._neighbours.items()
            if one.heard_s is None
        ]

    def turn(self, now: float, wall_s: float) -> None:
        """Tell where the own vehicles are once a tick, and what they broadcast at once.

        A shard that waits tells it again, so that others know that it lives.
        """
        self._give_up(wall_s)
        shard, tag = self._fleet.part.shard, self._abroad.tag
        if now >= self._told_s + TICK_S - 1e-6 or wall_s >= self._told_wall_s + TICK_S:
            self._told_s, self._told_wall_s = now, wall_s
            self._send(write_rows(tag, shard, now, self._abroad.rows), to_all=True)
        frames, self._abroad.outgoing = self._abroad.outgoing, []
        if frames:
            self._send(write_frames(tag, shard, now, frames), to_all=False)

    def drain(self, now: float, wall_s: float) -> None:
        """Read what has arrived, up to a bound, at mission time `now`."""
        for _ in range(DRAIN):
            try:
                data, address = self.socket.recvfrom(DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except OSError:  # an ICMP error of an earlier send: that shard is not up
                continue
            self._hear(data, address, now, wall_s)

    def _hear(self, data: bytes, address: Address, now: float, wall_s: float) -> None:
        self.traffic.arrived += 1
        self.traffic.arrived_bytes += len(data)
        neighbour = self._neighbours.get(address)
        if neighbour is None:
            self.traffic.refused["stranger"] += 1
            return
        if not self._fleet.learn(data, neighbour.shard, neighbour.vehicles, now):
            neighbour.is_other = self._abroad.is_of_another(data)
        else:
            if neighbour.heard_s is None:
                LOG.warning("shard %d is here", neighbour.shard)
            neighbour.heard_s = wall_s

    def _give_up(self, wall_s: float) -> None:
        """Fly on without those that have been silent for long."""
        for one in self._neighbours.values():
            if one.heard_s is not None and wall_s - one.heard_s > LOST_S:
                one.heard_s = None
                lost = self._abroad.forget(one.shard)
                if lost:
                    LOG.warning("shard %d is lost, and %d vehicles in the air", one.shard, lost)
                else:
                    LOG.warning("shard %d has ended, all its vehicles are down", one.shard)

    def _send(self, letters: Sequence[bytes], *, to_all: bool) -> None:
        for address, one in self._neighbours.items():
            if not (to_all or one.is_of_group):
                continue
            for letter in letters:
                with contextlib.suppress(OSError):  # a full buffer loses, as UDP does
                    self.socket.sendto(letter, address)
                    self.traffic.sent += 1
                    self.traffic.sent_bytes += len(letter)

    def report(self) -> dict[str, Any]:
        """Tell how it goes, in JSON values."""
        traffic = self.traffic
        return {
            "missing": self.missing(),
            "sent": traffic.sent,
            "sent_bytes": traffic.sent_bytes,
            "arrived": traffic.arrived,
            "arrived_bytes": traffic.arrived_bytes,
            "refused": dict(traffic.refused),
        }

    def close(self) -> None:
        """Close the socket."""
        self.socket.close()


def listen(bind: Address, buffer_bytes: int) -> socket.socket:
    """Open a UDP socket with room for so much that arrives; an occupied port is a PortError."""
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.setblocking(False)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
    try:
        opened.bind(bind)
    except OSError as error:
        opened.close()
        raise PortError(bind, error.strerror or "it is taken") from None
    return opened
