"""ArduCopter 4.7, as recorded in `reference/ardupilot` (SITL, default parameters)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from mock_vehicle.autopilot import (
    ardupilot_fence,
    ardupilot_telemetry,
    boot,
    commands,
    downloads,
    ftp,
    gnss,
    goto,
    keys,
    maintenance,
    mission_commands,
    missions,
    parameter_service,
    parameters,
    rates,
    requests,
    sitl_faults,
    streams,
    transfers,
    tuning,
    uploads,
)
from mock_vehicle.autopilot import ardupilot_setpoints as setpoints
from mock_vehicle.autopilot.ardupilot_failsafe import Failsafe, Settings
from mock_vehicle.autopilot.ardupilot_statistics import Statistics
from mock_vehicle.autopilot.ardupilot_traits import (
    ALLOW_ARMING,
    AUTO,
    BANNER,
    ENTRY_TEXTS,
    GUIDED,
    LAND,
    LOITER,
    MODES,
    RTL,
    STABILIZE,
    TRAITS,
    UNCHECKED,
)
from mock_vehicle.autopilot.auto_rules import ARDUPILOT_AUTO, AutoRules
from mock_vehicle.autopilot.base import Autopilot
from mock_vehicle.autopilot.commands import Command, CommandHandler, MessageHandler, Result, whole
from mock_vehicle.autopilot.ekf_failsafe import EkfFailsafe
from mock_vehicle.autopilot.fences import Breach, FenceSettings
from mock_vehicle.autopilot.legs import NAVIGATION
from mock_vehicle.autopilot.link import Encoder, Link
from mock_vehicle.autopilot.manoeuvres import STOP, Setpoint, Vector
from mock_vehicle.autopilot.plans import ARDUPILOT_RULES, Cmd, Item, Kind, PlanRules
from mock_vehicle.autopilot.traits import (
    LandedState,
    Manoeuvre,
    Severity,
    SystemStatus,
    Traits,
    shared,
)
from swarm_ctl import wire

SENSORS_PRESENT, SENSORS_ENABLED, SENSORS_HEALTHY = 0x5371FC0F, 0x5341FC0F, 0x4751FC0F
SENSOR_GNSS, SENSOR_FENCE, SENSOR_AHRS, SENSOR_LOGGING = 0x20, 0x100000, 0x200000, 0x1000000
POSITION_CONTROL = 0x6000
BASE_MODE_STABILIZE, BASE_MODE_GUIDED = 81, 89
PREARM_EVERY_S = 26.4
LAND_PAUSE_S = 4.0
"""From a failsafe to the descent, as two of them were recorded."""
FASTEST_INTERVAL_US = 5000
CUSTOM_MODE_ENABLED = 1


def set_mode(autopilot: ArduPilot, command: Command, now: float) -> int:
    """Change the mode by number; param1 must say that it is a custom mode."""
    base, number = whole(command.params[0]), whole(command.params[1])
    if base is None or not base & CUSTOM_MODE_ENABLED:
        return Result.DENIED
    return autopilot.choose(-1 if number is None else number, now)


def takeoff(autopilot: ArduPilot, command: Command, now: float) -> int:
    """Climb to param7 above home; only in GUIDED, armed, on the ground."""
    height = command.params[6]
    ready = autopilot.armed and autopilot.mode == GUIDED and not autopilot.flying
    if not ready or not math.isfinite(height) or height <= 0.0:
        return Result.FAILED
    autopilot.takeoff_height_m = height
    autopilot.begin(Manoeuvre.TAKEOFF, now)
    return Result.ACCEPTED


def set_message_interval(autopilot: ArduPilot, command: Command, now: float) -> int:
    """Refuse what is faster than the main loop, unknown, or has a param3, and say why."""
    number, (interval_us, reserved) = whole(command.params[0]), command.params[1:3]
    if number not in autopilot.streamable:
        autopilot.say(Severity.INFO, f"No ap_message for mavlink id ({number})", now)
    elif 0.0 < interval_us < FASTEST_INTERVAL_US:
        text = f"Requested rate for message ID {number} too fast. Increase SCHED_LOOP_RATE"
        autopilot.say(Severity.INFO, text, now)
        return Result.DENIED
    if reserved and not math.isnan(reserved):
        return Result.DENIED
    return requests.set_message_interval(autopilot, command, now)


def on_heartbeat(autopilot: ArduPilot, frame: wire.Frame, now: float) -> None:
    """Note that its own ground station, which is known by its sysid alone, is still there."""
    commands.on_heartbeat(autopilot, frame, now)
    if frame.sysid == autopilot.settings.gcs_sysid:
        autopilot.failsafe.gcs_seen_at = now


def on_set_mode(autopilot: ArduPilot, frame: wire.Frame, now: float) -> None:
    """Obey SET_MODE without a word."""
    v = frame.values
    if v.target_system in {0, autopilot.sysid}:
        autopilot.choose(v.custom_mode, now)


class ArduPilot(Autopilot):
    """The ArduPilot personality."""

    traits: Traits = TRAITS
    dialect: ClassVar[parameters.Dialect] = parameters.ARDUPILOT
    command_table: ClassVar[Mapping[int, CommandHandler]] = {
        **commands.COMMANDS,
        **requests.COMMANDS,
        **gnss.COMMANDS,
        **maintenance.ARDUPILOT_COMMANDS,
        commands.DO_SET_MODE: set_mode,
        commands.NAV_TAKEOFF: takeoff,
        commands.NAV_LAND: commands.mode_command(LAND),
        commands.NAV_RETURN_TO_LAUNCH: commands.mode_command(RTL),
        commands.NAV_LOITER_UNLIM: commands.mode_command(LOITER),
        ardupilot_fence.DO_FENCE_ENABLE: ardupilot_fence.enable,
        goto.DO_REPOSITION: goto.reposition_ardupilot,
        mission_commands.MISSION_START: mission_commands.start_ardupilot,
        mission_commands.DO_SET_MISSION_CURRENT: mission_commands.set_mission_current,
        mission_commands.DO_PAUSE_CONTINUE: mission_commands.pause,
        mission_commands.DO_CHANGE_SPEED: mission_commands.check_speed,
        mission_commands.CONDITION_YAW: mission_commands.condition_yaw,
        requests.SET_MESSAGE_INTERVAL: set_message_interval,
    }
    message_table: ClassVar[Mapping[int, MessageHandler]] = {
        **commands.MESSAGES,
        **parameter_service.MESSAGES,
        **missions.MESSAGES,
        goto.GLOBAL_SETPOINT.id: goto.on_global_setpoint,
        goto.ATTITUDE_SETPOINT.id: goto.on_attitude_setpoint,
        **gnss.MESSAGES,
        uploads.MISSION_WRITE_PARTIAL_LIST.id: uploads.on_write_partial_list,
        **ftp.MESSAGES,
        commands.HEARTBEAT.id: on_heartbeat,
        **keys.MESSAGES,
        commands.SET_MODE.id: on_set_mode,
        requests.REQUEST_DATA_STREAM.id: requests.on_request_data_stream,
    }
    plan_rules: ClassVar[PlanRules] = ARDUPILOT_RULES
    auto_rules: ClassVar[AutoRules] = ARDUPILOT_AUTO
    mission_mode: ClassVar[int] = AUTO
    streamable: ClassVar[Mapping[int, Encoder]] = ardupilot_telemetry.STREAMS
    requestable: ClassVar[Mapping[int, Encoder]] = ardupilot_telemetry.STREAMS
    announcements: ClassVar[Sequence[boot.Announcement]] = boot.ANNOUNCEMENTS
    stream_groups: ClassVar[Mapping[int, Sequence[int]]] = rates.ARDUPILOT_GROUPS

    def _restart(self, now: float) -> None:
        self.failsafe, self.ekf_failsafe = Failsafe(), EkfFailsafe()
        self._statistics = Statistics(now)
        self._has_started = False
        self._checked_at = math.inf
        """When the checks were last told; they are repeated once somebody has asked."""
        self._flight_log = boot.FlightLog()
        self._texts: list[tuple[Severity, str]] | None = None
        super()._restart(now)

    @property
    def banner(self) -> Sequence[str]:
        """Firmware, board and frame; the record's board has an MD5 sum for a name."""
        return (BANNER, f"Md{self.uid & (1 << 120) - 1:030x}", "Frame: QUAD/PLUS")

    @property
    def base_mode(self) -> int:
        """As the mode table says, but for the start, a blind LAND and a mission over."""
        if not self._has_started:
            return BASE_MODE_GUIDED
        has_flown_mission = self.mode == AUTO and not self.armed and self.progress.is_complete
        is_blind = self._lands_blindly or has_flown_mission
        return BASE_MODE_STABILIZE if is_blind else MODES[self.mode].base_mode

    @property
    def _lands_blindly(self) -> bool:
        return self.mode == LAND and self.armed and self.ekf_failsafe.is_on

    def tuned(self) -> Traits:
        """Scale the recorded numbers by the parameters."""
        return tuning.ardupilot(TRAITS, self.parameters)

    def tune(self) -> None:
        """Work out the failsafes and what the simulator breaks, too."""
        super().tune()
        self.settings = shared(Settings.of(self.parameters))
        self.fence_settings = shared(FenceSettings.of_ardupilot(self.parameters))
        self.ordered_faults = sitl_faults.ordered(self.parameters)

    def system_status(self, now: float) -> SystemStatus:
        """STANDBY also while armed on the ground; ACTIVE once the motors are up."""
        if self.uptime_s(now) < self.boot.standby_s:
            return SystemStatus.BOOT
        if self.failsafe.is_active or self.ekf_failsafe.is_on:
            return SystemStatus.CRITICAL
        on_ground = self.landed_state is LandedState.ON_GROUND
        return SystemStatus.STANDBY if on_ground else SystemStatus.ACTIVE

    def accepts_command(self, system: int, component: int, number: int) -> bool:  # noqa: ARG002
        """Execute broadcasts, and what is meant for components that do not exist."""
        return system in {0, self.sysid}

    def accepts_setpoint(self, system: int, component: int) -> bool:  # noqa: ARG002
        """Obey broadcasts, too."""
        return system in {0, self.sysid}

    def arming_refusals(self, now: float, *, force: bool) -> list[str] | None:
        """Refuse while booting, without a position, and in modes that have no take-off."""
        reasons = self.failed_checks(now)
        if self.is_ready(now) and force:
            return None
        return [f"Arm: {reason}" for reason in reasons] or None

    def failed_checks(self, now: float) -> list[str]:
        """Give the reasons not to arm."""
        reasons: list[str] = []
        has_started = self.uptime_s(now) >= self.boot.standby_s
        is_free = not self.settings.checks_arming and self.mode in UNCHECKED
        if is_free and has_started:
            return reasons
        if not self.is_ready(now):
            reasons += boot.refusals(self.recorded_s(now))
        elif not self.has_position(now):
            reasons += boot.LAST_REFUSAL
        if has_started:
            reasons += [*ardupilot_fence.arming_refusals(self), *self._mode_refusals()]
        return reasons

    def _mode_refusals(self) -> list[str]:
        mode = MODES[self.mode]
        if self.mode == AUTO and not self.plans.has_mission:
            return ["Mode requires mission"]
        allowed = self.mode == AUTO and int(self.parameters["AUTO_OPTIONS"]) & ALLOW_ARMING
        return [] if mode.can_arm or allowed else [f"{mode.name} mode not armable"]

    def _start(self, now: float) -> None:
        """End the start of the software, which forgets the mode set meanwhile."""
        self.enter(STABILIZE, now)
        self._has_started = True

    def receive(self, frame: wire.Frame, link: Link, now: float) -> None:
        """Say after the answer what there is to say."""
        self._texts = []
        super().receive(frame, link, now)
        texts, self._texts = self._texts, None
        for severity, text in texts:
            self.say(severity, text, now)
        if self.plans.untold:
            transfers.tell_totals(self)

    def say(self, severity: Severity, text: str, now: float) -> None:
        """Keep a text until the answer to a frame has been given; while it starts, do not."""
        if self._texts is None or not self._has_started:
            super().say(severity, text, now)
        else:
            self._texts.append((severity, text))

    def sensor_bits(self, now: float) -> tuple[int, int, int]:  # noqa: ARG002
        """Show the receiver once it has had a fix, the estimator once it has an origin."""
        present, enabled, health = SENSORS_PRESENT, SENSORS_ENABLED, SENSORS_HEALTHY
        if self.navigation.knows_time:
            present, enabled, health = (bits | SENSOR_GNSS for bits in (present, enabled, health))
        if self.navigation.has_origin or self.readings.has_odometry:
            enabled, health = enabled | SENSOR_AHRS, health | SENSOR_AHRS
        if self.fence_settings.is_on:
            present, enabled = present | SENSOR_FENCE, enabled | SENSOR_FENCE
            health |= SENSOR_FENCE if self.geofence.breach is Breach.NONE else 0
        if MODES[self.mode].manoeuvre is Manoeuvre.FALL:
            enabled, health = enabled & ~POSITION_CONTROL, health & ~POSITION_CONTROL
        return present, enabled if self.armed else enabled & ~SENSOR_LOGGING, health

    def announce_origin(self, now: float) -> None:
        """Tell origin and home at once."""
        self.announce_home(now)

    def announce_home(self, now: float) -> None:
        """Tell origin and home at once; home is also the first item of a mission."""
        if not self.plans.mission:
            self.plans.replace(Kind.MISSION, [downloads.home_item(self)])
        if self.is_talkative:
            gnss.global_origin(self, now)
            gnss.home_position(self, now)

    def enter(self, number: int, now: float) -> None:
        """Tell a change of mode at once by a HEARTBEAT."""
        changes = number != self.mode
        super().enter(number, now)
        if changes:
            streams.heartbeat(self, now)

    def enter_by_failsafe(self, number: int, now: float) -> None:
        """Change to a mode, and let the pilot see it before a landing descends."""
        is_new = number != self.mode
        self.enter(number, now)
        if is_new and number == LAND:
            self.descends_at = now + LAND_PAUSE_S
            self.steer(now)

    def choose(self, number: int, now: float) -> int:
        """Change the mode, or say why not."""
        mode = MODES.get(number)
        if mode is None:
            self.say(Severity.WARNING, f"No such mode {number}", now)
            return Result.FAILED
        if number in ENTRY_TEXTS:
            self.say(Severity.WARNING, ENTRY_TEXTS[number], now)
        if not mode.can_enter or (number == AUTO and self.armed and not self._may_begin(now)):
            self.say(Severity.WARNING, f"Mode change to {mode.name} failed: init failed", now)
            return Result.FAILED
        self.enter(number, now)
        return Result.ACCEPTED

    def _may_begin(self, now: float) -> bool:
        """Whether there is a mission, and on the ground one that takes off."""
        items = self.plans.mission
        can_fly = self.plans.has_mission and self.navigation.has_origin
        if self.flying or not can_fly:
            return can_fly
        begins = next((item.command for item in items[1:] if item.command in NAVIGATION), None)
        if begins != Cmd.NAV_TAKEOFF:
            self.say(Severity.CRITICAL, "Auto: Missing Takeoff Cmd", now)
        return begins == Cmd.NAV_TAKEOFF

    def advance(self, now: float) -> None:
        """Start, check, fail safe, and brake when a velocity has grown old."""
        if not self._has_started and self.uptime_s(now) >= self.boot.standby_s:
            self._start(now)
        if self.is_talkative and now - self._checked_at >= PREARM_EVERY_S:
            self.check(now)
        if self.is_talkative:
            self._flight_log.run(self, now)
        self.failsafe.watch(self, now)
        self.ekf_failsafe.watch(self, now)
        ardupilot_fence.watch(self, now)
        if self.is_talkative:
            self._statistics.watch(self, now)
        self._brake_when_old(now)

    def check(self, now: float) -> None:
        """Say why it would not arm."""
        self._checked_at = now
        if not self.armed:
            for reason in self.failed_checks(now):
                self.say(Severity.CRITICAL, f"PreArm: {reason}", now)

    def _brake_when_old(self, now: float) -> None:
        """Brake on an old velocity; a position is held for ever."""
        is_old = now - self.setpoint_at >= self.traits.setpoint_timeout_s
        if is_old and self.manoeuvre is Manoeuvre.SETPOINT and not self.setpoint.is_position_only:
            self.setpoint = STOP

    def takeoff_done(self, now: float) -> None:
        """GUIDED goes on holding the height."""
        self.hold_takeoff_height(now)

    def receive_setpoint(self, values: Any, now: float) -> None:
        """Follow a setpoint in GUIDED; one that comes during a take-off ends it, wherever it is."""
        self.receive_attitude(setpoints.read(values, self.state[:3], self.state.yaw_rad), now)

    def receive_attitude(self, setpoint: Setpoint, now: float) -> None:
        """Follow it in GUIDED, as any other setpoint."""
        if not self.armed or not self.is_guided:
            return
        if self.manoeuvre is not Manoeuvre.SETPOINT:
            self.begin(Manoeuvre.SETPOINT, now)
        self.accept_setpoint(setpoint, now)

    @property
    def is_guided(self) -> bool:
        """Whether it takes orders from afar."""
        return self.mode == GUIDED

    def guide_to(self, place_m: Vector, now: float) -> None:
        """Fly to a place in GUIDED; on the ground that is the mode alone."""
        self.enter(GUIDED, now)
        if self.flying:
            self.go_to(place_m, now)

    def take_guided_item(self, item: Item, current: int, now: float) -> int | None:
        """Fly to an item in GUIDED."""
        return goto.take_guided_item(self, item, current, now)
