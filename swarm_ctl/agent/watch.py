"""What every tick looks at before anything is decided: link, pilot, failsafe, time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from swarm_ctl.agent.endurance import Endurance
from swarm_ctl.agent.failsafe import Health, Verdict, verdict
from swarm_ctl.agent.phases import BEFORE_START, EXPLORES, STEERING, Cause, Phase
from swarm_ctl.agent.regain import heard_again, who_has_it
from swarm_ctl.model import Vec3

if TYPE_CHECKING:
    from swarm_ctl.agent.agent import Agent

MODE_LAG_S = 2.0
"""PX4's heartbeat tells a mode up to a second late, and so that it is armed."""
FAILSAFE_S = 5.0
"""PX4 leaves offboard when the stream was lost, and takes it up again when it is back."""
GONE_S = 60.0
"""An autopilot silent for so long is given up: its own failsafe has brought it down by then."""
JUMP_HOLD_S = 2.0
"""How long a vehicle waits, after its position has jumped, whether it does so again."""
OUTSIDE_M = 0.5
"""Beyond the fence by more than an overshoot."""
RISE_M, RISE_S = 0.1, 6.0
"""Who climbs on setpoints rises by so much within this time, 4 s of which PX4 takes to lift off;
else its height hangs, and nobody knows how high it is."""
TIME_OVER = "exploration time is over"

_AIRBORNE = frozenset({Phase.TAKEOFF, Phase.LANDING, *STEERING})
_CLIMBS = frozenset({Phase.ARMING, Phase.TAKEOFF})
_FLIES_OFFBOARD = STEERING | {Phase.TAKEOFF}
_NOT_OURS = frozenset({Phase.LOST, Phase.YIELDED})


@dataclass(slots=True)
class Vigil:
    """What is remembered from one look to the next."""

    mode_lost_s: float | None = None
    """Since when the autopilot has been in a mode that is not ours."""
    mode_before: int = -1
    """The mode that the present phase found, or the last one of ours in it; -1 for a failsafe's."""
    outside_s: float | None = None
    """Since when the vehicle has been outside its fence."""
    troubled_s: float | None = None
    """Since when something has demanded a hold, whether or not an operator paused it as well."""
    highest_m: float = -math.inf
    """How high the vehicle has come in this climb, and when."""
    risen_s: float = -math.inf
    is_crowded: bool = False
    """Whether a peer is much too close."""
    lost_from: Phase | None = None
    """What the vehicle was doing when its link or its controller was lost."""
    left_ned_m: Vec3 | None = None
    """Where its controller last knew it, when that was another process."""
    boot_s: float = 0.0
    """What its autopilot's clock said then."""
    distrust: str = ""
    """Why nothing is known of the flight so far, in words; empty when all is."""
    endurance: Endurance = field(default_factory=Endurance)


def watch(agent: Agent) -> None:
    """Change the phase when something outside the plan demands it."""
    if agent.phase in BEFORE_START:
        _watch_start(agent)
        return
    _watch_mode(agent)
    health = _health(agent)
    if agent.phase in _NOT_OURS:
        _watch_from_afar(agent, health.silent_s)
        return
    judged = verdict(health, agent.orders.limits)
    if judged is not None and judged.cause is Cause.SILENT:
        agent.note("LinkLost", silent_s=round(health.silent_s, 2))
        agent.commands.clear()
        agent.enter(Cause.SILENT if agent.phase in _AIRBORNE else Cause.FAULT, judged.reason)
    elif _has_lost_the_stick(agent):
        agent.commands.clear()
        agent.enter(Cause.PILOT, who_has_it(agent))
    elif agent.phase in _CLIMBS:
        _watch_climb(agent, judged)
    elif agent.phase in STEERING:
        _watch_flight(agent, judged)


def missing(agent: Agent) -> str:
    """Name what keeps the vehicle from being ready; empty when nothing does."""
    telemetry, fresh_s = agent.telemetry, agent.now - 2.0
    needs_ranges = not agent.orders.flight.open_air
    lacks = {
        "heartbeat": telemetry.heartbeat_s < fresh_s,
        "autopilot that is PX4 or ArduPilot": telemetry.autopilot is None,
        "local position": telemetry.position_s < fresh_s,
        "attitude": telemetry.attitude_s < fresh_s,
        "rangefinders front, back, left and right (only `open_air` flies without)": needs_ranges
        and min(telemetry.ranges_s[:4]) < fresh_s,
        "trust in its own position": telemetry.estimate_ok is False,
        "origin on the globe, which `frame` asks for": agent.frame.lacks_origin(telemetry),
        "readiness to arm": not telemetry.is_ready,
    }
    return next((f"no {what}" for what, is_lacking in lacks.items() if is_lacking), "")


