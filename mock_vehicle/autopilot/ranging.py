"""What the vehicle sees around it: rangefinders, peers by radio, victims by infrared."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from struct import Struct
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.autopilot.clock import boot_ms, boot_us
from mock_vehicle.autopilot.link import AUTOPILOT_COMPID, Encoder
from mock_vehicle.sensors.rangefinder import CONE_DEG, RING
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

DISTANCE_SENSOR = wire.message("DISTANCE_SENSOR")
LANDING_TARGET = wire.message("LANDING_TARGET")
OBSTACLE_DISTANCE = wire.message("OBSTACLE_DISTANCE")

RADIO_COMPID = 68
NO_ROTATION = (0.0, 0.0, 0.0, 0.0)
YAW_180, PITCH_180, ORIENTATION_CUSTOM = 4, 12, 100
"""MAV_SENSOR_ROTATION; the first two look back."""
SENSOR_LASER, SENSOR_UNKNOWN = 0, 4
FRAME_BODY_FRD = 12
FARTHEST_CM = 0xFFFF
BROKEN_CM = 0xFFFF
"""No range, but all of a ring that says nothing."""
BROKEN = BROKEN_CM.to_bytes(2, "little")
LONGEST_RANGE_M = 654.0
"""What fits into centimetres of 16 bits, with a number left for "nothing" that is not "unknown"."""
FIELDS_OF_VIEW_RAD = (math.radians(CONE_DEG),) * 4 + (0.0, 0.0)
RING_SPACING_DEG = 360 // RING


class _Mould(NamedTuple):
    """What stays the same in frames of which sender and first fields alone change."""

    start: bytes
    """Up to the sequence number and the sysid."""
    kind: bytes
    """Compid and message id, before the fields that change."""
    end: bytes
    """What follows those, up to the CRC."""

    @classmethod
    def of(cls, frame: bytes, layout: Struct) -> _Mould:
        """Take what stays from a frame and the layout of all before its end."""
        return cls(frame[:4], frame[6:10], frame[layout.size : -2])


RANGE = Struct("<4sBB4sIHHH")
"""Of DISTANCE_SENSOR up to its distance: `start`, seq, sysid, `kind`, then fields."""
SCAN = Struct("<4sBB4sQ144sHH")
"""Of OBSTACLE_DISTANCE up to its bounds."""
RANGES = {
    back: [
        _Mould.of(
            DISTANCE_SENSOR.pack(
                *(0, 0, AUTOPILOT_COMPID),
                *(0, 0, 0, 0),
                *(SENSOR_LASER, number, orientation, 0xFF, view_rad, 0.0, NO_ROTATION, 0),
            ),
            RANGE,
        )
        for number, (orientation, view_rad) in enumerate(
            zip((0, back, 6, 2, 24, 25), FIELDS_OF_VIEW_RAD, strict=True)
        )
    ]
    for back in (YAW_180, PITCH_180)
}
"""DISTANCE_SENSOR of each rangefinder, by the name of back."""
RINGS = _Mould.of(
    OBSTACLE_DISTANCE.pack(
        *(0, 0, AUTOPILOT_COMPID),
        *(0, SENSOR_LASER, [0] * RING, RING_SPACING_DEG, 0, 0),
        *(float(RING_SPACING_DEG), 0.0, FRAME_BODY_FRD),
    ),
    SCAN,
)
"""OBSTACLE_DISTANCE of a ring."""


def centimetres(metres: float) -> int:
    """Round a range into the field's 16 bits; what is no number is as far as can be."""
    return round(max(metres * 100.0, 0.0)) if metres < 655.0 else FARTHEST_CM


@cache
def _bounds(min_m: float, max_m: float) -> tuple[float, int, int]:
    """Give how far rangefinders reach, m, and from where to where they tell, cm."""
    reach_m = min(max_m, LONGEST_RANGE_M)
    return reach_m, centimetres(min_m), centimetres(reach_m)


