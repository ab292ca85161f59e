"""Telemetry: what stands in the messages that an autopilot sends of itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from mock_vehicle.autopilot.link import Encoder
from mock_vehicle.sensors.rangefinder import CONE_DEG, RING
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

ATTITUDE = wire.message("ATTITUDE")
ATTITUDE_QUATERNION = wire.message("ATTITUDE_QUATERNION")
AUTOPILOT_VERSION = wire.message("AUTOPILOT_VERSION")
BATTERY_STATUS = wire.message("BATTERY_STATUS")
DISTANCE_SENSOR = wire.message("DISTANCE_SENSOR")
EXTENDED_SYS_STATE = wire.message("EXTENDED_SYS_STATE")
HEARTBEAT = wire.message("HEARTBEAT")
LANDING_TARGET = wire.message("LANDING_TARGET")
LOCAL_POSITION_NED = wire.message("LOCAL_POSITION_NED")
OBSTACLE_DISTANCE = wire.message("OBSTACLE_DISTANCE")
SYS_STATUS = wire.message("SYS_STATUS")
VFR_HUD = wire.message("VFR_HUD")

QUADROTOR = 2
ARMED = 128
PREARM_CHECK = 0x10000000
RADIO_COMPID = 68
ORIENTATIONS = (0, 12, 6, 2, 24, 25)
"""MAV_SENSOR_ROTATION of front, back, left, right, up, down."""
ORIENTATION_CUSTOM = 100
SENSOR_LASER, SENSOR_UNKNOWN = 0, 4
FRAME_BODY_FRD = 12
FARTHEST_CM = 0xFFFF
LONGEST_RANGE_M = 654.0
"""What fits into centimetres of 16 bits, with a number left for "nothing" that is not "unknown"."""
NO_ROTATION = (0.0, 0.0, 0.0, 0.0)
FIELDS_OF_VIEW_RAD = (math.radians(CONE_DEG),) * 4 + (0.0, 0.0)
MOUNTINGS = tuple(
    (SENSOR_LASER, number, orientation, 0xFF, view_rad, 0.0, NO_ROTATION, 0)
    for number, (orientation, view_rad) in enumerate(
        zip(ORIENTATIONS, FIELDS_OF_VIEW_RAD, strict=True)
    )
)
"""What DISTANCE_SENSOR says of each rangefinder after the distance."""
RING_SPACING_DEG = 360 // RING
UNKNOWN_TEMPERATURE = 0x7FFF
UNUSED_CELLS = (0xFFFF,) * 9


def boot_ms(autopilot: Autopilot, now: float) -> int:
    """Give the time since boot as most messages do."""
    return int((now - autopilot.booted_at) * 1e3) & 0xFFFFFFFF


def boot_us(autopilot: Autopilot, now: float) -> int:
    """Give the time since boot as the others do."""
    return int((now - autopilot.booted_at) * 1e6)


def centimetres(metres: float) -> int:
    """Round a range into the field's 16 bits; what is no number is as far as can be."""
    return round(max(metres * 100.0, 0.0)) if metres < 655.0 else FARTHEST_CM


def clamped(value: float, low: int, high: int) -> int:
    """Round into the range of an integer field."""
    return int(min(max(value, low), high)) if math.isfinite(value) else low


def heartbeat(autopilot: Autopilot, now: float) -> None:
    """Send HEARTBEAT."""
    autopilot.send(
        HEARTBEAT,
        QUADROTOR,
        autopilot.traits.autopilot,
        autopilot.base_mode | (ARMED if autopilot.armed else 0),
        autopilot.reported_mode,
        autopilot.system_status(now),
        3,
    )


def attitude(autopilot: Autopilot, now: float) -> None:
    """Send ATTITUDE."""
    s = autopilot.state
    rates = (0.0, 0.0, s.yaw_rate_rad_s)
    autopilot.send(ATTITUDE, boot_ms(autopilot, now), s.roll_rad, s.pitch_rad, s.yaw_rad, *rates)


def attitude_quaternion(autopilot: Autopilot, now: float) -> None:
    """Send ATTITUDE_QUATERNION."""
    s = autopilot.state
    cr, sr = math.cos(s.roll_rad / 2), math.sin(s.roll_rad / 2)
    cp, sp = math.cos(s.pitch_rad / 2), math.sin(s.pitch_rad / 2)
    cy, sy = math.cos(s.yaw_rad / 2), math.sin(s.yaw_rad / 2)
    autopilot.send(
        ATTITUDE_QUATERNION,
        boot_ms(autopilot, now),
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        0.0,
        0.0,
        s.yaw_rate_rad_s,
        NO_ROTATION,
    )


def local_position(autopilot: Autopilot, now: float) -> None:
    """Send LOCAL_POSITION_NED; while there is no estimate yet nothing is sent."""
    if autopilot.has_position(now):
        autopilot.send(LOCAL_POSITION_NED, boot_ms(autopilot, now), *autopilot.state[:6])