def _watch_start(agent: Agent) -> None:
    wait_s = agent.orders.flight.ready_timeout_s
    if agent.phase is Phase.CONNECTING and agent.in_phase_s > wait_s:
        why = agent.telemetry.why_not(agent.now)
        words = f"{missing(agent)} ({why})" if why else missing(agent)
        agent.enter(Cause.FAULT, f"not ready after {wait_s:.0f} s: {words}")


def _watch_from_afar(agent: Agent, silent_s: float) -> None:
    """Watch a vehicle that is not ours to steer now: its link is lost, or somebody flies it."""
    telemetry = agent.telemetry
    still_flies = telemetry.armed and telemetry.is_failsafe  # told before the next heartbeat
    told_s = telemetry.mode_s if still_flies else telemetry.heartbeat_s
    beatless_s = agent.now - max(telemetry.heartbeat_s, agent.entered_s)
    if silent_s > GONE_S:
        agent.enter(Cause.FAULT, f"nothing heard from its autopilot for {silent_s:.0f} s")
    elif beatless_s > GONE_S:
        agent.enter(Cause.FAULT, f"no heartbeat of its autopilot for {beatless_s:.0f} s")
    elif agent.phase is Phase.YIELDED or told_s <= agent.entered_s:
        return
    elif (found := heard_again(agent)) is not None:
        agent.enter(*found)


def _watch_climb(agent: Agent, judged: Verdict | None) -> None:
    """Land who has reason to, or keep it on the ground; what makes others hold stops its climb."""
    _watch_trouble(agent, judged)
    if agent.phase is Phase.TAKEOFF and _climbs_in_vain(agent):
        agent.enter(Cause.LAND, f"did not rise for {RISE_S:.0f} s: {agent.why_not()}")
    elif judged is not None and judged.cause is Cause.LAND:
        agent.enter(judged.cause if agent.telemetry.armed else Cause.CANCELLED, judged.reason)


def _climbs_in_vain(agent: Agent) -> bool:
    telemetry, vigil, pilot = agent.telemetry, agent.vigil, agent.telemetry.autopilot
    if telemetry.height_m > vigil.highest_m + RISE_M:
        vigil.highest_m, vigil.risen_s = telemetry.height_m, agent.now
    by_command = pilot is not None and pilot.takeoff_by_command
    return not by_command and agent.now - max(vigil.risen_s, agent.entered_s) > RISE_S


def _watch_flight(agent: Agent, judged: Verdict | None) -> None:
    _watch_peers(agent)
    _watch_trouble(agent, judged)
    if not agent.telemetry.armed:
        agent.enter(Cause.DISARMED, "the vehicle disarmed in flight")
    elif judged is not None and judged.cause in {Cause.LAND, Cause.HOLD}:
        if (judged.cause, agent.phase) != (Cause.HOLD, Phase.HOLDING):
            agent.enter(*judged)
    elif agent.phase is Phase.RETURNING or (agent.is_paused and judged is None):
        return
    elif judged is not None or agent.homebound:
        agent.enter(Cause.RETURN, judged.reason if judged else agent.homebound)
    elif _is_time_up(agent):
        home = agent.orders.flight.return_home
        agent.enter(Cause.RETURN if home else Cause.LAND, TIME_OVER)
    elif agent.phase is Phase.HOLDING:
        agent.enter(Cause.RECOVERED, "all well again")


def _watch_trouble(agent: Agent, judged: Verdict | None) -> None:
    if judged is None or judged.cause is not Cause.HOLD:
        agent.vigil.troubled_s = None
    elif agent.vigil.troubled_s is None:
        agent.vigil.troubled_s = agent.now


