"""What autopilots differ in when they fly missions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mock_vehicle.autopilot.plans import Cmd
from mock_vehicle.autopilot.progress import MissionState


@dataclass(frozen=True, slots=True)
class AutoRules:
    """What autopilots differ in when they fly missions; recorded, see `reference/`."""

    cruise: tuple[str, float]
    """The parameter of the speed between places, and its unit in m/s."""
    accel_m_s2: float
    """Larger gets going sooner."""
    brake_m_s2: float
    """Larger brakes later before a place."""
    climb_m_s: float
    sink_m_s: float
    """Fastest climb and descent between places."""
    slows_setpoints: bool
    """DO_CHANGE_SPEED counts for setpoints that are places, too."""
    radius: tuple[str, float]
    """The parameter of the distance at which a place is reached, and its unit in m."""
    stops_exactly: bool
    """A place to stop at is reached when the vehicle rests there."""
    announces: bool
    """Each item is announced, and each place that is reached."""
    begin_text: str
    takeoff_text: str
    landed_text: str
    finished_text: str
    needs_leave: bool
    """On the ground it waits for MISSION_START."""
    zero_is_here: bool
    """An altitude of 0 means this one."""
    takes_off_by_itself: bool
    """A mission may begin with a place; else it may not be begun on the ground."""
    reaches_before_landing: bool
    """A landing is reached above its place; else on the ground."""
    disarms_landed: bool
    """A mission that ends on the ground disarms at once."""
    keeps_current: bool
    """The last item stays the current one at the end."""
    tells_changes: bool
    """MISSION_CURRENT is sent on every change."""
    left_state: MissionState
    """MISSION_CURRENT.mission_state of a mission that another mode interrupts."""


PX4_AUTO = AutoRules(
    cruise=("MPC_XY_CRUISE", 1.0),
    accel_m_s2=1.9,
    brake_m_s2=0.75,
    climb_m_s=3.0,  # MPC_Z_VEL_MAX_UP
    sink_m_s=1.5,  # MPC_Z_VEL_MAX_DN
    slows_setpoints=False,
    radius=("NAV_ACC_RAD", 1.0),
    stops_exactly=False,
    announces=False,
    begin_text="Executing Mission\t",
    takeoff_text="Climb to {:.1f} meters above home\t",
    landed_text="Mission finished, landed\t",
    finished_text="Mission finished, loitering\t",
    needs_leave=False,
    zero_is_here=False,
    takes_off_by_itself=True,
    reaches_before_landing=True,
    disarms_landed=True,
    keeps_current=True,
    tells_changes=True,
    left_state=MissionState.PAUSED,
)
ARDUPILOT_AUTO = AutoRules(
    cruise=("WPNAV_SPEED", 0.01),
    accel_m_s2=100.0,  # as soon as its velocity loop can
    brake_m_s2=0.6,
    climb_m_s=2.5,  # WPNAV_SPEED_UP
    sink_m_s=1.5,  # WPNAV_SPEED_DN
    slows_setpoints=True,
    radius=("WPNAV_RADIUS", 0.01),
    stops_exactly=True,
    announces=True,
    begin_text="",
    takeoff_text="",
    landed_text="",
    finished_text="",
    needs_leave=True,
    zero_is_here=True,
    takes_off_by_itself=False,
    reaches_before_landing=False,
    disarms_landed=False,
    keeps_current=False,
    tells_changes=False,
    left_state=MissionState.NOT_STARTED,
)


NAMES: Mapping[int, str] = {
    Cmd.NAV_WAYPOINT: "WP",
    Cmd.NAV_SPLINE_WAYPOINT: "SplineWP",
    Cmd.NAV_LOITER_UNLIM: "LoitUnlim",
    Cmd.NAV_LOITER_TURNS: "LoitTurns",
    Cmd.NAV_LOITER_TIME: "LoitTime",
    Cmd.NAV_LOITER_TO_ALT: "LoitAltitude",
    Cmd.NAV_RETURN_TO_LAUNCH: "RTL",
    Cmd.NAV_LAND: "Land",
    Cmd.NAV_TAKEOFF: "Takeoff",
    Cmd.NAV_DELAY: "Delay",
    Cmd.CONDITION_DELAY: "CondDelay",
    Cmd.CONDITION_YAW: "CondYaw",
    Cmd.DO_CHANGE_SPEED: "ChangeSpeed",
}
"""ArduPilot's words for items."""
REPORTED = frozenset({Cmd.NAV_WAYPOINT, Cmd.NAV_SPLINE_WAYPOINT, Cmd.NAV_LOITER_TIME})
"""What ArduPilot says "Reached command" of."""