def vfr_hud(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send VFR_HUD."""
    s = autopilot.state
    speed = math.hypot(s.north_m_s, s.east_m_s)
    heading = int(math.degrees(s.yaw_rad)) % 360
    throttle = 50 if autopilot.flying else 0
    height = autopilot.origin.amsl_m - s.down_m
    autopilot.send(VFR_HUD, speed, speed, heading, throttle, height, -s.down_m_s)


def sys_status(autopilot: Autopilot, now: float) -> None:
    """Send SYS_STATUS: sensors, whether it may arm, and the battery."""
    s = autopilot.state
    sensors = autopilot.traits.sensors
    ready = autopilot.armed or autopilot.arming_refusals(now, force=False) is None
    autopilot.send(
        SYS_STATUS,
        sensors | PREARM_CHECK,
        sensors | PREARM_CHECK,
        sensors | (PREARM_CHECK if ready else 0),
        100,
        clamped(s.battery_voltage_v * 1e3, 0, 0xFFFF),
        clamped(s.battery_current_a * 100.0, -1, 0x7FFF),
        clamped(s.battery_fraction * 100.0, 0, 100),
        *(0,) * 6,
    )


def battery_status(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send BATTERY_STATUS; the whole voltage stands in the first cell, as in both records."""
    s = autopilot.state
    autopilot.send(
        BATTERY_STATUS,
        0,
        0,
        0,
        UNKNOWN_TEMPERATURE,
        (clamped(s.battery_voltage_v * 1e3, 0, 0xFFFF), *UNUSED_CELLS),
        clamped(s.battery_current_a * 100.0, -1, 0x7FFF),
        -1,
        -1,
        clamped(s.battery_fraction * 100.0, 0, 100),
        0,
        1,
    )


def extended_sys_state(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send EXTENDED_SYS_STATE."""
    autopilot.send(EXTENDED_SYS_STATE, autopilot.traits.vtol_state, autopilot.landed_state)


def distance_sensors(autopilot: Autopilot, now: float) -> None:
    """Send the rangefinders that work; beyond max_distance there is nothing."""
    time, send = boot_ms(autopilot, now), autopilot.send
    reach_m = min(autopilot.range_max_m, LONGEST_RANGE_M)
    nearest, farthest = centimetres(autopilot.range_min_m), centimetres(reach_m)
    for range_m, mounting in zip(autopilot.state.ranges_m, MOUNTINGS, strict=True):
        if range_m == range_m:  # noqa: PLR0124 - not NaN, and six times cheaper than asking
            distance = round(range_m * 100.0) if range_m <= reach_m else farthest + 1
            send(DISTANCE_SENSOR, time, nearest, farthest, distance, *mounting)


def obstacle_distance(autopilot: Autopilot, now: float) -> None:
    """Send OBSTACLE_DISTANCE, the level rays clockwise from the nose, unless they are broken."""
    ring = autopilot.ring_m
    if np.isnan(ring).any():
        return
    reach_m = min(autopilot.range_max_m, LONGEST_RANGE_M)
    nearest, farthest = centimetres(autopilot.range_min_m), centimetres(reach_m)
    seen = ring <= reach_m
    distances = np.rint(np.where(seen, ring, 0.0) * 100.0).astype(int)
    autopilot.send(
        OBSTACLE_DISTANCE,
        boot_us(autopilot, now),
        SENSOR_LASER,
        np.where(seen, distances, farthest + 1).tolist(),
        RING_SPACING_DEG,
        nearest,
        farthest,
        float(RING_SPACING_DEG),
        0.0,
        FRAME_BODY_FRD,
    )


def peers(autopilot: Autopilot, now: float) -> None:
    """Send what the radio measured of its peers: +x turned towards each, body FRD."""
    time = boot_ms(autopilot, now)
    for fix in autopilot.peers:
        autopilot.send(
            DISTANCE_SENSOR,
            time,
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


def autopilot_version(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send AUTOPILOT_VERSION."""
    version = autopilot.traits.flight_sw_version
    autopilot.send(
        AUTOPILOT_VERSION,
        autopilot.traits.capabilities,
        version,
        version,
        0,
        1,
        b"",
        b"",
        b"",
        0,
        0,
        autopilot.uid & 0xFFFFFFFFFFFFFFFF,
        (autopilot.uid & (1 << 144) - 1).to_bytes(18, "big"),
    )


COMMON: Mapping[int, Encoder] = {
    HEARTBEAT.id: heartbeat,
    SYS_STATUS.id: sys_status,
    ATTITUDE.id: attitude,
    ATTITUDE_QUATERNION.id: attitude_quaternion,
    LOCAL_POSITION_NED.id: local_position,
    VFR_HUD.id: vfr_hud,
    DISTANCE_SENSOR.id: distance_sensors,
    BATTERY_STATUS.id: battery_status,
    EXTENDED_SYS_STATE.id: extended_sys_state,
    OBSTACLE_DISTANCE.id: obstacle_distance,
}
"""Messages that both autopilots stream, by id."""
