"""The controllers' end of the guardian (guardian.py): starts it and keeps it informed."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Self

from swarm_ctl.agent.agent import Agent
from swarm_ctl.controller import TICK_S
from swarm_ctl.signing import KEY_VARIABLE

MISSED_TICKS = 5
"""A controller that says nothing for as many ticks hangs."""
SOONEST_S = 0.2
"""Wall time that no machine hangs for any shorter than, also with a simulator that runs fast."""
AGAIN_S = 5.0
"""Wall time between two starts of a guardian that dies."""
END_S = 2.0
ALIVE_S = 0.04
"""Wall time between two signs of life, for one or for many vehicles."""
REMIND_S = 10.0
"""Between two lines that say all, when nothing has changed."""


class Guard:
    """Tells the guardian, tick by tick, how each vehicle that is steered would be stopped."""

    def __init__(self, journals: Path, *, speed: float = 1.0, key: bytes | None = None) -> None:
        """Start it for controllers that write these journals and tick `speed` times as fast."""
        hang_s = max(SOONEST_S, MISSED_TICKS * TICK_S / speed)
        self._words = [sys.executable, "-m", "swarm_ctl.run.guardian", str(journals), f"{hang_s}"]
        self._environment = {name: v for name, v in os.environ.items() if name != KEY_VARIABLE}
        if key is not None:  # never on a command line, which anybody may read
            self._environment[KEY_VARIABLE] = key.hex()
        self._told: dict[int, tuple[object, ...]] = {}
        self._said_s = 0.0
        self._start()

    def _start(self) -> None:
        self._started_s = time.monotonic()
        self._process = subprocess.Popen(  # noqa: S603 - ourselves
            self._words,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=self._environment,
            start_new_session=True,  # what kills our group is not to take it along
        )
        assert self._process.stdin is not None  # noqa: S101 - opened as a pipe above
        self._pipe = self._process.stdin.fileno()
        os.set_blocking(self._pipe, False)

    def tell(self, agent: Agent, reach: str) -> None:
        """Tell how a vehicle is reached, and stopped if it is being steered; or just live on."""
        is_steered, yaw_rad = agent.is_steering and not agent.is_ended, round(agent.yaw_rad, 1)
        news, now = (is_steered, yaw_rad, reach, agent.now // REMIND_S), time.monotonic()
        line = b"\n"
        if self._told.get(agent.sysid) != news:
            self._told[agent.sysid] = news
            line = _in_full(agent, reach)
        elif now - self._said_s < ALIVE_S:
            return
        self._said_s = now
        try:
            os.write(self._pipe, line)
        except BlockingIOError:
            self._told.pop(agent.sysid, None)  # it is behind; there will be another tick
        except BrokenPipeError:
            if time.monotonic() - self._started_s > AGAIN_S:
                self._end()
                self._told.clear()
                self._start()

    def _end(self) -> None:
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            if self._process.stdin is not None:
                self._process.stdin.close()
            self._process.wait(END_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()


def _in_full(agent: Agent, reach: str) -> bytes:
    frame, stamp = agent.standstill().hex(), agent.sender.gate.timestamp
    told = {"sysid": agent.sysid, "reach": reach, "frame": frame, "stamp": stamp}
    return json.dumps(told).encode() + b"\n"
