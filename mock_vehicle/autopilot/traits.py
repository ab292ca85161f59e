"""What autopilots differ in: modes, manoeuvres, and the numbers measured on the real ones."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, auto
from functools import lru_cache
from typing import Literal, TypeVar, cast

from mock_vehicle.dynamics import Limits
from mock_vehicle.sensors.gnss import Fix

Value = TypeVar("Value", bound=Hashable)


def shared(value: Value) -> Value:
    """Give the first of all equal values: what a whole fleet reads in turn stays in the cache."""
    return cast("Value", _first(value))


@lru_cache
def _first(value: Hashable) -> Hashable:
    return value


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class SystemStatus(IntEnum):
    """MAV_STATE."""

    UNINIT = 0
    BOOT = 1
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    FLIGHT_TERMINATION = 8


class Severity(IntEnum):
    """MAV_SEVERITY."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6
    DEBUG = 7


class Manoeuvre(IntEnum):
    """What a mode makes the vehicle do in the air."""

    HOLD = auto()
    TAKEOFF = auto()
    SETPOINT = auto()
    GO = auto()
    """To a place, there to stay."""
    CIRCLE = auto()
    RETURN = auto()
    LAND = auto()
    SINK = auto()
    """A pilot's mode without a pilot: level, descending."""
    FALL = auto()
    """A pilot's mode without a pilot: throttle closed."""


FLIGHT_STATES: Mapping[Manoeuvre, LandedState] = {
    Manoeuvre.HOLD: LandedState.IN_AIR,
    Manoeuvre.TAKEOFF: LandedState.TAKEOFF,
    Manoeuvre.SETPOINT: LandedState.IN_AIR,
    Manoeuvre.GO: LandedState.IN_AIR,
    Manoeuvre.CIRCLE: LandedState.IN_AIR,
    Manoeuvre.RETURN: LandedState.IN_AIR,
    Manoeuvre.LAND: LandedState.LANDING,
    Manoeuvre.SINK: LandedState.IN_AIR,
    Manoeuvre.FALL: LandedState.IN_AIR,
}


@dataclass(frozen=True, slots=True)
class Mode:
    """One row of an autopilot's mode table."""

    name: str
    base_mode: int
    """HEARTBEAT.base_mode while disarmed."""
    manoeuvre: Manoeuvre
    can_arm: bool = False
    can_enter_flying: bool = True
    """False for modes that want a pilot or a mission the mock does not have."""
    can_enter: bool = True


Rates = Literal["lean", "shown", "full"]
"""Telemetry as a swarm needs it, 10 Hz at most, or as the real autopilots send it."""


@dataclass(frozen=True, slots=True)
class Boot:
    """When an autopilot can do what, in seconds since boot; recorded."""

    heartbeat_s: float
    """The first HEARTBEAT."""
    standby_s: float
    """The software has started."""
    gnss_s: float
    """The receiver has a fix."""
    origin_s: float
    """The origin on the globe is known."""
    home_s: float
    """HOME_POSITION is known."""
    position_s: float
    """There is a local position."""
    ready_s: float
    """It may arm."""

    def within(self, ready_s: float | None) -> Boot:
        """Shorten it to be ready so soon, the heart beating from the start; None is as recorded."""
        if ready_s is None:
            return self
        share = ready_s / self.ready_s
        times = (self.standby_s, self.gnss_s, self.origin_s, self.home_s, self.position_s)
        return Boot(0.0, *(share * time_s for time_s in (*times, self.ready_s)))


@dataclass(frozen=True, slots=True)
class Return:
    """How high a vehicle flies home."""

    height_m: float
    """Above home, unless it is higher already."""
    slope: float
    """Near home it climbs only this times its distance."""
    near_m: float
    least_climb_m: float
    """Near home it climbs at least so much, up to its height."""
    wait_s: float
    """From reaching home to the descent."""

    def height(self, height_m: float, distance_m: float) -> float:
        """Give the height of a return that starts at this height and distance from home."""
        wanted = self.height_m
        if distance_m <= self.near_m:
            near = max(distance_m * self.slope, height_m + self.least_climb_m)
            wanted = min(wanted, near)
        return max(wanted, height_m)


@dataclass(frozen=True, slots=True)
class Motors:
    """Pulses that SERVO_OUTPUT_RAW shows, us, and the thrust, 0..1, that hovers."""

    disarmed_us: int
    idle_us: int
    hover_us: int
    hover_thrust: float
    unused_us: int