def _watch_peers(agent: Agent) -> None:
    """Note a peer at less than half of the separation; the last word pushes the two apart."""
    separation_m = agent.orders.limits.separation_m
    nearest_m = min([math.hypot(*at) for at, _, _ in agent.neighbours], default=math.inf)
    if nearest_m < 0.5 * separation_m and not agent.vigil.is_crowded:
        agent.vigil.is_crowded = True
        agent.note("PeerTooClose", distance_m=round(nearest_m, 2))
    elif nearest_m > separation_m:
        agent.vigil.is_crowded = False


def _health(agent: Agent) -> Health:
    telemetry, flight, vigil, now = agent.telemetry, agent.orders.flight, agent.vigil, agent.now
    planned_s = agent.plan_s if agent.has_plan_failed else max(agent.plan_s, agent.entered_s)
    plans = agent.has_plan_failed or agent.phase in EXPLORES
    troubled_s, battery = vigil.troubled_s, telemetry.battery_fraction
    if battery is not None and agent.phase in STEERING and vigil.endurance.is_due(now):
        vigil.endurance.sample(battery, agent.trail.length_m(), flight.speed_m_s, now)
    return Health(
        silent_s=now - telemetry.heard_s,
        untold_s=now - telemetry.mode_s,
        position_age_s=now - min(telemetry.position_s, telemetry.attitude_s),
        range_age_s=0.0 if flight.open_air else now - min(telemetry.ranges_s[:4]),
        plan_age_s=now - planned_s if plans else 0.0,
        holding_s=0.0 if troubled_s is None else now - troubled_s,
        mission_s=now - agent.began_s,
        battery_fraction=1.0 if battery is None else battery,
        way_home_fraction=vigil.endurance.needed,
        outside_s=_outside_s(agent),
        round_trip_s=telemetry.timesync.round_trip_s(now),
        estimate=_estimate_trouble(agent),
    )


def _outside_s(agent: Agent) -> float:
    (x, y, z), limits = agent.telemetry.position_ned_m, agent.orders.limits
    is_outside = max(math.hypot(x, y) - limits.radius_m, -z - limits.ceiling_m) > OUTSIDE_M
    if not is_outside:
        agent.vigil.outside_s = None
    elif agent.vigil.outside_s is None:
        agent.vigil.outside_s = agent.now
        agent.note("FenceLeft", position_ned_m=[round(metres, 2) for metres in (x, y, z)])
    return 0.0 if agent.vigil.outside_s is None else agent.now - agent.vigil.outside_s


def _estimate_trouble(agent: Agent) -> str:
    telemetry = agent.telemetry
    if telemetry.estimate_ok is False:
        return "its estimator does not trust its position"
    if agent.now - telemetry.jump_s < JUMP_HOLD_S:
        return f"its position jumped by {telemetry.jump_m:.1f} m"
    return ""


def _is_time_up(agent: Agent) -> bool:
    begun_s = agent.explored_from_s
    return begun_s is not None and agent.now - begun_s >= agent.orders.duration_s


def _watch_mode(agent: Agent) -> None:
    telemetry, vigil = agent.telemetry, agent.vigil
    lands = agent.phase is Phase.LANDING and telemetry.is_landing
    if telemetry.is_offboard or lands:
        vigil.mode_lost_s, vigil.mode_before = None, telemetry.custom_mode
    elif vigil.mode_lost_s is None and telemetry.mode_s > -math.inf:
        vigil.mode_lost_s = telemetry.mode_s


def _has_lost_the_stick(agent: Agent) -> bool:
    """Whether somebody else has chosen the mode; one that we asked to change may stay a while."""
    telemetry, vigil, pilot = agent.telemetry, agent.vigil, agent.telemetry.autopilot
    if pilot is None or vigil.mode_lost_s is None:
        return False
    lost_s, grace_s = vigil.mode_lost_s, 0.0
    if agent.phase is Phase.LANDING:
        if not telemetry.armed or telemetry.heartbeat_s < telemetry.mode_changed_s:
            return False  # PX4 leaves the mode by itself when it has disarmed
        lost_s = max(lost_s, agent.entered_s)
    if agent.phase not in _FLIES_OFFBOARD and telemetry.custom_mode == vigil.mode_before:
        grace_s = math.inf if agent.phase is Phase.ARMING else MODE_LAG_S
    elif telemetry.may_resume:
        grace_s = FAILSAFE_S
    return telemetry.mode_s - lost_s >= grace_s
