"""Ways to an autopilot: UDP, TCP and serial ports, written as MAVSDK writes them."""

from __future__ import annotations

from swarm_ctl.link.base import MESH, Heard, Link, Source
from swarm_ctl.link.serial import SerialLink
from swarm_ctl.link.tcp import TcpLink
from swarm_ctl.link.udp import UdpLink
from swarm_ctl.link.url import parse

__all__ = ["MESH", "Heard", "Link", "Source", "open_link"]


def open_link(url: str) -> Link:
    """Open a link; what is wrong with its address, or why it cannot be had, is a SwarmError."""
    match parse(url).scheme:
        case "serial":
            return SerialLink(url)
        case "tcpout":
            return TcpLink(url)
        case _:
            return UdpLink(url)
