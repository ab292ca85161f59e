"""PX4: offboard mode, entered while setpoints stream; climbs on setpoints."""

from __future__ import annotations

from swarm_ctl.autopilot.base import Autopilot

MAIN_MODES = {1: "MANUAL", 2: "ALTCTL", 3: "POSCTL", 5: "ACRO", 6: "OFFBOARD", 7: "STABILIZED"}
AUTO_MODES = {2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND", 8: "FOLLOW"}
AUTO, AUTO_LAND = 4, 6
OFFBOARD = 6

PX4 = Autopilot(
    name="px4",
    heartbeat_id=12,
    offboard_mode=OFFBOARD << 16,
    offboard_parameters=(float(OFFBOARD), 0.0),
    land_mode=AUTO << 16 | AUTO_LAND << 24,
    takeoff_by_command=False,
    resumes_from_failsafe=True,
    mode_names={main << 16: name for main, name in MAIN_MODES.items()}
    | {AUTO << 16 | sub << 24: f"AUTO.{name}" for sub, name in AUTO_MODES.items()},
)
