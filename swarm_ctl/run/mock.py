"""Fly a mission against mock vehicles over real UDP: the mock is a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from typing import Any

from swarm_ctl.controller import KILLED
from swarm_ctl.flight import (
    GRACE_S,
    MOCK_DIED,
    TRUTH,
    Faults,
    Shard,
    controllers_for,
    sign_with,
)
from swarm_ctl.link.udp import UdpLink
from swarm_ctl.mission import Mission
from swarm_ctl.model import Vec3
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.record.truth import read_truth
from swarm_ctl.run.fleet import Fleet
from swarm_ctl.run.process import MockProcess
from swarm_ctl.signing import KEY_VARIABLE

LEASH = "SWARM_CTL_LEASH"
"""In the environment of a run that shall not outlive whoever holds the other end of its input."""


class UdpRun(Fleet):
    """One mission over UDP, from the mock's first line to its last."""

    mode = "udp"

    def __init__(
        self,
        mission: Mission,
        folder: RunFolder,
        *,
        speed: float,
        faults: Faults | None = None,
        key: bytes | None = None,
        shard: Shard | None = None,
    ) -> None:
        """Prepare a run, or that of one shard; with a key of 32 bytes all said in it is signed."""
        sysids, group = (shard.sysids, shard.group) if shard else (None, 1)
        controllers = controllers_for(mission, folder, sysids, group=group)
        super().__init__(controllers, folder, speed=speed)
        self.mission = mission
        self._shard = shard
        self.referee: dict[str, Any] | None = None
        """The referee's latest report, for the operator's eyes only."""
        self.is_shown = False
        """Whether ground stations and viewers on this computer see the fleet."""
        self._environment = dict(os.environ)
        if key is not None:  # the mock's command line, which anybody may read, does not show it
            self._environment[KEY_VARIABLE] = key.hex()
            sign_with(key, self.controllers, datetime.now(UTC))
        self._faults = faults or Faults()
        self._mock: MockProcess | None = None
        self._is_ready = False

    async def fly(self, progress: Callable[[UdpRun], None]) -> None:
        """Start the mock, fly every vehicle, stop the mock; MockError when it does not start."""
        with self.interruptible(), _leash(self.interrupt):
            mock = self._mock = await MockProcess.start(self._arguments(), self._environment)
            try:
                ready = await mock.ready()
                self.referee = {"victims_total": ready["victims_total"]}
                self._look_at_the_map(ready)
                with _links(ready["ports"]) as links:
                    self._is_ready = True
                    aside = (self._listen(mock), mock.heed(), self._kill_controllers())
                    await self.fly_over(links, lambda: progress(self), aside)
            finally:
                self.notes += await mock.stop()

    def interrupt(self) -> None:
        """Land everybody; asked twice, end at once, also a mock that is still starting."""
        if self.interrupted and not self._is_ready:
            if self._mock is not None:
                self._mock.kill()
        else:
            super().interrupt()

    def _look_at_the_map(self, ready: dict[str, Any]) -> None:
        """Take what an operator may see of the world: its walls, and no victim."""
        outline = read_truth(self.folder.path).world
        self.plan = {key: value for key, value in outline.items() if key != "victims"} or None
        places = (Vec3(*place) for place in ready["starts_ned_m"])
        self.origins = dict(zip(ready["sysids"], places, strict=True))

    def _arguments(self) -> list[str]:
        mission = self.mission
        options = {
            "--vehicles": mission.vehicles,
            "--autopilot": mission.autopilot,
            "--speed": self.clock.speed,
            "--seed": mission.seed,
            "--port": 0,
            "--rates": "shown" if self.is_shown else "lean",
            "--out": self.folder.path / TRUTH,
        }
        if (shard := self._shard) is not None:
            options |= {"--shards": shard.addresses, "--shard": shard.number}
            options["--vehicles"] = shard.vehicles
        words = [str(part) for option in options.items() for part in option]
        words += [part for fault in self._faults.mock for part in ("--fault", fault)]
        return [str(mission.simulated), *words, "--json"]

    async def _listen(self, mock: MockProcess) -> None:
        async for report in mock.reports():
            self.referee = {**(self.referee or {}), **report}
        self.notes.append(f"the mock fleet died at {self.now:.1f} s")
        await self.clock.sleep_until(self.now + self.mission.limits.link_lost_s + GRACE_S)
        for controller in self.controllers:
            controller.kill(MOCK_DIED, self.now)

    async def _kill_controllers(self) -> None:
        for moment_s, sysid in self._faults.controllers:
            await self.clock.sleep_until(moment_s)
            (controller,) = (one for one in self.controllers if one.agent.sysid == sysid)
            controller.kill(KILLED, self.now)


@contextlib.contextmanager
def _leash(interrupt: Callable[[], None]) -> Iterator[None]:
    """Land everybody when whoever started us, and asked for it, is gone with our input's end."""
    loop = asyncio.get_running_loop()

    def read() -> None:
        if not os.read(0, 4096):
            loop.remove_reader(0)
            interrupt()

    if LEASH not in os.environ:
        yield
        return
    loop.add_reader(0, read)
    try:
        yield
    finally:
        loop.remove_reader(0)


@contextlib.contextmanager
def _links(ports: Sequence[int]) -> Iterator[list[UdpLink]]:
    with contextlib.ExitStack() as stack:
        links = [UdpLink(f"udpout://127.0.0.1:{port}") for port in ports]
        for link in links:
            stack.callback(link.close)
        yield links
