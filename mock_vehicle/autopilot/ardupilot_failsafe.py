"""What ArduPilot does when the ground station or the battery fail it; as recorded."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.parameters import Parameters
from mock_vehicle.autopilot.traits import Severity

if TYPE_CHECKING:
    from mock_vehicle.autopilot.ardupilot import ArduPilot

NOTICED_S = 0.3
"""The failsafe begins so much after FS_GCS_TIMEOUT: it is looked at three times a second."""
RTL, LAND, BRAKE, SMART_RTL = 6, 9, 17, 21
GCS_MODES: Mapping[float, int] = {3: SMART_RTL, 4: SMART_RTL, 5: LAND, 7: BRAKE}
"""FS_GCS_ENABLE; 0 is nothing, and all others are RTL."""
BATTERY_MODES: Mapping[float, int] = {1: LAND, 2: RTL, 3: SMART_RTL, 4: SMART_RTL, 6: RTL, 7: BRAKE}
"""BATT_FS_LOW_ACT and BATT_FS_CRT_ACT; all others are nothing."""


@dataclass(frozen=True, slots=True)
class BatteryLevel:
    """When a battery is low or critical, and what happens then."""

    name: str
    voltage_v: float
    charge_mah: float
    mode: int | None


@dataclass(frozen=True, slots=True)
class Settings:
    """What the parameters say."""

    gcs_sysid: int
    gcs_mode: int | None
    gcs_timeout_s: float
    battery: tuple[BatteryLevel, BatteryLevel]
    """Low, critical."""
    battery_delay_s: float
    """The voltage must be too low for so long."""
    capacity_mah: float
    checks_arming: bool

    @classmethod
    def of(cls, parameters: Parameters) -> Settings:
        """Read the parameters."""

        def level(name: str, infix: str, action: str) -> BatteryLevel:
            volt, charge = f"BATT_{infix}_VOLT", f"BATT_{infix}_MAH"
            return BatteryLevel(
                name, finite(volt), finite(charge), BATTERY_MODES.get(finite(action))
            )

        finite = parameters.finite
        enabled = finite("FS_GCS_ENABLE")
        return cls(
            gcs_sysid=int(finite("MAV_GCS_SYSID")),
            gcs_mode=GCS_MODES.get(enabled, RTL) if enabled else None,
            gcs_timeout_s=finite("FS_GCS_TIMEOUT") + NOTICED_S,
            battery=(
                level("low", "LOW", "BATT_FS_LOW_ACT"),
                level("critical", "CRT", "BATT_FS_CRT_ACT"),
            ),
            battery_delay_s=finite("BATT_LOW_TIMER"),
            capacity_mah=finite("BATT_CAPACITY"),
            checks_arming=finite("ARMING_CHECK") != 0.0,
        )


class Failsafe:
    """Watches a flight, and changes the mode when something fails."""

    def __init__(self) -> None:
        self.gcs_seen_at = -math.inf
        """When its ground station was last heard, if ever."""
        self._has_lost_gcs = False
        self._battery_level = 0
        """0 is well, 1 low, 2 critical."""
        self._fine_at = [0.0, 0.0]
        """When the voltage was last above each level, or the vehicle disarmed."""
        self._has_acted = False

    @property
    def is_active(self) -> bool:
        """Whether the vehicle is in a critical state; a battery stays so until a reboot."""
        return self._has_lost_gcs or self._has_acted

    def watch(self, vehicle: ArduPilot, now: float) -> None:
        """Look after the ground station, and in flight after the battery."""
        if vehicle.settings.gcs_mode is not None and self.gcs_seen_at > -math.inf:
            self._watch_gcs(vehicle, vehicle.settings.gcs_mode, now)
        if vehicle.armed:
            self._watch_battery(vehicle, now)
        else:
            self._fine_at[:] = (now, now)

    def _watch_gcs(self, vehicle: ArduPilot, mode: int, now: float) -> None:
        is_lost = now - self.gcs_seen_at >= vehicle.settings.gcs_timeout_s
        if is_lost == self._has_lost_gcs:
            return
        self._has_lost_gcs = is_lost
        if is_lost:
            self._act(vehicle, "GCS", mode, now)
        else:
            vehicle.say(Severity.WARNING, "GCS Failsafe Cleared", now)

    def _watch_battery(self, vehicle: ArduPilot, now: float) -> None:
        settings, state = vehicle.settings, vehicle.state
        left_mah, voltage_v = state.battery_fraction * settings.capacity_mah, vehicle.battery_v
        for number, level in enumerate(settings.battery):
            is_low = voltage_v < level.voltage_v
            if not is_low:
                self._fine_at[number] = now
            is_low = is_low and now - self._fine_at[number] >= settings.battery_delay_s
            if (is_low or left_mah < level.charge_mah) and number >= self._battery_level:
                self._battery_level = number + 1
                used_mah = settings.capacity_mah - left_mah
                spent = f"{voltage_v:.2f}V used {used_mah:.0f} mAh"
                vehicle.say(Severity.WARNING, f"Battery 1 is {level.name} {spent}", now)
                self._has_acted = True
                self._act(vehicle, "Battery", level.mode, now)

    def _act(self, vehicle: ArduPilot, what: str, mode: int | None, now: float) -> None:
        """Change the mode in the air; on the ground the motors stop."""
        if vehicle.armed and not vehicle.flying and mode is not None:
            vehicle.say(Severity.WARNING, f"{what} Failsafe - Disarming", now)
            vehicle.disarm(now)
            return
        vehicle.say(Severity.WARNING, f"{what} Failsafe", now)
        if vehicle.armed and mode is not None:
            vehicle.enter_by_failsafe(mode, now)
