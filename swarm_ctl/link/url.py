"""Addresses of links as MAVSDK writes them: `udpin://0.0.0.0:14540`, `serial:///dev/ttyACM0:57600`."""

from __future__ import annotations

import contextlib
import ipaddress
import re
from typing import NamedTuple
from urllib.parse import urlsplit

from swarm_ctl.errors import SwarmError

BAUD = 57600
"""What telemetry radios and TELEM ports are set to when they come out of their box."""
NETWORK = ("udpin", "udpout", "tcpout")
EXPECTED = "udpin://HOST:PORT, udpout://HOST:PORT, tcpout://HOST:PORT or serial:///DEVICE:BAUD"
NETWORK_EXPECTED = (
    "expected a multicast group and a port, as udp://239.255.42.42:14700, with ?interface=IP "
    "behind it where the machine has several networks, or a broadcast address of a network, as "
    "udp://192.168.1.255:14700"
)
BROKER_EXPECTED = (
    "expected mqtt://[USER@]HOST[:PORT], or mqtts:// for TLS, and the password in "
    "SWARM_MQTT_PASSWORD"
)
PEERS_EXPECTED = (
    "expected autopilot, udp://GROUP:PORT[?interface=IP] for multicast, udp://ADDRESS:PORT for "
    "broadcast, or mqtt://[USER@]HOST[:PORT]"
)
AUTOPILOT = "autopilot"
"""Peers' frames go the way that autopilots and their radios pass them on, and no other."""
PORT_MAX = 0xFFFF
_NETWORK = re.compile(
    r"udp://(?P<host>[\d.]+):(?P<port>\d{1,5})/?(\?interface=(?P<interface>[\d.]+))?"
)
_BROKER = re.compile(
    r"mqtts?://([^\s:@/?#]+@)?([\w.-]{1,253}|\[[0-9A-Fa-f:.]+\])(:(?P<port>\d{1,5}))?/?", re.ASCII
)
_RANGE = re.compile(r"(?P<place>[a-z]+://[^/]*:)(?P<first>\d{1,5})-(?P<last>\d{1,5})/?")
_SERIAL = re.compile(r"serial://(?P<device>/[^:]+)(?::(?P<baud>[1-9]\d{0,7}))?")


class Address(NamedTuple):
    """Where a link leads to."""

    scheme: str
    host: str
    """The device of a serial port."""
    port: int
    """Bits per second of a serial port."""


class Network(NamedTuple):
    """A network on which everybody hears what is sent to one address."""

    url: str
    host: str
    """IPv4 address of a multicast group, or a broadcast address."""
    port: int
    interface: str
    """Address of the machine on the network; 0.0.0.0 leaves the choice to the kernel."""
    is_group: bool
    """Whether it is a multicast group's."""


class Meeting(NamedTuple):
    """A broker at which vehicles meet."""

    url: str


def parse_peers(url: str) -> Network | Meeting | None:
    """Read what carries peers' frames beside autopilots, None for nothing; else SwarmError."""
    match url.partition("://")[0]:
        case "udp":
            return _network(url)
        case "mqtt" | "mqtts":
            return _meeting(url)
        case _ if url == AUTOPILOT:
            return None
    raise SwarmError(f"{url}: {PEERS_EXPECTED}")


def _meeting(url: str) -> Meeting:
    found = _BROKER.fullmatch(url)
    if found is None or not 0 < int(found["port"] or 1) <= PORT_MAX:
        raise SwarmError(BROKER_EXPECTED)  # without the address, which may hold a password
    return Meeting(url)


def _network(url: str) -> Network:
    found = _NETWORK.fullmatch(url)
    if found is not None:
        host, port, interface = found["host"], int(found["port"]), found["interface"]
        with contextlib.suppress(ValueError):
            is_group = ipaddress.IPv4Address(host).is_multicast
            chosen = ipaddress.IPv4Address(interface or 0)
            if 0 < port <= PORT_MAX and (is_group or interface is None):
                return Network(url, host, port, str(chosen), is_group)
    raise SwarmError(f"{url}: {NETWORK_EXPECTED}")


def spread(urls: list[str]) -> list[str]:
    """Give an address for each port of `udpout://HOST:14580-14589`; others stay as they are."""
    return [one for url in urls for one in _each(url)]


def _each(url: str) -> list[str]:
    found = _RANGE.fullmatch(url)
    if found is None:
        return [url]
    first, last = int(found["first"]), int(found["last"])
    if not 0 < first <= last <= PORT_MAX:
        raise SwarmError(f"{url}: expected the first and the last port, as 14580-14589")
    return [f"{found['place']}{port}" for port in range(first, last + 1)]


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
        reason = f"expected {scheme}://HOST:PORT, with a port of 1 to 65535"
        raise SwarmError(f"{url}: {reason}") from error
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
