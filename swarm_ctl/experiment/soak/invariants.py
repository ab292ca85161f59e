"""What no flight may break, whatever goes wrong: a function for each promise.

A check gives a sentence when its promise is broken and an empty string when it holds. Tolerances
are written beside their reasons; what a fault excuses is in `look.OUT_OF_HAND` and `look.BLIND`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from swarm_ctl.agent.phases import ENDED, SILENT, STREAMING, TABLE, Phase
from swarm_ctl.experiment.soak.look import Look

TOUCH_M = 0.6
"""Two bodies of 0.3 m radius (mock_vehicle/referee.py)."""
SEPARATION_SLACK_M = 0.3
FENCE_SLACK_M = 0.5
"""What a vehicle may overshoot its fence by before it counts as outside (watch.OUTSIDE_M)."""
HEIGHT_SLACK_M = 0.3
"""What a vehicle may overshoot floor and ceiling by."""
HEARD_S = 2.0
"""Until a change of mode has been heard of."""
MOST_WAITING = 500
"""Of anything in a controller: what 20 peers and a link that was frozen bring within a tick."""
MOST_HELD = 20_000
"""Frames held on the links of a vehicle: a minute of all its telemetry."""

Check = Callable[[Look], str]


def nobody_touches(look: Look) -> str:
    """Promise that no two bodies touch of which one is steered, when their radios know."""
    for i, j, gap_m in look.gaps_m:
        if gap_m < TOUCH_M:
            return f"vehicles {i + 1} and {j + 1} are {gap_m:.2f} m apart"
    return ""


def steered_ones_keep_their_distance(look: Look) -> str:
    """Promise that two that are steered and hear each other keep `limits.separation_m`.

    To 0.3 m: three times the worst noise of a range that is drawn, or what two vehicles that turn
    fly on within `flight.response_s`. Never excused.
    """
    for i, j, gap_m in look.gaps_m:
        if gap_m < look.mission.limits.separation_m - SEPARATION_SLACK_M and (
            look.steered[i] and look.steered[j]
        ):
            return f"vehicles {i + 1} and {j + 1} come within {gap_m:.2f} m"
    return ""


def nobody_hits_a_wall(look: Look) -> str:
    """Promise that nobody who is steered and sees walls touches one."""
    contacts = look.fleet.referee.wall_contacts
    if contacts == look.wall_contacts:
        return ""
    look.wall_contacts = contacts
    clearance_m = look.arena.fleet.world.clearance(look.fleet.dynamics.position_ned_m).tolist()
    for i in look.range:
        if look.steered[i] and clearance_m[i] < TOUCH_M / 2.0 + 0.05 and not look.is_blind(i):
            return f"vehicle {i + 1} is {clearance_m[i]:.2f} m from something solid"
    return ""


def nobody_leaves_the_fence(look: Look) -> str:
    """Promise that who is steered, and was once within its radius, stays there.

    To 0.5 m of overshoot, and to the error of its own estimate.
    """
    for i in look.range:
        (n, e, _), (n0, e0, _) = look.places_ned_m[i], look.fleet.starts_ned_m[i].tolist()
        beyond_m = math.hypot(n - n0, e - e0) - look.mission.limits.radius_m
        if look.has_left(look.within, i, beyond_m, FENCE_SLACK_M):
            return f"vehicle {i + 1} is {beyond_m:.2f} m beyond its fence"
    return ""


def nobody_flies_too_high_or_low(look: Look) -> str:
    """Promise that who is steered, and was once between floor and ceiling, stays there.

    To 0.3 m of overshoot, and to the error of its own estimate.
    """
    limits = look.mission.limits
    for i in look.range:
        height_m = -look.places_ned_m[i][2]
        beyond_m = max(limits.floor_m - height_m, height_m - limits.ceiling_m)
        if look.has_left(look.between, i, beyond_m, HEIGHT_SLACK_M):
            return f"vehicle {i + 1} flies at {height_m:.2f} m"
    return ""


def setpoints_leave_only_when_they_may(look: Look) -> str:
    """Promise one setpoint a tick, and only in a phase that streams; never while yielded.

    And no command in a phase that says nothing to its autopilot.
    """
    for i in look.sent:
        phase, names = look.sent[i]
        setpoints = names.count("SET_POSITION_TARGET_LOCAL_NED")
        if setpoints > (phase in STREAMING):
            return f"vehicle {i + 1} was sent {setpoints} setpoints while {phase.value}"
        if phase in SILENT and "COMMAND_LONG" in names:
            return f"vehicle {i + 1} was sent a command while {phase.value}"
    return ""


def nobody_fights_a_pilot(look: Look) -> str:
    """Promise silence to an autopilot whose mode a pilot has chosen, until an operator resumes.

    From 2 s after the choice on: a heartbeat comes once a second, and a tick decides. A mode that
    is ours again by then was refused, or never arrived.
    """
    for i, since_s in list(look.taken_s.items()):
        if look.now - since_s <= HEARD_S or look.is_out_of_hand(i):
            continue
        if look.is_ours(i):
            del look.taken_s[i]
        elif i in look.sent and look.sent[i][1]:
            mode = look.fleet.vehicles[i].mode_name
            return f"vehicle {i + 1} was sent {look.sent[i][1]} though its pilot chose {mode}"
    return ""


def phases_follow_the_table(look: Look) -> str:
    """Promise that every change of phase is one of the table's."""
    for event in look.events:
        if event.name != "PhaseChanged":
            continue
        before, after = Phase(event.data["before"]), Phase(event.data["after"])
        before = Phase.EXPLORING if before is Phase.AVOIDING else before
        if not any(P is before and to is after for (P, _), to in TABLE.items()):
            return f"vehicle {event.sysid} went from {before.value} to {after.value}"
    return ""


