"""Geofences: zones on the ground, limits of height and distance, and who breaches them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Flag, auto
from typing import TYPE_CHECKING

from mock_vehicle.autopilot import places
from mock_vehicle.autopilot.parameters import Parameters
from mock_vehicle.autopilot.plans import Cmd, Item, Kind
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

FENCE_STATUS = wire.message("FENCE_STATUS")
Point = tuple[float, float]
"""North and east of the origin, m."""


class Breach(Flag):
    """Which limits a vehicle is beyond."""

    NONE = 0
    MAX_ALTITUDE = auto()
    CIRCLE = auto()
    """The distance from home."""
    ZONES = auto()
    MIN_ALTITUDE = auto()


UNBROKEN = Breach.NONE
BREACH_TYPES: Mapping[Breach, int] = {
    Breach.MIN_ALTITUDE: 1,
    Breach.MAX_ALTITUDE: 2,
    Breach.CIRCLE: 3,
    Breach.ZONES: 3,
}
"""FENCE_BREACH."""


@dataclass(frozen=True, slots=True)
class Polygon:
    """An area within corners, wherever they begin and however they turn."""

    corners: Sequence[Point]

    def contains(self, north_m: float, east_m: float) -> bool:
        """Count the edges that a ray to the east crosses."""
        inside = False
        last_n, last_e = self.corners[-1]
        for corner_n, corner_e in self.corners:
            if (corner_n > north_m) != (last_n > north_m):
                share = (north_m - corner_n) / (last_n - corner_n)
                if east_m < corner_e + share * (last_e - corner_e):
                    inside = not inside
            last_n, last_e = corner_n, corner_e
        return inside


@dataclass(frozen=True, slots=True)
class Circle:
    """An area round a centre."""

    centre: Point
    radius_m: float

    def contains(self, north_m: float, east_m: float) -> bool:
        """Compare the distance from the centre."""
        return math.dist(self.centre, (north_m, east_m)) <= self.radius_m


Zone = Polygon | Circle


@dataclass(frozen=True, slots=True)
class Zones:
    """Where a vehicle may be, and where not."""

    inclusions: Sequence[Zone] = ()
    exclusions: Sequence[Zone] = ()

    def allow(self, north_m: float, east_m: float, *, any_will_do: bool) -> bool:
        """Whether a place is in all inclusions, or in any of them, and in no exclusion."""
        inside = [zone.contains(north_m, east_m) for zone in self.inclusions]
        is_included = not inside or (any(inside) if any_will_do else all(inside))
        return is_included and not any(zone.contains(north_m, east_m) for zone in self.exclusions)


@dataclass(frozen=True, slots=True)
class FenceSettings:
    """What the parameters say; infinite is no limit."""

    is_on: bool
    action: float
    """FENCE_ACTION or GF_ACTION."""
    radius_m: float
    """From home."""
    top_m: float
    floor_m: float
    """Above home; the floor counts once the vehicle has been above it."""
    has_zones: bool
    any_will_do: bool
    """One of several inclusions is enough."""

    @property
    def is_bounded(self) -> bool:
        """Whether it limits anything but zones."""
        return self.radius_m < math.inf or self.top_m < math.inf or self.floor_m > -math.inf

    @classmethod
    def of_px4(cls, parameters: Parameters) -> FenceSettings:
        """Read GF_*."""
        finite = parameters.finite
        action = finite("GF_ACTION")
        return cls(
            is_on=action != 0.0,
            action=action,
            radius_m=finite("GF_MAX_HOR_DIST") or math.inf,
            top_m=finite("GF_MAX_VER_DIST") or math.inf,
            floor_m=-math.inf,
            has_zones=True,
            any_will_do=True,
        )

    @classmethod
    def of_ardupilot(cls, parameters: Parameters) -> FenceSettings:
        """Read FENCE_*; FENCE_TYPE is a sum of 1 top, 2 radius, 4 zones, 8 floor."""
        finite = parameters.finite
        kinds, options = int(finite("FENCE_TYPE")), int(finite("FENCE_OPTIONS"))
        return cls(
            is_on=finite("FENCE_ENABLE") == 1.0,
            action=finite("FENCE_ACTION"),
            radius_m=finite("FENCE_RADIUS") if kinds & 2 else math.inf,
            top_m=finite("FENCE_ALT_MAX") if kinds & 1 else math.inf,
            floor_m=finite("FENCE_ALT_MIN") if kinds & 8 else -math.inf,
            has_zones=bool(kinds & 4),
            any_will_do=bool(options & 2),
        )


def zones(autopilot: Autopilot, items: Sequence[Item]) -> Zones:
    """Read the zones out of a plan; what is no whole polygon is left out."""
    found: dict[bool, list[Zone]] = {True: [], False: []}
    at = 0
    while at < len(items):
        item, size = items[at], 1
        if item.command in POLYGONS:
            size = max(int(item.params[0]), 1) if 0.0 < item.params[0] < 1e4 else 1
            corners = items[at : at + size]
            is_whole = len(corners) == size >= 3
            if is_whole and all(c.command == item.command for c in corners):
                polygon = Polygon([_point(autopilot, corner) for corner in corners])
                found[POLYGONS[item.command]].append(polygon)
        elif item.command in CIRCLES and math.isfinite(item.params[0]):
            circle = Circle(_point(autopilot, item), item.params[0])
            found[CIRCLES[item.command]].append(circle)
        at += size
    return Zones(found[True], found[False])


def _point(autopilot: Autopilot, item: Item) -> Point:
    return places.to_local(autopilot, 0, item.x * 1e-7, item.y * 1e-7, 0.0)[:2]


POLYGONS: Mapping[int, bool] = {
    Cmd.FENCE_POLYGON_INCLUSION: True,
    Cmd.FENCE_POLYGON_EXCLUSION: False,
}
CIRCLES: Mapping[int, bool] = {
    Cmd.FENCE_CIRCLE_INCLUSION: True,
    Cmd.FENCE_CIRCLE_EXCLUSION: False,
}
"""Whether a vehicle must be inside."""


class Geofence:
    """The fence of one vehicle, and what it breaches at the moment."""

    def __init__(self) -> None:
        self.breach = Breach.NONE
        self.count = 0
        """Breaches since the boot."""
        self.breached_at = 0.0
        self._zones = Zones()
        self._key: tuple[object, ...] = ()
        self._was_above_floor = False
        self._mission_key: tuple[object, ...] = ()
        self._forbids_mission = False

    def update(self, autopilot: Autopilot, settings: FenceSettings, now: float) -> Breach:
        """Look where the vehicle is, and give the limits that it has newly gone beyond."""
        before, self.breach = self.breach, self.at(autopilot, settings)
        if self.breach is before:
            return UNBROKEN
        new = self.breach & ~before
        if new:
            self.count += 1
            self.breached_at = now
        return new

    def at(self, autopilot: Autopilot, settings: FenceSettings) -> Breach:
        """Tell which limits the vehicle is beyond."""
        if not settings.is_on or not autopilot.navigation.has_origin:
            return UNBROKEN
        if not (settings.is_bounded or autopilot.plans.stored[Kind.FENCE]):
            return UNBROKEN
        north, east, down = autopilot.state[:3]
        home_n, home_e, home_d = autopilot.navigation.home_m
        height = home_d - down
        self._was_above_floor = autopilot.flying and (
            self._was_above_floor or height > settings.floor_m
        )
        breach = Breach.NONE
        if height > settings.top_m:
            breach |= Breach.MAX_ALTITUDE
        if math.hypot(north - home_n, east - home_e) > settings.radius_m:
            breach |= Breach.CIRCLE
        if settings.has_zones and not self.allows(autopilot, settings, (north, east)):
            breach |= Breach.ZONES
        if self._was_above_floor and height < settings.floor_m:
            breach |= Breach.MIN_ALTITUDE
        return breach

    def allows(self, autopilot: Autopilot, settings: FenceSettings, point: Point) -> bool:
        """Whether the zones allow to be at a place."""
        key = (autopilot.plans.versions[Kind.FENCE], autopilot.origin)
        if key != self._key:
            self._key = key
            self._zones = zones(autopilot, autopilot.plans.stored[Kind.FENCE])
        return self._zones.allow(*point, any_will_do=settings.any_will_do)

    def forbids_mission(self, autopilot: Autopilot, settings: FenceSettings) -> bool:
        """Whether a place of the mission is outside the zones."""
        plans = autopilot.plans
        key = (*plans.versions.values(), autopilot.origin)
        if key != self._mission_key:
            self._mission_key = key
            placed = plans.rules.placed[Kind.MISSION]
            points = [_point(autopilot, item) for item in plans.mission if item.command in placed]
            self._forbids_mission = not all(
                self.allows(autopilot, settings, point) for point in points
            )
        return settings.is_on and self._forbids_mission


def fence_status(autopilot: Autopilot, now: float) -> None:  # noqa: ARG001 - an Encoder
    """Send FENCE_STATUS, if there is a fence."""
    fence = autopilot.geofence
    if autopilot.fence_settings.is_on:
        kind = next((number for flag, number in BREACH_TYPES.items() if flag & fence.breach), 0)
        breached_ms = int(max(fence.breached_at - autopilot.booted_at, 0.0) * 1e3)
        is_breached = fence.breach is not Breach.NONE
        autopilot.send(FENCE_STATUS, int(is_breached), fence.count, kind, breached_ms, 0)