def distance_sensors(autopilot: Autopilot, now: float) -> None:
    """Send the rangefinders that work; beyond max_distance there is nothing."""
    time, sysid = boot_ms(autopilot, now), autopilot.sysid
    readings = autopilot.readings
    reach_m, nearest, farthest = _bounds(readings.range_min_m, readings.range_max_m)
    moulds = RANGES[autopilot.traits.backward]
    for link in autopilot.to:
        for range_m, (start, kind, end) in zip(autopilot.state.ranges_m, moulds, strict=True):
            if range_m == range_m:  # noqa: PLR0124 - not NaN, and six times cheaper than asking
                range_cm = round(range_m * 100.0) if range_m <= reach_m else farthest + 1
                seq = link.sequence()
                frame = RANGE.pack(start, seq, sysid, kind, time, nearest, farthest, range_cm) + end
                link.post(frame + wire.checksum(frame[1:]))


def obstacle_distance(autopilot: Autopilot, now: float) -> None:
    """Send OBSTACLE_DISTANCE, the level rays clockwise from the nose, unless they are broken."""
    readings = autopilot.readings
    reach_m, nearest, farthest = _bounds(readings.range_min_m, readings.range_max_m)
    if readings.scans_cm is None:
        readings.scans_cm = _scans_cm(readings.ring_m, reach_m, farthest + 1)
    scan_cm = readings.scans_cm[autopilot.index].tobytes()
    if scan_cm.startswith(BROKEN):
        return
    time, sysid, (start, kind, end) = boot_us(autopilot, now), autopilot.sysid, RINGS
    for link in autopilot.to:
        seq = link.sequence()
        frame = SCAN.pack(start, seq, sysid, kind, time, scan_cm, nearest, farthest) + end
        link.post(frame + wire.checksum(frame[1:]))


def _scans_cm(ring_m: NDArray[np.float64], reach_m: float, nothing_cm: int) -> NDArray[np.uint16]:
    """Round the rings of a whole fleet, (n, 72), at once; BROKEN_CM all round for a broken one."""
    seen = ring_m <= reach_m
    distances = np.rint(np.where(seen, ring_m, 0.0) * 100.0).astype("<u2")
    scans = np.where(seen, distances, np.uint16(nothing_cm))
    scans[np.isnan(ring_m).any(axis=1)] = BROKEN_CM
    return scans


def peers(autopilot: Autopilot) -> None:
    """Send what the radio measured of its peers, and when: +x turned towards each, body FRD."""
    for fix in autopilot.peers:
        autopilot.send(
            DISTANCE_SENSOR,
            boot_ms(autopilot, max(fix.time_s, autopilot.booted_at)),
            0,
            FARTHEST_CM,
            centimetres(fix.range_m),
            SENSOR_UNKNOWN,
            fix.sysid & 0xFF,
            ORIENTATION_CUSTOM,
            0xFF,
            0.0,
            0.0,
            quaternion_to(*fix.direction_body),
            0,
            compid=RADIO_COMPID,
        )


def quaternion_to(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Turn +x into a unit direction by the shortest way: quaternion w, x, y, z."""
    norm = math.sqrt((1.0 + x) ** 2 + z * z + y * y)
    if norm < 1e-6:  # straight behind: half a turn
        return (0.0, 0.0, 0.0, 1.0)
    return ((1.0 + x) / norm, 0.0, -z / norm, y / norm)


def victims(autopilot: Autopilot, now: float) -> None:
    """Send what the infrared sensor sees."""
    for fix in autopilot.victims:
        x, y, z = fix.x_m, fix.y_m, fix.z_m
        autopilot.send(
            LANDING_TARGET,
            boot_us(autopilot, now),
            fix.target_num & 0xFF,
            FRAME_BODY_FRD,
            0.0,
            0.0,
            math.sqrt(x * x + y * y + z * z),
            0.0,
            0.0,
            x,
            y,
            z,
            NO_ROTATION,
            0,
            1,
        )


STREAMS: Mapping[int, Encoder] = {
    DISTANCE_SENSOR.id: distance_sensors,
    OBSTACLE_DISTANCE.id: obstacle_distance,
}
"""What flows at an interval, by message id; peers and victims come whenever they are met."""
