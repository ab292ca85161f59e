"""The console as an operator has it: a command, the address that it prints, a browser."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import mosquitto
import pytest
from browser.chromium import PROGRAM, Chromium


@pytest.fixture
def console() -> Iterator[Callable[..., str]]:
    """Give a function that types `swarm-ctl console` and gives the address that it prints."""
    typed: list[subprocess.Popen[str]] = []

    def begin(*options: object) -> str:
        words = [sys.executable, "-m", "swarm_ctl", "console", "--port", "0", *map(str, options)]
        typed.append(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        assert typed[-1].stdout is not None
        return typed[-1].stdout.readline().removeprefix("open ").strip()

    yield begin
    for process in typed:
        process.terminate()
        process.communicate(timeout=30.0)


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Chromium]:
    if PROGRAM is None:
        pytest.skip("chromium is not installed, and pages cannot be tested without a browser")
    with Chromium(tmp_path) as opened:
        yield opened


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[mosquitto.Mosquitto]:
    """Give a broker that may be started."""
    if mosquitto.PROGRAM is None:
        pytest.skip("mosquitto is not installed")
    made = mosquitto.Mosquitto(tmp_path)
    yield made
    made.kill()
