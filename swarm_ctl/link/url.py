"""Addresses of links as MAVSDK writes them: `udpin://0.0.0.0:14540`, `serial:///dev/ttyACM0:57600`."""

from __future__ import annotations

import re
from typing import NamedTuple
from urllib.parse import urlsplit

from swarm_ctl.errors import SwarmError

BAUD = 57600
"""What telemetry radios and TELEM ports are set to when they come out of their box."""
NETWORK = ("udpin", "udpout", "tcpout")
EXPECTED = "udpin://HOST:PORT, udpout://HOST:PORT, tcpout://HOST:PORT or serial:///DEVICE:BAUD"
_SERIAL = re.compile(r"serial://(?P<device>/[^:]+)(?::(?P<baud>[1-9]\d{0,7}))?")


class Address(NamedTuple):
    """Where a link leads to."""

    scheme: str
    host: str
    """The device of a serial port."""
    port: int
    """Bits per second of a serial port."""


def parse(url: str) -> Address:
    """Read an address; SwarmError says what was expected."""
    scheme = url.partition("://")[0]
    if scheme == "serial":
        return _serial(url)
    if scheme not in NETWORK:
        raise SwarmError(f"{url}: expected {EXPECTED}")
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise SwarmError(f"{url}: {error}") from error
    is_bare = parts.path in {"", "/"} and not parts.query
    if not parts.hostname or port is None or not is_bare:
        raise SwarmError(f"{url}: expected {scheme}://HOST:PORT")
    if scheme != "udpin" and not port:
        raise SwarmError(f"{url}: nobody listens on port 0")
    return Address(scheme, parts.hostname, port)


def _serial(url: str) -> Address:
    found = _SERIAL.fullmatch(url)
    if found is None:
        raise SwarmError(f"{url}: expected serial:///DEVICE:BAUD, as serial:///dev/ttyACM0:57600")
    return Address("serial", found["device"], int(found["baud"] or BAUD))
