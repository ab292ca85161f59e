"""What ArduPilot counts of its life in parameters, and tells unasked."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mock_vehicle.autopilot.ardupilot import ArduPilot

FIRST_S, EVERY_S = 30.45, 30.0
"""After the boot, and then again and again; recorded."""


class Statistics:
    """Time since boot and in the air, stored now and then, and after each flight."""

    def __init__(self, booted_at: float) -> None:
        self._booted_at = booted_at
        self._due_at = booted_at + FIRST_S
        self._took_off_at: float | None = None
        self._flown_s = 0.0
        self._was_armed = False

    def watch(self, vehicle: ArduPilot, now: float) -> None:
        """Count on, and tell what is due."""
        if vehicle.flying and self._took_off_at is None:
            self._took_off_at = now
        has_landed = self._took_off_at is not None and not vehicle.flying
        if has_landed or now >= self._due_at:
            self._store(vehicle, now)
        if has_landed:
            self._flown_s, self._took_off_at = self._in_air_s(now), None
        if self._was_armed and not vehicle.armed:
            vehicle.parameter_service.tell(vehicle, "MOT_THST_HOVER")
        self._was_armed = vehicle.armed

    def _in_air_s(self, now: float) -> float:
        began = now if self._took_off_at is None else self._took_off_at
        return self._flown_s + now - began

    def _store(self, vehicle: ArduPilot, now: float) -> None:
        self._due_at = now + EVERY_S
        counted = {"STAT_FLTTIME": self._in_air_s(now), "STAT_RUNTIME": now - self._booted_at}
        for name, seconds in counted.items():
            if int(seconds) != vehicle.parameters[name]:
                vehicle.parameters[name] = float(int(seconds))
                vehicle.parameter_service.tell(vehicle, name)
