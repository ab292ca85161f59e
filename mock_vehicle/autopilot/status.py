"""How the vehicle is: checks, battery, estimator, and the radio it may carry."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.link import Encoder
from mock_vehicle.autopilot.ranging import RADIO_COMPID
from mock_vehicle.autopilot.streams import clamped
from mock_vehicle.sensors.gnss import Reception
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

BATTERY_STATUS = wire.message("BATTERY_STATUS")
RADIO_STATUS = wire.message("RADIO_STATUS")
SYS_STATUS = wire.message("SYS_STATUS")

PREARM_CHECK = 0x10000000
UNKNOWN_TEMPERATURE = 0x7FFF
UNUSED_CELLS = (0xFFFF,) * 9
ABSOLUTE_POSITION = 16 | 512
"""ESTIMATOR_STATUS_FLAGS: the place on the globe is known, and will be."""
CONSTANT_POSITION = 128
STRONG_RSSI, QUIET_RSSI = 200, 40


def sys_status(autopilot: Autopilot, now: float) -> None:
    """Send SYS_STATUS: sensors, whether it may arm, and the battery."""
    s = autopilot.state
    present, enabled, health = autopilot.sensor_bits(now)
    ready = autopilot.armed or autopilot.arming_refusals(now, force=False) is None
    autopilot.send(
        SYS_STATUS,
        present,
        enabled,
        health | (PREARM_CHECK if ready else 0),
        autopilot.traits.load,
        clamped(autopilot.battery_v * 1e3, 0, 0xFFFF),
        clamped(s.battery_current_a * 100.0, -1, 0x7FFF),
        clamped(math.ceil(s.battery_fraction * 100.0), 0, 100),
        *(0,) * 6,
    )


def battery_status(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send BATTERY_STATUS; the whole voltage stands in the first cell, as in both records."""
    s = autopilot.state
    autopilot.send(
        BATTERY_STATUS,
        0,
        *autopilot.traits.battery_kind,
        UNKNOWN_TEMPERATURE,
        (clamped(autopilot.battery_v * 1e3, 0, 0xFFFF), *UNUSED_CELLS),
        clamped(s.battery_current_a * 100.0, -1, 0x7FFF),
        -1,
        -1,
        clamped(math.ceil(s.battery_fraction * 100.0), 0, 100),
        0,
        1,
    )


def estimator_flags(autopilot: Autopilot, now: float) -> int:
    """Give ESTIMATOR_STATUS_FLAGS, as they came during the recorded boot and after."""
    traits, navigation = autopilot.traits, autopilot.navigation
    uptime_s = autopilot.recorded_s(now)
    flags = next(flags for since_s, flags in traits.estimator_flags if uptime_s >= since_s)
    if flags != traits.estimator_flags[0][1]:
        return flags
    if not autopilot.has_position(now):
        return traits.estimator_flags[1][1]
    if navigation.silent_s(now) >= traits.doubt_s:
        return traits.doubting_flags
    is_good = autopilot.receives_gnss and autopilot.state.reception == Reception.PRESENT
    if not is_good or not navigation.has_origin:
        flags &= ~ABSOLUTE_POSITION
    return flags & ~CONSTANT_POSITION if autopilot.armed else flags


def radio_status(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001
    """Send RADIO_STATUS of the telemetry radio, which is always strong; only when asked for."""
    autopilot.send(
        RADIO_STATUS,
        STRONG_RSSI,
        STRONG_RSSI,
        100,
        QUIET_RSSI,
        QUIET_RSSI,
        0,
        0,
        compid=RADIO_COMPID,
    )


STREAMS: Mapping[int, Encoder] = {
    SYS_STATUS.id: sys_status,
    BATTERY_STATUS.id: battery_status,
    RADIO_STATUS.id: radio_status,
}
"""What both autopilots send, by message id."""
