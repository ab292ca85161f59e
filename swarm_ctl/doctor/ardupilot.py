"""ArduCopter's parameters that would bite; recorded (4.7), or in ArduPilot's documentation.

Names are those of 4.7; `older` has what other versions call them.
"""

from __future__ import annotations

from swarm_ctl.doctor.rows import (
    ABOVE_CEILING,
    AMONG_WALLS,
    BEYOND_SWARM,
    CEILING,
    HEIGHT,
    IN_SWARM,
    RADIUS,
    WALL,
    WITH_MISSION,
    WITH_PILOT,
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
    one_of,
    setting,
)

ERROR, WARNING = Severity.ERROR, Severity.WARNING
LINK_ACTIONS = {
    0: "nothing",
    1: "return",
    3: "SmartRTL or return",
    4: "SmartRTL or land",
    5: "land",
    7: "brake or land",
}
STICK_ACTIONS = {**LINK_ACTIONS, 3: "land", 4: "SmartRTL or return", 5: "SmartRTL or land"}
BATTERY_ACTIONS = {0: "nothing", 1: "land", 2: "return", 5: "terminate", 7: "brake or land"}
ESTIMATOR_ACTIONS = {0: "report only", 1: "land", 2: "AltHold", 3: "land from any mode"}
SOURCES = {0: "none", 3: "GPS", 4: "beacon", 5: "optical flow", 6: "external"}
GUIDED_EXCEPTION = 4
"""Bit of FS_OPTIONS: go on in GUIDED when the transmitter is lost."""
NO_STABILIZING = 16 | 32
"""Bits of GUID_OPTIONS that leave position and velocity to drift."""
NO_FORWARDING = 2
CIRCLE_FENCE, HEIGHT_FENCE, PROXIMITY = 2, 1, 2


def _stays_in_guided(value: float, case: Case) -> bool:
    return value == 0.0 or bool(int(case.value("FS_OPTIONS")) & GUIDED_EXCEPTION)


def _is_silent(case: Case) -> bool:
    return not case.chart.ranges


def _fence(bit: int, words: str) -> tuple[When, ...]:
    return (
        WITH_MISSION,
        setting("FENCE_ENABLE", bool, "not 0"),
        setting("FENCE_TYPE", lambda value: bool(int(value) & bit), words),
    )


GNSS_DENIED = When("EK3_SRC1_POSXY is not 3 (GPS)", flies_blind, ("EK3_SRC1_POSXY",))
NO_RANGES = When("no rangefinder is heard", _is_silent)

