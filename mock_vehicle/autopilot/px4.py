"""PX4 1.17, as recorded in `reference/px4` (SIH quadcopter, default parameters)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from mock_vehicle.autopilot import (
    clock,
    commands,
    ftp,
    gnss,
    goto,
    maintenance,
    mission_commands,
    missions,
    parameter_service,
    parameters,
    px4_events,
    px4_telemetry,
    requests,
    tuning,
)
from mock_vehicle.autopilot import px4_setpoints as setpoints
from mock_vehicle.autopilot.auto_rules import PX4_AUTO, AutoRules
from mock_vehicle.autopilot.base import Autopilot
from mock_vehicle.autopilot.commands import Command, CommandHandler, MessageHandler, Result, whole
from mock_vehicle.autopilot.fences import UNBROKEN, Breach, FenceSettings
from mock_vehicle.autopilot.link import Encoder, Link
from mock_vehicle.autopilot.manoeuvres import Setpoint
from mock_vehicle.autopilot.plans import PX4_RULES, PlanRules
from mock_vehicle.autopilot.px4_failsafe import NONE, TERMINATE, Action, Failsafe, Settings
from mock_vehicle.autopilot.px4_traits import (
    AUTO_LAND,
    AUTO_LOITER,
    AUTO_MISSION,
    AUTO_RTL,
    AUTO_TAKEOFF,
    BASE_MODE_OFFBOARD_SILENT,
    CHOSEN_ACTIONS,
    FAILSAFE_MODES,
    MAIN_AUTO,
    MAIN_MODES,
    MODES,
    OFFBOARD,
    SUB_MISSION,
    TRAITS,
    custom_mode,
)
from mock_vehicle.autopilot.traits import (
    Manoeuvre,
    Severity,
    SystemStatus,
    Traits,
    shared,
)
from swarm_ctl import wire

SENSORS_S = 2.5
"""When the recorded boot first named its sensors."""
SENSORS_PRESENT, SENSORS_ENABLED, SENSORS_HEALTHY = 0x300400F, 0x301400F, 0x320C83F
SENSOR_GNSS = 0x20
GCS_TIMEOUT_S = 3.0
LOOP_S, ACKS_PER_LOOP = 0.01, 4.0
"""The commander's loop, and how many acknowledgements fit into its queue."""


def set_mode(autopilot: Px4, command: Command, now: float) -> int:
    """Change the mode by main and sub mode; the link acknowledges at once, then the commander."""
    commands.acknowledge(autopilot, command, Result.ACCEPTED)
    main, sub = whole(command.params[1]), whole(command.params[2])
    return autopilot.choose(main or 0, sub or 0, now)


def takeoff(autopilot: Px4, command: Command, now: float) -> int:
    """Choose AUTO.TAKEOFF; param7 is AMSL, NaN is MIS_TAKEOFF_ALT. It does not arm."""
    latitude, longitude, altitude = command.params[4:7]
    height = autopilot.traits.takeoff_height_m
    if math.isfinite(altitude):
        height = altitude - autopilot.origin.amsl_m
    if latitude == longitude == 0.0:
        height = 0.0  # accepted, and never climbs (reference/clients.md, fact 19)
    autopilot.takeoff_height_m = max(height, -autopilot.state.down_m)
    autopilot.enter(AUTO_TAKEOFF, now)
    autopilot.begin(Manoeuvre.TAKEOFF, now)
    return Result.ACCEPTED


def on_set_mode(autopilot: Px4, frame: wire.Frame, now: float) -> None:
    """Obey SET_MODE as DO_SET_MODE, with one acknowledgement."""
    v = frame.values
    if v.target_system in {0, autopilot.sysid}:
        result = autopilot.choose(v.custom_mode >> 16 & 0xFF, v.custom_mode >> 24, now)
        command = Command(commands.DO_SET_MODE, (), frame.sysid, frame.compid)
        commands.acknowledge(autopilot, command, result)


