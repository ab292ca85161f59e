"""What an autopilot knows of its place on the globe, and for how long without satellites."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mock_vehicle.geodesy import Origin, Vector
from mock_vehicle.sensors.gnss import Reception

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot


class Navigation:
    """Origin, home and satellites of one autopilot since its boot."""

    def __init__(self, site: Origin) -> None:
        self.site = site
        """Where its local frame really lies."""
        self.origin = site
        """Where it believes that to be; worth something with `has_origin` alone."""
        self.has_origin = False
        self.knows_time = False
        """Whether satellites have told the time of day."""
        self.home_m: Vector = (0.0, 0.0, 0.0)
        """Home in local NED."""
        self.lost_at: float | None = None
        """Since when nothing has told the position; None while something does."""

    def update(self, autopilot: Autopilot, now: float) -> None:
        """Look at the satellites."""
        reception = autopilot.state.reception
        uptime_s, boot = autopilot.uptime_s(now), autopilot.boot
        receives = reception > Reception.DENIED
        if receives and uptime_s >= boot.gnss_s:
            self.knows_time = True
            if not self.has_origin and uptime_s >= boot.home_s:
                self.set_origin(autopilot, self.site, now)
        if receives or autopilot.has_odometry:
            self.lost_at = None
        elif self.lost_at is None:
            self.lost_at = now

    def set_origin(self, autopilot: Autopilot, origin: Origin, now: float) -> None:
        """Take an origin, and the place of the start as home."""
        self.origin, self.has_origin = origin, True
        autopilot.announce_home(now)

    def silent_s(self, now: float) -> float:
        """Tell for how long nothing has told the position."""
        return 0.0 if self.lost_at is None else now - self.lost_at

    def has_position(self, autopilot: Autopilot, now: float) -> bool:
        """Whether there is a local position: measured, or still believed from the last one."""
        first_at = autopilot.booted_at + autopilot.boot.position_s
        if self.lost_at is None:
            return now >= first_at
        believed_s = autopilot.traits.dead_reckoning_s
        return self.lost_at > first_at and now - self.lost_at < believed_s
