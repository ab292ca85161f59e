"""PX4's parameters that would bite; what they do is recorded (1.17) or in PX4's documentation."""

from __future__ import annotations

from swarm_ctl.doctor.rows import (
    ABOVE_CEILING,
    CEILING,
    CLIMB,
    CRITICAL,
    HEIGHT,
    IN_SWARM,
    LONGEST,
    RADIUS,
    SPEED,
    WITH_MISSION,
    WITH_PILOT,
    WITHOUT_GROUND_STATION,
    WITHOUT_PILOT,
    Case,
    Good,
    Parameter,
    Severity,
    When,
    anything_but,
    at_least,
    at_most,
    between,
    bits,
    flies_blind,
    off_or_at_least,
    one_of,
    setting,
)

ERROR, WARNING = Severity.ERROR, Severity.WARNING
LOSS_ACTIONS = {
    0: "position mode",
    1: "altitude mode",
    2: "stabilized",
    3: "return",
    4: "land",
    5: "hold",
    6: "terminate",
    7: "disarm",
}
LINK_ACTIONS = {0: "nothing", 1: "hold", 2: "return", 3: "land", 5: "terminate", 6: "disarm"}
FENCE_ACTIONS = {0: "nothing", 1: "warn", 2: "hold", 3: "return", 4: "terminate", 5: "land"}
BATTERY_ACTIONS = {0: "warn only", 2: "land", 3: "return when critical, land in emergency"}
STICKS = {0: "transmitter only", 1: "joystick only", 4: "no sticks"}
STREAM_SETS = {0: "normal", 2: "onboard", 7: "minimal", 13: "low bandwidth"}
OFFBOARD_EXCEPTION = 4
IMMORTAL = 121212.0


def _has_eyes(value: float, case: Case) -> bool:
    return bool(value or case.value("EKF2_OF_CTRL"))


GNSS_DENIED = When(
    "EKF2_GPS_CTRL or SYS_HAS_GPS is 0", flies_blind, ("EKF2_GPS_CTRL", "SYS_HAS_GPS")
)
AIDED = Good("not 0, or EKF2_OF_CTRL not 0", _has_eyes, lambda *_: None, ("EKF2_OF_CTRL",))
FENCED = setting("GF_ACTION", lambda action: action >= 2.0, "2 or more")

