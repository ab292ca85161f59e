"""What ArduPilot does about its fence: it warns, acts by a mode, and does not arm outside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.commands import Command, Result, whole
from mock_vehicle.autopilot.fences import Breach
from mock_vehicle.autopilot.traits import Severity

if TYPE_CHECKING:
    from mock_vehicle.autopilot.ardupilot import ArduPilot

DO_FENCE_ENABLE = 207
RTL, LAND, BRAKE, SMART_RTL = 6, 9, 17, 21
MODES: Mapping[float, int] = {1: RTL, 2: LAND, 3: SMART_RTL, 4: BRAKE, 5: SMART_RTL}
"""FENCE_ACTION; 0 only reports."""
NAMES: Mapping[Breach, str] = {
    Breach.MAX_ALTITUDE: "Max Alt",
    Breach.CIRCLE: "Circle",
    Breach.ZONES: "Polygon",
    Breach.MIN_ALTITUDE: "Min Alt",
}


def _names(breach: Breach) -> str:
    return ", ".join(name for flag, name in NAMES.items() if flag & breach)


def watch(vehicle: ArduPilot, now: float) -> None:
    """Act on a breach when it begins; a pilot may choose another mode afterwards."""
    settings = vehicle.fence_settings
    if not settings.is_on or not vehicle.armed:
        vehicle.geofence.breach = Breach.NONE
        return
    new = vehicle.geofence.update(vehicle, settings, now)
    if not new:
        return
    vehicle.say(Severity.WARNING, f"{_names(new)} fence breached", now)
    if vehicle.flying and settings.action in MODES:
        vehicle.enter(MODES[settings.action], now)


def arming_refusals(vehicle: ArduPilot) -> list[str]:
    """Say why not to arm here."""
    breach = vehicle.geofence.at(vehicle, vehicle.fence_settings)
    return [f"Vehicle breaching {_names(breach)} fence"] if breach else []


def enable(autopilot: ArduPilot, command: Command, now: float) -> int:  # noqa: ARG001
    """Switch the fence on (param1 1) or off (0)."""
    wish = whole(command.params[0])
    if wish not in {0, 1, 2}:
        return Result.FAILED
    if wish == 2:  # the floor alone: it is off until the vehicle is above it, anyway
        return Result.ACCEPTED
    autopilot.set_parameter("FENCE_ENABLE", float(wish))
    return Result.ACCEPTED
