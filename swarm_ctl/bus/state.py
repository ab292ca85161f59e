"""What is told of a vehicle twice a second, read off its controller."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.phases import BEFORE_START, EXPLORES
from swarm_ctl.bus.messages import State
from swarm_ctl.frames import Geodetic
from swarm_ctl.model import Vec3


def state_of(agent: Agent, run: str, *, origin: Vec3 | None, seen_m2: float) -> State:
    """Read off how an agent is; `origin` is its start in the launch frame, if that is known."""
    telemetry, now = agent.telemetry, agent.now
    start = agent.frame.start(telemetry)
    if origin is None and isinstance(start, Vec3):
        origin = start
    target = agent.target_ned_m if agent.phase in EXPLORES else None
    return State(
        run=run,
        sysid=agent.sysid,
        time_s=round(now, 3),
        phase=agent.phase.value,
        words=agent.reason,
        is_paused=agent.is_paused,
        is_waiting=agent.awaits_start and agent.phase in BEFORE_START,
        position_ned_m=_rounded(telemetry.position_ned_m),
        velocity_ned_m_s=_rounded(telemetry.velocity_ned_m_s),
        yaw_rad=round(telemetry.yaw_rad, 3),
        target_ned_m=target and _rounded(target),
        origin_ned_m=origin and _rounded(origin),
        origin_geodetic=[*start] if isinstance(start, Geodetic) else None,
        battery=telemetry.battery_fraction,
        link_age_s=round(now - telemetry.heard_s, 3),
        neighbours=list(agent.peers.heard(now)),
        ranges_m=_rounded(telemetry.ranges_m),
        victims=sorted(agent.victims.seen),
        seen_m2=round(seen_m2, 2),
        autopilot=telemetry.autopilot.name if telemetry.autopilot else "",
    )


def _rounded(values: Iterable[float]) -> list[Any]:
    return [round(value, 3) for value in values]