@dataclass(frozen=True, slots=True)
class Traits:
    """The numbers in which two autopilots differ; all measured, see `reference/`.

    Those that a parameter decides are scaled by it, see `tuning`.
    """

    autopilot: int
    """MAV_AUTOPILOT."""
    capabilities: int
    """MAV_PROTOCOL_CAPABILITY bits."""
    flight_sw_version: int
    other_versions: tuple[int, int, int, bytes, bytes]
    """Of middleware, operating system and board, then git hashes of firmware and middleware."""
    limits: Limits
    modes: Mapping[int, Mode]
    """By custom_mode."""
    first_mode: int
    load: int
    """SYS_STATUS.load, in thousandths."""
    full_battery_v: float
    """What a full battery reads."""
    battery_kind: tuple[int, int]
    """MAV_BATTERY_FUNCTION and MAV_BATTERY_TYPE."""
    motors: Motors
    fix: Fix
    """What a good fix looks like."""
    has_receiver: bool
    """Whether there is a receiver of satellites at all."""
    backward: int
    """MAV_SENSOR_ROTATION of a rangefinder that looks back: half a turn of yaw, or of pitch."""
    gives_origin_with_home: bool
    """Whether GET_HOME_POSITION also gives GPS_GLOBAL_ORIGIN."""
    home_attitude: tuple[float, float, float, float]
    """HOME_POSITION.q."""
    guesses_airspeed: bool
    """Whether VFR_HUD takes the ground speed for airspeed."""
    estimator_flags: tuple[tuple[float, int], ...]
    """(seconds since the recorded boot, flags), latest first."""
    doubt_s: float
    """Without any position for so long the estimator says `doubting_flags`."""
    doubting_flags: int
    dead_reckoning_s: float
    """Without any position for so long there is none."""
    boot: Boot
    intervals_s: Mapping[Rates, Sequence[Mapping[int, float]]]
    """Streams that flow unasked, by message id, for each link: companion, station, viewer."""
    sources_s: Mapping[int, float]
    """By message id, the interval that none can undercut."""
    fixed_streams: frozenset[int]
    """Message ids whose interval nobody may change."""
    denial: int
    """MAV_RESULT for arming or disarming at the wrong time."""
    arm_nan_result: int | None
    """MAV_RESULT for an arm command that says NaN; None is silence."""
    arm_other_result: int | None
    """MAV_RESULT for an arm command that says neither 0 nor 1."""
    interval_refusal: int
    """MAV_RESULT for the interval of an unknown message."""
    request_refusal: int
    """MAV_RESULT for the request of an unknown message."""
    reboot_refusal: int
    """MAV_RESULT for a reboot while armed."""
    unknown_interval_us: int
    """MESSAGE_INTERVAL of an unknown message."""
    unknown_interval_result: int
    """MAV_RESULT for asking after it."""
    acknowledges_first: bool
    """Whether a requested message comes after its acknowledgement, not before."""
    vtol_state: int
    """MAV_VTOL_STATE in EXTENDED_SYS_STATE."""
    texts_armed: tuple[str, ...]
    texts_disarmed: tuple[str, ...]
    texts_disarmed_by_landing: tuple[str, ...]
    texts_takeoff: tuple[str, ...]
    texts_landing: tuple[str, ...]
    not_landed_texts: tuple[str, ...]
    """Said when a disarm command comes in flight."""
    idle_disarm_s: float
    """Armed without leaving the ground for this long disarms."""
    touchdown_s: float
    """From touching the ground to ON_GROUND."""
    landed_disarm_s: float
    """From ON_GROUND to disarmed."""
    disarms_wherever_landed: bool
    """True when a landing in any mode disarms, not in a landing mode alone."""
    takeoff_announced_s: float
    """From the take-off (or arming) to landed_state TAKEOFF."""
    takeoff_lift_s: float
    """From the take-off (or arming) to leaving the ground."""
    takeoff_height_m: float
    """Of a take-off that gives no height."""
    takeoff_speed_m_s: float
    takeoff_gain_1_s: float
    """Climb rate per height missing; larger arrives more abruptly."""
    takeoff_slack_m: float
    """The take-off is over this far below its height."""
    setpoint_announced_s: float | None
    """From arming to IN_AIR when a setpoint climbs; None where setpoints never leave the ground."""
    setpoint_lift_s: float
    """From arming to leaving the ground by a setpoint."""
    setpoint_timeout_s: float
    """Silence after which the last velocity is not flown any more."""
    land_speeds_m_s: tuple[tuple[float, float], ...]
    """(above this height, descend so fast), highest first."""
    sink_m_s: float
    """Descent in a pilot's mode without a pilot."""
    going_home: Return
