"""How vehicles really are."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mock_vehicle.fleet import Fleet

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Truth:
    """How one vehicle really is at an instant, whatever its telemetry says."""

    time_s: float
    """Mission time."""
    position_ned_m: Vector
    """From where it started."""
    velocity_ned_m_s: Vector
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    latitude_deg: float
    longitude_deg: float
    amsl_m: float
    armed: bool
    ready_to_arm: bool
    """Whether an arm command would be accepted."""
    mode: str
    """Name in the autopilot's own words."""
    landed: bool
    """Whether it stands on the ground."""
    alive: bool
    """Whether the autopilot runs."""
    battery_fraction: float
    battery_voltage_v: float

    @property
    def height_m(self) -> float:
        """Height above where it started."""
        return -self.position_ned_m[2]

    @property
    def distance_to_home_m(self) -> float:
        """Horizontal distance to where it started."""
        return math.hypot(*self.position_ned_m[:2])

    @property
    def speed_m_s(self) -> float:
        """Horizontal speed over ground."""
        return math.hypot(*self.velocity_ned_m_s[:2])


def look(fleet: Fleet, index: int, now: float) -> Truth:
    """Look at one vehicle of a fleet."""
    vehicle, body = fleet.vehicles[index], fleet.dynamics
    roll_rad, pitch_rad = body.lean_rad()
    north, east, down = (body.position_ned_m[index] - vehicle.home_ned_m).tolist()
    place = vehicle.autopilot.origin.to_global(north, east, down)
    velocity = body.velocity_ned_m_s[index].tolist()
    return Truth(
        time_s=now,
        position_ned_m=(north, east, down),
        velocity_ned_m_s=(velocity[0], velocity[1], velocity[2]),
        roll_rad=float(roll_rad[index]),
        pitch_rad=float(pitch_rad[index]),
        yaw_rad=float(body.yaw_rad[index]),
        latitude_deg=place.latitude_deg,
        longitude_deg=place.longitude_deg,
        amsl_m=place.amsl_m,
        armed=vehicle.armed,
        ready_to_arm=vehicle.autopilot.arming_refusals(now, force=False) is None,
        mode=vehicle.mode_name,
        landed=bool(body.on_ground[index]),
        alive=vehicle.alive,
        battery_fraction=float(fleet.batteries.fraction[index]),
        battery_voltage_v=float(fleet.batteries.voltage_v[index]) * vehicle.autopilot.battery_scale,
    )
