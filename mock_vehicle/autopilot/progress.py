"""How far an autopilot has flown its mission, and what it tells of that."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.plans import Item
from mock_vehicle.autopilot.transfers import is_ours
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

MISSION_CURRENT = wire.message("MISSION_CURRENT")
MISSION_ITEM_REACHED = wire.message("MISSION_ITEM_REACHED")

ACTIVE_MODE = 1
"""MISSION_CURRENT.mission_mode in a mission."""


class MissionState(IntEnum):
    """MISSION_STATE."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


@dataclass
class Leg:
    """One NAV_ item that is being flown."""

    sequence: int
    item: Item
    todo: list[tuple[int, Item]]
    """Items without a place that are still to be done, and their numbers."""
    since: float
    """When the first of `todo` was begun."""
    is_begun: bool = False
    """False as long as a take-off, or leave to start, is missing."""
    is_last: bool = False
    is_reached: bool = False
    """MISSION_ITEM_REACHED has been sent."""
    arrived_at: float | None = None


@dataclass
class Progress:
    """How far the mission has been flown."""

    current: int = 0
    """MISSION_CURRENT.seq."""
    is_begun: bool = False
    is_complete: bool = False
    is_paused: bool = False
    may_leave_ground: bool = False
    """MISSION_START has come."""
    reached: int = 0
    reached_at: float = -math.inf
    leg: Leg | None = None
    jumps: dict[int, int] = field(default_factory=dict)
    """How often each DO_JUMP was followed."""


def on_set_current(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Go on with another item; MISSION_CURRENT is the answer."""
    if is_ours(autopilot, frame.values) and set_current(autopilot, frame.values.seq):
        mission_current(autopilot, now)


def set_current(autopilot: Autopilot, sequence: int) -> bool:
    """Choose the item to fly next, and tell whether it exists."""
    plans, progress = autopilot.plans, autopilot.progress
    if not plans.has_mission or not 0 <= sequence < len(plans.mission):
        return False
    autopilot.progress = Progress(
        current=max(sequence, int(plans.rules.has_home)),
        is_begun=progress.is_begun,
        may_leave_ground=progress.may_leave_ground,
    )
    return True


def mission_state(autopilot: Autopilot) -> MissionState:
    """Tell MISSION_CURRENT.mission_state."""
    progress = autopilot.progress
    if not autopilot.plans.has_mission or autopilot.bars_mission:
        return MissionState.NO_MISSION
    if progress.is_complete:
        return MissionState.COMPLETE
    if not progress.is_begun or not autopilot.armed:
        return MissionState.NOT_STARTED
    if progress.is_paused:
        return MissionState.PAUSED
    if autopilot.mode == autopilot.mission_mode:
        return MissionState.ACTIVE
    return autopilot.auto_rules.left_state


def mission_current(autopilot: Autopilot, now: float) -> None:
    """Send MISSION_CURRENT, and what was reached lately."""
    plans = autopilot.plans
    total, mode = plans.rules.idle_total, plans.rules.idle_mode
    if plans.has_mission:
        total = len(plans.mission) - plans.rules.has_home
    if autopilot.is_on_mission:
        mode = ACTIVE_MODE
    current = autopilot.progress.current
    autopilot.send(MISSION_CURRENT, current, total, mission_state(autopilot), mode)
    progress = autopilot.progress
    if now - progress.reached_at < plans.rules.reached_s:
        autopilot.send(MISSION_ITEM_REACHED, progress.reached)
