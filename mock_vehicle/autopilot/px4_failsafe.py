"""What PX4 does when setpoints, ground station or battery fail it, as recorded, or satellites."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, IntEnum, auto
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.fences import UNBROKEN
from mock_vehicle.autopilot.parameters import Parameters
from mock_vehicle.autopilot.traits import Severity

if TYPE_CHECKING:
    from mock_vehicle.autopilot.px4 import Px4

HEARTBEAT_LATE_S = 2.2
"""From the end of COM_DL_LOSS_T to the failsafe: a heartbeat may be late."""


class Action(IntEnum):
    """What a failsafe does; the larger is the graver, and the gravest wins."""

    NONE = 0
    POSITION = 1
    """A pilot's mode; without a pilot it sinks."""
    ALTITUDE = 2
    STABILIZED = 3
    HOLD = 4
    RETURN = 5
    LAND = 6
    DISARM = 7
    TERMINATE = 8


NONE, TERMINATE = Action.NONE, Action.TERMINATE


class Cause(Enum):
    """Why a failsafe acts."""

    GCS = auto()
    CRITICAL_BATTERY = auto()
    EMERGENCY_BATTERY = auto()
    GEOFENCE = auto()


OFFBOARD_ACTIONS: Mapping[float, Action] = {
    0: Action.POSITION,
    1: Action.ALTITUDE,
    2: Action.STABILIZED,
    3: Action.RETURN,
    4: Action.LAND,
    5: Action.HOLD,
    6: Action.TERMINATE,
    7: Action.DISARM,
}
"""COM_OBL_RC_ACT, without a pilot."""
GCS_ACTIONS: Mapping[float, Action] = {
    1: Action.HOLD,
    2: Action.RETURN,
    3: Action.LAND,
    5: Action.TERMINATE,
    6: Action.DISARM,
}
"""NAV_DLL_ACT."""
BATTERY_ACTIONS: Mapping[float, tuple[Action, Action]] = {
    1: (Action.RETURN, Action.RETURN),
    2: (Action.LAND, Action.LAND),
    3: (Action.RETURN, Action.LAND),
}
"""COM_LOW_BAT_ACT: when the battery is critical, and in an emergency."""
GEOFENCE_ACTIONS: Mapping[float, Action] = {
    2: Action.HOLD,
    3: Action.RETURN,
    4: Action.TERMINATE,
    5: Action.LAND,
}
"""GF_ACTION; 1 warns."""
BATTERY_TEXTS = ("", "Low battery level\t", "Critical battery level\t", "Emergency battery level\t")


@dataclass(frozen=True, slots=True)
class Settings:
    """What the parameters say."""

    offboard: Action
    gcs: Action
    gcs_loss_s: float
    hold_s: float
    """Graver actions than HOLD begin so much later than it, but for those on lost setpoints."""
    battery_fractions: tuple[float, float, float]
    """Low, critical, emergency."""
    critical_battery: Action
    emergency_battery: Action
    geofence: Action

    @classmethod
    def of(cls, parameters: Parameters) -> Settings:
        """Read the parameters."""
        finite = parameters.finite
        nothing = (Action.NONE, Action.NONE)
        critical, emergency = BATTERY_ACTIONS.get(finite("COM_LOW_BAT_ACT"), nothing)
        return cls(
            offboard=OFFBOARD_ACTIONS.get(finite("COM_OBL_RC_ACT"), Action.POSITION),
            gcs=GCS_ACTIONS.get(finite("NAV_DLL_ACT"), Action.NONE),
            gcs_loss_s=finite("COM_DL_LOSS_T") + HEARTBEAT_LATE_S,
            hold_s=finite("COM_FAIL_ACT_T"),
            battery_fractions=(
                finite("BAT_LOW_THR"),
                finite("BAT_CRIT_THR"),
                finite("BAT_EMERGEN_THR"),
            ),
            critical_battery=critical,
            emergency_battery=emergency,
            geofence=GEOFENCE_ACTIONS.get(finite("GF_ACTION"), Action.NONE),
        )


class Failsafe:
    """Watches a flight, and flies another mode than the chosen one when something fails."""

    def __init__(self) -> None:
        self.action = Action.NONE
        self._least = Action.NONE
        """What lasts until the user chooses a mode, even if the cause goes away."""
        self._since: dict[Cause, float] = {}
        self._overridden: set[Cause] = set()
        """Causes that the user has seen, and flies on."""
        self._battery_level = 0

    def watch(self, px4: Px4, now: float) -> None:
        """Begin or end what the causes of this moment ask for."""
        if not px4.armed:
            return
        wanted = max(self._wanted(px4, now), self._least)
        if wanted is not NONE and wanted <= px4.chosen_action:
            wanted = NONE
        if wanted is self.action:
            return
        is_graver, self.action = wanted > self.action, wanted
        if is_graver:
            px4.say(Severity.CRITICAL, "Failsafe activated\t", now)
        px4.fly_failsafe(now)

    def override(self) -> None:
        """Let the user fly on, whatever the cause; terminated is terminated."""
        if self.action is not Action.TERMINATE:
            self.action = self._least = Action.NONE
            self._overridden = set(self._since)

    def _wanted(self, px4: Px4, now: float) -> Action:
        wanted = px4.settings.offboard if px4.has_lost_setpoints(now) else NONE
        if wanted is TERMINATE:
            self._least = wanted
        if px4.flying and not px4.has_position(now):
            wanted = max(wanted, Action.LAND)
        present = self._causes(px4, now)
        if not present and not self._since:
            return wanted
        self._since = {cause: self._since.get(cause, now) for cause in present}
        self._overridden &= present.keys()
        for cause in present.keys() - self._overridden:
            action, waited_s = present[cause], now - self._since[cause]
            if action > Action.HOLD and waited_s < px4.settings.hold_s:
                action = Action.HOLD
            elif action > Action.HOLD:
                self._least = max(self._least, action)
            wanted = max(wanted, action)
        return wanted

    def _causes(self, px4: Px4, now: float) -> dict[Cause, Action]:
        settings = px4.settings
        causes: dict[Cause, Action] = {}
        if settings.gcs and not px4.hears_gcs(now):
            causes[Cause.GCS] = settings.gcs
        if settings.geofence and px4.geofence.breach is not UNBROKEN:
            causes[Cause.GEOFENCE] = settings.geofence
        left = px4.state.battery_fraction
        if left >= settings.battery_fractions[0]:
            return causes
        level = sum(left < fraction for fraction in settings.battery_fractions)
        if level > self._battery_level:
            self._battery_level = level
            px4.say(Severity.CRITICAL, BATTERY_TEXTS[level], now)
        if level >= 2 and settings.critical_battery:
            causes[Cause.CRITICAL_BATTERY] = settings.critical_battery
        if level == 3 and settings.emergency_battery:
            causes[Cause.EMERGENCY_BATTERY] = settings.emergency_battery
        return causes