def nothing_raises(look: Look) -> str:
    """Promise that neither a controller nor its planner breaks."""
    for event in look.events:
        reason = str(event.data.get("reason", ""))
        if event.name == "PlannerFailed" or reason.startswith("its controller broke"):
            return f"vehicle {event.sysid}: {event.data.get('error', reason)}"
    return ""


def victims_are_reported_once(look: Look) -> str:
    """Promise that a vehicle tells of each victim once, found or heard of, and of none but those.

    Who is told to have found one has told so before.
    """
    for event in look.events:
        if event.name not in {"VictimFound", "VictimHeard"}:
            continue
        victim, finder = event.data["victim"], event.data.get("finder", event.sysid)
        if not 0 <= victim < len(look.scenario.world.victims):
            return f"vehicle {event.sysid} tells of victim {victim}, and there is none"
        if (event.sysid, victim) in look.reported:
            return f"vehicle {event.sysid} tells of victim {victim} again"
        look.reported.add((event.sysid, victim))
        if (finder, victim) not in look.reported:
            return (
                f"vehicle {event.sysid} heard that {finder} found victim {victim}, which it did not"
            )
    return ""


def coverage_never_falls(look: Look) -> str:
    """Promise that what was seen stays seen, and that it is a share of the whole."""
    before, look.coverage = look.coverage, look.fleet.referee.coverage.fraction
    if not before <= look.coverage <= 1.0 + 1e-9:
        return f"coverage went from {before:.4f} to {look.coverage:.4f}"
    return ""


def nobody_knows_more_of_a_trail_than_who_flew_it(look: Look) -> str:
    """Promise that a copy of a trail is a prefix of it: merged twice it would be longer."""
    if round(look.now, 3) % 1.0 > 0.05:
        return ""  # once a second
    explorers = [agent.explorer for agent in look.agents]
    for i, knower in enumerate(explorers):
        for j, flyer in enumerate(explorers):
            if i == j or knower is None or flyer is None:
                continue
            known, flown = knower.trails.length(j + 1), flyer.trails.length(j + 1)
            if known > flown:
                return f"vehicle {i + 1} knows {known} entries of {j + 1}'s trail of {flown}"
    return ""


def queues_are_bounded(look: Look) -> str:
    """Promise that nothing waits without end, in controllers, on links, after the flight."""
    for agent in look.agents:
        telemetry = agent.telemetry
        waiting = (agent.commands, telemetry.peer_fixes, telemetry.victim_fixes, telemetry.acks)
        for queue in waiting:
            if len(queue) > MOST_WAITING:
                return f"vehicle {agent.sysid}: {len(queue)} wait in its {type(queue).__name__}"
    held = len(look.fleet.links)
    return f"{held} frames wait on links" if held > MOST_HELD * len(look.agents) else ""


def everybody_is_down_in_the_end(look: Look) -> str:
    """Promise that every vehicle ends done and on the ground, or failed for a reason that is told.

    Who yielded is its pilot's: one whose motor is out lies there armed, and obeys nobody. Who
    failed may fly on: its controller has no say any more.
    """
    for i, agent in enumerate(look.agents):
        if agent.phase is Phase.DONE and look.airborne[i]:
            return f"vehicle {i + 1} is done, and flies"
        if agent.phase is Phase.FAILED and not agent.trouble:
            return f"vehicle {i + 1} failed and nobody says why"
        if agent.phase not in ENDED | {Phase.YIELDED} or (
            agent.phase is Phase.YIELDED and look.airborne[i]
        ):
            return f"vehicle {i + 1} is still {agent.phase.value}: {agent.reason}"
    return ""


EVERY_TICK: tuple[Check, ...] = (
    nobody_touches,
    steered_ones_keep_their_distance,
    nobody_hits_a_wall,
    nobody_leaves_the_fence,
    nobody_flies_too_high_or_low,
    setpoints_leave_only_when_they_may,
    nobody_fights_a_pilot,
    phases_follow_the_table,
    nothing_raises,
    victims_are_reported_once,
    coverage_never_falls,
    nobody_knows_more_of_a_trail_than_who_flew_it,
    queues_are_bounded,
)
IN_THE_END: tuple[Check, ...] = (everybody_is_down_in_the_end,)
