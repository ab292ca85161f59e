"""ArduPilot: GUIDED mode; climbs on NAV_TAKEOFF, which a setpoint would cancel."""

from __future__ import annotations

from swarm_ctl.autopilot.base import Autopilot

COPTER_MODES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    5: "LOITER",
    6: "RTL",
    7: "CIRCLE",
    9: "LAND",
    11: "DRIFT",
    13: "SPORT",
    14: "FLIP",
    15: "AUTOTUNE",
    16: "POSHOLD",
    17: "BRAKE",
    18: "THROW",
    19: "AVOID_ADSB",
    20: "GUIDED_NOGPS",
    21: "SMART_RTL",
    22: "FLOWHOLD",
    23: "FOLLOW",
    24: "ZIGZAG",
    25: "SYSTEMID",
    26: "AUTOROTATE",
    27: "AUTO_RTL",
    28: "TURTLE",
}
"""By HEARTBEAT.custom_mode."""
ALT_HOLD, GUIDED, RTL, LAND, BRAKE, SMART_RTL, AUTO_RTL = 2, 4, 6, 9, 17, 21, 27

ARDUPILOT = Autopilot(
    name="ardupilot",
    heartbeat_id=3,
    offboard_mode=GUIDED,
    offboard_parameters=(float(GUIDED), 0.0),
    waiting_parameters=(float(GUIDED), 0.0),
    land_mode=LAND,
    takeoff_by_command=True,
    resumes_from_failsafe=False,
    setpoint_frames=frozenset({1, 7, 8, 9}),
    streams_hz={
        "LOCAL_POSITION_NED": 10.0,  # silent, though accepted, until there is a position
        "ATTITUDE": 10.0,
        "DISTANCE_SENSOR": 10.0,
        "SYS_STATUS": 1.0,
        "EKF_STATUS_REPORT": 1.0,
    },
    mode_names=COPTER_MODES,
    failsafe_modes=frozenset({ALT_HOLD, RTL, LAND, BRAKE, SMART_RTL, AUTO_RTL}),
)
