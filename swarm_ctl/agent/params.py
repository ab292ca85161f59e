"""What a mission may set about flying and about the limits no setpoint leaves."""

import math

from pydantic import Field

from swarm_ctl.sections import Section


class FlightParams(Section):
    """How a vehicle takes off, moves and comes home."""

    height_m: float = Field(default=1.5, gt=0.0, le=120.0)
    """Height above its own start to take off to, and to fly at in two dimensions, in metres."""
    speed_m_s: float = Field(default=1.0, gt=0.0, le=15.0)
    """Fastest horizontal flight, in m/s; larger explores faster and needs a longer radio range."""
    climb_m_s: float = Field(default=0.5, gt=0.0, le=5.0)
    """Fastest climb and descent, in m/s."""
    acceleration_m_s2: float = Field(default=2.0, gt=0.0, le=10.0)
    """What the vehicle can brake with, in m/s²; larger lets it come closer before it slows down."""
    response_s: float = Field(default=0.6, ge=0.0, le=3.0)
    """Delay between a demanded velocity and half of its effect, in seconds; larger brakes earlier.

    PX4 and ArduPilot take 0.6 to 0.8 s to half of a step of 2 m/s."""
    open_air: bool = False
    """Fly without rangefinders; only where nothing can be run into within `limits.radius_m`."""
    ready_timeout_s: float = Field(default=60.0, gt=0.0, le=3600.0)
    """Longest wait for an autopilot that is ready to arm, in seconds.

    ArduPilot takes about 40 s from power-up; a cold GNSS receiver takes minutes."""
    return_home: bool = True
    """Fly back to the own start when the exploration ends; else land where it is."""
    return_timeout_s: float = Field(default=240.0, ge=0.0, le=3600.0)
    """Longest flight home, in seconds, before it lands where the ground below is free."""
    start_spacing_s: float = Field(default=0.0, ge=0.0, le=60.0)
    """Delay between the take-offs of one vehicle and the next, in seconds; 0 = all at once."""


class Limits(Section):
    """What geofence and failsafe hold against every planner; lengths from the vehicle's centre."""

    radius_m: float = Field(default=200.0, ge=1.0, le=10_000.0)
    """Farthest from its own start, level, in metres; larger lets it roam farther."""
    floor_m: float = Field(default=0.4, ge=0.0, le=120.0)
    """Lowest height above its own start while exploring, in metres."""
    ceiling_m: float = Field(default=3.0, gt=0.0, le=120.0)
    """Greatest height above its own start, in metres."""
    separation_m: float = Field(default=1.0, ge=0.0, le=20.0)
    """Distance kept between the centres of two vehicles, in metres; larger is safer and slower."""
    wall_m: float = Field(default=0.5, ge=0.1, le=20.0)
    """Distance kept to walls, in metres; must stay below `planner.avoid_distance_m`."""
    battery_reserve: float = Field(default=0.25, ge=0.0, lt=1.0)
    """Charge (0 to 1) to be home with; the way home is added. Larger comes home earlier."""
    battery_critical: float = Field(default=0.12, ge=0.0, lt=1.0)
    """Charge (0 to 1) at which a vehicle lands where it is; below `battery_reserve`."""
    range_stale_s: float = Field(default=0.5, gt=0.0, le=10.0)
    """Age, in seconds, at which a rangefinder's reading is no longer believed."""
    link_hold_s: float = Field(default=1.0, gt=0.0, le=60.0)
    """Silence of the autopilot, in seconds, after which the vehicle is told to hold."""
    link_lost_s: float = Field(default=5.0, gt=0.0, le=600.0)
    """Silence of the autopilot, in seconds, after which its link counts as lost: setpoints stop."""
    link_delay_s: float = Field(default=0.5, gt=0.0, le=10.0)
    """Longest way there and back over the link, in seconds; a vehicle behind a slower one holds."""
    planner_stall_s: float = Field(default=1.0, gt=0.0, le=60.0)
    """Age of the plan, in seconds, at which the stream of setpoints becomes a hold."""
    max_time_s: float = Field(default=1800.0, gt=0.0, le=86_400.0)
    """Mission time, in seconds, at which every vehicle lands, come what may."""


class RangingParams(Section):
    """How well the radio measures where a peer is."""

    range_sigma_m: float = Field(default=0.05, gt=0.0, le=5.0)
    """Standard deviation of its range, in metres, with a bias that does not average out; larger
    trusts single fixes less and keeps farther away from peers."""
    bearing_sigma_deg: float = Field(default=3.0, gt=0.0, le=45.0)
    """Standard deviation of its bearing, sideways and up each, in degrees; larger does the same,
    the more the farther the peer is."""

    def variance_m2(self, squared_range_m2: float) -> float:
        """Give the variance of a fix per axis, the mean over the three of them."""
        along_m, across_rad = self.range_sigma_m, math.radians(self.bearing_sigma_deg)
        return (along_m * along_m + 2.0 * across_rad * across_rad * squared_range_m2) / 3.0
