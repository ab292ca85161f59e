"""What every client's script needs: patience, and a way to say what it saw."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

PATIENCE_S = 40.0


def until(condition: Callable[[], object], wanted: str, patience_s: float = PATIENCE_S) -> None:
    """Wait for what a vehicle does in its own time."""
    deadline = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"never {wanted}")
        time.sleep(0.02)  # noqa: TID251 - a client lives in real time


def main(scenarios: Mapping[str, Callable[..., dict[str, Any]]]) -> None:
    """Run `SCENARIO ARGUMENTS...` of the command line; end with a line of JSON."""
    name, *arguments = sys.argv[1:]
    sys.stdout.write("\n" + json.dumps(scenarios[name](*arguments)) + "\n")
