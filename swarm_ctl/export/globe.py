"""Where a run lies on the globe: by the option, the world, the survey or the satellites."""

from __future__ import annotations

from swarm_ctl.errors import SwarmError
from swarm_ctl.frames import Geodetic, ned_to_geodetic
from swarm_ctl.model import Vec3
from swarm_ctl.record.reader import Run


def parse_origin(text: str) -> Geodetic:
    """Read LAT,LON or LAT,LON,ALT; SwarmError says what was expected."""
    try:
        numbers = [float(part) for part in text.split(",")]
        latitude, longitude, altitude = [*numbers, 0.0][:3]
    except ValueError:
        numbers = []
        latitude = longitude = altitude = 0.0
    if len(numbers) not in {2, 3} or not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
        raise SwarmError(
            f"--origin {text}: expected LATITUDE,LONGITUDE or LATITUDE,LONGITUDE,ALTITUDE in "
            "degrees and metres, as 47.3977,8.5456,488"
        )
    return Geodetic(latitude, longitude, altitude)


def origin_of(run: Run) -> Geodetic:
    """Give where the launch frame begins on the globe; SwarmError when nobody knows."""
    if not run.starts_ned_m:
        raise SwarmError(
            f"{run.path}: nobody knows where one vehicle's start lies from another's, so nothing "
            "has a place on a map: declare a shared frame in the mission (docs/frames.md)"
        )
    if run.origin is None:
        raise SwarmError(
            f"{run.path}: nobody has told where on the globe this run was flown: "
            "give the place of its origin with --origin LATITUDE,LONGITUDE,ALTITUDE"
        )
    return run.origin


def position(place: Vec3, origin: Geodetic) -> list[float]:
    """Write a place of the launch frame as longitude, latitude, altitude: to 1 cm."""
    at = ned_to_geodetic(place, origin)
    return [round(at.longitude_deg, 7), round(at.latitude_deg, 7), round(at.altitude_m, 2)]
