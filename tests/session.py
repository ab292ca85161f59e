"""`swarm-ctl run` or `fly` as a process of its own, for tests on real sockets."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

PATIENCE_S = 90.0


class Session:
    """A user at a shell who has typed a command that flies."""

    def __init__(self, mission: Path, *options: object, command: str = "run") -> None:
        self.out = mission.parent / "run"
        words = [sys.executable, "-m", "swarm_ctl", command, mission, "--out", self.out, *options]
        self.process = subprocess.Popen(
            [str(word) for word in words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def events(self) -> list[dict[str, Any]]:
        with contextlib.suppress(FileNotFoundError):
            whole = (self.out / "events.jsonl").read_text().split("\n")[:-1]
            return [json.loads(line) for line in whole]
        return []

    def wait_for(self, phase: str, sysid: int = 1) -> None:
        """Watch the journal until a vehicle is in a phase."""

        def is_there() -> bool:
            return any(
                event.get("sysid") == sysid and event["data"].get("after") == phase
                for event in self.events()
            )

        self.wait_until(is_there)

    def wait_until(self, is_so: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not is_so():
            assert time.monotonic() < deadline_s, self.events()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(0.02)
                pytest.fail(f"the run ended: {self.process.communicate()}")

    def ctrl_c(self) -> None:
        """Do as a terminal does: all processes in the foreground are told."""
        os.killpg(self.process.pid, signal.SIGINT)

    def signal(self, number: int) -> None:
        self.process.send_signal(number)

    def end(self) -> tuple[int, str, str]:
        out, complaints = self.process.communicate(timeout=PATIENCE_S)
        assert "Traceback" not in complaints, complaints
        return self.process.returncode, out, complaints

    def summary(self) -> dict[str, Any]:
        return dict(json.loads((self.out / "summary.json").read_text()))

    def phases(self) -> list[str]:
        return [vehicle["phase"] for vehicle in self.summary()["per_vehicle"]]
