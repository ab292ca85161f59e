"""What each autopilot sends unasked, how often, and in which groups; as recorded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from swarm_ctl import wire


def _intervals_s(hz: Mapping[str, float]) -> Mapping[int, float]:
    """Turn rates by name into intervals by message id."""
    return {wire.message(name).id: 1.0 / rate for name, rate in hz.items()}


def _ids(*names: str) -> tuple[int, ...]:
    return tuple(wire.message(name).id for name in names)


PX4_LEAN = _intervals_s(
    # What a swarm's controller reads of the companion link, 10 Hz at most.
    {
        "HEARTBEAT": 1.0,
        "ATTITUDE": 10.0,
        "LOCAL_POSITION_NED": 10.0,
        "DISTANCE_SENSOR": 10.0,
        "EXTENDED_SYS_STATE": 5.0,
        "SYS_STATUS": 5.0,
        "BATTERY_STATUS": 0.5,
    }
)
PX4_COMPANION = _intervals_s(
    # default_streams.offboard_14540 in sim time: what was counted, over 0.988.
    {
        "HEARTBEAT": 1.0,
        "ATTITUDE": 100.0,
        "ATTITUDE_QUATERNION": 50.0,
        "GLOBAL_POSITION_INT": 50.0,
        "HIGHRES_IMU": 50.0,
        "LOCAL_POSITION_NED": 30.0,
        "ODOMETRY": 30.0,
        "TIMESYNC": 10.0,
        "ALTITUDE": 10.0,
        "DISTANCE_SENSOR": 10.0,
        "ATTITUDE_TARGET": 10.0,
        "POSITION_TARGET_LOCAL_NED": 10.0,
        "SERVO_OUTPUT_RAW": 10.0,
        "VFR_HUD": 10.0,
        "GPS_RAW_INT": 8.0,
        "EXTENDED_SYS_STATE": 5.0,
        "SYS_STATUS": 5.0,
        "MISSION_CURRENT": 1.0,
        "ESTIMATOR_STATUS": 1.0,
        "OPEN_DRONE_ID_LOCATION": 1.0,
        "OPEN_DRONE_ID_SYSTEM": 1.0,
        "PING": 1.0,
        "SCALED_PRESSURE": 1.0,
        "SYSTEM_TIME": 1.0,
        "BATTERY_STATUS": 0.5,
        "CURRENT_MODE": 0.5,
        "HOME_POSITION": 0.5,
        "VIBRATION": 0.5,
    }
)
PX4_GROUND = _intervals_s(
    # default_streams.gcs_14550, likewise.
    {
        "HEARTBEAT": 1.0,
        "ATTITUDE": 50.0,
        "ATTITUDE_QUATERNION": 50.0,
        "GLOBAL_POSITION_INT": 50.0,
        "LOCAL_POSITION_NED": 50.0,
        "ATTITUDE_TARGET": 50.0,
        "POSITION_TARGET_LOCAL_NED": 50.0,
        "SERVO_OUTPUT_RAW": 50.0,
        "GPS_RAW_INT": 5.0,
        "VFR_HUD": 4.0,
        "ALTITUDE": 1.0,
        "EXTENDED_SYS_STATE": 1.0,
        "OPEN_DRONE_ID_LOCATION": 1.0,
        "OPEN_DRONE_ID_SYSTEM": 1.0,
        "SCALED_PRESSURE": 1.0,
        "SYS_STATUS": 1.0,
        "MISSION_CURRENT": 1.0,
        "BATTERY_STATUS": 0.5,
        "CURRENT_MODE": 0.5,
        "DISTANCE_SENSOR": 0.5,
        "ESTIMATOR_STATUS": 0.5,
        "HOME_POSITION": 0.5,
        "PING": 0.1,
        "VIBRATION": 0.1,
    }
)
PX4_DISPLAY = _intervals_s(
    # default_streams.sihsim_19410, likewise, without the motors' HIL_ACTUATOR_CONTROLS.
    {"HEARTBEAT": 1.0, "HIL_STATE_QUATERNION": 25.0, "MISSION_CURRENT": 1.0}
)
PX4_SHOWN = {number: max(interval_s, 0.25) for number, interval_s in PX4_GROUND.items()}
"""The same for a swarm: 4 Hz is enough to look at."""
PX4_SOURCES_S = _intervals_s({"GPS_RAW_INT": 8.0})
"""Sources that are slower than the steps: asking for more gives no more."""

ARDUPILOT_LEAN = _intervals_s({"HEARTBEAT": 1.0})
ARDUPILOT_FULL = _intervals_s({"HEARTBEAT": 1.0, "TIMESYNC": 0.1})
"""Nothing else flows until somebody asks."""

STREAM_ALL = 0
_GROUPS: Mapping[int, tuple[int, ...]] = {
    1: _ids("RAW_IMU", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE", "SCALED_PRESSURE2"),
    2: _ids(
        "SYS_STATUS",
        "POWER_STATUS",
        "MEMINFO",
        "NAV_CONTROLLER_OUTPUT",
        "MISSION_CURRENT",
        "GPS_RAW_INT",
        "FENCE_STATUS",
    ),
    3: _ids("SERVO_OUTPUT_RAW", "RC_CHANNELS"),
    6: _ids("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    10: _ids("AHRS2", "ATTITUDE", "SIMSTATE", "ESC_TELEMETRY_1_TO_4"),
    11: _ids("VFR_HUD"),
    12: _ids(
        "VIBRATION",
        "BATTERY_STATUS",
        "AHRS",
        "SYSTEM_TIME",
        "TERRAIN_REPORT",
        "EKF_STATUS_REPORT",
        "WIND",
        "DISTANCE_SENSOR",  # which the recorded vehicle did not have
    ),
}


def _all(groups: Iterable[tuple[int, ...]]) -> tuple[int, ...]:
    return tuple(number for group in groups for number in group)


ARDUPILOT_GROUPS = {STREAM_ALL: _all(_GROUPS.values()), **_GROUPS}
"""Message ids by MAV_DATA_STREAM, for REQUEST_DATA_STREAM."""
