"""Rotations between body (forward, right, down) and local NED, component by component."""

from __future__ import annotations

import math

from swarm_ctl.model import Vec3


def wrap_rad(angle_rad: float) -> float:
    """Bring an angle into (-pi, pi]."""
    return math.pi - (math.pi - angle_rad) % (2.0 * math.pi)


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
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    x, y, z = vector
    y, z = cr * y - sr * z, sr * y + cr * z
    x, z = cp * x + sp * z, -sp * x + cp * z
    return Vec3(cy * x - sy * y, sy * x + cy * y, z)