PARAMETERS = (
    # when the controller is gone
    Parameter(
        "COM_OF_LOSS_T",
        between(0.5, 1.0),
        ERROR,
        "so long the last velocity is flown on blindly when the controller dies; much shorter, a "
        "few late setpoints end the flight",
        unit="s",
        is_safe_to_set=True,
    ),
    Parameter(
        "COM_OBL_RC_ACT",
        one_of(4, 5, 0),
        ERROR,
        "what happens when the setpoints stop: sticks that nobody holds, a way home through "
        "unknown walls, or motors off in the air",
        meanings=LOSS_ACTIONS,
        is_safe_to_set=True,
    ),
    Parameter(
        "COM_OBL_RC_ACT",
        one_of(4, 5),
        WARNING,
        "position mode without a pilot sinks and lands somewhere, and shows a mode it is not in",
        when=(WITHOUT_PILOT, setting("COM_OBL_RC_ACT", lambda action: action == 0.0, "0")),
        meanings=LOSS_ACTIONS,
        is_safe_to_set=True,
    ),
    # without ground station and transmitter
    Parameter(
        "NAV_DLL_ACT",
        one_of(0),
        ERROR,
        "it will not arm without a ground station, and leaves offboard mode when one goes away",
        when=(WITHOUT_GROUND_STATION,),
        meanings=LINK_ACTIONS,
    ),
    Parameter(
        "NAV_DLL_ACT",
        one_of(0, 1, 2, 3),
        ERROR,
        "motors off in the air because a ground station was not heard",
        meanings=LINK_ACTIONS,
    ),
    Parameter(
        "NAV_RCL_ACT",
        one_of(1, 3, 2),
        ERROR,
        "motors off in the air because the transmitter was not heard",
        meanings=LINK_ACTIONS,
    ),
    Parameter(
        "COM_RCL_EXCEPT",
        bits(set_=OFFBOARD_EXCEPTION),
        WARNING,
        "a transmitter that is on at the start and out of range behind the first wall ends the "
        "mission by NAV_RCL_ACT",
        when=(WITH_PILOT,),
    ),
    Parameter(
        "COM_RC_IN_MODE",
        anything_but(0, instead=1.0),
        WARNING,
        "wants a calibrated transmitter, and none is there",
        when=(WITHOUT_PILOT,),
        meanings=STICKS,
    ),
    # limits of its own beside the mission's
    Parameter(
        "GF_ACTION",
        anything_but(4, instead=2.0),
        ERROR,
        "leaving the autopilot's own fence would stop the motors in the air",
        meanings=FENCE_ACTIONS,
    ),
    Parameter(
        "GF_MAX_HOR_DIST",
        off_or_at_least(RADIUS),
        ERROR,
        "the autopilot's own fence would end the mission inside the mission's",
        when=(WITH_MISSION, FENCED),
        unit="m",
    ),
    Parameter(
        "GF_MAX_VER_DIST",
        off_or_at_least(ABOVE_CEILING),
        ERROR,
        "the autopilot's own fence would end the mission below the mission's ceiling",
        when=(WITH_MISSION, FENCED),
        unit="m",
    ),
    Parameter(
        "RTL_RETURN_ALT",
        at_most(CEILING, instead=HEIGHT),
        ERROR,
        "a return, by a failsafe or by a ground station's button, climbs to it first: into the "
        "roof, or out of the mission's ceiling",
        when=(WITH_MISSION,),
        unit="m",
        is_safe_to_set=True,
    ),
    Parameter(
        "RTL_DESCEND_ALT",
        at_most(CEILING, instead=HEIGHT),
        WARNING,
        "where a return waits before it lands; above the ceiling it is where RTL_RETURN_ALT says",
        when=(WITH_MISSION,),
        unit="m",
        is_safe_to_set=True,
    ),
    Parameter(
        "MPC_XY_VEL_MAX",
        at_least(SPEED),
        WARNING,
        "cuts every setpoint: the mission is flown more slowly than planned",
        when=(WITH_MISSION,),
        unit="m/s",
    ),
    Parameter(
        "MPC_Z_VEL_MAX_UP",
        at_least(CLIMB),
        WARNING,
        "cuts every setpoint: it climbs more slowly than planned",
        when=(WITH_MISSION,),
        unit="m/s",
    ),
    Parameter(
        "MPC_Z_VEL_MAX_DN",
        at_least(CLIMB),
        WARNING,
        "cuts every setpoint: it sinks more slowly than planned",
        when=(WITH_MISSION,),
        unit="m/s",
    ),
    Parameter(
        "COM_FLT_TIME_MAX",
        Good(
            "-1 or at least limits.max_time_s",
            lambda value, case: value < 0.0 or at_least(LONGEST).holds(value, case),
            at_least(LONGEST).advised,
        ),
        WARNING,
        "the autopilot returns by itself before the mission is over",
        when=(WITH_MISSION,),
        unit="s",
    ),
    Parameter(
        "CP_DIST",
        at_most(-1.0),
        WARNING,
        "its own collision prevention acts in position mode, where it lands after the loss of "
        "setpoints; the controller keeps the distances",
        unit="m",
    ),
    # protections that are off
    Parameter(
        "COM_LOW_BAT_ACT",
        one_of(2, 3),
        WARNING,
        "nobody acts on an empty battery when the controller is gone",
        meanings=BATTERY_ACTIONS,
        is_safe_to_set=True,
    ),
    Parameter(
        "BAT_CRIT_THR",
        at_most(CRITICAL),
        WARNING,
        "the autopilot acts on the battery before the mission's limits do",
        when=(WITH_MISSION,),
    ),
    Parameter(
        "COM_DISARM_PRFLT",
        Good(
            "negative or at least 5",
            lambda value, _: value < 0.0 or value >= 5.0,
            lambda *_: 10.0,
        ),
        WARNING,
        "it disarms before it has taken off",
        unit="s",
        is_safe_to_set=True,
    ),
    Parameter(
        "CBRK_SUPPLY_CHK",
        one_of(0),
        WARNING,
        "the power supply is not checked before arming",
        is_safe_to_set=True,
    ),
    Parameter(
        "CBRK_FLIGHTTERM",
        Good("121212", lambda value, _: value == IMMORTAL, lambda *_: None),
        WARNING,
        "its failure detector may stop the motors in the air; known to its owner?",
        needs_reboot=True,
    ),
    Parameter(
        "CBRK_IO_SAFETY",
        anything_but(0, instead=22027.0),
        WARNING,
        "somebody has to press its safety switch before every flight",
    ),
    # without satellites
    Parameter(
        "COM_ARM_WO_GPS",
        one_of(1, 2),
        ERROR,
        "it will not arm without satellites",
        when=(GNSS_DENIED,),
    ),
    Parameter(
        "EKF2_HGT_REF",
        anything_but(1, instead=0.0),
        ERROR,
        "its height would come from satellites that it does not use",
        when=(GNSS_DENIED,),
        meanings={0: "barometer", 1: "GPS", 2: "rangefinder", 3: "vision"},
        needs_reboot=True,
    ),
    Parameter(
        "EKF2_EV_CTRL",
        AIDED,
        ERROR,
        "without satellites, vision and optical flow nothing tells where it is",
        when=(GNSS_DENIED,),
    ),
    # messages of the peers
    *(
        Parameter(
            f"MAV_{n}_FORWARD",
            one_of(1),
            ERROR,
            "what the peers say does not get from the radio's port to the companion's: vehicles "
            "that do not hear each other collide",
            when=(IN_SWARM, setting(f"MAV_{n}_CONFIG", bool, "not 0")),
            is_safe_to_set=True,
            needs_reboot=True,
        )
        for n in range(3)
    ),
    Parameter(
        "MAV_1_MODE",
        one_of(2),
        WARNING,
        "the companion's port sends what a ground station needs, not what a controller needs",
        when=(setting("MAV_1_CONFIG", bool, "not 0"),),
        meanings=STREAM_SETS,
        needs_reboot=True,
    ),
    Parameter(
        "MAV_1_RATE",
        Good(
            "0 or at least 10000",
            lambda value, _: value == 0.0 or value >= 10_000.0,
            lambda *_: 0.0,
        ),
        WARNING,
        "PX4 thins out all streams until they fit",
        when=(setting("MAV_1_CONFIG", bool, "not 0"),),
        unit="B/s",
        needs_reboot=True,
    ),
)
