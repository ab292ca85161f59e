"""How the fields of an answer are compared: the one table of what may differ, and why."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import zip_longest
from typing import Any

_NUMBERS = re.compile(r"\b[A-Z][a-z][0-9a-f]{30}\b|-?\d+(\.\d+)?")
FLOAT32 = 1e-6
"""Relative error of numbers that were floats of 32 bits."""


def without_numbers(text: str) -> str:
    """Replace numbers and board ids."""
    return _NUMBERS.sub("#", text).strip()


@dataclass(frozen=True)
class Rule:
    """By how much a field may differ."""

    reason: str
    tolerance: float = 0.0
    """Absolute; inf compares nothing but that both are numbers."""
    is_text: bool = False
    """Compare texts without the numbers in them."""

    def agree(self, theirs: Any, ours: Any) -> bool:
        """Compare two values; zeros at the end of an array may be left out."""
        if self.tolerance == math.inf:
            return True
        if isinstance(theirs, str) or isinstance(ours, str):
            a, b = theirs or "", ours or ""
            return bool(without_numbers(a) == without_numbers(b) if self.is_text else a == b)
        pairs = zip_longest(_listed(theirs), _listed(ours), fillvalue=0)
        return all(self._are_close(a, b) for a, b in pairs)

    def _are_close(self, a: float, b: float) -> bool:
        """Compare two numbers; NaN is like NaN."""
        if math.isnan(a) or math.isnan(b):
            return math.isnan(a) and math.isnan(b)
        return math.isclose(a, b, rel_tol=FLOAT32, abs_tol=self.tolerance)


def _listed(value: Any) -> list[float]:
    return list(value) if isinstance(value, (list, tuple, bytes)) else [value]


SAME = Rule("")

CLOCK = Rule("a clock", math.inf)
BUILD = Rule("hashes of a build", math.inf)
NOISE = Rule("sensor noise", math.inf)
PLACE_E7 = Rule("where the estimate wanders, 5 m", 500.0)
HEIGHT_MM = Rule("where the estimate wanders, 3 m", 3000.0)
WANDER_M = Rule("where the estimate wanders, 5 m", 5.0)
LEVEL_RAD = Rule("attitude on the ground", 0.1)
ABOVE_SEA_M = Rule("where the estimate wanders, 3 m", 3.0)

MEASURED_PARAMS = (
    "BARO?_GND_PRESS",
    "CAL_*",
    "INS_*",
    "MOT_THST_HOVER",
    "SENS_*_OFF",
    "STAT_*",
)
"""Parameters that a vehicle measures or counts; their values are noise."""

RULES: Mapping[tuple[str, str], Rule] = {
    ("*", "time_boot_ms"): CLOCK,
    ("*", "time_usec"): CLOCK,
    ("*", "time_unix_usec"): CLOCK,
    ("TIMESYNC", "tc1"): CLOCK,
    ("AUTOPILOT_VERSION", "uid"): Rule("a board's number", math.inf),
    ("AUTOPILOT_VERSION", "uid2"): Rule("a board's number", math.inf),
    ("AUTOPILOT_VERSION", "flight_custom_version"): BUILD,
    ("AUTOPILOT_VERSION", "middleware_custom_version"): BUILD,
    ("AUTOPILOT_VERSION", "os_custom_version"): BUILD,
    ("AUTOPILOT_VERSION", "os_sw_version"): BUILD,
    ("MISSION_ACK", "opaque_id"): Rule("a hash of the plan", math.inf),
    ("MISSION_COUNT", "opaque_id"): Rule("a hash of the plan", math.inf),
    ("MISSION_CURRENT", "mission_id"): Rule("a hash of the plan", math.inf),
    ("MISSION_CURRENT", "fence_id"): Rule("a hash of the plan", math.inf),
    ("MISSION_CURRENT", "rally_points_id"): Rule("a hash of the plan", math.inf),
    ("STATUSTEXT", "text"): Rule("numbers, dates and board ids in it", is_text=True),
    ("STATUSTEXT", "id"): Rule("a running number", math.inf),
    ("HOME_POSITION", "latitude"): PLACE_E7,
    ("HOME_POSITION", "longitude"): PLACE_E7,
    ("HOME_POSITION", "altitude"): HEIGHT_MM,
    ("HOME_POSITION", "x"): WANDER_M,
    ("HOME_POSITION", "y"): WANDER_M,
    ("HOME_POSITION", "z"): WANDER_M,
    ("HOME_POSITION", "q"): Rule("attitude of the ground", 0.5),
    ("GPS_GLOBAL_ORIGIN", "latitude"): PLACE_E7,
    ("GPS_GLOBAL_ORIGIN", "longitude"): PLACE_E7,
    ("GPS_GLOBAL_ORIGIN", "altitude"): HEIGHT_MM,
    ("GLOBAL_POSITION_INT", "lat"): PLACE_E7,
    ("GLOBAL_POSITION_INT", "lon"): PLACE_E7,
    ("GLOBAL_POSITION_INT", "alt"): HEIGHT_MM,
    ("GLOBAL_POSITION_INT", "relative_alt"): HEIGHT_MM,
    ("GLOBAL_POSITION_INT", "vx"): NOISE,
    ("GLOBAL_POSITION_INT", "vy"): NOISE,
    ("GLOBAL_POSITION_INT", "vz"): NOISE,
    ("GLOBAL_POSITION_INT", "hdg"): Rule("which way it was put down", math.inf),
    ("LOCAL_POSITION_NED", "*"): WANDER_M,
    ("ATTITUDE", "*"): LEVEL_RAD,
    ("ATTITUDE", "yaw"): Rule("which way it was put down", math.inf),
    ("ATTITUDE_QUATERNION", "*"): LEVEL_RAD,
    ("ATTITUDE_TARGET", "*"): LEVEL_RAD,
    ("HIGHRES_IMU", "*"): NOISE,
    ("EKF_STATUS_REPORT", "velocity_variance"): NOISE,
    ("EKF_STATUS_REPORT", "pos_horiz_variance"): NOISE,
    ("EKF_STATUS_REPORT", "pos_vert_variance"): NOISE,
    ("EKF_STATUS_REPORT", "compass_variance"): NOISE,
    ("VIBRATION", "*"): NOISE,
    ("SIM_STATE", "*"): NOISE,
    ("SIMSTATE", "*"): NOISE,
    ("SYS_STATUS", "load"): NOISE,
    ("SYS_STATUS", "voltage_battery"): Rule("the pack's state, 0.1 V", 100.0),
    ("SYS_STATUS", "current_battery"): NOISE,
    ("BATTERY_STATUS", "voltages"): Rule("the pack's state, 0.1 V", 100.0),
    ("BATTERY_STATUS", "current_battery"): NOISE,
    ("BATTERY_STATUS", "current_consumed"): NOISE,
    ("BATTERY_STATUS", "energy_consumed"): NOISE,
}
"""(message, field) -> rule; * is every message, or every other field."""


def rule_of(message: str, fields: Mapping[str, Any], name: str) -> Rule:
    """Find the rule of a field."""
    if message.startswith("MISSION_ITEM") and name == "z" and not fields.get("frame", 0):
        return ABOVE_SEA_M  # of home
    if message == "PARAM_VALUE" and name == "param_value":
        measured = any(fnmatchcase(fields["param_id"], pattern) for pattern in MEASURED_PARAMS)
        return NOISE if measured else SAME
    keys = (("*", name), (message, name), (message, "*"))
    return next((RULES[key] for key in keys if key in RULES), SAME)
