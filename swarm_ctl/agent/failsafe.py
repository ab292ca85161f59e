"""When a flight may not go on as planned, and what is done instead: one table, first row wins."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from swarm_ctl.agent.params import Limits
from swarm_ctl.agent.phases import Cause

HOLD_LAND_S = 10.0
"""A hold that lasts longer becomes a landing."""
OUTSIDE_LAND_S = 10.0
"""Who is not back behind the fence by then lands; the last word steers it back meanwhile."""
MODE_UNTOLD_S = 10.0
"""Who does not tell its mode cannot tell that a pilot took it: one heartbeat of ten must come."""


class Health(NamedTuple):
    """What the failsafe looks at; ages and times in seconds."""

    silent_s: float
    """Since anything was heard from the autopilot."""
    position_age_s: float
    range_age_s: float
    """Of the oldest level rangefinder; 0 in open air."""
    plan_age_s: float
    holding_s: float
    """Since something has demanded the present hold; 0 when nothing does."""
    mission_s: float
    """Since the mission began."""
    battery_fraction: float
    """1 when the autopilot does not tell."""
    way_home_fraction: float = 0.0
    """Charge that the way home will take."""
    outside_s: float = 0.0
    """Since the fence was left; 0 inside."""
    untold_s: float = 0.0
    """Since the autopilot told its mode."""
    round_trip_s: float = 0.0
    """There and back over the link to the autopilot."""
    estimate: str = ""
    """What is wrong with the position estimate, in words; empty when nothing is."""


class Verdict(NamedTuple):
    """What to do and why, in words for the record."""

    cause: Cause
    reason: str


Rule = tuple[Callable[[Health, Limits], bool], Cause, str]

RULES: tuple[Rule, ...] = (
    (
        lambda h, m: h.silent_s > m.link_lost_s,
        Cause.SILENT,
        "nothing heard from its autopilot for {h.silent_s:.1f} s",
    ),
    (
        lambda h, _m: h.untold_s > MODE_UNTOLD_S,
        Cause.SILENT,
        "no heartbeat of its autopilot for {h.untold_s:.1f} s",
    ),
    (
        lambda h, m: h.battery_fraction < m.battery_critical,
        Cause.LAND,
        "battery critical at {h.battery_fraction:.0%}",
    ),
    (
        lambda h, m: h.mission_s > m.max_time_s,
        Cause.LAND,
        "longest mission time reached at {h.mission_s:.0f} s",
    ),
    (
        lambda h, _m: h.outside_s > OUTSIDE_LAND_S,
        Cause.LAND,
        "outside its fence for {h.outside_s:.0f} s",
    ),
    (
        lambda h, _m: h.holding_s > HOLD_LAND_S,
        Cause.LAND,
        "held for {h.holding_s:.0f} s without recovery",
    ),
    (
        lambda h, m: h.position_age_s > m.link_hold_s,
        Cause.HOLD,
        "no position for {h.position_age_s:.1f} s",
    ),
    (
        lambda h, _m: bool(h.estimate),
        Cause.HOLD,
        "{h.estimate}",
    ),
    (
        lambda h, m: h.round_trip_s > m.link_delay_s,
        Cause.HOLD,
        "link slow: {h.round_trip_s:.1f} s there and back",
    ),
    (
        lambda h, m: h.range_age_s > m.range_stale_s,
        Cause.HOLD,
        "no rangefinder for {h.range_age_s:.1f} s",
    ),
    (
        lambda h, m: h.plan_age_s > m.planner_stall_s,
        Cause.HOLD,
        "no plan for {h.plan_age_s:.1f} s",
    ),
    (
        lambda h, m: h.battery_fraction < m.battery_reserve + h.way_home_fraction,
        Cause.RETURN,
        "battery low at {h.battery_fraction:.0%}, the way home takes {h.way_home_fraction:.0%}",
    ),
)


def verdict(health: Health, limits: Limits) -> Verdict | None:
    """Give the first rule that applies, or None when all is well."""
    for applies, cause, reason in RULES:
        if applies(health, limits):
            return Verdict(cause, reason.format(h=health))
    return None
