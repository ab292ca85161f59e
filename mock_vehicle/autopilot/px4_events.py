"""EVENT of PX4, which everybody hears: that it will not arm, and why not."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from mock_vehicle.autopilot.clock import boot_ms
from mock_vehicle.autopilot.commands import Command, Result
from mock_vehicle.autopilot.fences import Breach
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.px4 import Px4

EVENT = wire.message("EVENT")

ARM_DENIED, CHECKS_BEGIN, CHECKS_END = 16910493, 27825120, 18691879
"""Numbers of events, as recorded."""
CRITICAL, ERROR, PROTOCOL = 0x62, 0x33, 0x88
"""Levels, internal and external."""


class Check(NamedTuple):
    """One thing that keeps it from arming."""

    number: int
    modes: int
    """Those it bars, a bit each."""
    component: int


ALL_MODES = 0xFFFFFFFF
NO_POSITION = Check(30612409, 0x7E007C, 17)
NO_SETPOINTS = Check(19865031, 1 << 14, 20)
NO_GROUND_STATION = Check(23579003, ALL_MODES, 12)
OUTSIDE_FENCE = Check(16920235, ALL_MODES, 20)
"""check_gf_violation_custom_gf: not recorded, its number is by PX4's rule."""


def deny_arming(autopilot: Px4, now: float) -> None:
    """Say that it will not arm; the reasons were told when they came up."""
    _tell(autopilot, ARM_DENIED, CRITICAL, b"", now)


def report_checks(autopilot: Px4, command: Command, now: float) -> int:  # noqa: ARG001
    """Tell every check that fails, between two summaries, as RUN_PREARM_CHECKS wants it."""
    failing = list(_failing(autopilot, now))
    may = ALL_MODES
    for check in failing:
        may &= ~check.modes
    _tell(autopilot, CHECKS_BEGIN, PROTOCOL, struct.pack("<BIIII", 0, 0, 0, may, may), now)
    for check in failing:
        _tell(autopilot, check.number, ERROR, struct.pack("<IB", *check[1:]), now)
    _tell(autopilot, CHECKS_END, PROTOCOL, b"", now)
    return Result.ACCEPTED


def _failing(autopilot: Px4, now: float) -> Iterator[Check]:
    has_position = autopilot.is_ready(now) and autopilot.has_position(now)
    if not has_position:
        yield NO_POSITION
    if not (has_position and autopilot.has_setpoints(now)):
        yield NO_SETPOINTS
    if autopilot.settings.gcs and not autopilot.hears_gcs(now):
        yield NO_GROUND_STATION
    if autopilot.geofence.breach is not Breach.NONE:
        yield OUTSIDE_FENCE


def _tell(autopilot: Px4, number: int, level: int, arguments: bytes, now: float) -> None:
    """Send one EVENT over every link."""
    autopilot.events_told = autopilot.events_told + 1 & 0xFFFF
    sequence, padded = autopilot.events_told, arguments.ljust(40, b"\0")
    with autopilot.serving(*autopilot.links):
        autopilot.send(EVENT, 0, 0, number, boot_ms(autopilot, now), sequence, level, padded)
