"""PX4: offboard mode, entered while setpoints stream; climbs on setpoints."""

from __future__ import annotations

from swarm_ctl.autopilot.base import Autopilot

AUTO, POSCTL, OFFBOARD = 4, 3, 6
MAIN_MODES = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
    10: "TERMINATION",
    11: "ALTITUDE_CRUISE",
}
"""By PX4_CUSTOM_MAIN_MODE; HEARTBEAT.custom_mode is main << 16 | sub << 24."""
AUTO_MODES = {
    1: "READY",
    2: "TAKEOFF",
    3: "LOITER",
    4: "MISSION",
    5: "RTL",
    6: "LAND",
    8: "FOLLOW",
    9: "PRECLAND",
    10: "VTOL_TAKEOFF",
    **{10 + number: f"EXTERNAL{number}" for number in range(1, 9)},
}
"""By PX4_CUSTOM_SUB_MODE_AUTO."""
POSCTL_MODES = {1: "ORBIT", 2: "SLOW"}


def custom_mode(main: int, sub: int = 0) -> int:
    """Give the HEARTBEAT.custom_mode of a main and a sub mode."""
    return main << 16 | sub << 24


PX4 = Autopilot(
    name="px4",
    heartbeat_id=12,
    offboard_mode=custom_mode(OFFBOARD),
    offboard_parameters=(float(OFFBOARD), 0.0),
    waiting_parameters=(float(AUTO), 3.0),
    land_mode=custom_mode(AUTO, 6),
    takeoff_by_command=False,
    resumes_from_failsafe=True,
    setpoint_frames=frozenset({1, 8}),
    streams_hz={
        "LOCAL_POSITION_NED": 10.0,
        "ATTITUDE": 10.0,
        "DISTANCE_SENSOR": 10.0,
        "CURRENT_MODE": 10.0,  # sent twice a second, and when it has changed
        "SYS_STATUS": 1.0,
        "ESTIMATOR_STATUS": 1.0,
    },
    mode_names={custom_mode(main): name for main, name in MAIN_MODES.items()}
    | {custom_mode(AUTO, sub): f"AUTO.{name}" for sub, name in AUTO_MODES.items()}
    | {custom_mode(POSCTL, sub): f"POSCTL.{name}" for sub, name in POSCTL_MODES.items()},
    failsafe_modes=frozenset(
        {
            *(custom_mode(main) for main in (2, POSCTL, 7, 10)),
            *(custom_mode(AUTO, sub) for sub in (3, 5, 6, 9)),
        }
    ),
)
