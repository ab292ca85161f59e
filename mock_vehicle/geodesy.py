"""Latitude, longitude and altitude of places near an origin, on a sphere that is flat nearby."""

from __future__ import annotations

import math
from typing import NamedTuple

EARTH_RADIUS_M = 6_371_000.0
"""As PX4 and the map projections of small areas take it."""
Vector = tuple[float, float, float]


class Origin(NamedTuple):
    """Where a local NED frame lies on the globe."""

    latitude_deg: float
    longitude_deg: float
    amsl_m: float
    """Altitude above mean sea level."""

    def to_global(self, north_m: float, east_m: float, down_m: float) -> Origin:
        """Give the place that lies so far from this origin."""
        latitude_deg = self.latitude_deg + math.degrees(north_m / EARTH_RADIUS_M)
        longitude_deg = self.longitude_deg + math.degrees(east_m / self._parallel_radius_m)
        return Origin(latitude_deg, longitude_deg, self.amsl_m - down_m)

    def to_local(self, latitude_deg: float, longitude_deg: float, amsl_m: float) -> Vector:
        """Give north, east and down, m, of a place; NaN stays NaN."""
        north_m = math.radians(latitude_deg - self.latitude_deg) * EARTH_RADIUS_M
        east_m = math.radians(longitude_deg - self.longitude_deg) * self._parallel_radius_m
        return north_m, east_m, self.amsl_m - amsl_m

    @property
    def _parallel_radius_m(self) -> float:
        return EARTH_RADIUS_M * math.cos(math.radians(self.latitude_deg))


TESTING_GROUND = Origin(47.3977418, 8.5455939, 489.4)
"""Where both recorded simulators start, a meadow near Zurich."""
