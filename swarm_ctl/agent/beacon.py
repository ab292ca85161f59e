"""What a vehicle tells the peers in radio range: a TUNNEL payload of a few dozen bytes."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from swarm_ctl.agent.frame import FAR_M, Place
from swarm_ctl.agent.phases import Phase
from swarm_ctl.frames import Geodetic
from swarm_ctl.model import Vec3

BEACON_TYPE, SUMMARY_TYPE, TRAIL_TYPE = 40417, 40418, 40419
"""TUNNEL payload types, from the range that MAVLink leaves to everybody (32768 and up)."""
VERSION = 2
PERIOD_S = 0.2
"""At least. A tick that comes a moment early lets the next one tell: in virtual time one of eight,
in real time every other one; so it is 4 to 5 Hz."""

_HEAD = struct.Struct("<BIB3h3i3iB3iB")
"""Version, mission, phase, velocity cm/s, position cm, target cm, kind of start, start, number of
heard peers; a start is nothing, NED in cm, or latitude and longitude in degE7, altitude in cm."""
_NO_TARGET = -(2**31)
FAR_CM = round(FAR_M * 100.0)
"""Nobody of the swarm is farther from anything it tells of."""
_NO_START, _SURVEYED, _GEODETIC = range(3)
_ID = struct.Struct("<I")  # ids are 32 bits wide, as MAVLink's own are about to be
_PHASES = tuple(Phase)
_NUMBERS = {phase: number for number, phase in enumerate(_PHASES)}
MOST_HEARD = (128 - _HEAD.size) // _ID.size
"""sysids that fit into a beacon."""


class Beacon(NamedTuple):
    """State and intent of one vehicle."""

    mission: int
    """Tag of the mission (`mission_tag`); beacons of other missions are not ours."""
    phase: Phase
    velocity_ned_m_s: Vec3
    """Axes along north, east, down; peers share north by compass, not an origin."""
    position_ned_m: Vec3
    """In the sender's own local frame; with the radio's fix it gives the shift between frames."""
    target_ned_m: Vec3 | None
    """Where it is heading to, in the same frame."""
    heard: tuple[int, ...]
    """sysids this vehicle hears itself, from which clusters are computed; with more than
    `MOST_HEARD`, some of them, others in the next beacon."""
    start: Place | None = None
    """Where its own frame begins in the frame that the mission shares; None while nobody knows."""


def mission_tag(name: str) -> int:
    """Give a mission's 32-bit tag."""
    return zlib.crc32(name.encode())


def encode(beacon: Beacon) -> bytes:
    """Pack a beacon into at most 128 bytes."""
    velocity = centimetres(beacon.velocity_ned_m_s, 2**15 - 1)
    position = centimetres(beacon.position_ned_m)
    target = [_NO_TARGET] * 3
    if beacon.target_ned_m is not None:
        target = centimetres(beacon.target_ned_m)
    heard = beacon.heard[:MOST_HEARD]
    head = _HEAD.pack(
        VERSION,
        beacon.mission,
        _NUMBERS[beacon.phase],
        *velocity,
        *position,
        *target,
        *_packed_start(beacon.start),
        len(heard),
    )
    return head + struct.pack(f"<{len(heard)}I", *heard)


@lru_cache(maxsize=256)  # one beacon is heard by many, where many fly in one process
def decode(payload: bytes) -> Beacon | None:
    """Read a beacon; None when it is none of ours or broken."""
    if len(payload) < _HEAD.size:
        return None
    version, mission, phase, *numbers, kind, a, b, c, count = _HEAD.unpack_from(payload)
    fits = _HEAD.size + count * _ID.size <= len(payload)
    velocity, position, target = numbers[:3], numbers[3:6], numbers[6:]
    has_target = target[0] != _NO_TARGET
    told = numbers if has_target else numbers[:6]
    is_near = max(told) <= FAR_CM and min(told) >= -FAR_CM
    if version != VERSION or phase >= len(_PHASES) or not fits or not is_near:
        return None
    return Beacon(
        mission,
        _PHASES[phase],
        metres(velocity),
        metres(position),
        metres(target) if has_target else None,
        struct.unpack_from(f"<{count}I", payload, _HEAD.size) if count else (),
        _start(kind, a, b, c),
    )


def _packed_start(start: Place | None) -> tuple[int, ...]:
    match start:
        case None:
            return _NO_START, 0, 0, 0
        case Geodetic(latitude, longitude, altitude):
            return _GEODETIC, round(latitude * 1e7), round(longitude * 1e7), round(altitude * 100.0)
        case Vec3():
            return _SURVEYED, *centimetres(start)


def _start(kind: int, a: int, b: int, c: int) -> Place | None:
    """Read a start; one that is nowhere is none."""
    if kind == _NO_START:
        return None
    if kind == _SURVEYED:
        return metres([a, b, c])
    is_somewhere = abs(a) <= 900_000_000 and abs(b) <= 1_800_000_000
    return Geodetic(a * 1e-7, b * 1e-7, c / 100.0) if kind == _GEODETIC and is_somewhere else None


def centimetres(vector: Vec3, most: int = FAR_CM) -> list[int]:
    """Give a vector as it travels, no component larger than `most`."""
    north, east, down = vector
    x, y, z = round(north * 100.0), round(east * 100.0), round(down * 100.0)
    if -most <= x <= most and -most <= y <= most and -most <= z <= most:
        return [x, y, z]
    return [max(-most, min(most, number)) for number in (x, y, z)]


def metres(numbers: Sequence[int]) -> Vec3:
    """Read a vector that travelled in centimetres."""
    return Vec3(numbers[0] / 100.0, numbers[1] / 100.0, numbers[2] / 100.0)
