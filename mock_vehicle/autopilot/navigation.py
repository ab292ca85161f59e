"""What an autopilot knows of its place on the globe, and for how long without satellites."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mock_vehicle.geodesy import Origin, Vector

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
        uptime_s, receives = autopilot.uptime_s(now), autopilot.receives_gnss
        if receives and not self.has_origin:
            self.knows_time = uptime_s >= autopilot.boot.gnss_s
            if uptime_s >= autopilot.boot.origin_s:
                self.set_origin(autopilot, self.site, now)
        if receives or autopilot.readings.has_odometry:
            self.lost_at = None
        elif self.lost_at is None:
            self.lost_at = now

    def set_origin(self, autopilot: Autopilot, origin: Origin, now: float) -> None:
        """Take an origin."""
        self.origin, self.has_origin = origin, True
        autopilot.announce_origin(now)

    def set_home(self, autopilot: Autopilot, home_m: Vector, now: float) -> None:
        """Take a home."""
        self.home_m = home_m
        if self.has_home(autopilot, now):
            autopilot.announce_home(now)

    def has_home(self, autopilot: Autopilot, now: float) -> bool:
        """Whether home lies anywhere on the globe."""
        return self.has_origin and autopilot.uptime_s(now) >= autopilot.boot.home_s

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
