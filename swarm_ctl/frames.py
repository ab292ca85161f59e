"""Body, local NED, shared and geodetic frames, component by component."""

from __future__ import annotations

import math
from typing import NamedTuple

from swarm_ctl.model import Vec3

EQUATOR_M = 6_378_137.0
"""Semi-major axis of the ellipsoid (WGS 84, NIMA TR8350.2, table 3.1)."""
FLATTENING = 1.0 / 298.257223563
"""Of the ellipsoid (WGS 84, the same table)."""
_POLE_M = EQUATOR_M * (1.0 - FLATTENING)
_E2 = FLATTENING * (2.0 - FLATTENING)  # first eccentricity, squared
_E2_POLE = _E2 / (1.0 - _E2)  # second eccentricity, squared


class Geodetic(NamedTuple):
    """A place on the globe."""

    latitude_deg: float
    """Northward."""
    longitude_deg: float
    """Eastward, -180 to 180."""
    altitude_m: float
    """Above mean sea level or the ellipsoid: over a few kilometres the two differ by a constant."""


def wrap_rad(angle_rad: float) -> float:
    """Bring an angle into (-pi, pi]."""
    return math.pi - (math.pi - angle_rad) % (2.0 * math.pi)


def turn(vector: Vec3, angle_rad: float) -> Vec3:
    """Turn a vector about down: clockwise from north as a compass reads, north to east."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return Vec3(c * vector.x - s * vector.y, s * vector.x + c * vector.y, vector.z)


def rotate(quaternion: tuple[float, float, float, float], vector: Vec3) -> Vec3:
    """Rotate a vector by a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    vx, vy, vz = vector
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return Vec3(
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def body_to_ned(vector: Vec3, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Vec3:
    """Turn a vector from body FRD into NED; angles are MAVLink ATTITUDE's (intrinsic z-y-x)."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    x, y, z = vector
    y, z = cr * y - sr * z, sr * y + cr * z
    x, z = cp * x + sp * z, -sp * x + cp * z
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return Vec3(c * x - s * y, s * x + c * y, z)


def enu_to_ned(vector: Vec3) -> Vec3:
    """Turn x east, y north, z up, as floor plans are drawn, into NED."""
    return Vec3(vector.y, vector.x, -vector.z)


def geodetic_to_ned(place: Geodetic, origin: Geodetic) -> Vec3:
    """Give a place in the tangent plane at an origin: exact, whatever the distance."""
    x, y, z = (p - o for p, o in zip(_ecef(place), _ecef(origin), strict=True))
    north, east, down = _axes(origin)
    return Vec3(*(a * x + b * y + c * z for a, b, c in (north, east, down)))


def ned_to_geodetic(offset: Vec3, origin: Geodetic) -> Geodetic:
    """Give the place that lies so far from an origin in its tangent plane.

    Good to a micrometre within 10 km of the ground (B. R. Bowring, Survey Review 23, 1976).
    """
    axes = zip(_ecef(origin), *_axes(origin), strict=True)
    x, y, z = (o + n * offset.x + e * offset.y + d * offset.z for o, n, e, d in axes)
    level = math.hypot(x, y)
    reduced = math.atan2(z * EQUATOR_M, level * _POLE_M)
    latitude = math.atan2(
        z + _E2_POLE * _POLE_M * math.sin(reduced) ** 3,
        level - _E2 * EQUATOR_M * math.cos(reduced) ** 3,
    )
    sin, cos = math.sin(latitude), math.cos(latitude)
    altitude_m = level * cos + z * sin - EQUATOR_M * math.sqrt(1.0 - _E2 * sin * sin)
    return Geodetic(math.degrees(latitude), math.degrees(math.atan2(y, x)), altitude_m)


def _ecef(place: Geodetic) -> Vec3:
    """Give a place from the Earth's centre: x to longitude 0, z to the north pole, metres."""
    latitude, longitude = math.radians(place.latitude_deg), math.radians(place.longitude_deg)
    sin, cos = math.sin(latitude), math.cos(latitude)
    normal_m = EQUATOR_M / math.sqrt(1.0 - _E2 * sin * sin)
    level = (normal_m + place.altitude_m) * cos
    up = (normal_m * (1.0 - _E2) + place.altitude_m) * sin
    return Vec3(level * math.cos(longitude), level * math.sin(longitude), up)


def _axes(place: Geodetic) -> tuple[Vec3, Vec3, Vec3]:
    """Give the directions north, east and down at a place, from the Earth's centre."""
    latitude, longitude = math.radians(place.latitude_deg), math.radians(place.longitude_deg)
    sin_lat, cos_lat = math.sin(latitude), math.cos(latitude)
    sin_lon, cos_lon = math.sin(longitude), math.cos(longitude)
    north = Vec3(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat)
    down = Vec3(-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat)
    return north, Vec3(-sin_lon, cos_lon, 0.0), down
