"""ArduCopter 4.7 in numbers: loops, modes, times and texts, as in `reference/ardupilot`."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mock_vehicle.autopilot import clock, rates
from mock_vehicle.autopilot.commands import Result
from mock_vehicle.autopilot.manoeuvres import NAN
from mock_vehicle.autopilot.traits import (
    Boot,
    Manoeuvre,
    Mode,
    Motors,
    Return,
    Traits,
)
from mock_vehicle.dynamics import Limits, Loop
from mock_vehicle.sensors.gnss import Fix

LIMITS = Limits(
    # A square-root controller with limited acceleration and jerk behind a pure delay and the
    # attitude loop's lag; fitted to ten recorded steps, all rise times within 7 %.
    horizontal=Loop(
        velocity_gain_1_s=2.44,
        accel_m_s2=2.87,
        jerk_m_s3=5.57,  # PSC_JERK_XY is 5
        delay_s=0.14,
        speed_m_s=10.25,  # where 30 deg of lean end
        lag_s=0.07,
        thrust_m_s2=5.66,  # 30 deg
        integral_1_s2=0.3,
        integral_error_m_s=0.55,
        damping=0.1,
        drag_1_s=0.15,
        drag_known=1.0,
        position_gain_1_s=1.0,  # PSC_POSXY_P
        position_accel_m_s2=1.25,
        position_speed_m_s=10.0,  # WPNAV_SPEED
    ),
    vertical=Loop(
        velocity_gain_1_s=6.96,
        accel_m_s2=1.23,
        jerk_m_s3=6.8,
        delay_s=0.06,
        speed_m_s=6.0,
        lag_s=0.21,
        thrust_m_s2=5.0,
        integral_1_s2=0.51,
        integral_error_m_s=0.26,
        damping=0.03,
        drag_1_s=0.15,
        drag_known=1.0,
        position_gain_1_s=1.0,
        position_accel_m_s2=0.8,
        position_speed_m_s=2.5,  # WPNAV_SPEED_UP
    ),
    sink_m_s=6.0,
    position_sink_m_s=1.5,  # WPNAV_SPEED_DN
    yaw_rate_rad_s=1.24,
    yaw_accel_rad_s2=2.5,
    yaw_gain_1_s=4.0,
)

STABILIZE, ACRO, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, LAND, BRAKE = 0, 1, 2, 3, 4, 5, 6, 9, 17

MODES: Mapping[int, Mode] = {
    STABILIZE: Mode("STABILIZE", 81, Manoeuvre.FALL, can_arm=True),
    ACRO: Mode("ACRO", 81, Manoeuvre.FALL, can_arm=True),
    ALT_HOLD: Mode("ALT_HOLD", 81, Manoeuvre.SINK, can_arm=True),
    AUTO: Mode("AUTO", 89, Manoeuvre.HOLD, can_enter_flying=False),
    GUIDED: Mode("GUIDED", 89, Manoeuvre.SETPOINT, can_arm=True),
    LOITER: Mode("LOITER", 89, Manoeuvre.SINK, can_arm=True),
    RTL: Mode("RTL", 89, Manoeuvre.RETURN),
    7: Mode("CIRCLE", 89, Manoeuvre.HOLD),
    LAND: Mode("LAND", 89, Manoeuvre.LAND),
    14: Mode("FLIP", 81, Manoeuvre.HOLD, can_enter=False),
    16: Mode("POSHOLD", 89, Manoeuvre.SINK, can_arm=True),
    BRAKE: Mode("BRAKE", 89, Manoeuvre.HOLD),
    21: Mode("SMART_RTL", 89, Manoeuvre.RETURN),
    23: Mode("FOLLOW", 89, Manoeuvre.HOLD, can_enter=False),
}
UNCHECKED = frozenset({STABILIZE, ACRO, ALT_HOLD})
"""A pilot's modes need no position: without ARMING_CHECK they arm as soon as the software runs."""
ENTRY_TEXTS: Mapping[int, str] = {23: "Set FOLL_ENABLE = 1"}
"""Said when the mode is asked for."""
ALLOW_ARMING = 1
"""The bit of AUTO_OPTIONS."""

BANNER = "ArduCopter V4.7.0-dev (2598e9d4)"
TRAITS = Traits(
    autopilot=3,
    capabilities=64495,
    flight_sw_version=67567616,
    other_versions=(0, 0, 0, b"2598e9d4", b""),
    limits=LIMITS,
    modes=MODES,
    first_mode=STABILIZE,
    load=0,
    full_battery_v=12.6,
    battery_kind=(0, 0),
    motors=Motors(disarmed_us=1000, idle_us=1100, hover_us=1583, hover_thrust=0.35, unused_us=0),
    fix=Fix(6, 121, 200, 10, 300, 300, 0),
    has_receiver=True,
    backward=4,
    gives_origin_with_home=True,
    home_attitude=(NAN, NAN, NAN, NAN),
    guesses_airspeed=True,
    estimator_flags=((41.5, 831), (5.9, 167), (5.5, 0), (-math.inf, 1024)),
    doubt_s=6.8,
    doubting_flags=37,
    dead_reckoning_s=15.2,
    boot=Boot(
        heartbeat_s=1.02,
        standby_s=2.46,
        gnss_s=10.1,
        origin_s=20.0,
        home_s=20.0,
        position_s=41.5,
        ready_s=41.5,
    ),
    intervals_s={
        "lean": (rates.ARDUPILOT_LEAN,),
        "shown": (rates.ARDUPILOT_LEAN,) * 3,
        "full": (rates.ARDUPILOT_FULL,),
    },
    sources_s={},
    fixed_streams=frozenset({clock.TIMESYNC.id}),
    denial=Result.FAILED,
    arm_nan_result=Result.UNSUPPORTED,  # the real one dies of it
    arm_other_result=Result.UNSUPPORTED,
    interval_refusal=Result.DENIED,
    request_refusal=Result.FAILED,
    reboot_refusal=Result.FAILED,
    unknown_interval_us=0,
    unknown_interval_result=Result.FAILED,
    acknowledges_first=True,
    vtol_state=3,
    texts_armed=("Arming motors",),
    texts_disarmed=("Disarming motors",),
    texts_disarmed_by_landing=(),
    texts_takeoff=(),
    texts_landing=(),
    not_landed_texts=(),
    idle_disarm_s=10.4,
    touchdown_s=1.7,
    landed_disarm_s=0.5,
    disarms_wherever_landed=False,
    takeoff_announced_s=3.4,
    takeoff_lift_s=3.25,
    takeoff_height_m=0.0,
    takeoff_speed_m_s=1.85,
    takeoff_gain_1_s=2.0,
    takeoff_slack_m=0.2,
    setpoint_announced_s=None,
    setpoint_lift_s=0.0,
    setpoint_timeout_s=3.0,  # GUID_TIMEOUT
    land_speeds_m_s=((10.0, 1.5), (-math.inf, 0.5)),
    sink_m_s=2.5,
    going_home=Return(height_m=15.0, slope=3.0, near_m=math.inf, least_climb_m=2.5, wait_s=5.0),
)
