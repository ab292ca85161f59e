from __future__ import annotations

import contextlib
import os
import select
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from halls import write_hall
from mosquitto import PROGRAM, Mosquitto
from session import Session

SHORT: dict[str, Any] = {"duration_s": 5.0, "flight": {"height_m": 1.5, "climb_m_s": 1.0}}


@pytest.fixture
def hall(tmp_path: Path) -> Callable[..., Path]:
    """Give a function that writes a mission in a hall, changed as asked for."""

    def write(*, world: dict[str, Any] | None = None, **changes: Any) -> Path:
        return write_hall(tmp_path, {**SHORT, **changes}, world)

    return write


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Mosquitto]:
    """Give a broker that runs."""
    if PROGRAM is None:
        pytest.skip("mosquitto is not installed")
    begun = Mosquitto(tmp_path)
    begun.start()
    yield begun
    begun.kill()


NETWORKS = {
    "multicast": "udp://239.255.42.42:{}?interface=127.0.0.1",
    "broadcast": "udp://127.255.255.255:{}",
}


@pytest.fixture(params=[*NETWORKS, "mqtt"])
def peers_url(request: pytest.FixtureRequest) -> str:
    """Give the address of what carries peers' frames, once for each kind of transport."""
    if request.param in NETWORKS:
        return NETWORKS[request.param].format(request.getfixturevalue("free_udp_port"))
    url: str = request.getfixturevalue("broker").url
    return url


@pytest.fixture
def end_guardians(processes: Callable[[str], list[int]]) -> Callable[[], None]:
    """Give a function that kills those who look after the killed, and waits until they are gone."""

    def end() -> None:
        for pid in processes("swarm_ctl.run.guardian"):
            with contextlib.suppress(ProcessLookupError):  # it has just ended by itself
                handle = os.pidfd_open(pid)
                signal.pidfd_send_signal(handle, signal.SIGKILL)
                select.select([handle], [], [], 5.0)
                os.close(handle)

    return end


@pytest.fixture
def processes(tmp_path: Path) -> Callable[[str], list[int]]:
    """Give a function that finds the live processes of this test that run a module."""

    def find(module: str) -> list[int]:
        return [pid for pid, words in _alive(tmp_path) if module in words]

    return find


@pytest.fixture
def swarm_ctl_run() -> Iterator[Callable[..., Session]]:
    sessions: list[Session] = []

    def begin(mission: Path, *options: object, command: str = "run") -> Session:
        sessions.append(Session(mission, *options, command=command))
        return sessions[-1]

    yield begin
    for session in sessions:
        session.process.kill()
        session.process.communicate()


@pytest.fixture(autouse=True)
def _nothing_is_left_running(tmp_path: Path) -> Iterator[None]:
    yield
    left = list(_alive(tmp_path))
    for pid, _ in left:
        os.kill(pid, signal.SIGKILL)
    assert left == []


def _alive(tmp_path: Path) -> Iterator[tuple[int, list[str]]]:
    """Give those that have a file of this test on their command line; the dead have none."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            line = (entry / "cmdline").read_bytes().decode(errors="replace")
        except OSError:
            continue
        if f"{tmp_path}/" in line:
            yield int(entry.name), line.split("\0")
