"""Which vehicle listens where and calls whom: as the real simulators do, unless told otherwise."""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
from collections.abc import Sequence

from mock_vehicle.server import Port
from mock_vehicle.shards import Address

LOCALHOST = "127.0.0.1"
PORT_MAX = 65535
PX4_BIND, PX4_REMOTE = 14580, 14540
"""PX4's link to a companion: instance i listens on 14580 + i and calls 14540 + i."""
PX4_GCS_BIND = 18570
"""PX4's link to a ground station: instance i listens on 18570 + i."""
PX4_DISPLAY_BIND, PX4_DISPLAY_REMOTE = 19450, 19410
"""PX4's link to a viewer, of its simulator in hardware: 19450 + i calls 19410 + i."""
ARDUPILOT_BIND, GCS_REMOTE = 14650, 14550
"""ArduPilot calls the one port of a ground station."""
FIRST_FREE, FREE = 20_000, 12_000
"""Where free ports are looked for: below those that systems hand out by themselves."""
_UNTRIED = (FIRST_FREE + number % FREE for number in itertools.count(61 * os.getpid()))
"""Each process begins elsewhere, for test runners that work side by side."""


def plan_ports(
    kinds: Sequence[str],
    *,
    host: str,
    base: int | None = None,
    listed: str | None = None,
    remote: str | None = None,
) -> list[Port]:
    """Give every vehicle the ports of its autopilot's own simulator, unless told otherwise."""
    if base is not None and listed is not None:
        raise ValueError("--port and --ports say the same; give one of them")
    called = parse_remote(remote) if remote is not None else None
    binds = _count_up(kinds, base) if listed is None else parse_ports(listed, len(kinds))
    usual = [(LOCALHOST, PX4_REMOTE + i if k == "px4" else GCS_REMOTE) for i, k in enumerate(kinds)]
    return [
        Port((host, bind), called or (default if base != 0 else None))
        for bind, default in zip(binds, usual, strict=True)
    ]


def _count_up(kinds: Sequence[str], base: int | None) -> list[int]:
    """Count from the first port on; 0 stays 0, and takes a free one each time."""
    firsts = [(PX4_BIND if k == "px4" else ARDUPILOT_BIND) if base is None else base for k in kinds]
    binds = [first + index if first else 0 for index, first in enumerate(firsts)]
    for index, bind in enumerate(binds):
        if bind > PORT_MAX:
            raise ValueError(f"--port {base}: vehicle {index + 1} would listen beyond {PORT_MAX}")
    return binds


def parse_ports(text: str, vehicles: int) -> list[int]:
    """Read ports and ranges of them, as 14580,14590-14592; there must be enough."""
    ports: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        ends = (first, last if dash else first)
        if not all(end.isdecimal() and 0 < int(end) <= PORT_MAX for end in ends):
            raise ValueError(f"--ports {text}: expected ports, as 14580,14590 or 14580-14589")
        ports += range(int(ends[0]), int(ends[1]) + 1)
    if len(ports) < vehicles or len(set(ports)) < len(ports):
        raise ValueError(f"--ports {text}: names {len(set(ports))} ports for {vehicles} vehicles")
    return ports[:vehicles]


def parse_remote(text: str) -> tuple[str, int]:
    """Read HOST:PORT; the host becomes an address here, never while flying."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdecimal() or not 0 < int(port) <= PORT_MAX:
        raise ValueError(f"--remote {text}: expected HOST:PORT, as 127.0.0.1:14540")
    try:
        return socket.gethostbyname(host), int(port)
    except OSError:
        raise ValueError(f"--remote {text}: there is no host {host!r}") from None


def plan_further_ports(kinds: Sequence[str], *, host: str, usual: bool) -> list[Port]:
    """Let PX4 call ground stations and viewers, too, or just listen if ports are not the usual."""
    calls = [
        (PX4_GCS_BIND + index, GCS_REMOTE) for index, kind in enumerate(kinds) if kind == "px4"
    ] + [
        (PX4_DISPLAY_BIND + index, PX4_DISPLAY_REMOTE + index)
        for index, kind in enumerate(kinds)
        if kind == "px4"
    ]
    return [
        Port((host, bind), (LOCALHOST, remote)) if usual else Port((host, 0))
        for bind, remote in calls
    ]


def plan_shown_ports(vehicles: int, *, host: str) -> list[Port]:
    """Let every vehicle of a swarm call ground stations and viewers from free ports."""
    stations = [GCS_REMOTE] * vehicles
    viewers = [PX4_DISPLAY_REMOTE + index for index in range(vehicles)]
    return [Port((host, 0), (LOCALHOST, remote)) for remote in (*stations, *viewers)]


def hint(bind: Address, remote: Address | None) -> str:
    """Say how clients reach a vehicle that listens here and calls there, in their own words."""
    scheme, (host, port) = ("udpout", bind) if remote is None else ("udpin", remote)
    if remote is not None and host.startswith("127."):
        host = "0.0.0.0"  # noqa: S104 - where clients listen, as their manuals have it
    return f"MAVSDK {scheme}://{host}:{port} · pymavlink, MAVProxy, DroneKit {scheme}:{host}:{port}"


def free_udp_port(host: str = LOCALHOST) -> int:
    """Find a port that nobody listens on, and that this process has not given lately."""
    for port in itertools.islice(_UNTRIED, FREE):
        probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with contextlib.closing(probe), contextlib.suppress(OSError):
            probe.bind((host, port))
            return port
    raise OSError(f"no UDP port from {FIRST_FREE} on is free on {host}")
