"""Where the mock is known to differ from the recordings, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import NamedTuple

from compare import Comparison


class Known(NamedTuple):
    """Differences that stay."""

    topic: str
    """Their name in the table."""
    suites: str
    """Pattern of personality/suite."""
    kinds: tuple[str, ...]
    """Patterns of the differences in words."""
    reason: str


KNOWN = (
    Known(
        "parameters",
        "px4/*",
        (
            "PARAM_VALUE *, param_count: recorded 893, mock *",
            "PARAM_VALUE *, param_index: recorded *, mock *",
            "PARAM_VALUE _HASH_CHECK, param_value: *",
            "PARAM_VALUE BAT1_V_CHARGED missing",
            "PARAM_VALUE CAL_ACC0_ID not recorded",
            "PARAM_VALUE EKF2_MAG_DECL missing",
        ),
        "The mock keeps those of PX4's 893 parameters that somebody read or that do something; "
        "so places in the list, their count and their hash differ. Clients that ask for parameters "
        "by name do not notice.",
    ),
    Known(
        "hidden parameters",
        "ardupilot/fail_gps_loss",
        ("PARAM_VALUE *, param_count: recorded 1327, mock 1349",),
        "ArduPilot hides a group of parameters, here those of a GNSS receiver, while the first of "
        "them switches the group off; the mock's list stays whole.",
    ),
    Known(
        "repeated changes",
        "px4/p*",
        (
            "PARAM_VALUE COM_OF_LOSS_T not recorded",
            "PARAM_VALUE MIS_TAKEOFF_ALT *",
            "PARAM_VALUE NAV_DLL_ACT *",
        ),
        "PX4 told a change again on all its links 10 ms later in one recording, and some seconds "
        "later, with other changes, in another; the mock always does the former.",
    ),
    Known(
        "gimbal and camera",
        "px4/flight_*",
        ("COMMAND_LONG 1000 *", "COMMAND_LONG 1001 *", "COMMAND_LONG 2003 *"),
        "PX4 sends commands on to a gimbal and a camera; the mock carries neither.",
    ),
    Known(
        "rangefinders",
        "*/r*",
        (
            "DISTANCE_SENSOR*",
            "OBSTACLE_DISTANCE not recorded",
            "COMMAND_ACK 512, result: recorded FAILED, mock ACCEPTED",
        ),
        "The recorded ArduPilot had no rangefinder, PX4 one that looks down; the mock has six, "
        "and a ring of level ones.",
    ),
    Known(
        "fast streams",
        "*/rates",
        ("ATTITUDE: * mock 100 Hz", "LOCAL_POSITION_NED: * mock 100 Hz"),
        "The mock moves in steps of 10 ms, and sends nothing faster than that.",
    ),
    Known(
        "terrain",
        "ardupilot/rates",
        ("TERRAIN_REQUEST: *",),
        "ArduPilot asks its ground station for heights of the terrain; the mock has no use for "
        "them.",
    ),
    Known(
        "motor test",
        "ardupilot/commands",
        ("HEARTBEAT (89, 4, 3) missing", "PARAM_VALUE MOT_THST_HOVER missing"),
        "ArduPilot is armed while a motor is tested; the mock acknowledges the test, and no motor "
        "turns.",
    ),
    Known(
        "SmartRTL",
        "ardupilot/fail_gps_loss",
        ('STATUSTEXT "SmartRTL deactivated: bad position" missing',),
        "The mock keeps no path for SMART_RTL, so it does not give one up.",
    ),
    Known(
        "home counted twice",
        "ardupilot/missions",
        ("PARAM_VALUE MIS_TOTAL not recorded",),
        "While a mission is sent after another was cleared, ArduPilot counts home twice for the "
        "first two items.",
    ),
    Known(
        "attitude setpoints",
        "ardupilot/typemask",
        ("HEARTBEAT (217, 4, 4) missing",),
        "ArduPilot's base_mode loses the guided bit while it follows an attitude.",
    ),
    Known(
        "chosen while disarming",
        "px4/flight_basic",
        (
            "HEARTBEAT, base_mode: recorded 17, *",
            "HEARTBEAT, custom_mode: recorded 393216, *",
            "MISSION_CURRENT (0, 65535, 1, 1) not recorded",
        ),
        "A landing was ordered on the ground just before PX4 disarmed by itself, which took it "
        "back to OFFBOARD; the mock stays in the mode that was ordered.",
    ),
    Known(
        "log files",
        "px4/flight_mission",
        ('STATUSTEXT "[[]logger] *',),
        "The mock writes no log, so it does not say where to.",
    ),
    Known(
        "late acknowledgements",
        "px4/protocol",
        ("other order than AUTOPILOT_VERSION, COMMAND_ACK 512",),
        "PX4 acknowledges in its next loop of 10 ms, after all messages that a burst of requests "
        "asked for; the mock answers each request at once.",
    ),
    Known(
        "swallowed frames",
        "*/malformed",
        ("the next command: recorded 0 answers, mock 1",),
        "After a cut frame, or one with unknown flags, the parsers of the real autopilots swallow "
        "what follows, until they have as many bytes as it promised, and lose the next command; "
        "the mock finds the next frame.",
    ),
    Known(
        "chance",
        "*",
        (
            "other order than COMMAND_ACK 400, STATUSTEXT *",
            "other order than STATUSTEXT *, COMMAND_ACK 176",
            "MISSION_REQUEST_INT earlier than recorded",
            "MISSION_REQUEST_INT not recorded",
            "PARAM_VALUE STAT_* not recorded",
        ),
        "What the vehicle says by itself meets an answer, or a timer the end of a transfer, some "
        "hundredths of a second sooner or later, so an order or a count differs by one.",
    ),
)


def known(suite: str, kind: str) -> Known | None:
    """Find out why a difference stays."""
    return next(
        (
            entry
            for entry in KNOWN
            if fnmatchcase(suite, entry.suites)
            and any(fnmatchcase(kind, pattern) for pattern in entry.kinds)
        ),
        None,
    )


def unexplained(comparison: Comparison) -> Counter[str]:
    """Count the kinds of differences that no reason explains."""
    kinds = Counter(difference.kind for difference in comparison.differences)
    return Counter({kind: n for kind, n in kinds.items() if known(comparison.suite, kind) is None})


def topics(comparison: Comparison) -> Counter[str]:
    """Count the differences that stay, by topic."""
    found = (known(comparison.suite, difference.kind) for difference in comparison.differences)
    return Counter(entry.topic for entry in found if entry is not None)


def unmet(comparisons: Iterable[Comparison]) -> list[tuple[str, str]]:
    """Give topic and pattern of what is known to differ, but does not."""
    met = [(c.suite, d.kind) for c in comparisons for d in c.differences]
    return [
        (entry.topic, pattern)
        for entry in KNOWN
        for pattern in entry.kinds
        if not any(fnmatchcase(s, entry.suites) and fnmatchcase(k, pattern) for s, k in met)
    ]
