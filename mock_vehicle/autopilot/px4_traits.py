"""PX4 1.17 in numbers: loops, modes, times and texts, as recorded in `reference/px4`."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mock_vehicle.autopilot import commands, rates
from mock_vehicle.autopilot.commands import Result
from mock_vehicle.autopilot.px4_failsafe import Action
from mock_vehicle.autopilot.traits import (
    Boot,
    Manoeuvre,
    Mode,
    Motors,
    Return,
    Traits,
)
from mock_vehicle.dynamics import UNLIMITED, Limits, Loop
from mock_vehicle.sensors.gnss import Fix

LIMITS = Limits(
    # A PID on velocity with SIH's drag and a lagging attitude loop that turns only so fast; fitted
    # to step_responses.json, all times and shares reached within 20 %.
    horizontal=Loop(
        velocity_gain_1_s=2.0,
        accel_m_s2=UNLIMITED,
        jerk_m_s3=24.0,
        delay_s=0.12,
        speed_m_s=12.0,  # MPC_XY_VEL_MAX
        lag_s=0.11,
        thrust_m_s2=9.6,  # tilt 45 deg, less what the lag takes
        integral_1_s2=0.7,
        integral_error_m_s=4.0,
        damping=0.15,
        drag_1_s=0.8,
        position_gain_1_s=0.95,  # MPC_XY_P
    ),
    vertical=Loop(
        velocity_gain_1_s=5.3,
        accel_m_s2=8.5,
        jerk_m_s3=UNLIMITED,
        delay_s=0.06,
        speed_m_s=3.0,
        lag_s=0.04,
        thrust_m_s2=8.5,
        integral_1_s2=4.7,
        damping=0.3,
        drag_1_s=0.3,
        position_gain_1_s=0.8,
    ),
    sink_m_s=1.5,
    yaw_rate_rad_s=2.46,
    yaw_accel_rad_s2=6.0,
    yaw_gain_1_s=4.0,
)


def custom_mode(main: int, sub: int = 0) -> int:
    """Build HEARTBEAT.custom_mode."""
    return main << 16 | sub << 24


MAIN_AUTO = 4
ALTCTL = custom_mode(2)
POSCTL = custom_mode(3)
STABILIZED = custom_mode(7)
AUTO_TAKEOFF = custom_mode(MAIN_AUTO, 2)
AUTO_LOITER = custom_mode(MAIN_AUTO, 3)
AUTO_MISSION = custom_mode(MAIN_AUTO, 4)
AUTO_RTL = custom_mode(MAIN_AUTO, 5)
AUTO_LAND = custom_mode(MAIN_AUTO, 6)
OFFBOARD = custom_mode(6)
TERMINATION = custom_mode(10)
SUB_MISSION = 4

MODES: Mapping[int, Mode] = {
    custom_mode(1): Mode("MANUAL", 81, Manoeuvre.SINK, can_enter_flying=False),
    ALTCTL: Mode("ALTCTL", 81, Manoeuvre.SINK, can_enter_flying=False),
    POSCTL: Mode("POSCTL", 81, Manoeuvre.SINK, can_enter_flying=False),
    custom_mode(5): Mode("ACRO", 65, Manoeuvre.SINK, can_enter_flying=False),
    STABILIZED: Mode("STABILIZED", 81, Manoeuvre.SINK, can_enter_flying=False),
    OFFBOARD: Mode("OFFBOARD", 17, Manoeuvre.SETPOINT),
    AUTO_TAKEOFF: Mode("AUTO.TAKEOFF", 29, Manoeuvre.TAKEOFF, can_arm=True),
    AUTO_LOITER: Mode("AUTO.LOITER", 29, Manoeuvre.HOLD, can_arm=True),
    AUTO_MISSION: Mode("AUTO.MISSION", 29, Manoeuvre.HOLD, can_enter_flying=False),
    AUTO_RTL: Mode("AUTO.RTL", 29, Manoeuvre.RETURN),
    AUTO_LAND: Mode("AUTO.LAND", 29, Manoeuvre.LAND),
    custom_mode(MAIN_AUTO, 8): Mode("AUTO.FOLLOW", 17, Manoeuvre.HOLD),
    custom_mode(MAIN_AUTO, 9): Mode("AUTO.PRECLAND", 29, Manoeuvre.LAND),
    TERMINATION: Mode("TERMINATION", 1, Manoeuvre.FALL, can_enter=False),
}
MAIN_MODES = frozenset(number >> 16 & 0xFF for number in MODES)
FAILSAFE_MODES: Mapping[Action, int] = {
    Action.POSITION: POSCTL,
    Action.ALTITUDE: ALTCTL,
    Action.STABILIZED: STABILIZED,
    Action.HOLD: AUTO_LOITER,
    Action.RETURN: AUTO_RTL,
    Action.LAND: AUTO_LAND,
    Action.TERMINATE: TERMINATION,
}
"""What a failsafe flies."""
CHOSEN_ACTIONS: Mapping[int, Action] = {AUTO_RTL: Action.RETURN, AUTO_LAND: Action.LAND}
"""What the user does by himself; no failsafe less grave interferes."""
BASE_MODE_OFFBOARD_SILENT = 1
"""Disarmed in OFFBOARD without setpoints."""

TRAITS = Traits(
    autopilot=12,
    capabilities=59647,
    flight_sw_version=17891392,
    other_versions=(
        17891392,
        101854463,
        1,
        bytes([0, 0, 0, 12, 152, 106, 67, 102]),
        bytes([0, 0, 0, 12, 152, 106, 67, 102]),
    ),
    limits=LIMITS,
    modes=MODES,
    first_mode=AUTO_LOITER,
    load=117,
    full_battery_v=16.2,
    battery_kind=(1, 1),
    motors=Motors(disarmed_us=900, idle_us=1000, hover_us=1507, hover_thrust=0.51, unused_us=900),
    fix=Fix(3, 70, 110, 10, 900, 1780, 400),
    has_receiver=True,
    backward=12,
    gives_origin_with_home=False,
    home_attitude=(1.0, 0.0, 0.0, 0.0),
    guesses_airspeed=False,
    estimator_flags=((3.5, 1023), (2.5, 229), (-math.inf, 164)),
    doubt_s=1.0,
    doubting_flags=0x25,
    dead_reckoning_s=5.0,  # EKF2_NOAID_TOUT; a loss was not recorded
    boot=Boot(
        heartbeat_s=1.45,
        standby_s=1.45,
        gnss_s=0.55,
        origin_s=1.2,
        home_s=2.5,
        position_s=0.6,
        ready_s=4.6,
    ),
    intervals_s={
        "lean": (rates.PX4_LEAN,),
        "shown": (rates.PX4_LEAN, rates.PX4_SHOWN, rates.PX4_DISPLAY),
        "full": (rates.PX4_COMPANION, rates.PX4_GROUND, rates.PX4_DISPLAY),
    },
    sources_s=rates.PX4_SOURCES_S,
    fixed_streams=frozenset({commands.HEARTBEAT.id}),
    denial=Result.TEMPORARILY_REJECTED,
    arm_nan_result=Result.ACCEPTED,
    arm_other_result=None,
    interval_refusal=Result.FAILED,
    request_refusal=Result.DENIED,
    reboot_refusal=Result.DENIED,
    unknown_interval_us=-1,
    unknown_interval_result=Result.ACCEPTED,
    acknowledges_first=False,
    vtol_state=0,
    texts_armed=("Armed by external command\t",),
    texts_disarmed=(),
    texts_disarmed_by_landing=("Disarmed by landing\t",),
    texts_takeoff=("Takeoff detected\t",),
    texts_landing=("Landing detected\t",),
    not_landed_texts=("Disarming denied: not landed\t",),
    idle_disarm_s=10.0,  # COM_DISARM_PRFLT
    touchdown_s=1.5,
    landed_disarm_s=2.0,  # COM_DISARM_LAND
    disarms_wherever_landed=True,
    takeoff_announced_s=1.9,
    takeoff_lift_s=4.4,
    takeoff_height_m=2.5,  # MIS_TAKEOFF_ALT
    takeoff_speed_m_s=1.4,
    takeoff_gain_1_s=1.0,
    takeoff_slack_m=0.25,
    setpoint_announced_s=2.0,
    setpoint_lift_s=3.4,
    setpoint_timeout_s=1.0,  # COM_OF_LOSS_T
    land_speeds_m_s=((5.0, 1.3), (0.5, 0.7), (-math.inf, 0.3)),
    sink_m_s=0.6,
    going_home=Return(height_m=30.0, slope=1.0, near_m=10.0, least_climb_m=0.0, wait_s=0.0),
)
