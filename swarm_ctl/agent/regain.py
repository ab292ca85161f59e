"""What becomes of a vehicle that is heard again, after a silent link or a restart of ours."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from swarm_ctl.agent.failsafe import Verdict
from swarm_ctl.agent.phases import Cause, Phase
from swarm_ctl.model import Vec3

if TYPE_CHECKING:
    from swarm_ctl.agent.agent import Agent

POSITION_S = 5.0
"""How long a vehicle that is heard again may take to say where it is."""
ON_GROUND_S = 60.0
"""The same for one that has not taken off yet."""
DRIFT_S, DRIFT_M = 5.0, 3.0
"""A vehicle that nobody steers flies on for no longer than this and drifts no farther."""
HAS_LANDED, STILL_LANDING = "landed", "it was landing"

_CLIMBING = frozenset({Phase.ARMING, Phase.TAKEOFF})


def heard_again(agent: Agent) -> Verdict | None:
    """Judge how a vehicle goes on whose heartbeat is back; None while it is too early to tell."""
    if not agent.telemetry.armed:
        return _on_ground(agent)
    if not _is_ours(agent):
        return Verdict(Cause.PILOT, who_has_it(agent))
    verdict = _in_flight(agent)
    if verdict is not None:
        agent.vigil.mode_lost_s = agent.vigil.left_ned_m = None
        agent.note("LinkRegained")
    return verdict


def who_has_it(agent: Agent) -> str:
    """Say who has chosen the mode that the autopilot is in."""
    telemetry = agent.telemetry
    who = "its autopilot's own failsafe" if telemetry.is_failsafe else "the pilot"
    return f"{who} chose {telemetry.mode_name}"


def _on_ground(agent: Agent) -> Verdict | None:
    match agent.vigil.lost_from:
        case Phase.ARMING if agent.telemetry.position_s > agent.entered_s:
            agent.vigil.distrust = ""
            return Verdict(Cause.CHECKED, "it had not taken off yet")
        case Phase.ARMING if agent.in_phase_s < ON_GROUND_S:
            return None
        case Phase.LANDING:
            return Verdict(Cause.DISARMED, HAS_LANDED)
        case _:
            words = f"{agent.reason}; it was on the ground when it was heard again"
            return Verdict(Cause.DISARMED, words)


def _is_ours(agent: Agent) -> bool:
    """Whether nobody but the autopilot's own failsafe has changed the mode that we chose."""
    telemetry, vigil = agent.telemetry, agent.vigil
    may_land = vigil.lost_from is Phase.LANDING or bool(vigil.distrust)
    return telemetry.is_offboard or telemetry.may_resume or (may_land and telemetry.is_landing)


def _in_flight(agent: Agent) -> Verdict | None:
    telemetry, vigil = agent.telemetry, agent.vigil
    if vigil.distrust:
        return Verdict(Cause.LAND, vigil.distrust)
    if vigil.lost_from is Phase.LANDING:
        return Verdict(Cause.LAND, STILL_LANDING)
    if min(telemetry.position_s, telemetry.attitude_s) <= agent.entered_s:
        is_late = agent.in_phase_s > POSITION_S
        return Verdict(Cause.LAND, f"no position for {POSITION_S:.0f} s") if is_late else None
    if vigil.left_ned_m is not None and (why := _is_elsewhere(agent, vigil.left_ned_m)):
        return Verdict(Cause.LAND, why)
    if vigil.lost_from in _CLIMBING and telemetry.height_m < agent.orders.limits.floor_m:
        return Verdict(Cause.LAND if telemetry.is_failsafe else Cause.ARMED, agent.reason)
    return Verdict(Cause.RECOVERED, "its link is back")


def _is_elsewhere(agent: Agent, left_ned_m: Vec3) -> str:
    """Say why the positions of now and of before a restart are not in one frame; empty if none."""
    telemetry = agent.telemetry
    if telemetry.boot_s < agent.vigil.boot_s:
        return "its autopilot was restarted in flight"
    moved_m = math.dist(telemetry.position_ned_m, left_ned_m)
    most_m = DRIFT_S * agent.orders.flight.speed_m_s + DRIFT_M
    if moved_m > most_m and not telemetry.is_failsafe:  # which may be on its own way home
        return f"it is {moved_m:.0f} m from where it was left"
    return ""
