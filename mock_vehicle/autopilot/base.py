"""What both autopilots do alike: arm, leave the ground, fly manoeuvres, land, disarm."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum, IntEnum, auto
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from mock_vehicle.autopilot.streams import Streams
from mock_vehicle.dynamics import Control, Dynamics, Limits
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.commands import CommandHandler, MessageHandler
    from mock_vehicle.autopilot.streams import Encoder
    from mock_vehicle.sensors.readings import PeerFix, VictimFix

AUTOPILOT_COMPID = 1
RADIO_COMPID = 68
STATUSTEXT = wire.message("STATUSTEXT")
TEXT_LENGTH = 50

NAN = math.nan
Vector = tuple[float, float, float]
STILL: Vector = (0.0, 0.0, 0.0)
NOWHERE: Vector = (NAN, NAN, NAN)
BRAKED_M_S = 0.3
"""Slower than this a vehicle that was told to hold takes its position."""
HOME_REACHED_M = 0.5
REACTION_S = 0.3
"""A climb is planned this far ahead: ticks, delays and jerk limits eat as much."""


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


class Severity(IntEnum):
    """MAV_SEVERITY."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


class Manoeuvre(Enum):
    """What a mode makes the vehicle do in the air."""

    HOLD = auto()
    TAKEOFF = auto()
    SETPOINT = auto()
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


@dataclass(frozen=True, slots=True)
class Traits:
    """The numbers in which two autopilots differ; all measured, see `reference/`."""

    autopilot: int
    """MAV_AUTOPILOT."""
    capabilities: int
    """MAV_PROTOCOL_CAPABILITY bits."""
    flight_sw_version: int
    limits: Limits
    modes: Mapping[int, Mode]
    """By custom_mode."""
    first_mode: int
    sensors: int
    """MAV_SYS_STATUS_SENSOR bits present and enabled."""
    default_intervals_s: Mapping[int, float]
    """Streams that flow unasked, by message id."""
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


class State(NamedTuple):
    """One vehicle's row of truth and readings, as of the last refresh; local NED, SI."""

    north_m: float
    east_m: float
    down_m: float
    """Estimated position: truth - home + drift."""
    north_m_s: float
    east_m_s: float
    down_m_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    yaw_rate_rad_s: float
    on_ground: float
    drift_north_m: float
    drift_east_m: float
    drift_down_m: float
    battery_fraction: float
    battery_voltage_v: float
    battery_current_a: float
    ranges_m: list[float]


class Setpoint(NamedTuple):
    """An understood SET_POSITION_TARGET_LOCAL_NED in local NED; NaN is not given."""

    position_m: Vector = NOWHERE
    velocity_m_s: Vector = NOWHERE
    acceleration_m_s2: Vector = NOWHERE
    yaw_rad: float = NAN
    yaw_rate_rad_s: float = NAN

    @property
    def is_position_only(self) -> bool:
        """Whether it may be flown for ever."""
        return self.velocity_m_s == STILL or not any(
            map(math.isfinite, self.velocity_m_s + self.acceleration_m_s2)
        )


STOP = Setpoint(velocity_m_s=STILL)


def rotated(vector: Vector, yaw_rad: float) -> Vector:
    """Turn a level body vector (forward, right, down) into NED."""
    forward, right, down = vector
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return (cos * forward - sin * right, sin * forward + cos * right, down)


