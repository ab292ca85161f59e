"""Third-party clients as processes of their own, beside a mock that calls them."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mock_process import Mock

FIELD = """
name: field
size_m: [100, 100]
starts: {grid: {origin_m: [30, 30], spacing_m: 5, columns: 5}}
"""
PATIENCE_S = 120.0
PORTS = range(20_000, 32_000)
"""Below those that the kernel gives out by itself: nobody takes one between choice and use."""


@pytest.fixture
def port() -> int:
    """Choose a port for a client to listen on; another process begins its search elsewhere."""
    first = os.getpid() * 97
    for number in range(len(PORTS)):
        port = PORTS[(first + number) % len(PORTS)]
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port
    pytest.fail("every port is taken")


@pytest.fixture
def launch(tmp_path: Path, port: int) -> Iterator[Callable[..., tuple[Mock, list[int]]]]:
    """Give a function that starts vehicles that call `port`, and tells the ports they hear on."""
    mocks: list[Mock] = []
    field = tmp_path / "field.yaml"
    field.write_text(FIELD)

    def begin(personality: str, *options: object) -> tuple[Mock, list[int]]:
        call = ("--port", 0, "--remote", f"127.0.0.1:{port}")
        mocks.append(Mock(field, "--json", "--autopilot", personality, *call, *options))
        return mocks[-1], mocks[-1].line()["ready"]["ports"]

    yield begin
    for mock in mocks:
        code, _, complaints = mock.wait()
        assert (code, "Traceback" in complaints) == (0, False), complaints


@pytest.fixture
def fly() -> Callable[..., dict[str, Any]]:
    """Give a function that runs a scenario of a client and gives what the client saw."""

    def run(client: str, scenario: str, *arguments: object) -> dict[str, Any]:
        done = subprocess.run(
            [sys.executable, "-m", f"clients.{client}", scenario, *map(str, arguments)],
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return dict(json.loads(done.stdout.splitlines()[-1]))

    return run
