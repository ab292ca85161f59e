"""Several shards of one world on this computer: processes that each fly one, told of as one."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import signal
import socket
import sys
from collections.abc import Callable, Sequence

from swarm_ctl.run.fleet import STOP_SIGNALS
from swarm_ctl.run.mock import LEASH

BAD_INPUT = 2
LINE_BYTES = 1 << 20
PROGRESS = re.compile(r" *[0-9.]+ s  ")
"""Begins the lines that a run says while it flies; what it says in the end is in its record."""


def free_addresses(shards: int) -> str:
    """Find as many free UDP ports of this computer, as `--shards` names them."""
    with contextlib.ExitStack() as opened:
        found = []
        for _ in range(shards):
            one = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            one.bind(("127.0.0.1", 0))
            found.append("{}:{}".format(*one.getsockname()))
    return ",".join(found)


class Shards:
    """Processes `swarm-ctl run`, each of which flies one shard."""

    def __init__(self, commands: Sequence[Sequence[str]], say: Callable[[str], None]) -> None:
        """Prepare to run these, and to say how they go, each line with the shard's number."""
        self._commands = commands
        self._say = say
        self._processes: list[asyncio.subprocess.Process] = []

    async def fly(self) -> list[int]:
        """Run all to their ends and give their exit codes; one that cannot begin ends all."""
        loop = asyncio.get_running_loop()
        for number in STOP_SIGNALS:
            loop.add_signal_handler(number, self.interrupt)
        try:
            for command in self._commands:
                self._processes.append(await _start(command))
            watches = (self._watch(*both) for both in enumerate(self._processes, start=1))
            return await asyncio.gather(*watches)
        finally:
            for number in STOP_SIGNALS:
                loop.remove_signal_handler(number)
            for process in self._processes:
                _signal(process, signal.SIGKILL)

    def interrupt(self) -> None:
        """Let all shards land; asked again, end at once."""
        for process in self._processes:
            _signal(process, signal.SIGINT)

    async def _watch(self, shard: int, process: asyncio.subprocess.Process) -> int:
        assert process.stdout is not None  # noqa: S101 - opened as a pipe below
        last = ""
        while line := await process.stdout.readline():
            if PROGRESS.match(text := line.decode(errors="replace").rstrip()):
                self._say(f"shard {shard}: {text}")
            last = text or last
        code = await process.wait()
        if code == BAD_INPUT:
            self._say(f"shard {shard}: {last}")
            for other in self._processes:  # which would wait for it
                _signal(other, signal.SIGTERM)
                _signal(other, signal.SIGTERM)
        return code


def _signal(process: asyncio.subprocess.Process, number: int) -> None:
    if process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, number)


async def _start(command: Sequence[str]) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "swarm_ctl", "run", *command),
        stdin=asyncio.subprocess.PIPE,
        env={**os.environ, LEASH: ""},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        start_new_session=True,  # a Ctrl-C is for us, who pass it on
        limit=LINE_BYTES,
    )
