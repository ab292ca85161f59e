"""What ArduPilot says of itself while it boots and flies, and why it does not arm before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from mock_vehicle.autopilot.traits import Severity

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot


class Announcement(NamedTuple):
    """A STATUSTEXT of the boot."""

    at_s: float
    """Since the recorded boot."""
    text: str
    wants_gnss: bool = False
    """Only said where satellites are received."""


ANNOUNCEMENTS = (
    Announcement(1.94, "Barometer 1 calibration complete"),
    Announcement(1.94, "Barometer 2 calibration complete"),
    Announcement(2.46, "ArduPilot Ready"),
    Announcement(2.46, "AHRS: DCM active"),
    Announcement(2.76, "RC7: SaveWaypoint LOW"),
    Announcement(4.46, "EKF3 IMU0 initialised"),
    Announcement(4.46, "EKF3 IMU1 initialised"),
    Announcement(4.47, "AHRS: EKF3 active"),
    Announcement(5.81, "EKF3 IMU0 tilt alignment complete"),
    Announcement(5.81, "EKF3 IMU1 tilt alignment complete"),
    Announcement(5.91, "EKF3 IMU0 MAG0 initial yaw alignment complete"),
    Announcement(5.91, "EKF3 IMU1 MAG0 initial yaw alignment complete"),
    Announcement(9.82, "GPS 1: probing for u-blox at 230400 baud"),
    Announcement(9.84, "GPS 1: detected u-blox"),
    Announcement(20.03, "EKF3 IMU0 origin set", wants_gnss=True),
    Announcement(20.06, "Field Elevation Set: {amsl_m:.0f}m", wants_gnss=True),
    Announcement(20.22, "EKF3 IMU1 origin set", wants_gnss=True),
    Announcement(41.43, "EKF3 IMU0 is using GPS", wants_gnss=True),
    Announcement(41.63, "EKF3 IMU1 is using GPS", wants_gnss=True),
)

REFUSALS: Sequence[tuple[float, tuple[str, ...]]] = (
    (2.46, ("System not initialised",)),
    (
        5.9,
        (
            "Need Alt Estimate",
            "Accels inconsistent",
            "EKF attitude is bad",
            "AHRS: waiting for home",
        ),
    ),
    (14.5, ("Accels inconsistent", "AHRS: waiting for home")),
    (20.03, ("Gyros inconsistent", "AHRS: waiting for home")),
    (24.5, ("Gyros inconsistent", "Need Position Estimate")),
)
"""(until, reasons not to arm), earliest first."""
LAST_REFUSAL = ("Need Position Estimate",)


def refusals(recorded_s: float) -> tuple[str, ...]:
    """Give the reasons not to arm at a time of the recorded boot that is not over."""
    return next((reasons for until_s, reasons in REFUSALS if recorded_s < until_s), LAST_REFUSAL)


class BootLog:
    """The texts of one boot that are still to come."""

    def __init__(self, announcements: Sequence[Announcement]) -> None:
        self._waiting = list(announcements)[::-1]

    def run(self, autopilot: Autopilot, now: float) -> None:
        """Say what is due."""
        while self._waiting and self._waiting[-1].at_s <= autopilot.recorded_s(now):
            announcement = self._waiting.pop()
            if autopilot.receives_gnss or not announcement.wants_gnss:
                text = announcement.text.format(amsl_m=autopilot.origin.amsl_m)
                autopilot.say(Severity.INFO, text, now)


ALIGNED_M = 2.3
"""At this height the compasses are trusted anew, once in a flight."""


class FlightLog:
    """What the estimator and the simulator say of each flight."""

    def __init__(self) -> None:
        self._is_aligned = False
        self._was_up = False
        self._sink_m_s = 0.0

    def run(self, autopilot: Autopilot, now: float) -> None:
        """Say when the compasses are aligned, and how hard it lands."""
        state = autopilot.state
        is_up = state.on_ground == 0.0
        self._is_aligned = self._is_aligned and autopilot.armed
        if self._was_up and not is_up:
            autopilot.say(Severity.INFO, f"SIM Hit ground at {self._sink_m_s:f} m/s", now)
        height_m = autopilot.navigation.home_m[2] - state.down_m
        if is_up and not self._is_aligned and height_m > ALIGNED_M:
            self._is_aligned = True
            for imu in (0, 1):
                text = f"EKF3 IMU{imu} MAG0 in-flight yaw alignment complete"
                autopilot.say(Severity.INFO, text, now)
        self._was_up, self._sink_m_s = is_up, state.down_m_s
