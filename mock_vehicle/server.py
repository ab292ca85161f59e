"""The mock fleet on UDP, in real or scaled time: sockets, the clock and nothing else."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os
import socket
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from mock_vehicle.border import Border, listen
from mock_vehicle.fleet import TICK_S, Fleet
from mock_vehicle.shards import Address

LOG = logging.getLogger(__name__)

DEBT_MAX_S = 0.5
"""Mission time caught up at most; what is owed beyond is dropped."""
COMPLAIN_EVERY_S = 5.0
GATHER_S = 0.05
HEARD_S = 10.0
"""A sender that was heard within this time (wall clock) gets telemetry."""
DATAGRAM_BYTES = 2048
RECEIVE_BUFFER_BYTES = 256 * 1024
REPORT_EVERY_S = 1.0


@dataclass(frozen=True, slots=True)
class Port:
    """Where one vehicle listens and whom it calls unasked."""

    bind: Address
    """Port 0 takes a free one."""
    remote: Address | None = None
    """Gets telemetry from the start; none: only who spoke is answered."""


@dataclass(slots=True)
class _Endpoint:
    """The socket of one vehicle's link."""

    socket: socket.socket
    remote: Address | None
    vehicle: int
    link: int
    heard: dict[Address, float] = field(default_factory=dict)
    """Senders and when they were last heard."""
    arrived: int = 0
    """Datagrams read."""
    sent: int = 0
    """Datagrams sent, to whomever."""
    unsent: int = 0
    """Datagrams that did not leave: a full buffer, or a network that is down."""

    @property
    def bind(self) -> Address:
        """Where it listens."""
        host, port = self.socket.getsockname()
        return host, port

    def send(self, data: bytes, now: float) -> None:
        """Send to the remote and to every sender heard lately; a full buffer loses, as UDP does."""
        for address, last in list(self.heard.items()):
            if now - last > HEARD_S:
                del self.heard[address]
        if self.remote is not None and self.remote not in self.heard:
            self._send(data, self.remote)
        for address in self.heard:
            self._send(data, address)

    def _send(self, data: bytes, address: Address) -> None:
        try:
            self.socket.sendto(data, address)
            self.sent += 1
        except OSError:
            self.unsent += 1

    def receive(self, now: float) -> bytes | None:
        """Read a datagram that has arrived; None when there is none."""
        try:
            data, address = self.socket.recvfrom(DATAGRAM_BYTES)
        except OSError:  # also an ICMP error of an earlier send
            return None
        self.heard[address] = now
        self.arrived += 1
        return data


