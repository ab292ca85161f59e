"""What a vehicle itself gives as the reason for not doing what it was asked."""

from __future__ import annotations

from swarm_ctl.autopilot.texts import Text

FRESH_S = 5.0
"""How long a complaint counts; arming is asked for, and refused, more often than that."""
WARNING = 4
"""MAV_SEVERITY; what is said with less weight is no complaint."""
PREFIXES = ("Arm: ", "PreArm: ", "Preflight Fail: ", "Arming denied: ")

PREARM_CHECK = 0x10000000
"""MAV_SYS_STATUS_PREARM_CHECK: healthy when the vehicle would arm."""
SENSORS = (
    "gyroscope",
    "accelerometer",
    "compass",
    "absolute pressure",
    "differential pressure",
    "GNSS",
    "optical flow",
    "vision position",
    "laser position",
    "external ground truth",
    "angular rate control",
    "attitude stabilisation",
    "yaw position",
    "altitude control",
    "position control",
    "motor outputs",
    "radio control",
    "second gyroscope",
    "second accelerometer",
    "second compass",
    "geofence",
    "attitude estimate",
    "terrain",
    "reversed motor",
    "logging",
    "battery",
    "proximity",
    "satellite communication",
    "",  # the check before arming is no sensor
    "obstacle avoidance",
    "propulsion",
)
"""MAV_SYS_STATUS_SENSOR by bit."""


class Complaints:
    """The latest complaints of one vehicle."""

    def __init__(self) -> None:
        self._heard_s: dict[str, float] = {}

    def hear(self, text: Text, now: float) -> None:
        """Take what was said, if it is a warning or worse."""
        if text.severity <= WARNING:
            words = text.words
            for prefix in PREFIXES:
                words = words.removeprefix(prefix)
            self._heard_s[words] = now

    def recent(self, now: float) -> list[str]:
        """Give every distinct complaint of the last seconds, oldest first."""
        self._heard_s = {w: s for w, s in self._heard_s.items() if now - s <= FRESH_S}
        return list(self._heard_s)


def unhealthy(present: int, enabled: int, health: int) -> list[str]:
    """Name the sensors of a SYS_STATUS that are there and in use, but not healthy."""
    bits = present & enabled & ~health & ~PREARM_CHECK
    return [f"{name} not healthy" for bit, name in enumerate(SENSORS) if bits >> bit & 1]
