"""`mock-vehicle` as a process of its own, for tests on real UDP."""

from __future__ import annotations

import json
import select
import subprocess
import sys
from typing import Any

PATIENCE_S = 60.0


class Mock:
    """The command, its lines and its end."""

    def __init__(self, *arguments: object) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "mock_vehicle", *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            bufsize=1,
        )

    def line(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], PATIENCE_S)
        assert ready, "the mock says nothing"
        line = self.process.stdout.readline()
        return dict(json.loads(line)) if line else {}

    def wait(self) -> tuple[int, list[dict[str, Any]], str]:
        """Give the exit code, the remaining lines and what was complained about."""
        assert self.process.stdin is not None
        out, err = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, [json.loads(line) for line in out.splitlines()], err

    def end(self) -> None:
        """Leave nothing running."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()
