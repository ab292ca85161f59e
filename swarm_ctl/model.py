"""Values that travel between the parts of a controller: facts, setpoints, operator commands."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple


class Vec3(NamedTuple):
    """Three components in a frame that the name of the variable tells (NED: down is positive)."""

    x: float
    y: float
    z: float


ZERO = Vec3(0.0, 0.0, 0.0)


class Setpoint(NamedTuple):
    """What a vehicle should do now, in its own local NED frame."""

    velocity_ned_m_s: Vec3
    """Demanded velocity."""
    yaw_rad: float
    """Demanded heading, clockwise from north."""


class Operator(StrEnum):
    """What an operator may ask of a vehicle at any time."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    RETURN = "return"
    LAND = "land"
    ABORT = "abort"


@dataclass(frozen=True, slots=True)
class Event:
    """A fact about one vehicle, in the past tense."""

    time_s: float
    """Mission time."""
    sysid: int
    name: str
    """CamelCase: `PhaseChanged`, `VictimFound`, `LinkLost`."""
    data: dict[str, Any] = field(default_factory=dict)
    """JSON values only."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One vehicle as an operator's table shows it."""

    sysid: int
    phase: str
    position_ned_m: Vec3
    """In the vehicle's own local frame: its start is the origin."""
    battery_fraction: float | None
    peers: tuple[int, ...]
    """sysids heard within the last second."""
    victims: int
    """Victims this vehicle has seen itself."""
    note: str
    """The last event in a few words."""
    silent_s: float = 0.0
    """Since its autopilot was last heard; infinite when it never was."""
    cluster: tuple[int, ...] = ()
    """sysids of `peers` and whom they reach, as far as this vehicle can know."""
