"""Flying a mission: one NAV_ item after the other, with the DO_ items between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mock_vehicle.autopilot.auto_rules import NAMES
from mock_vehicle.autopilot.legs import (
    GROUND_COMMANDS,
    NAVIGATION,
    change_speed,
    reach,
    say,
    take_off_to,
    turn,
)
from mock_vehicle.autopilot.plans import Cmd, Item
from mock_vehicle.autopilot.progress import Leg, Progress, mission_current
from mock_vehicle.autopilot.traits import Manoeuvre, Severity

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

MOST_JUMPS = 100
"""A mission that does nothing but jump ends after so many."""


def prepare(autopilot: Autopilot) -> None:
    """Begin anew with a mission that was flown to its end."""
    if autopilot.progress.is_complete:
        autopilot.progress = Progress()


def run(autopilot: Autopilot, now: float) -> None:
    """Go on with the mission, if its mode is on."""
    progress = autopilot.progress
    if autopilot.mode != autopilot.mission_mode or not autopilot.armed:
        progress.leg = None
        progress.is_paused = progress.may_leave_ground = False
        return
    if progress.leg is None and autopilot.plans.has_mission and not progress.is_complete:
        first = max(progress.current, int(autopilot.plans.rules.has_home))
        if not progress.is_begun:
            say(autopilot, autopilot.auto_rules.begin_text, now)
        progress.is_begun = True
        _advance(autopilot, first, now)
    if progress.leg is not None:
        _go_on(autopilot, progress.leg, now)


def _announce(autopilot: Autopilot, sequence: int, item: Item, now: float) -> None:
    if autopilot.auto_rules.announces:
        autopilot.say(Severity.INFO, f"Mission: {sequence} {NAMES.get(item.command, '?')}", now)


def _advance(autopilot: Autopilot, sequence: int, now: float) -> None:
    """Find the next item to fly, and what is to be done on the way."""
    items, progress = autopilot.plans.mission, autopilot.progress
    todo: list[tuple[int, Item]] = []
    while sequence < len(items) and items[sequence].command not in NAVIGATION:
        item = items[sequence]
        if item.command == Cmd.DO_JUMP:
            sequence = _jump(progress, sequence, item)
        else:
            todo.append((sequence, item))
            sequence += 1
    if sequence >= len(items):
        _complete(autopilot, now)
        return
    item = items[sequence]
    progress.current = sequence
    progress.leg = Leg(sequence, item, todo, now, is_last=sequence == len(items) - 1)
    _announce(autopilot, sequence, item, now)
    if autopilot.auto_rules.tells_changes:
        mission_current(autopilot, now)


def _jump(progress: Progress, sequence: int, item: Item) -> int:
    """Give the item after a DO_JUMP: param1, param2 times (-1 is for ever)."""
    target, repeats = item.params[:2]
    done = progress.jumps.get(sequence, 0)
    progress.jumps[sequence] = done + 1
    is_due = (repeats < 0 or done < repeats) and sum(progress.jumps.values()) < MOST_JUMPS
    return int(target) if is_due and 0.0 <= target <= 65535.0 else sequence + 1


def _go_on(autopilot: Autopilot, leg: Leg, now: float) -> None:
    if autopilot.progress.is_paused:
        return
    if not leg.is_begun:
        _set_out(autopilot, leg, now)
        return
    _do(autopilot, leg, now)
    if NAVIGATION[leg.item.command].fly(autopilot, leg, now):
        _finish(autopilot, leg, now)


def _set_out(autopilot: Autopilot, leg: Leg, now: float) -> None:
    """Begin to fly an item, after a take-off where one is needed."""
    may_leave = autopilot.progress.may_leave_ground or not autopilot.auto_rules.needs_leave
    if not autopilot.flying and not may_leave:
        return
    if autopilot.flying or leg.item.command in GROUND_COMMANDS:
        leg.is_begun, leg.since = True, now
        NAVIGATION[leg.item.command].begin(autopilot, leg, now)
    elif autopilot.manoeuvre is not Manoeuvre.TAKEOFF:
        take_off_to(autopilot, autopilot.takeoff_height_m, now)


def _do(autopilot: Autopilot, leg: Leg, now: float) -> None:
    """Do what stands between two places, in turn; what is not known is passed over."""
    while leg.todo:
        sequence, item = leg.todo[0]
        if item.command == Cmd.CONDITION_DELAY and now - leg.since < item.params[0]:
            return
        leg.todo.pop(0)
        leg.since = now
        _announce(autopilot, sequence, item, now)
        if item.command == Cmd.DO_CHANGE_SPEED:
            change_speed(autopilot, item.params)
        elif item.command == Cmd.CONDITION_YAW:
            turn(autopilot, item.params)


def _finish(autopilot: Autopilot, leg: Leg, now: float) -> None:
    reach(autopilot, leg, now)
    autopilot.progress.leg = None
    _advance(autopilot, leg.sequence + 1, now)


def _complete(autopilot: Autopilot, now: float) -> None:
    """End the mission: on the ground, or waiting in the air."""
    progress, rules = autopilot.progress, autopilot.auto_rules
    progress.is_complete, progress.leg = True, None
    if not rules.keeps_current:
        progress.current = 0
    say(autopilot, rules.finished_text if autopilot.flying else rules.landed_text, now)
    if autopilot.flying and autopilot.manoeuvre is not Manoeuvre.GO:
        autopilot.begin(Manoeuvre.HOLD, now)
    elif not autopilot.flying and rules.disarms_landed:
        autopilot.disarm_landed(now)
    if rules.tells_changes:
        mission_current(autopilot, now)
