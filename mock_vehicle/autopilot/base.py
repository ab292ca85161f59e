"""What both autopilots do alike: arm, leave the ground, fly manoeuvres, land, disarm."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from mock_vehicle.autopilot import auto, missions, ranging
from mock_vehicle.autopilot.boot import BootLog
from mock_vehicle.autopilot.fences import Geofence
from mock_vehicle.autopilot.ground import Ground
from mock_vehicle.autopilot.link import AUTOPILOT_COMPID, Link, Streams
from mock_vehicle.autopilot.manoeuvres import (
    FLY,
    NAN,
    NOWHERE,
    POSITION,
    STILL,
    STOP,
    Orbit,
    Setpoint,
    Vector,
    fall,
)
from mock_vehicle.autopilot.navigation import Navigation
from mock_vehicle.autopilot.parameter_service import ParameterService
from mock_vehicle.autopilot.parameters import Parameters
from mock_vehicle.autopilot.personality import Personality
from mock_vehicle.autopilot.progress import Progress
from mock_vehicle.autopilot.routing import Routes
from mock_vehicle.autopilot.state import State
from mock_vehicle.autopilot.traits import (
    FLIGHT_STATES,
    LandedState,
    Manoeuvre,
    Rates,
    Severity,
    shared,
)
from mock_vehicle.autopilot.transfers import Plans
from mock_vehicle.dynamics import Control, Dynamics
from mock_vehicle.faults import Trouble
from mock_vehicle.geodesy import Origin
from mock_vehicle.sensors.battery import FULL_V
from mock_vehicle.sensors.gnss import Reception
from mock_vehicle.sensors.readings import Readings
from swarm_ctl import wire
from swarm_ctl.signing import Gatekeeper

if TYPE_CHECKING:
    from mock_vehicle.sensors.readings import PeerFix, VictimFix

HEARTBEAT_ID = wire.message("HEARTBEAT").id
TUNNEL_ID = wire.message("TUNNEL").id
ACK_ID = wire.message("COMMAND_ACK").id
STATUSTEXT = wire.message("STATUSTEXT")
TEXT_LENGTH = 50
SETPOINTS_KEPT = 3_000
"""Five minutes at 10 Hz."""
DENIED = int(Reception.DENIED)
GOLDEN = 0.618
"""Its multiples, modulo 1, are far from one another, however many they are."""


class Autopilot(Personality):
    """One mock autopilot, sans I/O; frames to send pile up in the outboxes of its links."""

    # So many attributes would lie scattered in memory, and a fleet does not fit into a cache.
    __slots__ = (
        "_boot_log",
        "_boot_s",
        "_rates",
        "_site",
        "_text_number",
        "_timers",
        "armed",
        "boot",
        "booted_at",
        "descends_at",
        "flying",
        "gate",
        "geofence",
        "ground",
        "heading_rad",
        "hold_at",
        "home_at",
        "home_ned_m",
        "index",
        "is_talkative",
        "landed_state",
        "links",
        "manoeuvre",
        "navigation",
        "orbit",
        "parameter_service",
        "parameters",
        "peers",
        "plans",
        "progress",
        "readings",
        "refusals",
        "return_m",
        "routes",
        "setpoint",
        "setpoint_at",
        "setpoint_times",
        "speed_m_s",
        "stale_state",
        "state",
        "sysid",
        "takeoff_height_m",
        "to",
        "truth",
        "uid",
        "victims",
    )

    def __init__(
        self,
        *,
        sysid: int,
        index: int,
        uid: int,
        boot_s: float | None,
        home_ned_m: Vector,
        origin: Origin,
        truth: Dynamics,
        rates: Rates = "lean",
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self.sysid = sysid
        self.index = index
        self.uid = uid
        self.home_ned_m = home_ned_m
        self.truth = truth
        self.state = State._make([*(0.0,) * 21, [math.inf] * 6])
        self._site = origin
        self.peers: list[PeerFix] = []
        self.victims: list[VictimFix] = []
        self.readings = Readings.blank(0)
        """Of the whole fleet."""
        self.plans = Plans(self.plan_rules)
        """Missions, geofence and rally points; they survive reboots."""
        self.refusals: Sequence[Trouble] = ()
        """Commands that are refused, whatever they ask."""
        self.stale_state: State | None = None
        """What the streams repeat while telemetry is frozen."""
        self.gate = Gatekeeper()
        self._rates = rates
        self.is_talkative = rates == "full"
        """Whether it says all that the real ones say, not only what a swarm needs."""
        self._boot_s = boot_s
        self.parameters = Parameters(
            self.dialect, {**(parameters or {}), self.dialect.sysid: sysid}
        )
        """As they are stored; `set_parameter` changes them."""
        self._restart(0.0)

    def _restart(self, now: float) -> None:
        """Forget everything that a reboot makes an autopilot forget."""
        self.booted_at = now
        self.sysid = self.parameters.sysid or self.sysid
        self.parameter_service = ParameterService(self.parameters)
        self.tune()
        self.boot = shared(self.traits.boot.within(self._boot_s))
        """When it can do what, in seconds since boot."""
        self.navigation = Navigation(self._site)
        self._timers: list[tuple[float, Callable[[float], None]]] = []
        self._boot_log = BootLog(self.announcements if self.is_talkative else ())
        subscribed = {*self.message_table, HEARTBEAT_ID, TUNNEL_ID, ACK_ID}
        phase = self.index * GOLDEN % 1.0 if self._rates == "full" else 0.0
        self.links = [
            Link(
                number,
                subscribed,
                Streams(self.streamable, intervals_s, self.traits.sources_s, phase),
                self.gate,
            )
            for number, intervals_s in enumerate(self.traits.intervals_s[self._rates])
        ]
        self.to: Sequence[Link] = self.links
        """The links that `send` serves at the moment."""
        self.routes = Routes(self.sysid, AUTOPILOT_COMPID)
        self.mode = self.traits.first_mode
        self.armed = False
        self.landed_state = LandedState.ON_GROUND
        self.flying = False
        """From leaving the ground to the landing detected."""
        self.manoeuvre = self.traits.modes[self.mode].manoeuvre
        self.setpoint = STOP
        self.setpoint_at = -math.inf
        self.setpoint_times = array("d")
        """Arrivals of accepted setpoints, the latest of them."""
        self.takeoff_height_m = self.traits.takeoff_height_m
        self.hold_at: Vector | None = None
        """Place that the manoeuvre keeps to, once it has one."""
        self.descends_at = now
        """When a landing begins to descend."""
        self.home_at: float | None = None
        """When the manoeuvre reached home."""
        self.plans.transfer = None
        self.progress = Progress()
        """How far the mission has been flown."""
        self.speed_m_s: float | None = None
        """Asked for in place of the cruise, until the mode changes."""
        self.heading_rad = NAN
        """Where the nose points unless a manoeuvre or a setpoint turns it."""
        self.orbit = Orbit()
        self.return_m: tuple[float, float] | None = None
        """Where the manoeuvre returns to, home or a rally point, once it has chosen."""
        self.geofence = Geofence()
        self.ground = Ground(now)
        self._text_number = 0

    # Frames.

    def send(self, message: wire.Message, *values: object, compid: int = AUTOPILOT_COMPID) -> None:
        """Queue a frame on the links that are served at the moment."""
        for link in self.to:
            link.post(message.pack(link.sequence(compid), self.sysid, compid, *values))

    @contextmanager
    def serving(self, *links: Link) -> Iterator[None]:
        """Send over these links alone."""
        before, self.to = self.to, links
        try:
            yield
        finally:
            self.to = before

    def say(self, severity: Severity, text: str, now: float) -> None:
        """Send a STATUSTEXT, in chunks if it is long."""
        chunks = [text[at : at + TEXT_LENGTH] for at in range(0, len(text), TEXT_LENGTH)]
        if len(chunks) > 1:
            self._text_number = self._text_number % 0xFFFF + 1
        number = self._text_number if len(chunks) > 1 else 0
        with self.serving(*(link for link in self.links if self.may_speak(link, now))):
            for sequence, chunk in enumerate(chunks):
                self.send(STATUSTEXT, severity, chunk, number, sequence)

    def refuse_to_arm(self, texts: Sequence[str], now: float) -> None:
        """Say why."""
        for text in texts:
            self.say(Severity.CRITICAL, text, now)

    def inform(self, texts: tuple[str, ...], now: float) -> None:
        """Send texts that warn of nothing."""
        for text in texts:
            self.say(Severity.INFO, text, now)

    # Places.

    @property
    def receives_gnss(self) -> bool:
        """Whether there are satellites, and something to receive them with."""
        return self.traits.has_receiver and self.state.reception > DENIED

    @property
    def origin(self) -> Origin:
        """Where it believes its local frame to lie on the globe."""
        return self.navigation.origin

    @property
    def battery_v(self) -> float:
        """What its battery reads."""
        return self.state.battery_voltage_v * self.battery_scale

    @property
    def battery_scale(self) -> float:
        """Its battery's voltage over that of the four cells that all vehicles are computed with."""
        return self.traits.full_battery_v / FULL_V

    # Time.

    def uptime_s(self, now: float) -> float:
        """Tell the time since boot."""
        return now - self.booted_at

    def recorded_s(self, now: float) -> float:
        """Tell how far a boot of the recorded length would be."""
        whole_s, ready_s = self.traits.boot.ready_s, self.boot.ready_s
        return self.uptime_s(now) * whole_s / ready_s if ready_s else math.inf

    def is_ready(self, now: float) -> bool:
        """Whether the checks before arming have all passed once."""
        return self.uptime_s(now) >= self.boot.ready_s

    def has_position(self, now: float) -> bool:
        """Whether there is an estimate of the local position."""
        return self.navigation.has_position(self, now)

    def tick(self, now: float) -> None:
        """Run timers, steer, and queue the telemetry that is due."""
        self.gate.advance(now)
        self.advance(now)
        missions.watch(self, now)
        auto.run(self, now)
        self.ground.watch(self, now)
        self.steer(now)
        current, self.state = self.state, self.stale_state or self.state
        for link in self.links if self.uptime_s(now) >= self.boot.heartbeat_s else ():
            self.to = (link,)
            link.streams.run(self, now)
        self.state = current
        self.to = self.links
        self.parameter_service.run(self, now)
        self.to = self.links[:1]
        if self.peers:
            ranging.peers(self)
        if self.victims:
            ranging.victims(self, now)
        self.to = self.links
        self.navigation.update(self, now)
        self._boot_log.run(self, now)
        if self._timers:
            self._run_timers(now)

    def admits(self, frame: wire.Frame, link: Link) -> bool:
        """Whether a frame may be obeyed; each kind that may not is told of once over a link."""
        refusal = link.refusal(frame)
        if refusal:
            with self.serving(link):
                self.send(STATUSTEXT, Severity.WARNING, refusal, 0, 0)
        return refusal is None

    def receive(self, frame: wire.Frame, link: Link, now: float) -> None:
        """Obey a frame that came over a link, and answer there, or pass it on to whom it is for."""
        handler = self.message_table.get(frame.id)
        if not self.routes.pass_on(frame, link) and handler is not None:
            self.to = (link,)
            handler(self, frame, now)
            self.to = self.links

    def later(self, at_s: float, act: Callable[[float], None]) -> None:
        """Do something at a time; a reboot forgets it."""
        self._timers.append((at_s, act))

    def _run_timers(self, now: float) -> None:
        due = [timer for timer in self._timers if timer[0] <= now]
        self._timers = [timer for timer in self._timers if timer[0] > now]
        for _, act in due:
            act(now)

    def reboot(self, now: float) -> None:
        """Start again, motors off, as after power-on."""
        self.armed = False
        self._restart(now)
        self.steer(now)

    def set_parameter(self, name: str, value: float) -> None:
        """Store a parameter; a sysid counts from the next boot on."""
        self.parameters[name] = value
        self.tune()

    def tune(self) -> None:
        """Work out anew what the parameters decide."""
        before, self.traits = self.traits.limits, self.tuned()
        if self.traits.limits != before:
            self.truth.relimit(self.index, self.traits.limits)

    # Arming and modes.

    def arm(self, now: float) -> None:
        """Start the motors."""
        if self.mode == self.mission_mode:
            auto.prepare(self)
        self.armed = True
        self.flying = self.state.on_ground == 0.0
        self.ground.arm(flying=self.flying, now=now)
        self.inform(self.traits.texts_armed, now)
        self.navigation.set_home(self, self.state[:3], now)

    def disarm(self, now: float) -> None:
        """Stop the motors, wherever the vehicle is."""
        self.armed = False
        self.flying = False
        self.inform(self.traits.texts_disarmed, now)
        self.steer(now)

    def disarm_landed(self, now: float) -> None:
        """Stop the motors after a landing."""
        self.inform(self.traits.texts_disarmed_by_landing, now)
        self.disarm(now)

    def enter(self, number: int, now: float) -> None:
        """Change to a mode of the table; the same mode again changes nothing."""
        if number != self.mode:
            self.mode = number
            self.speed_m_s = None
            if number == self.mission_mode:
                auto.prepare(self)
            self.begin(self.traits.modes[number].manoeuvre, now)

    def begin(self, manoeuvre: Manoeuvre, now: float) -> None:
        """Start a manoeuvre anew."""
        self.manoeuvre = manoeuvre
        self.ground.begun_at = now
        self.hold_at = self.home_at = self.return_m = None
        self.descends_at = now
        self.setpoint = STOP
        self.heading_rad = NAN
        self.steer(now)

    def go_to(self, place_m: Vector, now: float) -> None:
        """Fly to a place and stay there."""
        self.begin(Manoeuvre.GO, now)
        self.hold_at = place_m
        self.steer(now)

    def circle(self, orbit: Orbit, now: float) -> None:
        """Fly round a place."""
        self.orbit = orbit
        self.begin(Manoeuvre.CIRCLE, now)

    def return_in_mission(self, now: float) -> None:
        """Fly home as an item of the mission."""
        self.begin(Manoeuvre.RETURN, now)

    @property
    def cruise_m_s(self) -> float:
        """How fast it flies from place to place."""
        name, unit_m_s = self.auto_rules.cruise
        cruise_m_s = self.parameters.finite(name, 0.1 / unit_m_s, 100.0 / unit_m_s) * unit_m_s
        return cruise_m_s if self.speed_m_s is None else self.speed_m_s

    def accept_setpoint(self, setpoint: Setpoint, now: float) -> None:
        """Fly this from now on, if the manoeuvre follows setpoints."""
        self.setpoint = setpoint
        self.setpoint_at = now
        self.setpoint_times.append(now)
        del self.setpoint_times[:-SETPOINTS_KEPT]
        if self.manoeuvre is Manoeuvre.SETPOINT:
            self.steer(now)

    # The air.

    def steer(self, now: float) -> None:
        """Write this vehicle's control and targets into the dynamics."""
        if not self.armed:
            fall(self, now)
        elif not self.flying:
            self.ground.wait(self, now)
        else:
            self.landed_state = FLIGHT_STATES[self.manoeuvre]
            FLY[self.manoeuvre](self, now)

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
        if control is POSITION:
            truth.target_position_ned_m[index] = (
                position_m[0] + home[0] - state.drift_north_m,
                position_m[1] + home[1] - state.drift_east_m,
                position_m[2] + home[2] - state.drift_down_m,
            )
        is_steered = math.isfinite(yaw_rad) or math.isfinite(yaw_rate_rad_s)
        truth.target_yaw_rad[index] = yaw_rad if is_steered else self.heading_rad
        truth.target_yaw_rate_rad_s[index] = yaw_rate_rad_s

    def hold_takeoff_height(self, now: float) -> None:
        """Hold where the take-off ends."""
        target = self.hold_at
        self.begin(Manoeuvre.HOLD, now)
        self.hold_at = target
        self.steer(now)
