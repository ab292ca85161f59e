"""Fly a mission against mock vehicles over real UDP: the mock is a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from typing import Any

from swarm_ctl.controller import KILLED, Clock, Controller, fly
from swarm_ctl.errors import MockError
from swarm_ctl.flight import GRACE_S, MOCK_DIED, TRUTH, Faults, controllers_for
from swarm_ctl.link.udp import UdpLink
from swarm_ctl.mission import Mission
from swarm_ctl.model import Operator
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.signing import KEY_VARIABLE, timestamp_of

START_S = 30.0
"""Longest wait for the mock to open its ports, wall time."""
LAST_WORDS_S = 2.0
STOP_S = 10.0
REPORT_S = 0.25
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
TWICE = "interrupted twice: ended without waiting for the landings"


class UdpRun:
    """One mission over UDP, from the mock's first line to its last."""

    def __init__(
        self,
        mission: Mission,
        folder: RunFolder,
        *,
        speed: float,
        faults: Faults | None = None,
        key: bytes | None = None,
    ) -> None:
        """Prepare a run; with a key of 32 bytes all that is said in it is signed."""
        self.mission = mission
        self.folder = folder
        self.clock = Clock(speed)
        self.controllers = controllers_for(mission, folder)
        self._environment = dict(os.environ)
        if key is not None:
            self._sign_with(key)
        self.referee: dict[str, Any] | None = None
        """The referee's latest report, for the operator's eyes only."""
        self.notes: list[str] = []
        self.interrupted = False
        self._faults = faults or Faults()
        self._mock: asyncio.subprocess.Process | None = None
        self._complaint = ""
        self._is_ready = False

    def _sign_with(self, key: bytes) -> None:
        """Hand out the key; the mock's command line, which anybody may read, does not show it."""
        self._environment[KEY_VARIABLE] = key.hex()
        timestamp = timestamp_of(datetime.now(UTC))
        for controller in self.controllers:
            controller.agent.sign_with(key, timestamp)

    @property
    def now(self) -> float:
        """Give mission time."""
        return self.clock.now()

    async def fly(self, progress: Callable[[UdpRun], None]) -> None:
        """Start the mock, fly every vehicle, stop the mock; MockError when it does not start."""
        with self._interruptible():
            mock = self._mock = await self._start_mock()
            try:
                with _links(await self._ready(mock)) as links:
                    self._is_ready = True
                    gc.collect()
                    gc.freeze()  # a collection of everything would hold up the setpoints
                    self.clock = Clock(self.clock.speed)
                    async with asyncio.TaskGroup() as aside:
                        tasks = [
                            aside.create_task(self._listen(mock), name="mock output"),
                            aside.create_task(self._heed(mock), name="mock complaints"),
                            aside.create_task(self._report(progress), name="progress"),
                            aside.create_task(self._kill_controllers(), name="faults"),
                        ]
                        await self._fly_all(links)
                        for task in tasks:
                            task.cancel()
            finally:
                await self._stop_mock(mock)

    def interrupt(self) -> None:
        """Land everybody; asked twice, end at once."""
        if not self.interrupted:
            self.interrupted = True
            for controller in self.controllers:
                controller.order(Operator.LAND, self.now)
        elif not self._is_ready:
            _kill(self._mock)
        elif not all(controller.agent.is_ended for controller in self.controllers):
            self.notes.append(TWICE)
            for controller in self.controllers:
                controller.kill(TWICE, self.now)

    # -- vehicles ------------------------------------------------------------------------------

    async def _fly_all(self, links: Sequence[UdpLink]) -> None:
        async with asyncio.TaskGroup() as vehicles:
            for controller, link in zip(self.controllers, links, strict=True):
                name = f"vehicle {controller.agent.sysid}"
                vehicles.create_task(self._fly_one(controller, link), name=name)

    async def _fly_one(self, controller: Controller, link: UdpLink) -> None:
        """Fly one vehicle; whatever breaks in it stays with it."""
        offset_s = 0.1 * controller.index / len(self.controllers)
        try:
            await fly(controller, link, self.clock, offset_s=offset_s)
        except Exception as error:  # noqa: BLE001 - one vehicle never stops another
            controller.break_down(error, self.now)

    async def _kill_controllers(self) -> None:
        for moment_s, sysid in self._faults.controllers:
            await self.clock.sleep_until(moment_s)
            self.controllers[sysid - 1].kill(KILLED, self.now)

    async def _report(self, progress: Callable[[UdpRun], None]) -> None:
        while True:
            try:
                self.folder.tick(self.now)
                progress(self)
            except OSError as error:  # a full disk, a terminal that is gone: no reason to fall
                self._note_once(f"not everything could be written: {error.strerror or error}")
            await asyncio.sleep(REPORT_S)

    @contextlib.contextmanager
    def _interruptible(self) -> Iterator[None]:
        loop = asyncio.get_running_loop()
        before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
        for number in STOP_SIGNALS:
            loop.add_signal_handler(number, self.interrupt)
        try:
            yield
        finally:
            for number, handler in before.items():
                loop.remove_signal_handler(number)
                signal.signal(number, handler)

    def _note_once(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)

    # -- the mock process ----------------------------------------------------------------------

    async def _start_mock(self) -> asyncio.subprocess.Process:
        mission = self.mission
        options = {
            "--vehicles": mission.vehicles,
            "--autopilot": mission.autopilot,
            "--speed": self.clock.speed,
            "--seed": mission.seed,
            "--port": 0,
            "--rates": "lean",
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
            env=self._environment,
            start_new_session=True,  # a Ctrl-C is for us: the vehicles must stay up to be landed
            limit=1 << 20,
        )

    async def _ready(self, mock: asyncio.subprocess.Process) -> list[int]:
        assert mock.stdout is not None  # noqa: S101 - opened as a pipe above
        try:
            line = await asyncio.wait_for(mock.stdout.readline(), START_S)
            ready = json.loads(line)["ready"]
        except (TimeoutError, ValueError, KeyError):
            words = await _last_words(mock)
            raise MockError(words) from None
        self.referee = {"victims_total": ready["victims_total"]}
        ports: list[int] = ready["ports"]
        return ports

    async def _listen(self, mock: asyncio.subprocess.Process) -> None:
        assert mock.stdout is not None  # noqa: S101 - opened as a pipe above
        while line := await mock.stdout.readline():
            with contextlib.suppress(ValueError):
                self.referee = {**(self.referee or {}), **json.loads(line)}
        self.notes.append(f"the mock fleet died at {self.now:.1f} s")
        await self.clock.sleep_until(self.now + self.mission.limits.link_lost_s + GRACE_S)
        for controller in self.controllers:
            controller.kill(MOCK_DIED, self.now)

    async def _heed(self, mock: asyncio.subprocess.Process) -> None:
        """Keep the mock's latest complaint, and its pipe from filling up."""
        assert mock.stderr is not None  # noqa: S101 - opened as a pipe above
        while line := await mock.stderr.readline():
            self._complaint = line.decode(errors="replace").strip() or self._complaint

    async def _stop_mock(self, mock: asyncio.subprocess.Process) -> None:
        """Close its input, which asks it to write the truth and go."""
        if mock.stdin is not None:
            mock.stdin.close()
        try:
            await asyncio.wait_for(mock.communicate(), STOP_S)
        except TimeoutError:
            _kill(mock)
            await mock.communicate()
            self.notes.append("the mock fleet did not stop and was killed")
        if self._complaint:
            self.notes.append(f"the mock fleet's last complaint: {self._complaint}")


def _kill(mock: asyncio.subprocess.Process | None) -> None:
    """Kill without asking whether it lives: asking would take its exit code from asyncio."""
    if mock is not None and mock.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(mock.pid, signal.SIGKILL)


async def _last_words(mock: asyncio.subprocess.Process) -> str:
    """Give the last line of a mock that would not start."""
    try:
        _, error = await asyncio.wait_for(mock.communicate(), LAST_WORDS_S)
    except TimeoutError:
        _kill(mock)
        _, error = await mock.communicate()
    lines = error.decode(errors="replace").strip().splitlines()
    return lines[-1].removeprefix("mock-vehicle: ") if lines else "the mock fleet did not start"


@contextlib.contextmanager
def _links(ports: Sequence[int]) -> Iterator[list[UdpLink]]:
    with contextlib.ExitStack() as stack:
        links = [UdpLink(f"udpout://127.0.0.1:{port}") for port in ports]
        for link in links:
            stack.callback(link.close)
        yield links