class Px4(Autopilot):
    """The PX4 personality."""

    traits: Traits = TRAITS
    dialect: ClassVar[parameters.Dialect] = parameters.PX4
    command_table: ClassVar[Mapping[int, CommandHandler]] = {
        **commands.COMMANDS,
        **requests.COMMANDS,
        **gnss.COMMANDS,
        **maintenance.PX4_COMMANDS,
        maintenance.RUN_PREARM_CHECKS: px4_events.report_checks,
        requests.REQUEST_PROTOCOL_VERSION: requests.request_protocol_version,
        commands.DO_SET_MODE: set_mode,
        commands.NAV_TAKEOFF: takeoff,
        commands.NAV_LAND: commands.mode_command(AUTO_LAND),
        commands.NAV_RETURN_TO_LAUNCH: commands.mode_command(AUTO_RTL),
        goto.DO_REPOSITION: goto.reposition_px4,
        goto.DO_ORBIT: goto.orbit_px4,
        mission_commands.MISSION_START: mission_commands.start_px4,
        mission_commands.DO_CHANGE_SPEED: mission_commands.accept_speed,
    }
    message_table: ClassVar[Mapping[int, MessageHandler]] = {
        **commands.MESSAGES,
        **parameter_service.MESSAGES,
        **missions.MESSAGES,
        goto.GLOBAL_SETPOINT.id: goto.on_global_setpoint_px4,
        goto.ATTITUDE_SETPOINT.id: goto.on_attitude_setpoint,
        **ftp.MESSAGES,
        **gnss.MESSAGES,
        commands.SET_MODE.id: on_set_mode,
        clock.PING.id: clock.on_ping,
    }
    plan_rules: ClassVar[PlanRules] = PX4_RULES
    auto_rules: ClassVar[AutoRules] = PX4_AUTO
    mission_mode: ClassVar[int] = AUTO_MISSION
    streamable: ClassVar[Mapping[int, Encoder]] = px4_telemetry.STREAMS
    requestable: ClassVar[Mapping[int, Encoder]] = px4_telemetry.REQUESTS

    def _restart(self, now: float) -> None:
        self.failsafe = Failsafe()
        self._loop_at = -math.inf
        self.events_told = 0
        super()._restart(now)

    def receive(self, frame: wire.Frame, link: Link, now: float) -> None:
        """Acknowledge no more commands of one burst than the real one can keep in its queue."""
        if self.is_talkative and now - self._loop_at >= LOOP_S:
            self._loop_at, self.acks_left = now, ACKS_PER_LOOP
        super().receive(frame, link, now)

    @property
    def in_failsafe(self) -> bool:
        """Whether another mode is flown than the chosen one."""
        return self.failsafe.action is not NONE

    @property
    def chosen_action(self) -> Action:
        """What the user does by himself."""
        return CHOSEN_ACTIONS.get(self.mode, NONE)

    @property
    def base_mode(self) -> int:
        """1 says that OFFBOARD is chosen and nobody sends setpoints."""
        silent = self.setpoint_at == -math.inf
        if self.mode == OFFBOARD and not self.armed and silent:
            return BASE_MODE_OFFBOARD_SILENT
        return MODES[self.reported_mode].base_mode

    @property
    def reported_mode(self) -> int:
        """Give what is flown, not what was chosen."""
        return FAILSAFE_MODES.get(self.failsafe.action, self.mode)

    def tuned(self) -> Traits:
        """Scale the recorded numbers by the parameters."""
        return tuning.px4(TRAITS, self.parameters)

    def tune(self) -> None:
        """Work out the failsafes, too."""
        super().tune()
        self.settings = shared(Settings.of(self.parameters))
        self.fence_settings = shared(FenceSettings.of_px4(self.parameters))

    def system_status(self, now: float) -> SystemStatus:
        """UNINIT comes back whenever a mode is chosen that cannot arm."""
        if self.failsafe.action is TERMINATE:
            return SystemStatus.FLIGHT_TERMINATION
        if self.in_failsafe:
            return SystemStatus.CRITICAL
        if self.armed:
            return SystemStatus.ACTIVE
        ready = self.arming_refusals(now, force=False) is None
        return SystemStatus.STANDBY if ready else SystemStatus.UNINIT

    def accepts_command(self, system: int, component: int, number: int) -> bool:
        """Ignore broadcast systems, but for the old version request."""
        to_all = system == 0 and number == requests.REQUEST_AUTOPILOT_CAPABILITIES
        ours = to_all or system == self.sysid
        return ours and component in {0, 1}

    def accepts_setpoint(self, system: int, component: int) -> bool:
        """Accept broadcasts."""
        return system in {0, self.sysid} and component in {0, 1}

    def arming_refusals(self, now: float, *, force: bool) -> list[str] | None:  # noqa: ARG002
        """Refuse before the boot is over, in a mode that cannot fly, without its ground station."""
        if not (self.is_ready(now) and self.has_position(now)):
            return ["Arming denied: Resolve system health failures first\t"]
        if self.settings.gcs and not self.hears_gcs(now):
            return []
        if self.geofence.breach is not Breach.NONE:
            return ["Preflight Fail: Geofence violation\t"]
        can_arm = MODES[self.mode].can_arm
        if self.mode in {OFFBOARD, AUTO_MISSION}:
            can_arm = self._can_enter_armed(self.mode, now)
        return None if can_arm else []

    def sensor_bits(self, now: float) -> tuple[int, int, int]:
        """Show nothing before the estimator runs, and the receiver last."""
        if self.recorded_s(now) < SENSORS_S:
            return (0, 0, SENSORS_HEALTHY)
        if not self.receives_gnss:
            return (SENSORS_PRESENT, SENSORS_ENABLED, SENSORS_HEALTHY & ~SENSOR_GNSS)
        seen = SENSOR_GNSS if self.is_ready(now) else 0
        return (SENSORS_PRESENT | seen, SENSORS_ENABLED | seen, SENSORS_HEALTHY)

    def announce_origin(self, now: float) -> None:
        """Tell it at once."""
        if self.is_talkative:
            gnss.global_origin(self, now)

    def announce_home(self, now: float) -> None:
        """Wait to be asked."""

    def may_speak(self, link: Link, now: float) -> bool:
        """PX4 sends STATUSTEXT only while a ground station's heartbeat arrives there."""
        return now - link.gcs_seen_at < GCS_TIMEOUT_S

    def choose(self, main: int, sub: int, now: float) -> int:
        """Change the mode, or give the commander's reason why not."""
        if main not in MAIN_MODES:
            return Result.ACCEPTED  # and nothing changes
        number = custom_mode(main, (sub or SUB_MISSION) if main == MAIN_AUTO else 0)
        is_over = self.failsafe.action is Action.TERMINATE
        if is_over or number not in MODES or not MODES[number].can_enter:
            return Result.TEMPORARILY_REJECTED
        if self.armed and not self._can_enter_armed(number, now):
            name = MODES[number].name.removeprefix("AUTO.").capitalize()
            self.say(Severity.CRITICAL, f"Switching to {name} is currently not available\t", now)
            return Result.TEMPORARILY_REJECTED
        if number == AUTO_TAKEOFF != self.mode:
            self.takeoff_height_m = max(self.traits.takeoff_height_m, -self.state.down_m)
        self.enter(number, now)
        return Result.ACCEPTED

    def _can_enter_armed(self, number: int, now: float) -> bool:
        if number == OFFBOARD:
            return self.has_setpoints(now)
        if number == AUTO_MISSION:
            return self.can_fly_mission
        return MODES[number].can_enter_flying

    def refuse_to_arm(self, texts: Sequence[str], now: float) -> None:
        """Say it by an event, too."""
        super().refuse_to_arm(texts, now)
        px4_events.deny_arming(self, now)

    def has_setpoints(self, now: float) -> bool:
        """Whether there is something to follow in OFFBOARD."""
        return now - self.setpoint_at <= self.traits.setpoint_timeout_s

    def enter(self, number: int, now: float) -> None:
        """End the failsafe by any mode, and go on with the last setpoint in OFFBOARD."""
        if self.failsafe.action is Action.TERMINATE:
            return
        setpoint, was_lost = self.setpoint, self.in_failsafe
        self.failsafe.override()
        if was_lost and number == self.mode:
            self.begin(MODES[number].manoeuvre, now)
        super().enter(number, now)
        if number == OFFBOARD:
            self.setpoint = setpoint
            self.steer(now)

    def disarm(self, now: float) -> None:
        """Return to the mode that the user chose."""
        super().disarm(now)
        was_lost, self.failsafe = self.in_failsafe, Failsafe()
        if was_lost:
            self.begin(MODES[self.mode].manoeuvre, now)

    def advance(self, now: float) -> None:
        """Watch what may fail."""
        new = self.geofence.update(self, self.fence_settings, now)
        if new is not UNBROKEN and self.armed:
            self.say(Severity.CRITICAL, "Geofence violation\t", now)
        self.failsafe.watch(self, now)

    def has_lost_setpoints(self, now: float) -> bool:
        """Whether OFFBOARD has nothing to follow."""
        return self.mode == OFFBOARD and not self.has_setpoints(now)

    def hears_gcs(self, now: float) -> bool:
        """Whether a ground station's heartbeats come, over whichever link."""
        seen_at = max(link.gcs_seen_at for link in self.links)
        return now - seen_at <= self.settings.gcs_loss_s

    def fly_failsafe(self, now: float) -> None:
        """Do what the failsafe says, or again what the user chose, by the latest setpoint."""
        if self.failsafe.action is Action.DISARM:
            self.disarm(now)
            return
        setpoint = self.setpoint
        self.begin(MODES[self.reported_mode].manoeuvre, now)
        if not self.in_failsafe:
            self.setpoint = setpoint
            self.steer(now)

    @property
    def is_on_mission(self) -> bool:
        """Count landings as missions."""
        return self.mode in {AUTO_MISSION, AUTO_LAND}

    @property
    def bars_mission(self) -> bool:
        """Whether a place of the mission is outside the zones of the fence."""
        return self.geofence.forbids_mission(self, self.fence_settings)

    @property
    def can_fly_mission(self) -> bool:
        """Whether there is a mission, and nothing against it."""
        has_mission = self.plans.has_mission and self.navigation.has_origin
        return has_mission and not self.bars_mission

    def return_in_mission(self, now: float) -> None:
        """Change to the mode that returns: the item is nothing more."""
        self.enter(AUTO_RTL, now)

    def takeoff_done(self, now: float) -> None:
        """PX4 loiters by itself after a take-off, and goes on with a mission."""
        if self.mode != AUTO_MISSION:
            self.mode = AUTO_LOITER
        self.hold_takeoff_height(now)

    def receive_setpoint(self, values: Any, now: float) -> None:
        """Take a setpoint in any mode: OFFBOARD is entered only while they come."""
        setpoint = setpoints.read(values, self.state.yaw_rad)
        if isinstance(setpoint, str):
            self.say(Severity.CRITICAL, setpoint, now)
        else:
            self.receive_attitude(setpoint, now)

    def receive_attitude(self, setpoint: Setpoint, now: float) -> None:
        """Take it as any other setpoint."""
        self.accept_setpoint(setpoint, now)
        self.failsafe.watch(self, now)

    def loiter(self, now: float) -> None:
        """Change to the mode in which places and circles are flown."""
        self.enter(AUTO_LOITER, now)