class Autopilot(ABC):
    """One mock autopilot, sans I/O; frames to send pile up in `outbox`."""

    traits: ClassVar[Traits]
    command_table: ClassVar[Mapping[int, CommandHandler]]
    """By MAV_CMD; what is not here is UNSUPPORTED."""
    message_table: ClassVar[Mapping[int, MessageHandler]]
    """By message id; what is not here is ignored."""
    streamable: ClassVar[Mapping[int, Encoder]]
    """Messages with an interval, by id."""
    requestable: ClassVar[Mapping[int, Encoder]]
    """Messages that REQUEST_MESSAGE gives, by id."""

    def __init__(
        self,
        *,
        sysid: int,
        index: int,
        uid: int,
        boot_s: float,
        home_ned_m: Vector,
        truth: Dynamics,
    ) -> None:
        self.sysid = sysid
        self.index = index
        self.uid = uid
        self.boot_s = boot_s
        self.home_ned_m = home_ned_m
        self.home_amsl_m = 0.0
        """Altitude of home; there is no global position yet."""
        self.truth = truth
        self.state = State._make([*(0.0,) * 17, [math.inf] * 6])
        self.peers: list[PeerFix] = []
        self.victims: list[VictimFix] = []
        self.range_min_m = 0.0
        self.range_max_m = 0.0
        self.outbox: list[bytes] = []
        self.streams = Streams(self.streamable, self.traits.default_intervals_s)
        self.mode = self.traits.first_mode
        self.armed = False
        self.landed_state = LandedState.ON_GROUND
        self.flying = False
        """From leaving the ground to the landing detected."""
        self.manoeuvre = self.traits.modes[self.mode].manoeuvre
        self.setpoint = STOP
        self.setpoint_at = -math.inf
        self.setpoint_times: deque[float] = deque(maxlen=10_000)
        """Arrivals of accepted setpoints."""
        self.takeoff_height_m = 2.5
        self.gcs_seen_at = -math.inf
        self._has_flown = False
        self._hold_at: Vector | None = None
        self._manoeuvre_since = 0.0
        self._armed_at = 0.0
        self._idle_since = 0.0
        self._touched_at: float | None = None
        self._sequences = {AUTOPILOT_COMPID: 0, RADIO_COMPID: 0}
        self._text_number = 0

    # What personalities decide.

    @property
    @abstractmethod
    def base_mode(self) -> int:
        """HEARTBEAT.base_mode without the armed bit."""

    @property
    def reported_mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        return self.mode

    @abstractmethod
    def system_status(self, now: float) -> SystemStatus:
        """HEARTBEAT.system_status."""

    @abstractmethod
    def accepts_command(self, system: int, component: int, number: int) -> bool:
        """Whether a command with this target is for us."""

    @abstractmethod
    def accepts_setpoint(self, system: int, component: int) -> bool:
        """Whether a setpoint with this target is for us."""

    @abstractmethod
    def arming_refusals(self, now: float, *, force: bool) -> list[str] | None:
        """Say why arming is refused (perhaps without words), or None when it is not."""

    @abstractmethod
    def receive_setpoint(self, values: Any, now: float) -> None:
        """Take a SET_POSITION_TARGET_LOCAL_NED that is for us."""

    @abstractmethod
    def advance(self, now: float) -> None:
        """Run the personality's own timers."""

    @abstractmethod
    def takeoff_done(self, now: float) -> None:
        """Go on after a take-off."""

    def may_speak(self, now: float) -> bool:  # noqa: ARG002 - PX4 looks at the time
        """Whether STATUSTEXT is sent at all."""
        return True

    # Frames.

    def send(self, message: wire.Message, *values: object, compid: int = AUTOPILOT_COMPID) -> None:
        """Queue a frame."""
        sequence = self._sequences[compid]
        self._sequences[compid] = (sequence + 1) & 0xFF
        self.outbox.append(message.pack(sequence, self.sysid, compid, *values))

    def say(self, severity: Severity, text: str, now: float) -> None:
        """Send a STATUSTEXT, in chunks if it is long."""
        if not self.may_speak(now):
            return
        chunks = [text[at : at + TEXT_LENGTH] for at in range(0, len(text), TEXT_LENGTH)]
        if len(chunks) > 1:
            self._text_number = self._text_number % 0xFFFF + 1
        number = self._text_number if len(chunks) > 1 else 0
        for sequence, chunk in enumerate(chunks):
            self.send(STATUSTEXT, severity, chunk, number, sequence)

    def _inform(self, texts: tuple[str, ...], now: float) -> None:
        for text in texts:
            self.say(Severity.INFO, text, now)

    # Time.

    def tick(self, now: float) -> None:
        """Run timers, steer, and queue the telemetry that is due."""
        self.advance(now)
        self._watch_ground(now)
        self.steer(now)
        self.streams.run(self, now)

    # Arming and modes.

    def arm(self, now: float) -> None:
        """Start the motors."""
        self.armed = True
        self.flying = self._has_flown = self.state.on_ground == 0.0
        self._armed_at = self._idle_since = now
        self._touched_at = None
        self._inform(self.traits.texts_armed, now)

    def disarm(self, now: float) -> None:
        """Stop the motors, wherever the vehicle is."""
        self.armed = False
        self.flying = False
        self._inform(self.traits.texts_disarmed, now)
        self.steer(now)

    def enter(self, number: int, now: float) -> None:
        """Change to a mode of the table; the same mode again changes nothing."""
        if number != self.mode:
            self.mode = number
            self.begin(self.traits.modes[number].manoeuvre, now)

    def begin(self, manoeuvre: Manoeuvre, now: float) -> None:
        """Start a manoeuvre anew."""
        self.manoeuvre = manoeuvre
        self._manoeuvre_since = now
        self._hold_at = None
        self.setpoint = STOP
        self.steer(now)

    def accept_setpoint(self, setpoint: Setpoint, now: float) -> None:
        """Fly this from now on, if the manoeuvre follows setpoints."""
        self.setpoint = setpoint
        self.setpoint_at = now
        self.setpoint_times.append(now)
        if self.manoeuvre is Manoeuvre.SETPOINT:
            self.steer(now)

    # The ground.

    def _watch_ground(self, now: float) -> None:
        if self.state.on_ground == 0.0:
            self._touched_at = None
            return
        if self._touched_at is None:
            self._touched_at = now
        if not self.armed:
            self.landed_state = LandedState.ON_GROUND
        elif self.flying:
            if now - self._touched_at >= self.traits.touchdown_s:
                self.flying = False
                self.landed_state = LandedState.ON_GROUND
                self._idle_since = now
                self._inform(self.traits.texts_landing, now)
        elif now - self._idle_since >= self._disarm_delay_s():
            if self._has_flown:
                self._inform(self.traits.texts_disarmed_by_landing, now)
            self.disarm(now)

    def _disarm_delay_s(self) -> float:
        is_landing = self.manoeuvre in {Manoeuvre.LAND, Manoeuvre.RETURN}
        if is_landing or (self._has_flown and self.traits.disarms_wherever_landed):
            return self.traits.landed_disarm_s
        return self.traits.idle_disarm_s

    def _wait_on_ground(self, now: float) -> None:
        """Leave the ground when the motors are up and something wants to climb."""
        self._fall(now)
        traits = self.traits
        if self.manoeuvre is Manoeuvre.TAKEOFF:
            waited = now - max(self._armed_at, self._manoeuvre_since)
            announced_s, lift_s = traits.takeoff_announced_s, traits.takeoff_lift_s
        elif traits.setpoint_announced_s is not None and self._setpoint_climbs():
            waited = now - self._armed_at
            announced_s, lift_s = traits.setpoint_announced_s, traits.setpoint_lift_s
        else:
            self.landed_state = LandedState.ON_GROUND
            return
        self._idle_since = now
        if waited >= announced_s:
            self.landed_state = FLIGHT_STATES[self.manoeuvre]
        if waited >= lift_s:
            self.flying = self._has_flown = True
            self._touched_at = None
            self._inform(traits.texts_takeoff, now)

    def _setpoint_climbs(self) -> bool:
        if self.manoeuvre is not Manoeuvre.SETPOINT:
            return False
        setpoint = self.setpoint
        climbs_to = setpoint.position_m[2] < self.state.down_m - 0.1
        return climbs_to or setpoint.velocity_m_s[2] < -0.05 or setpoint.acceleration_m_s2[2] < 0.0

    # The air.

    def steer(self, now: float) -> None:
        """Write this vehicle's control and targets into the dynamics."""
        if not self.armed:
            self._fall(now)
        elif not self.flying:
            self._wait_on_ground(now)
        else:
            self.landed_state = FLIGHT_STATES[self.manoeuvre]
            _FLY[self.manoeuvre](self, now)

    def command(
        self,
        control: Control,
        velocity_m_s: Vector = STILL,
        position_m: Vector = NOWHERE,
        yaw_rad: float = NAN,
        yaw_rate_rad_s: float = NAN,
    ) -> None:
        """Hand targets in local NED over to the dynamics, which know the world's NED alone."""
        index, state, home = self.index, self.state, self.home_ned_m
        truth = self.truth
        truth.control[index] = control
        truth.target_velocity_ned_m_s[index] = velocity_m_s
        if control is Control.POSITION:
            truth.target_position_ned_m[index] = (
                position_m[0] + home[0] - state.drift_north_m,
                position_m[1] + home[1] - state.drift_east_m,
                position_m[2] + home[2] - state.drift_down_m,
            )
        truth.target_yaw_rad[index] = yaw_rad
        truth.target_yaw_rate_rad_s[index] = yaw_rate_rad_s

    def _fall(self, now: float) -> None:  # noqa: ARG002 - manoeuvres have one signature
        self.truth.control[self.index] = Control.OFF

    def _sink(self, now: float) -> None:  # noqa: ARG002
        self.command(Control.VELOCITY, (0.0, 0.0, self.traits.sink_m_s))

    def _stopped_at(self) -> Vector | None:
        """Position to hold, once the vehicle has braked."""
        state = self.state
        if self._hold_at is None:
            speed = math.hypot(state.north_m_s, state.east_m_s)
            if speed < BRAKED_M_S and abs(state.down_m_s) < BRAKED_M_S:
                self._hold_at = state[:3]
        return self._hold_at

    def _hold(self, now: float) -> None:  # noqa: ARG002
        here = self._stopped_at()
        if here is None:
            self.command(Control.VELOCITY)
        else:
            self.command(Control.POSITION, position_m=here)

    def _take_off(self, now: float) -> None:
        if self._hold_at is None:
            self._hold_at = (self.state.north_m, self.state.east_m, -self.takeoff_height_m)
        missing = self.state.down_m + self.takeoff_height_m
        if missing <= self.traits.takeoff_slack_m:
            self.takeoff_done(now)
            return
        traits = self.traits
        soon = max(missing + REACTION_S * self.state.down_m_s, 0.0)
        braking = math.sqrt(2.0 * traits.limits.vertical.position_accel_m_s2 * soon)
        climb = min(traits.takeoff_gain_1_s * soon, traits.takeoff_speed_m_s, braking)
        north, east, _ = self._hold_at
        self.command(Control.POSITION, (0.0, 0.0, -climb), (north, east, NAN))

    def hold_takeoff_height(self, now: float) -> None:
        """Hold where the take-off ends."""
        target = self._hold_at
        self.begin(Manoeuvre.HOLD, now)
        self._hold_at = target
        self.steer(now)

    def _follow_setpoint(self, now: float) -> None:  # noqa: ARG002
        setpoint, state = self.setpoint, self.state
        gain = self.traits.limits.horizontal.velocity_gain_1_s
        axes = zip(setpoint.velocity_m_s, setpoint.acceleration_m_s2, state[3:6], strict=True)
        north, east, down = (
            wanted
            if math.isfinite(wanted)
            else current + acceleration / gain
            if math.isfinite(acceleration)
            else 0.0
            for wanted, acceleration, current in axes
        )
        has_position = any(map(math.isfinite, setpoint.position_m))
        self.command(
            Control.POSITION if has_position else Control.VELOCITY,
            (north, east, down),
            setpoint.position_m,
            setpoint.yaw_rad,
            setpoint.yaw_rate_rad_s,
        )

    def _return(self, now: float) -> None:
        state = self.state
        if self._hold_at is None:
            self._hold_at = (0.0, 0.0, state.down_m)
        if math.hypot(state.north_m, state.east_m) < HOME_REACHED_M:
            self.begin(Manoeuvre.LAND, now)
        else:
            self.command(Control.POSITION, position_m=self._hold_at)

    def _land(self, now: float) -> None:  # noqa: ARG002
        state = self.state
        height = -state.down_m
        speed = next(speed for above, speed in self.traits.land_speeds_m_s if height > above)
        if self._hold_at is None and math.hypot(state.north_m_s, state.east_m_s) < BRAKED_M_S:
            self._hold_at = state[:3]
        if self._hold_at is None:
            self.command(Control.VELOCITY, (0.0, 0.0, speed))
        else:
            north, east, _ = self._hold_at
            self.command(Control.POSITION, (0.0, 0.0, speed), (north, east, NAN))


_FLY: Mapping[Manoeuvre, Callable[[Autopilot, float], None]] = {
    Manoeuvre.HOLD: Autopilot._hold,  # noqa: SLF001 - the table of this very class
    Manoeuvre.TAKEOFF: Autopilot._take_off,  # noqa: SLF001
    Manoeuvre.SETPOINT: Autopilot._follow_setpoint,  # noqa: SLF001
    Manoeuvre.RETURN: Autopilot._return,  # noqa: SLF001
    Manoeuvre.LAND: Autopilot._land,  # noqa: SLF001
    Manoeuvre.SINK: Autopilot._sink,  # noqa: SLF001
    Manoeuvre.FALL: Autopilot._fall,  # noqa: SLF001
}
