"""Missions, geofences and rally points as they are stored, and what each autopilot takes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

from swarm_ctl import wire

MISSION_REQUEST = wire.message("MISSION_REQUEST")
MISSION_REQUEST_INT = wire.message("MISSION_REQUEST_INT")

INT_MAX = 2**31 - 1
"""Stands for "not given" in a latitude or longitude of degE7."""
ALL_KINDS = 255
FRAME_MISSION = 2
"""MAV_FRAME of an item without a place."""
NO_PARAMS = (0.0,) * 4


class Kind(IntEnum):
    """MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


class Outcome(IntEnum):
    """MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID_PARAM1 = 6
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


class Cmd(IntEnum):
    """MAV_CMD of the items that are flown, or mean a place."""

    NAV_WAYPOINT = 16
    NAV_LOITER_UNLIM = 17
    NAV_LOITER_TURNS = 18
    NAV_LOITER_TIME = 19
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_LOITER_TO_ALT = 31
    NAV_SPLINE_WAYPOINT = 82
    NAV_DELAY = 93
    CONDITION_DELAY = 112
    CONDITION_YAW = 115
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178
    DO_SET_HOME = 179
    DO_LAND_START = 189
    DO_SET_ROI_LOCATION = 195
    DO_SET_ROI = 201
    FENCE_RETURN_POINT = 5000
    FENCE_POLYGON_INCLUSION = 5001
    FENCE_POLYGON_EXCLUSION = 5002
    FENCE_CIRCLE_INCLUSION = 5003
    FENCE_CIRCLE_EXCLUSION = 5004
    RALLY_POINT = 5100


class Item(NamedTuple):
    """One item of a plan."""

    frame: int
    """MAV_FRAME."""
    command: int
    params: tuple[float, ...]
    """The first four."""
    x: int
    """Latitude, degE7; param5 of an item without a place."""
    y: int
    """Longitude, degE7; param6 of an item without a place."""
    z: float
    """Altitude, m, as the frame says; param7 of an item without a place."""
    autocontinue: int = 1


@dataclass(frozen=True, slots=True)
class PlanRules:
    """What autopilots differ in when plans are sent and fetched; recorded, see `reference/`."""

    request: wire.Message
    """What asks for the next item of an upload."""
    retry_s: float
    timeout_s: float
    """Silence that ends a transfer."""
    timeout_result: int | None
    """MAV_MISSION_RESULT told when an upload starves; None is silence."""
    timeout_text: str
    no_space_text: str
    """Said of too large a plan, with its limit."""
    wrong_sequence: int | None
    """MAV_MISSION_RESULT for an item out of turn; None waits for the right one."""
    unasked_item: int | None
    """MAV_MISSION_RESULT for an item without an upload; None is silence."""
    restarts: bool
    """A second MISSION_COUNT of an uploading client starts anew; else it is an error."""
    is_atomic: bool
    """The stored plan changes only when an upload is complete."""
    has_sessions: bool
    """A download is begun by MISSION_REQUEST_LIST, goes in turn and ends with MISSION_ACK."""
    has_home: bool
    """Item 0 of a mission is home, whatever is uploaded."""
    capacity: Mapping[int, int]
    """Most items, by kind."""
    received_texts: Mapping[int, tuple[int, str]]
    """(severity, text) said after an upload, by kind."""
    warns_of_floats: bool
    """The outdated messages, with degrees in 32 bits, are served with a complaint."""
    placed: Mapping[int, frozenset[int]]
    """Commands with a place, by kind."""
    unplaced: frozenset[int]
    """Mission commands without one."""
    frames: Mapping[int, int]
    """Frames with a place, and what each comes back as."""
    float_frames: Mapping[int, int]
    """What the stored frames come back as in a MISSION_ITEM."""
    unplaced_frame: int | None
    """The only frame of commands without a place; None takes any, and forgets it."""
    checks_numbers: bool
    """NaN and places off the globe are refused."""
    idle_total: int
    """MISSION_CURRENT.total without a mission."""
    idle_mode: int
    """MISSION_CURRENT.mission_mode outside of missions."""
    totals: Mapping[int, str]
    """Parameters that count the items, by kind."""
    reached_s: float
    """MISSION_ITEM_REACHED comes again with every MISSION_CURRENT for so long."""


def read_item(values: Any, *, is_float: bool) -> Item:
    """Read a MISSION_ITEM or MISSION_ITEM_INT."""
    params = (values.param1, values.param2, values.param3, values.param4)
    x, y = values.x, values.y
    if is_float:
        scale = 1.0 if values.frame == FRAME_MISSION else 1e7
        x, y = _whole(x * scale), _whole(y * scale)
    return Item(values.frame, values.command, params, x, y, values.z, values.autocontinue)


def _whole(value: float) -> int:
    return round(value) if abs(value) < INT_MAX else INT_MAX


def check(rules: PlanRules, kind: int, item: Item) -> int:
    """Give the MAV_MISSION_RESULT of an item."""
    has_place = item.command in rules.placed[kind]
    has_none = kind == Kind.MISSION and item.command in rules.unplaced
    if rules.unplaced_frame is None:
        is_known = has_place or has_none
    elif item.frame in {rules.unplaced_frame, *rules.frames}:
        is_known = has_none if item.frame == rules.unplaced_frame else has_place
    else:
        return Outcome.UNSUPPORTED_FRAME
    if not is_known:
        return Outcome.UNSUPPORTED
    refusal = _refused_number(item, has_place=has_place) if rules.checks_numbers else None
    if refusal is not None:
        return refusal
    is_framed = item.frame in rules.frames or not has_place
    return Outcome.ACCEPTED if is_framed else Outcome.UNSUPPORTED_FRAME


def _refused_number(item: Item, *, has_place: bool) -> int | None:
    """Find the first parameter that is no number, or off the globe; a yaw may be NaN."""
    for index, value in enumerate(item.params[:3]):
        if not math.isfinite(value):
            return Outcome.INVALID_PARAM1 + index
    if has_place and abs(item.x) > 90e7:
        return Outcome.INVALID_PARAM5_X
    if has_place and abs(item.y) > 180e7:
        return Outcome.INVALID_PARAM6_Y
    return None if math.isfinite(item.z) else Outcome.INVALID_PARAM7


def stored(rules: PlanRules, kind: int, item: Item) -> Item:
    """Give what is left of an item once it is stored."""
    if not rules.checks_numbers:
        return item._replace(frame=rules.frames.get(item.frame, item.frame))
    params = tuple(0.0 if math.isnan(value) else value for value in item.params)
    if item.command in rules.placed[kind]:
        return item._replace(frame=rules.frames[item.frame], params=params)
    return Item(0, item.command, params, 0, 0, 0.0)


FENCE_COMMANDS = frozenset(
    {
        Cmd.FENCE_RETURN_POINT,
        Cmd.FENCE_POLYGON_INCLUSION,
        Cmd.FENCE_POLYGON_EXCLUSION,
        Cmd.FENCE_CIRCLE_INCLUSION,
        Cmd.FENCE_CIRCLE_EXCLUSION,
    }
)
CAMERA_AND_CARGO = frozenset(
    {183, 184, 197, 203, 204, 205, 206, 211, 212, 530, 531, 1000, 1001, 2000, 2001, 2500, 2501}
)
"""DO_ commands that the mock stores and passes over."""

PX4_RULES = PlanRules(
    request=MISSION_REQUEST_INT,
    retry_s=0.26,
    timeout_s=5.0,
    timeout_result=None,
    timeout_text="",
    no_space_text="",
    wrong_sequence=None,
    unasked_item=None,
    restarts=False,
    is_atomic=True,
    has_sessions=True,
    has_home=False,
    capacity={Kind.MISSION: 10_000, Kind.FENCE: 1000, Kind.RALLY: 32},
    received_texts={},
    warns_of_floats=False,
    placed={
        Kind.MISSION: frozenset({16, 17, 19, 21, 22, 31, 80, 84, 85, 195, 201, 4501}),
        Kind.FENCE: FENCE_COMMANDS,
        Kind.RALLY: frozenset({Cmd.RALLY_POINT}),
    },
    unplaced=CAMERA_AND_CARGO | {20, 93, 177, 178, 179, 189, 196, 214, 3000},
    frames={0: 5, 5: 5, 3: 6, 6: 6},
    float_frames={5: 0, 6: 3},
    unplaced_frame=FRAME_MISSION,
    checks_numbers=False,
    idle_total=65535,
    idle_mode=2,
    totals={},
    reached_s=10.0,
)
ARDUPILOT_RULES = PlanRules(
    request=MISSION_REQUEST,
    retry_s=1.0,
    timeout_s=8.0,
    timeout_result=Outcome.OPERATION_CANCELLED,
    timeout_text="Mission upload timeout",
    no_space_text="Only {} items are supported",
    wrong_sequence=Outcome.INVALID_SEQUENCE,
    unasked_item=Outcome.ERROR,
    restarts=True,
    is_atomic=False,
    has_sessions=False,
    has_home=True,
    capacity={Kind.MISSION: 650, Kind.FENCE: 84, Kind.RALLY: 20},
    received_texts={Kind.MISSION: (6, "Flight plan received"), Kind.FENCE: (7, "Fence Indexed OK")},
    warns_of_floats=True,
    placed={
        Kind.MISSION: frozenset({16, 17, 18, 19, 21, 22, 31, 82, 85, 92, 179, 189, 195, 201}),
        Kind.FENCE: FENCE_COMMANDS,
        Kind.RALLY: frozenset({Cmd.RALLY_POINT}),
    },
    unplaced=CAMERA_AND_CARGO
    | {20, 93, 94, 112, 114, 115, 177, 178, 181, 182, 207, 208, 215, 216, 217, 218, 222, 600, 601},
    frames={0: 0, 2: 0, 5: 0, 3: 3, 6: 3, 10: 10, 11: 10},
    float_frames={},
    unplaced_frame=None,
    checks_numbers=True,
    idle_total=0,
    idle_mode=0,
    totals={Kind.MISSION: "MIS_TOTAL", Kind.FENCE: "FENCE_TOTAL", Kind.RALLY: "RALLY_TOTAL"},
    reached_s=0.0,
)
