"""Time on the wire: stamps of messages, TIMESYNC, PING and SYSTEM_TIME."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.link import Encoder
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

PING = wire.message("PING")
SYSTEM_TIME = wire.message("SYSTEM_TIME")
TIMESYNC = wire.message("TIMESYNC")

DAWN_UNIX_US = 1_767_225_600_000_000
"""Where mission time 0 lies: 2026-01-01, so that runs repeat."""


def boot_ms(autopilot: Autopilot, now: float) -> int:
    """Give the time since boot as most messages do."""
    return int((now - autopilot.booted_at) * 1e3) & 0xFFFFFFFF


def boot_us(autopilot: Autopilot, now: float) -> int:
    """Give the time since boot as the others do."""
    return int((now - autopilot.booted_at) * 1e6)


def unix_us(autopilot: Autopilot, now: float) -> int:
    """Give the time of day, which comes from the satellites: 0 before they are received."""
    return DAWN_UNIX_US + int(now * 1e6) if autopilot.navigation.knows_time else 0


def system_time(autopilot: Autopilot, now: float) -> None:
    """Send SYSTEM_TIME."""
    autopilot.send(SYSTEM_TIME, unix_us(autopilot, now), boot_ms(autopilot, now))


def ask_time(autopilot: Autopilot, now: float) -> None:
    """Send a TIMESYNC request, which both autopilots do unasked."""
    autopilot.send(TIMESYNC, 0, boot_us(autopilot, now) * 1000)


def ask_ping(autopilot: Autopilot, now: float) -> None:
    """Send a PING to everybody."""
    link = autopilot.to[0]
    autopilot.send(PING, boot_us(autopilot, now), link.pings, 0, 0)
    link.pings += 1


def on_timesync(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Answer a TIMESYNC request with the time since boot."""
    if frame.values.tc1 == 0:
        autopilot.send(TIMESYNC, boot_us(autopilot, now) * 1000, frame.values.ts1)


def on_ping(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:  # noqa: ARG001
    """Answer a PING that asks everybody."""
    v = frame.values
    if v.target_system == 0 and v.target_component == 0:
        autopilot.send(PING, v.time_usec, v.seq, frame.sysid, frame.compid)


STREAMS: Mapping[int, Encoder] = {
    SYSTEM_TIME.id: system_time,
    TIMESYNC.id: ask_time,
}
"""What both autopilots send about time, by message id."""
