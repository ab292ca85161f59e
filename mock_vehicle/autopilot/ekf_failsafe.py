"""What ArduPilot does when its estimator loses the position, as recorded in GUIDED flight."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mock_vehicle.autopilot.ardupilot_failsafe import LAND
from mock_vehicle.autopilot.traits import Manoeuvre, Severity

if TYPE_CHECKING:
    from mock_vehicle.autopilot.ardupilot import ArduPilot

VARIANCE_S = 8.2
"""From the last position to the failsafe."""
REPORT_ONLY = 0
"""FS_EKF_ACTION; all others land, the only action that was recorded."""


class EkfFailsafe:
    """Whether the position is doubted, and whether it is given up."""

    def __init__(self) -> None:
        self.is_on = False
        """Whether it has acted; also on the ground, until there is a position again."""
        self._has_stopped = False

    def watch(self, autopilot: ArduPilot, now: float) -> None:
        """Land when there has been no position for too long; one that is back clears it."""
        silent_s = autopilot.navigation.silent_s(now)
        if silent_s >= VARIANCE_S and not self.is_on and autopilot.flying:
            self._begin(autopilot, now)
        if silent_s >= autopilot.traits.dead_reckoning_s and not self._has_stopped:
            self._has_stopped = True
            autopilot.say(Severity.WARNING, "EKF3 IMU1 stopped aiding", now)
            autopilot.say(Severity.WARNING, "EKF3 IMU0 stopped aiding", now)
        if silent_s == 0.0:
            self.is_on = self._has_stopped = False

    def _begin(self, autopilot: ArduPilot, now: float) -> None:
        """Say so, and land if it flies by position."""
        self.is_on = True
        autopilot.say(Severity.CRITICAL, "EKF variance", now)
        by_hand = autopilot.manoeuvre in {Manoeuvre.FALL, Manoeuvre.SINK}
        if by_hand or autopilot.parameters["FS_EKF_ACTION"] == REPORT_ONLY:
            return
        autopilot.say(Severity.CRITICAL, "EKF Failsafe: changed to LAND Mode", now)
        autopilot.enter_by_failsafe(LAND, now)
