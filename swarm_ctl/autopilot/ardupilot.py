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
    16: "POSHOLD",
    17: "BRAKE",
    21: "SMART_RTL",
}
GUIDED, LAND = 4, 9

ARDUPILOT = Autopilot(
    name="ardupilot",
    heartbeat_id=3,
    offboard_mode=GUIDED,
    offboard_parameters=(float(GUIDED), 0.0),
    land_mode=LAND,
    takeoff_by_command=True,
    resumes_from_failsafe=False,
    mode_names=COPTER_MODES,
)