PARAMETERS = (
    # when the controller is gone
    Parameter(
        "GUID_TIMEOUT",
        between(0.5, 1.0),
        ERROR,
        "so long the last velocity is flown on blindly when the controller dies; then it brakes "
        "and stays in GUIDED",
        unit="s",
        is_safe_to_set=True,
    ),
    Parameter(
        "GUID_OPTIONS",
        bits(clear=NO_STABILIZING),
        ERROR,
        "position or velocity is not held in GUIDED: it drifts into what is beside it",
    ),
    # without ground station and transmitter
    Parameter(
        "FS_GCS_ENABLE",
        one_of(0),
        WARNING,
        "a ground station that was heard once and is out of range behind the first wall ends the "
        "mission; setpoints are no substitute for its heartbeats",
        meanings=LINK_ACTIONS,
    ),
    Parameter(
        "FS_GCS_TIMEOUT",
        at_least(5.0),
        WARNING,
        "a short shadow on the ground station's radio ends the mission",
        when=(setting("FS_GCS_ENABLE", bool, "not 0"),),
        unit="s",
        is_safe_to_set=True,
    ),
    Parameter(
        "MAV_GCS_SYSID",
        at_least(BEYOND_SWARM),
        WARNING,
        "a peer's controller, heard by radio, counts as the ground station: out of its range the "
        "failsafe strikes",
        when=(WITH_MISSION,),
        older={"SYSID_MYGCS": 1.0},
    ),
    Parameter(
        "FS_THR_ENABLE",
        Good("0, or FS_OPTIONS with 4", _stays_in_guided, lambda *_: 0.0, ("FS_OPTIONS",)),
        ERROR,
        "without a transmitter the radio failsafe strikes a second after arming",
        when=(WITHOUT_PILOT,),
        meanings=STICK_ACTIONS,
    ),
    Parameter(
        "FS_OPTIONS",
        bits(set_=GUIDED_EXCEPTION),
        WARNING,
        "a transmitter that is on at the start and out of range behind the first wall ends the "
        "mission by FS_THR_ENABLE",
        when=(WITH_PILOT, setting("FS_THR_ENABLE", bool, "not 0")),
    ),
    # limits of its own beside the mission's
    Parameter(
        "FENCE_RADIUS",
        at_least(RADIUS),
        ERROR,
        "the autopilot's own fence would end the mission inside the mission's",
        when=_fence(CIRCLE_FENCE, "with 2"),
        unit="m",
    ),
    Parameter(
        "FENCE_ALT_MAX",
        at_least(ABOVE_CEILING),
        ERROR,
        "the autopilot's own fence would end the mission below the mission's ceiling",
        when=_fence(HEIGHT_FENCE, "with 1"),
        unit="m",
    ),
    Parameter(
        "FENCE_ACTION",
        anything_but(0, instead=2.0),
        WARNING,
        "its fence only reports",
        when=(setting("FENCE_ENABLE", bool, "not 0"),),
    ),
    Parameter(
        "RTL_ALT_M",
        at_most(CEILING, instead=HEIGHT),
        ERROR,
        "a return, by a failsafe or by a ground station's button, climbs to it first: into the "
        "roof, or out of the mission's ceiling",
        when=(WITH_MISSION,),
        unit="m",
        older={"RTL_ALT": 0.01},
        is_safe_to_set=True,
    ),
    Parameter(
        "AVOID_MARGIN",
        at_most(WALL),
        ERROR,
        "its own avoidance stops farther from walls than the mission flies, and backs off: it "
        "never gets through a door",
        when=(
            WITH_MISSION,
            setting("AVOID_ENABLE", lambda value: bool(int(value) & PROXIMITY), "with 2"),
            setting("PRX1_TYPE", bool, "not 0"),
        ),
        unit="m",
    ),
    Parameter(
        "LAND_SPD_MS",
        between(0.2, 1.0),
        WARNING,
        "how hard it touches down when a failsafe lands it",
        unit="m/s",
        older={"LAND_SPEED": 0.01},
        is_safe_to_set=True,
    ),
    Parameter(
        "LAND_SPD_HIGH_MS",
        at_most(2.5),
        WARNING,
        "how fast a landing sinks above LAND_ALT_LOW; 0 is the waypoint's speed",
        unit="m/s",
        older={"LAND_SPEED_HIGH": 0.01},
        is_safe_to_set=True,
    ),
    # protections that are off
    Parameter(
        "FS_EKF_ACTION",
        one_of(1, 3),
        ERROR,
        "without a position it would drift on in GUIDED instead of landing",
        meanings=ESTIMATOR_ACTIONS,
        is_safe_to_set=True,
    ),
    Parameter(
        "FS_EKF_THRESH",
        between(0.6, 1.0),
        ERROR,
        "how bad the position estimate may get before it lands; 0 is no limit",
        is_safe_to_set=True,
    ),
    Parameter(
        "FS_CRASH_CHECK",
        one_of(1),
        WARNING,
        "the motors run on after a crash",
        is_safe_to_set=True,
    ),
    Parameter(
        "BATT_FS_LOW_ACT",
        anything_but(5, instead=1.0),
        ERROR,
        "a low battery stops the motors in the air",
        meanings=BATTERY_ACTIONS,
        is_safe_to_set=True,
    ),
    Parameter(
        "BATT_FS_LOW_ACT",
        anything_but(0, instead=1.0),
        WARNING,
        "nobody acts on an empty battery when the controller is gone",
        meanings=BATTERY_ACTIONS,
        is_safe_to_set=True,
    ),
    Parameter(
        "BATT_LOW_VOLT",
        Good(
            "above 0 V, or BATT_LOW_MAH is",
            lambda value, case: value > 0.0 or case.value("BATT_LOW_MAH") > 0.0,
            lambda *_: None,
            ("BATT_LOW_MAH",),
        ),
        WARNING,
        "nothing tells it when the battery is low",
        unit="V",
    ),
    Parameter(
        "ARMING_CHECK",
        anything_but(0, instead=1.0),
        ERROR,
        "it arms whatever is broken",
        is_safe_to_set=True,
    ),
    Parameter(
        "ARMING_CHECK",
        bits(set_=1),
        WARNING,
        "some of its checks before arming are switched off",
    ),
    Parameter(
        "ARMING_SKIPCHK",
        one_of(0),
        WARNING,
        "some of its checks before arming are switched off (the versions after ARMING_CHECK)",
    ),
    Parameter(
        "DISARM_DELAY",
        Good("5 to 60", between(5.0, 60.0).holds, lambda *_: 10.0),
        WARNING,
        "it disarms before it has taken off, or never after it has landed (0)",
        unit="s",
        is_safe_to_set=True,
    ),
    Parameter(
        "BRD_SAFETY_DEFLT",
        one_of(0),
        WARNING,
        "somebody has to press its safety switch before every flight",
        older={"BRD_SAFETYENABLE": 1.0},
        needs_reboot=True,
    ),
    # rangefinders
    Parameter(
        "RNGFND1_TYPE",
        anything_but(0),
        WARNING,
        "no rangefinder is set up, down and up are missing",
        when=(AMONG_WALLS, NO_RANGES),
        needs_reboot=True,
    ),
    Parameter(
        "PRX1_TYPE",
        anything_but(0),
        WARNING,
        "no proximity sensor is set up, front, back, left and right are missing",
        when=(AMONG_WALLS, NO_RANGES),
        needs_reboot=True,
    ),
    # without satellites
    Parameter(
        "EK3_SRC1_VELXY",
        one_of(5, 6),
        ERROR,
        "its velocity would come from satellites that it does not use",
        when=(GNSS_DENIED,),
        meanings=SOURCES,
    ),
    Parameter(
        "EK3_SRC1_POSZ",
        one_of(1, 2, 6),
        ERROR,
        "its height would come from satellites that it does not use",
        when=(GNSS_DENIED,),
        meanings={**SOURCES, 1: "barometer", 2: "rangefinder"},
    ),
    Parameter(
        "EK3_SRC1_YAW",
        one_of(1, 6, 8),
        ERROR,
        "its heading would come from satellites that it does not use",
        when=(GNSS_DENIED,),
        meanings={0: "none", 1: "compass", 2: "GPS", 3: "GPS or compass", 6: "external"},
    ),
    Parameter(
        "FLOW_TYPE",
        anything_but(0),
        ERROR,
        "its velocity comes from optical flow, and no flow sensor is set up",
        when=(setting("EK3_SRC1_VELXY", lambda source: source == 5.0, "5"),),
        needs_reboot=True,
    ),
    Parameter(
        "VISO_TYPE",
        anything_but(0),
        ERROR,
        "its velocity comes from outside, and nothing outside is set up",
        when=(setting("EK3_SRC1_VELXY", lambda source: source == 6.0, "6"),),
        needs_reboot=True,
    ),
    Parameter(
        "ARMING_NEED_LOC",
        one_of(0),
        ERROR,
        "it will not arm without a place on the globe",
        when=(GNSS_DENIED,),
    ),
    # messages of the peers
    *(
        Parameter(
            f"MAV{n}_OPTIONS",
            bits(clear=NO_FORWARDING),
            ERROR,
            "what the peers say does not get from the radio's port to the companion's: vehicles "
            "that do not hear each other collide",
            when=(IN_SWARM,),
            is_safe_to_set=True,
            needs_reboot=True,
        )
        for n in range(1, 5)
    ),
)
