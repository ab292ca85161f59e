"""One mission in several processes: who flies which vehicles, and in which MAVLink network.

A MAVLink network tells 255 sysids apart, a mission's 250 vehicles. More vehicles are several
groups, each a network of its own with sysids from the first on; no sysid is ever wrapped.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

GROUP_MAX = 250
"""Vehicles of one MAVLink network at most, as `swarm_ctl` flies them."""
VEHICLES_MAX = 10_000
"""Vehicles of one mission at most, in all its groups."""
PORT_MAX = 65535

Address = tuple[str, int]


class Part(NamedTuple):
    """What one shard flies; vehicles are counted from 0 through the whole mission."""

    shard: int
    """Its number, from 1 on."""
    shards: int
    vehicles: int
    """In all shards."""
    group: int
    """Number of its MAVLink network, from 1 on."""
    members: range
    """The vehicles of its group, of which this shard flies some."""
    own: range
    """The vehicles that it flies."""


def whole(vehicles: int) -> Part:
    """Give the part of who flies all of a mission alone."""
    everybody = range(vehicles)
    return Part(1, 1, vehicles, 1, everybody, everybody)


def divide(vehicles: int, shards: int) -> list[Part]:
    """Share a mission out as evenly as may be; ValueError says how many shards it needs."""
    groups = -(-vehicles // GROUP_MAX)
    if shards % groups:
        raise ValueError(
            f"--shards: {vehicles} vehicles are {groups} groups of at most {GROUP_MAX}, each a "
            f"MAVLink network: name {groups} addresses or a multiple, not {shards}"
        )
    if shards > vehicles:
        raise ValueError(f"--shards: {shards} shards for {vehicles} vehicles; name fewer")
    parts: list[Part] = []
    for group, members in enumerate(_shares(range(vehicles), groups), start=1):
        for own in _shares(members, shards // groups):
            parts.append(Part(len(parts) + 1, shards, vehicles, group, members, own))
    return parts


def _shares(vehicles: range, count: int) -> list[range]:
    """Cut into so many ranges, of which none is longer than another by more than one."""
    n = len(vehicles)
    return [vehicles[n * k // count : n * (k + 1) // count] for k in range(count)]


def parse_addresses(text: str) -> list[Address]:
    """Read where all shards hear one another, as 10.0.0.1:14700,10.0.0.2:14700."""
    addresses: list[Address] = []
    for part in text.split(","):
        host, _, port = part.strip().rpartition(":")
        octets = host.split(".")
        is_host = len(octets) == 4 and all(o.isdecimal() and int(o) < 256 for o in octets)
        if not is_host or not port.isdecimal() or not 0 < int(port) <= PORT_MAX:
            raise ValueError(
                f"--shards {text}: expected IP:PORT for each shard, as "
                "10.0.0.1:14700,10.0.0.2:14700"
            )
        addresses.append((host, int(port)))
    if len(set(addresses)) < len(addresses):
        raise ValueError(f"--shards {text}: names an address twice")
    return addresses


def choose(vehicles: int, addresses: Sequence[Address], shard: int | None) -> Part:
    """Give the part of one shard; ValueError where its number is missing or none."""
    if shard is None or not 1 <= shard <= len(addresses):
        which = "is missing" if shard is None else f"{shard}"
        raise ValueError(
            f"--shard {which}: say which of the {len(addresses)} --shards this one is, from 1 on"
        )
    return divide(vehicles, len(addresses))[shard - 1]
