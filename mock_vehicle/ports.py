"""Which vehicle listens where and calls whom: as the real simulators do, unless told otherwise."""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
from collections.abc import Sequence

from mock_vehicle.server import Port

LOCALHOST = "127.0.0.1"
PORT_MAX = 65535
PX4_BIND, PX4_REMOTE = 14580, 14540
"""PX4's link to a companion: instance i listens on 14580 + i and calls 14540 + i."""
PX4_GCS_BIND = 18570
"""PX4's link to a ground station: instance i listens on 18570 + i."""
ARDUPILOT_BIND, GCS_REMOTE = 14650, 14550
"""ArduPilot calls the one port of a ground station."""
FIRST_FREE, FREE = 20_000, 12_000
"""Where free ports are looked for: below those that systems hand out by themselves."""
_UNTRIED = (FIRST_FREE + number % FREE for number in itertools.count(61 * os.getpid()))
"""Each process begins elsewhere, for test runners that work side by side."""


def plan_ports(
    kinds: Sequence[str], *, host: str, base: int | None, remote: str | None
) -> list[Port]:
    """Give every vehicle the ports of its autopilot's own simulator, unless told otherwise."""
    called = parse_remote(remote) if remote is not None else None
    ports: list[Port] = []
    for index, kind in enumerate(kinds):
        is_px4 = kind == "px4"
        first = (PX4_BIND if is_px4 else ARDUPILOT_BIND) if base is None else base
        bind = first + index if first else 0
        if bind > PORT_MAX:
            raise ValueError(f"--port {base}: vehicle {index + 1} would listen beyond {PORT_MAX}")
        default = (LOCALHOST, PX4_REMOTE + index if is_px4 else GCS_REMOTE)
        ports.append(Port((host, bind), called or (default if base != 0 else None)))
    return ports


def parse_remote(text: str) -> tuple[str, int]:
    """Read HOST:PORT; the host becomes an address here, never while flying."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdecimal() or not 0 < int(port) <= PORT_MAX:
        raise ValueError(f"--remote {text}: expected HOST:PORT, as 127.0.0.1:14540")
    try:
        return socket.gethostbyname(host), int(port)
    except OSError:
        raise ValueError(f"--remote {text}: there is no host {host!r}") from None


def plan_gcs_ports(kinds: Sequence[str], *, host: str, base: int | None) -> list[Port]:
    """Let PX4 call a ground station, too; only from its own simulator's ports, else it waits."""
    return [
        Port((host, PX4_GCS_BIND + index), (LOCALHOST, GCS_REMOTE))
        if base is None
        else Port((host, 0))
        for index, kind in enumerate(kinds)
        if kind == "px4"
    ]


def free_udp_port(host: str = LOCALHOST) -> int:
    """Find a port that nobody listens on, and that this process has not given lately."""
    for port in itertools.islice(_UNTRIED, FREE):
        probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with contextlib.closing(probe), contextlib.suppress(OSError):
            probe.bind((host, port))
            return port
    raise OSError(f"no UDP port from {FIRST_FREE} on is free on {host}")
