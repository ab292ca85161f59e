"""What every tick looks at before anything is decided: link, pilot, failsafe, time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from swarm_ctl.agent.failsafe import Health, Verdict, verdict
from swarm_ctl.agent.phases import STEERING, Cause, Phase

if TYPE_CHECKING:
    from swarm_ctl.agent.agent import Agent

CONNECT_S = 60.0
"""Longest wait for a vehicle that is ready to arm; ArduPilot takes about 40 s from power-up."""
MODE_LAG_S = 2.0
"""PX4's heartbeat tells a mode up to a second late."""
FAILSAFE_S = 5.0
"""PX4 leaves offboard when the stream was lost, and takes it up again when it is back."""
TIME_OVER = "exploration time is over"

_EXPLORING = frozenset({Phase.EXPLORING, Phase.AVOIDING})


def watch(agent: Agent) -> None:
    """Change the phase when something outside the plan demands it."""
    if agent.phase in {Phase.CONNECTING, Phase.READY}:
        if agent.phase is Phase.CONNECTING and agent.in_phase_s > CONNECT_S:
            agent.enter(Cause.FAULT, f"not ready after {CONNECT_S:.0f} s: {missing(agent)}")
        return
    if agent.telemetry.is_offboard:
        agent.mode_lost_s = None
    elif agent.mode_lost_s is None:
        agent.mode_lost_s = agent.telemetry.heartbeat_s
    health = _health(agent)
    judged = verdict(health, agent.orders.limits)
    if judged is not None and judged.cause is Cause.FAULT:
        agent.note("LinkLost", silent_s=round(health.silent_s, 2))
        agent.enter(*judged)
    elif _pilot_took_over(agent):
        agent.commands.clear()
        agent.enter(Cause.PILOT, f"the pilot chose {agent.telemetry.mode_name}")
    elif agent.phase in STEERING:
        _watch_flight(agent, judged)


def missing(agent: Agent) -> str:
    """Name what keeps the vehicle from being ready; empty when nothing does."""
    telemetry, fresh_s = agent.telemetry, agent.now - 2.0
    lacks = {
        "heartbeat": telemetry.heartbeat_s < fresh_s,
        "autopilot that is PX4 or ArduPilot": telemetry.autopilot is None,
        "local position": telemetry.position_s < fresh_s,
        "attitude": telemetry.attitude_s < fresh_s,
        "rangefinders front, back, left and right": min(telemetry.ranges_s[:4]) < fresh_s,
        "readiness to arm": not telemetry.is_ready,
    }
    return next((f"no {what}" for what, is_lacking in lacks.items() if is_lacking), "")


def _watch_flight(agent: Agent, judged: Verdict | None) -> None:
    if not agent.telemetry.armed:
        agent.enter(Cause.DISARMED, "the vehicle disarmed in flight")
        return
    if judged is not None:
        already = (judged.cause, agent.phase) in {
            (Cause.HOLD, Phase.HOLDING),
            (Cause.RETURN, Phase.RETURNING),
        }
        if not already:
            agent.enter(*judged)
    elif _is_time_up(agent) and agent.phase is not Phase.RETURNING:
        home = agent.orders.flight.return_home
        agent.enter(Cause.RETURN if home else Cause.LAND, TIME_OVER)
    elif agent.phase is Phase.HOLDING and not agent.is_paused:
        agent.enter(Cause.RECOVERED, "all well again")


def _health(agent: Agent) -> Health:
    telemetry, now = agent.telemetry, agent.now
    planned_s = agent.plan_s if agent.has_plan_failed else max(agent.plan_s, agent.entered_s)
    plans = agent.phase in _EXPLORING or agent.has_plan_failed
    waits = agent.phase is Phase.HOLDING and not agent.is_paused
    battery = telemetry.battery_fraction
    return Health(
        silent_s=now - telemetry.heard_s,
        position_age_s=now - min(telemetry.position_s, telemetry.attitude_s),
        range_age_s=now - min(telemetry.ranges_s[:4]),
        plan_age_s=now - planned_s if plans else 0.0,
        holding_s=agent.in_phase_s if waits else 0.0,
        mission_s=now,
        battery_fraction=1.0 if battery is None else battery,
    )


def _is_time_up(agent: Agent) -> bool:
    begun_s = agent.explored_from_s
    return begun_s is not None and agent.now - begun_s >= agent.orders.duration_s


def _pilot_took_over(agent: Agent) -> bool:
    telemetry, pilot = agent.telemetry, agent.telemetry.autopilot
    if pilot is None or telemetry.heartbeat_s <= agent.entered_s + MODE_LAG_S:
        return False
    match agent.phase:
        case Phase.LANDING:
            ours = telemetry.is_offboard or telemetry.custom_mode == pilot.land_mode
            return telemetry.armed and not ours
        case Phase.ARMING:
            return agent.was_offboard and not telemetry.is_offboard
        case _:
            grace_s = FAILSAFE_S if telemetry.is_failsafe else 0.0
            if agent.mode_lost_s is None or telemetry.heartbeat_s - agent.mode_lost_s < grace_s:
                return False
            return agent.phase in {Phase.TAKEOFF, *STEERING}
