"""Standing, leaving the ground and coming back to it: when a vehicle flies, lands and disarms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mock_vehicle.autopilot.manoeuvres import fall
from mock_vehicle.autopilot.traits import FLIGHT_STATES, LandedState, Manoeuvre

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot


class Ground:
    """What a vehicle remembers of the ground, and what it does there."""

    def __init__(self, now: float) -> None:
        self.has_flown = False
        """Since it was armed."""
        self.begun_at = now
        """When the manoeuvre began."""
        self._armed_at = now
        self._idle_since = now
        self._touched_at: float | None = None

    def arm(self, *, flying: bool, now: float) -> None:
        """Count from here."""
        self.has_flown = flying
        self._armed_at = self._idle_since = now
        self._touched_at = None

    def watch(self, autopilot: Autopilot, now: float) -> None:
        """Notice a landing, and disarm who has stood for long enough."""
        if autopilot.state.on_ground == 0.0 or autopilot.truth.motor_lost[autopilot.index]:
            self._touched_at = None  # ArduPilot believes that it flies when it lies there
            return
        if self._touched_at is None:
            self._touched_at = now
        if not autopilot.armed:
            autopilot.landed_state = LandedState.ON_GROUND
        elif autopilot.flying:
            if now - self._touched_at >= autopilot.traits.touchdown_s:
                self._land(autopilot, now)
        elif now - self._idle_since >= self._disarm_delay_s(autopilot):
            if self.has_flown:
                autopilot.disarm_landed(now)
            else:
                autopilot.disarm(now)

    def _land(self, autopilot: Autopilot, now: float) -> None:
        autopilot.flying = False
        autopilot.landed_state = LandedState.ON_GROUND
        self._idle_since = now
        autopilot.inform(autopilot.traits.texts_landing, now)

    def _disarm_delay_s(self, autopilot: Autopilot) -> float:
        traits = autopilot.traits
        is_landing = autopilot.manoeuvre in {Manoeuvre.LAND, Manoeuvre.RETURN}
        if is_landing or (self.has_flown and traits.disarms_wherever_landed):
            return traits.landed_disarm_s
        return traits.idle_disarm_s

    def wait(self, autopilot: Autopilot, now: float) -> None:
        """Leave the ground when the motors are up and something wants to climb."""
        fall(autopilot, now)
        traits = autopilot.traits
        if autopilot.manoeuvre is Manoeuvre.TAKEOFF:
            waited = now - max(self._armed_at, self.begun_at)
            announced_s, lift_s = traits.takeoff_announced_s, traits.takeoff_lift_s
        elif traits.setpoint_announced_s is not None and _wants_to_climb(autopilot):
            waited = now - self._armed_at
            announced_s, lift_s = traits.setpoint_announced_s, traits.setpoint_lift_s
        else:
            autopilot.landed_state = LandedState.ON_GROUND
            return
        self._idle_since = now
        if waited >= announced_s and autopilot.landed_state is LandedState.ON_GROUND:
            autopilot.landed_state = FLIGHT_STATES[autopilot.manoeuvre]
            autopilot.inform(traits.texts_takeoff, now)
        if waited >= lift_s:
            autopilot.flying = self.has_flown = True
            self._touched_at = None


def _wants_to_climb(autopilot: Autopilot) -> bool:
    is_followed = autopilot.manoeuvre is Manoeuvre.SETPOINT
    return is_followed and autopilot.setpoint.climbs_from(autopilot.state.down_m)
