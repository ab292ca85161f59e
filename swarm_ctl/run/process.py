"""The mock fleet as a process of its own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Any, Self

from swarm_ctl.errors import MockError

START_S = 30.0
"""Longest wait for the mock to open its ports, wall time."""
LAST_WORDS_S = 2.0
RELIEF = "is here", "are down"
"""How it takes back that it waits for another shard, and says that one has ended as it should."""
STOP_S = 10.0


class MockProcess:
    """`mock-vehicle`, its lines and its end."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.complaint = ""
        """What it last wrote to stderr."""
        self._process = process

    @classmethod
    async def start(cls, arguments: Sequence[str], environment: Mapping[str, str]) -> Self:
        """Start it; it stops when its input is closed, also by our death."""
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "mock_vehicle", *arguments),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env=environment,
            start_new_session=True,  # a Ctrl-C is for us: the vehicles must stay up to be landed
            limit=1 << 20,
        )
        return cls(process)

    async def ready(self) -> dict[str, Any]:
        """Wait for what it says when its ports are open; MockError when it does not start."""
        assert self._process.stdout is not None  # noqa: S101 - opened as a pipe above
        try:
            line = await asyncio.wait_for(self._process.stdout.readline(), START_S)
            ready: dict[str, Any] = json.loads(line)["ready"]
        except (TimeoutError, ValueError, KeyError):
            raise MockError(await self._last_words()) from None
        return ready

    async def reports(self) -> AsyncIterator[dict[str, Any]]:
        """Give the referee's reports until the process ends."""
        assert self._process.stdout is not None  # noqa: S101 - opened as a pipe above
        while line := await self._process.stdout.readline():
            with contextlib.suppress(ValueError):
                yield json.loads(line)

    async def heed(self) -> None:
        """Keep its latest complaint, and its pipe from filling up."""
        assert self._process.stderr is not None  # noqa: S101 - opened as a pipe above
        while line := await self._process.stderr.readline():
            said = line.decode(errors="replace").strip()
            self.complaint = "" if said.endswith(RELIEF) else said or self.complaint

    def kill(self) -> None:
        """Kill without asking whether it lives: asking would take its exit code from asyncio."""
        if self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._process.pid, signal.SIGKILL)

    async def stop(self) -> list[str]:
        """Close its input, which asks it to write the truth and go; give what there is to say."""
        notes = []
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            await asyncio.wait_for(self._process.communicate(), STOP_S)
        except TimeoutError:
            self.kill()
            await self._process.communicate()
            notes.append("the mock fleet did not stop and was killed")
        if self.complaint:
            notes.append(f"the mock fleet's last complaint: {self.complaint}")
        return notes

    async def _last_words(self) -> str:
        """Give the last line of a mock that would not start."""
        try:
            _, error = await asyncio.wait_for(self._process.communicate(), LAST_WORDS_S)
        except TimeoutError:
            self.kill()
            _, error = await self._process.communicate()
        lines = error.decode(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("mock-vehicle: ") if lines else "the mock fleet did not start"
