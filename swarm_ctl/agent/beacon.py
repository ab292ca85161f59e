"""What a vehicle tells the peers in radio range: a TUNNEL payload of a few dozen bytes."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from swarm_ctl.agent.phases import Phase
from swarm_ctl.model import Vec3

PAYLOAD_TYPE = 40417
"""From the range of TUNNEL payload types that MAVLink leaves to everybody (32768 and up)."""
VERSION = 1
PERIOD_S = 0.2

_HEAD = struct.Struct("<BIB3hB")  # version, mission, phase, velocity cm/s, number of heard peers
_ID = struct.Struct("<I")  # ids are 32 bits wide, as MAVLink's own are about to be
_PHASES = tuple(Phase)
_MOST_HEARD = (128 - _HEAD.size) // _ID.size


@dataclass(frozen=True, slots=True)
class Beacon:
    """State and intent of one vehicle."""

    mission: int
    """Tag of the mission (`mission_tag`); beacons of other missions are not ours."""
    phase: Phase
    velocity_ned_m_s: Vec3
    """Axes along north, east, down; peers share north by compass, not an origin."""
    heard: tuple[int, ...]
    """sysids this vehicle hears itself, from which clusters are computed."""


def mission_tag(name: str) -> int:
    """Give a mission's 32-bit tag."""
    return zlib.crc32(name.encode())


def encode(beacon: Beacon) -> bytes:
    """Pack a beacon into at most 128 bytes."""
    velocity = (max(-32767, min(32767, round(v * 100.0))) for v in beacon.velocity_ned_m_s)
    heard = beacon.heard[:_MOST_HEARD]
    head = _HEAD.pack(VERSION, beacon.mission, _PHASES.index(beacon.phase), *velocity, len(heard))
    return head + b"".join(map(_ID.pack, heard))


def decode(payload: bytes) -> Beacon | None:
    """Read a beacon; None when it is none of ours or broken."""
    if len(payload) < _HEAD.size:
        return None
    version, mission, phase, vx, vy, vz, count = _HEAD.unpack_from(payload)
    fits = _HEAD.size + count * _ID.size <= len(payload)
    if version != VERSION or phase >= len(_PHASES) or not fits:
        return None
    heard = struct.unpack_from(f"<{count}I", payload, _HEAD.size)
    return Beacon(mission, _PHASES[phase], Vec3(vx / 100.0, vy / 100.0, vz / 100.0), heard)
