"""Fly a mission against mock vehicles over real UDP: the mock is a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from swarm_ctl.controller import Clock, Controller, fly
from swarm_ctl.errors import MockError
from swarm_ctl.flight import TRUTH, Faults, controllers_for
from swarm_ctl.link.udp import UdpLink
from swarm_ctl.mission import Mission
from swarm_ctl.model import Operator
from swarm_ctl.record.folder import RunFolder

START_S = 30.0
"""Longest wait for the mock to open its ports, wall time."""
STOP_S = 10.0
REPORT_S = 0.25


class UdpRun:
    """One mission over UDP, from the mock's first line to its last."""

    def __init__(
        self, mission: Mission, folder: RunFolder, *, speed: float, faults: Faults | None = None
    ) -> None:
        self.mission = mission
        self.folder = folder
        self.clock = Clock(speed)
        self.controllers = controllers_for(mission, folder)
        self.referee: dict[str, Any] | None = None
        """The referee's latest report, for the operator's eyes only."""
        self.notes: list[str] = []
        self.interrupted = False
        self._faults = faults or Faults()
        self._is_stopping = False

    @property
    def now(self) -> float:
        """Give mission time."""
        return self.clock.now()

    async def fly(self, progress: Callable[[UdpRun], None]) -> None:
        """Start the mock, fly every vehicle, stop the mock; MockError when it does not start."""
        mock = await self._start_mock()
        try:
            ports = await self._ready(mock)
            with _links(ports) as links, self._interruptible():
                self.clock = Clock(self.clock.speed)
                async with asyncio.TaskGroup() as aside:
                    tasks = [
                        aside.create_task(self._listen(mock), name="mock output"),
                        aside.create_task(self._report(progress), name="progress"),
                        aside.create_task(self._kill_controllers(), name="faults"),
                    ]
                    async with asyncio.TaskGroup() as vehicles:
                        for controller, link in zip(self.controllers, links, strict=True):
                            name = f"vehicle {controller.agent.sysid}"
                            vehicles.create_task(self._fly_one(controller, link), name=name)
                    for task in tasks:
                        task.cancel()
        finally:
            self._is_stopping = True
            await self._stop_mock(mock)

    def interrupt(self) -> None:
        """Land everybody; asked twice, end at once."""
        if self.interrupted:
            for controller in self.controllers:
                controller.kill("interrupted twice", self.now)
        self.interrupted = True
        for controller in self.controllers:
            controller.order(Operator.LAND, self.now)

    # -- vehicles ------------------------------------------------------------------------------

    async def _fly_one(self, controller: Controller, link: UdpLink) -> None:
        """Fly one vehicle; whatever breaks in it stays with it."""
        offset_s = 0.1 * controller.index / len(self.controllers)
        try:
            await fly(controller, link, self.clock, offset_s=offset_s)
        except Exception as error:  # noqa: BLE001 - one vehicle never stops another
            controller.kill(f"its controller broke: {type(error).__name__}: {error}", self.now)

    async def _kill_controllers(self) -> None:
        for moment_s, sysid in self._faults.controllers:
            await self.clock.sleep_until(moment_s)
            self.controllers[sysid - 1].kill("its controller was killed", self.now)

    async def _report(self, progress: Callable[[UdpRun], None]) -> None:
        while True:
            self.folder.tick(self.now)
            progress(self)
            await asyncio.sleep(REPORT_S)

    @contextlib.contextmanager
    def _interruptible(self) -> Iterator[None]:
        loop = asyncio.get_running_loop()
        signals = (signal.SIGINT, signal.SIGTERM)
        for number in signals:
            loop.add_signal_handler(number, self.interrupt)
        try:
            yield
        finally:
            for number in signals:
                loop.remove_signal_handler(number)

    # -- the mock process ----------------------------------------------------------------------

    async def _start_mock(self) -> asyncio.subprocess.Process:
        mission = self.mission
        options = {
            "--vehicles": mission.vehicles,
            "--autopilot": mission.autopilot,
            "--speed": self.clock.speed,
            "--seed": mission.seed,
            "--port": 0,
            "--out": self.folder.path / TRUTH,
        }
        arguments = [str(part) for option in options.items() for part in option]
        arguments += [part for fault in self._faults.mock for part in ("--fault", fault)]
        return await asyncio.create_subprocess_exec(
            sys.executable,
            *("-m", "mock_vehicle", str(mission.world), *arguments, "--json"),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            start_new_session=True,  # a Ctrl-C is for us: the vehicles must stay up to be landed
            limit=1 << 20,
        )

    async def _ready(self, mock: asyncio.subprocess.Process) -> list[int]:
        assert mock.stdout is not None  # noqa: S101 - opened as a pipe above
        try:
            line = await asyncio.wait_for(mock.stdout.readline(), START_S)
            ready = json.loads(line)["ready"]
        except (TimeoutError, ValueError, KeyError):
            raise MockError(await _last_words(mock)) from None
        self.referee = {"victims_total": ready["victims_total"]}
        ports: list[int] = ready["ports"]
        return ports

    async def _listen(self, mock: asyncio.subprocess.Process) -> None:
        assert mock.stdout is not None  # noqa: S101 - opened as a pipe above
        while line := await mock.stdout.readline():
            with contextlib.suppress(ValueError):
                self.referee = {**(self.referee or {}), **json.loads(line)}
        if not self._is_stopping:
            self.notes.append(f"the mock fleet died at {self.now:.1f} s")

    async def _stop_mock(self, mock: asyncio.subprocess.Process) -> None:
        """Close its input, which asks it to write the truth and go."""
        if mock.stdin is not None:
            mock.stdin.close()
        try:
            await asyncio.wait_for(mock.communicate(), STOP_S)
        except TimeoutError:
            mock.kill()
            await mock.communicate()
            self.notes.append("the mock fleet did not stop and was killed")


async def _last_words(mock: asyncio.subprocess.Process) -> str:
    """Give the last line of a mock that would not start."""
    with contextlib.suppress(ProcessLookupError):
        mock.terminate()
    _, error = await mock.communicate()
    lines = error.decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "the mock fleet did not start"


@contextlib.contextmanager
def _links(ports: Sequence[int]) -> Iterator[list[UdpLink]]:
    with contextlib.ExitStack() as stack:
        links = [UdpLink(f"udpout://127.0.0.1:{port}") for port in ports]
        for link in links:
            stack.callback(link.close)
        yield links
