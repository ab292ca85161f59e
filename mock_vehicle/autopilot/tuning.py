"""What parameters change: recorded numbers, scaled by a parameter over its recorded default."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from mock_vehicle.autopilot.parameters import Parameters
from mock_vehicle.autopilot.traits import Return, Traits
from mock_vehicle.dynamics import Limits

CM = 100.0
LEAST_GAIN = 0.01
STEEP = 1e6
"""The slope of a return that has no cone."""
LEAST_CLIMB_M = 2.5
"""RTL_ABS_MIN_CLIMB of ArduPilot."""


def px4(traits: Traits, parameters: Parameters) -> Traits:
    """Give PX4's numbers under these parameters."""
    share, finite = parameters.share, parameters.finite
    fast, slow, crawl = traits.land_speeds_m_s
    return _changed(
        traits,
        limits=_px4_limits(traits.limits, parameters),
        setpoint_timeout_s=traits.setpoint_timeout_s * share("COM_OF_LOSS_T"),
        idle_disarm_s=_unless_never(traits.idle_disarm_s, share("COM_DISARM_PRFLT")),
        landed_disarm_s=_unless_never(traits.landed_disarm_s, share("COM_DISARM_LAND")),
        takeoff_height_m=finite("MIS_TAKEOFF_ALT"),
        takeoff_speed_m_s=traits.takeoff_speed_m_s * share("MPC_TKO_SPEED"),
        land_speeds_m_s=(
            fast,
            (slow[0], slow[1] * share("MPC_LAND_SPEED")),
            (crawl[0], crawl[1] * share("MPC_LAND_CRWL")),
        ),
        going_home=Return(
            height_m=finite("RTL_RETURN_ALT"),
            slope=_cone_slope(finite("RTL_CONE_ANG")),
            near_m=finite("RTL_MIN_DIST"),
            least_climb_m=0.0,
            wait_s=traits.going_home.wait_s + finite("RTL_LAND_DELAY", 0.0),
        ),
    )


def _changed(recorded: Traits, **numbers: Any) -> Traits:
    """Replace numbers; whose are all as recorded share one object, as with `traits.shared`."""
    changed = replace(recorded, **numbers)
    return recorded if changed == recorded else changed


def _px4_limits(limits: Limits, parameters: Parameters) -> Limits:
    share, horizontal, vertical = parameters.share, limits.horizontal, limits.vertical
    return replace(
        limits,
        horizontal=replace(
            horizontal,
            speed_m_s=horizontal.speed_m_s * share("MPC_XY_VEL_MAX"),
            position_gain_1_s=horizontal.position_gain_1_s * share("MPC_XY_P", LEAST_GAIN),
        ),
        vertical=replace(
            vertical,
            speed_m_s=vertical.speed_m_s * share("MPC_Z_VEL_MAX_UP"),
            position_gain_1_s=vertical.position_gain_1_s * share("MPC_Z_P", LEAST_GAIN),
        ),
        sink_m_s=limits.sink_m_s * share("MPC_Z_VEL_MAX_DN"),
    )


def ardupilot(traits: Traits, parameters: Parameters) -> Traits:
    """Give ArduPilot's numbers under these parameters."""
    share, finite = parameters.share, parameters.finite
    high, low = traits.land_speeds_m_s
    high_m_s = finite("LAND_SPEED_HIGH", 0.0) / CM or high[1] * share("WPNAV_SPEED_DN")
    return _changed(
        traits,
        limits=_ardupilot_limits(traits.limits, parameters),
        has_receiver=finite("SIM_GPS1_ENABLE") != 0.0,
        full_battery_v=finite("SIM_BATT_VOLTAGE", 0.0, 65.0),
        setpoint_timeout_s=traits.setpoint_timeout_s * share("GUID_TIMEOUT"),
        idle_disarm_s=_unless_never(traits.idle_disarm_s, share("DISARM_DELAY")),
        takeoff_speed_m_s=traits.takeoff_speed_m_s * share("WPNAV_SPEED_UP"),
        land_speeds_m_s=(
            (finite("LAND_ALT_LOW", 0.0) / CM, high_m_s),
            (low[0], low[1] * share("LAND_SPEED")),
        ),
        going_home=Return(
            height_m=finite("RTL_ALT") / CM,
            slope=finite("RTL_CONE_SLOPE") or STEEP,
            near_m=math.inf,
            least_climb_m=LEAST_CLIMB_M,
            wait_s=finite("RTL_LOIT_TIME", 0.0) / 1e3,
        ),
    )


def _ardupilot_limits(limits: Limits, parameters: Parameters) -> Limits:
    share, horizontal, vertical = parameters.share, limits.horizontal, limits.vertical
    return replace(
        limits,
        horizontal=replace(
            horizontal,
            position_speed_m_s=horizontal.position_speed_m_s * share("WPNAV_SPEED"),
        ),
        vertical=replace(
            vertical,
            position_speed_m_s=vertical.position_speed_m_s * share("WPNAV_SPEED_UP"),
        ),
        position_sink_m_s=limits.position_sink_m_s * share("WPNAV_SPEED_DN"),
    )


def _unless_never(delay_s: float, share: float) -> float:
    """Scale a delay for which 0 means never."""
    return delay_s * share or math.inf


def _cone_slope(half_angle_deg: float) -> float:
    """Turn PX4's cone into height per distance; no cone is steep."""
    if half_angle_deg <= 0.0:
        return STEEP
    return round(1.0 / math.tan(math.radians(min(half_angle_deg, 89.0))), 6)  # 45 deg are 1