class Server:
    """Runs a fleet on its sockets until told to stop."""

    def __init__(
        self, fleet: Fleet, ports: list[Port], *, speed: float = 1.0, border: Border | None = None
    ) -> None:
        """Open a socket per port; ports stand in the order of `fleet.places`.

        Over a `border` the fleet keeps pace with the other shards of its mission.
        """
        self._fleet = fleet
        fleet.takes_turns = True
        self.border = border
        self._speed = speed
        self.endpoints = [
            _open(port, *place) for port, place in zip(ports, fleet.places, strict=True)
        ]
        self.time_s = 0.0
        """Mission time."""
        self.behind_s = 0.0
        """Mission time dropped so far because the machine was too slow."""
        self.steps_late = 0
        """Steps that began more than a step late."""
        self._steps = 0
        self._started_s = math.inf
        """Wall clock of mission time 0; what was dropped has moved it on."""
        self._complained_s = -COMPLAIN_EVERY_S
        self._stopped = False

    @property
    def ports(self) -> list[int]:
        """The ports the vehicles listen on for their companions."""
        return [endpoint.bind[1] for endpoint in self.endpoints[: self._fleet.n]]

    def ready(self) -> dict[str, Any]:
        """Say who listens where, in JSON values."""
        fleet = self._fleet
        return {
            "ports": self.ports,
            "sysids": fleet.sysids,
            "host": self.endpoints[0].bind[0],
            "group": fleet.part.group,
            "world": fleet.world.name,
            "autopilots": fleet.personalities,
            "victims_total": len(fleet.world.victims),
            "starts_ned_m": fleet.starts_ned_m.round(3).tolist(),
        }

    def pace(self) -> dict[str, Any]:
        """Say how well it keeps up, in JSON values."""
        unsent = sum(endpoint.unsent for endpoint in self.endpoints)
        return {
            "behind_s": round(self.behind_s, 3),
            "mock_late_fraction": round(self.steps_late / max(self._steps, 1), 5),
            "mock_dropped": unsent + self._fleet.dropped,
        }

    def stop(self) -> None:
        """End `run` after the current step; any thread may ask."""
        self._stopped = True

    async def run(
        self,
        *,
        duration_s: float | None = None,
        report: Callable[[], None] = lambda: None,
        watch_stdin: bool = False,
    ) -> None:
        """Fly until stopped by a closed stdin, `stop` or the end of `duration_s`."""
        loop = asyncio.get_running_loop()
        for endpoint in self.endpoints:
            loop.add_reader(endpoint.socket, self._receive, endpoint, loop)
        if watch_stdin:
            self._watch_stdin(loop)
        try:
            async with asyncio.TaskGroup() as tasks:
                reporter = tasks.create_task(_repeat(report), name="report")
                if self.border is not None:
                    await self._gather(self.border, loop)
                await self._fly(loop, duration_s)
                reporter.cancel()
        finally:
            self._close(loop)

    async def _fly(self, loop: asyncio.AbstractEventLoop, duration_s: float | None) -> None:
        """Step at absolute deadlines, a tick at most before the sockets have their turn."""
        self._started_s = loop.time() - self.time_s / self._speed
        step_s = self._fleet.step_s
        steps_per_turn = round(TICK_S / step_s)
        while not self._stopped:
            if self.border is not None:
                self._keep_pace(self.border, loop.time())
            owed = self._due_s(loop.time()) - self.time_s
            if owed > DEBT_MAX_S + step_s:
                self._started_s += (owed - DEBT_MAX_S) / self._speed
                self._fall_behind(owed - DEBT_MAX_S, loop.time())
            for _ in range(min(steps_per_turn, int(owed / step_s + 1e-6))):
                self._step(loop.time())
                if duration_s is not None and self.time_s >= duration_s - 1e-9:
                    return
            rest = (self.time_s + step_s - self._due_s(loop.time())) / self._speed
            await asyncio.sleep(max(rest, 0.0))

    async def _gather(self, border: Border, loop: asyncio.AbstractEventLoop) -> None:
        """Wait for all other shards; who comes late begins at their time."""
        loop.add_reader(border.socket, lambda: border.drain(self.time_s, loop.time()))
        while not self._stopped and (missing := border.missing()):
            border.turn(self.time_s, loop.time())
            self._complain(loop.time(), "waiting for %s", " and ".join(missing))
            await asyncio.sleep(GATHER_S)
        self._steps = round(border.latest_s / self._fleet.step_s)
        self.time_s = self._steps * self._fleet.step_s

    def _keep_pace(self, border: Border, wall_s: float) -> None:
        """Tell the other shards how far we are, and wait for who is behind."""
        border.turn(self.time_s, wall_s)
        ahead_s = self._due_s(wall_s) - border.limit_s
        if ahead_s > 0.0:
            self._started_s += ahead_s / self._speed

    def _due_s(self, wall_s: float) -> float:
        """Tell the mission time that a wall clock stands for; steps come a little after it."""
        return (wall_s - self._started_s) * self._speed

    def _step(self, wall_s: float) -> None:
        self._steps += 1
        self.time_s = self._steps * self._fleet.step_s
        self.steps_late += self._due_s(wall_s) - self.time_s > self._fleet.step_s
        for index, data in self._fleet.step(self.time_s):
            self.endpoints[index].send(data, wall_s)
        for endpoint in self.endpoints[self._fleet.n :]:
            self._answer(endpoint, wall_s)

    def _answer(self, endpoint: _Endpoint, wall_s: float) -> None:
        for data in self._fleet.answers(endpoint.vehicle, endpoint.link):
            endpoint.send(data, wall_s)

    def _fall_behind(self, dropped_s: float, wall_s: float) -> None:
        self.behind_s += dropped_s
        if self.behind_s >= 0.1:
            self._complain(wall_s, "falling behind real time by %.1f s so far", self.behind_s)

    def _complain(self, wall_s: float, words: str, *values: object) -> None:
        """Warn, now and then."""
        if wall_s - self._complained_s >= COMPLAIN_EVERY_S:
            self._complained_s = wall_s
            LOG.warning(words, *values)

    def _receive(self, endpoint: _Endpoint, loop: asyncio.AbstractEventLoop) -> None:
        """Hand over a datagram at the time of its arrival, and send what is answered.

        One at a time: to learn that there is no other costs another call of the kernel.
        """
        wall_s = loop.time()
        data = endpoint.receive(wall_s)
        if data is not None:
            now = max(self.time_s, self._due_s(wall_s))
            self._fleet.receive(endpoint.vehicle, data, now, endpoint.link)
            self._answer(endpoint, wall_s)

    def _watch_stdin(self, loop: asyncio.AbstractEventLoop) -> None:
        """Stop when whoever started us closes our input; files and /dev/null are not watched."""

        def read() -> None:
            if not os.read(sys.stdin.fileno(), 4096):
                loop.remove_reader(sys.stdin)
                self.stop()

        with contextlib.suppress(PermissionError, ValueError, AttributeError):
            if not sys.stdin.isatty():
                loop.add_reader(sys.stdin, read)

    def _close(self, loop: asyncio.AbstractEventLoop) -> None:
        with contextlib.suppress(PermissionError, ValueError, AttributeError):
            loop.remove_reader(sys.stdin)
        if self.border is not None:
            loop.remove_reader(self.border.socket)
            self.border.close()
        for endpoint in self.endpoints:
            loop.remove_reader(endpoint.socket)
            endpoint.socket.close()


async def _repeat(report: Callable[[], None]) -> None:
    while True:
        await asyncio.sleep(REPORT_EVERY_S)
        report()


def _open(port: Port, vehicle: int, link: int) -> _Endpoint:
    endpoint = listen(port.bind, RECEIVE_BUFFER_BYTES)
    return _Endpoint(endpoint, port.remote, vehicle, link)
