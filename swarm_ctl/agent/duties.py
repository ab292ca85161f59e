"""What a vehicle does in each phase; a duty gives the setpoint to fly, or None for no setpoint."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from swarm_ctl.agent.phases import Cause, Phase
from swarm_ctl.agent.regain import HAS_LANDED
from swarm_ctl.agent.watch import MODE_LAG_S, missing
from swarm_ctl.autopilot import command as commands
from swarm_ctl.autopilot.base import CUSTOM_MODE_FLAG
from swarm_ctl.autopilot.command import command
from swarm_ctl.explore.planner import RANGE_ORDER
from swarm_ctl.model import ZERO, Vec3

if TYPE_CHECKING:
    from swarm_ctl.agent.agent import Agent

CHECK_AGAIN_S = 4.0
"""Between two questions what keeps a vehicle from being ready."""
WAY_UP_S = 4.0
"""How long it stays down for who is right above; autopilots disarm by themselves after 10 s."""
ARM_S = 30.0
TAKE_BACK_S = 8.0
"""In flight a change of mode is asked for once; without effect by then, its pilot keeps it."""
TAKEOFF_S = 40.0
TAKEOFF_AGAIN_S = 8.0
"""ArduPilot is 0.2 m up 4 s after the command, and begins anew when it comes again."""
LANDING_S = 90.0
STOP_S = 2.0
"""Without it ArduPilot flies on at its last setpoint for GUID_TIMEOUT; PX4, told to stop for any
longer, would not land by its own failsafe when the command is lost or refused."""
STREAM_BEFORE_SWITCH_S = 1.0
"""PX4 wants setpoints before it takes the offboard mode (PX4 guide, offboard mode)."""
SETTLED_M_S = 0.2
"""A landing begun any faster ends beside the place it was meant for."""
SETTLE_S = 4.0
"""Then it is at rest, and its velocity tells the estimator's noise (PX4: up to 0.3 m/s)."""
CLIMBED_FRACTION = 0.9
DOWN = RANGE_ORDER.index("down")
ON_GROUND_M = 0.3
HOLD_GAIN, HOLD_M_S = 0.8, 0.5
"""Speed per metre off the place that is held, and at most: wind at take-off blows a metre away."""
IS_HOME = "home"

Duty = Callable[["Agent"], Vec3 | None]


def connect(agent: Agent) -> Vec3 | None:
    """Wait until everything that is needed arrives, and ask what keeps it from being ready."""
    if agent.telemetry.autopilot is None:
        return None
    if agent.telemetry.armed:
        mode = agent.telemetry.mode_name
        agent.enter(Cause.FAULT, f"armed already, in {mode}: somebody else flies it")
        return None
    if missing(agent):
        if agent.in_phase_s > CHECK_AGAIN_S and agent.is_time_to_ask:
            agent.ask(command(commands.RUN_PREARM_CHECKS), CHECK_AGAIN_S)
            _leave_landing_mode(agent)
    else:
        name = agent.telemetry.autopilot.name
        agent.note("Connected", autopilot=name)
        agent.enter(Cause.CHECKED, f"{name} ready{', waits for start' * agent.awaits_start}")
    return None


def wait_for_start(agent: Agent) -> Vec3 | None:
    """Wait for this vehicle's turn to take off, and for the order to if there is to be one."""
    if agent.telemetry.armed:
        agent.enter(Cause.FAULT, "armed by somebody else before its start")
        return None
    agent.telemetry.start_here()
    waited_s = agent.now - max(agent.entered_s, agent.began_s)
    if not agent.awaits_start and waited_s >= agent.start_delay_s:
        agent.enter(Cause.STARTED, "")
    return None


def arm(agent: Agent) -> Vec3 | None:
    """Stream setpoints, switch to offboard, arm."""
    telemetry, pilot = agent.telemetry, agent.telemetry.autopilot
    is_flown = telemetry.armed and not telemetry.is_offboard
    if is_flown and agent.in_phase_s > (TAKE_BACK_S if agent.is_given else 0.0):
        agent.enter(Cause.PILOT, f"armed in {telemetry.mode_name}, which is not ours")
        return None
    if agent.in_phase_s > ARM_S:
        agent.enter(Cause.FAULT, f"did not arm within {ARM_S:.0f} s: {agent.why_not()}")
        return None
    if pilot is None or (
        not pilot.takeoff_by_command and agent.in_phase_s < STREAM_BEFORE_SWITCH_S
    ):
        return ZERO
    if not telemetry.is_offboard:
        if agent.is_time_to_ask:
            mode = (CUSTOM_MODE_FLAG, *pilot.offboard_parameters)
            again_s = 2.0 * TAKE_BACK_S if is_flown else MODE_LAG_S
            agent.ask(command(commands.DO_SET_MODE, *mode), again_s)
        return ZERO
    agent.commands.forget(commands.DO_SET_MODE)
    if telemetry.armed:
        agent.enter(Cause.ARMED, "")
    elif agent.is_time_to_ask:
        agent.ask(command(commands.COMPONENT_ARM_DISARM, 1.0))
    return ZERO


def take_off(agent: Agent) -> Vec3 | None:
    """Climb: PX4 by setpoints, ArduPilot by a command that no setpoint may follow."""
    telemetry, flight, pilot = agent.telemetry, agent.orders.flight, agent.telemetry.autopilot
    by_command = pilot is not None and pilot.takeoff_by_command
    enough_m = CLIMBED_FRACTION * flight.height_m
    is_astray = by_command and agent.vigil.troubled_s is not None  # setpoints stop it, at last
    if agent.is_given or is_astray:  # in flight, where ArduPilot obeys no take-off
        enough_m = min(enough_m, agent.orders.limits.floor_m)
    if telemetry.height_m > enough_m:
        agent.enter(Cause.AIRBORNE, "")
        return None if by_command else ZERO
    if agent.in_phase_s < WAY_UP_S and _is_below_somebody(agent):
        return None if by_command else ZERO
    if not telemetry.armed and agent.in_phase_s > MODE_LAG_S:
        agent.enter(Cause.DISARMED, f"disarmed before it flew: {agent.why_not()}")
    elif agent.in_phase_s > TAKEOFF_S:
        agent.enter(Cause.LAND, f"did not climb within {TAKEOFF_S:.0f} s: {agent.why_not()}")
    elif not by_command and agent.vigil.troubled_s is not None:
        return ZERO
    elif not by_command:
        short_m = flight.height_m - telemetry.height_m
        level = _towards(ZERO, telemetry.position_ned_m)
        return Vec3(level.x, level.y, -min(flight.climb_m_s, max(0.2, short_m)))
    elif telemetry.height_m > ON_GROUND_M:
        agent.commands.forget(commands.NAV_TAKEOFF)
    elif agent.is_time_to_ask:
        agent.ask(command(commands.NAV_TAKEOFF, *[0.0] * 6, flight.height_m), TAKEOFF_AGAIN_S)
    return None


def explore(agent: Agent) -> Vec3 | None:
    """Follow the planner; in two dimensions at the mission's height."""
    if agent.now - agent.plan_s >= agent.orders.planner.period_s - 1e-6:
        agent.plan()
    return _at_height(agent, agent.planned_ned_m_s)


def hold(agent: Agent) -> Vec3 | None:
    """Stay where the hold began; a planner that failed is asked again."""
    if agent.has_plan_failed:
        agent.plan()
    if agent.now - agent.telemetry.position_s > agent.orders.limits.link_hold_s:
        return ZERO  # nobody knows where the hold began
    return _towards(agent.hold_ned_m, agent.telemetry.position_ned_m)


def come_home(agent: Agent) -> Vec3 | None:
    """Fly back along ground the vehicle has flown before."""
    flight, place = agent.orders.flight, agent.telemetry.position_ned_m
    if agent.in_phase_s > flight.return_timeout_s and _is_free_below(agent):
        return _settle(agent, Cause.LAND, f"not home after {flight.return_timeout_s:.0f} s")
    route = agent.homeward.route(place, agent.now, agent.way_home)
    velocity = route.velocity(place, flight.speed_m_s)
    if route.is_done():
        return _settle(agent, Cause.HOME, IS_HOME)
    agent.homeward.go_on()
    if math.hypot(velocity.x, velocity.y) > 0.1:
        agent.yaw_rad = math.atan2(velocity.y, velocity.x)
    return _at_height(agent, velocity)


def land(agent: Agent) -> Vec3 | None:
    """Let the autopilot land and wait until it has disarmed; stop until it has begun."""
    telemetry = agent.telemetry
    if not telemetry.armed:
        agent.enter(Cause.DISARMED, HAS_LANDED)
    elif agent.in_phase_s > LANDING_S:
        agent.enter(Cause.FAULT, f"did not land within {LANDING_S:.0f} s")
    elif telemetry.is_landing or telemetry.heartbeat_s < telemetry.mode_changed_s:
        agent.commands.forget(commands.NAV_LAND)  # PX4 leaves the mode itself when it has disarmed
    elif agent.is_time_to_ask:
        agent.ask(command(commands.NAV_LAND))
    return ZERO if telemetry.is_offboard and agent.in_phase_s < STOP_S else None


def listen(_agent: Agent) -> Vec3 | None:
    """Do nothing: the autopilot's own failsafe flies until it is heard again (watch.py)."""
    return None


def give_way(agent: Agent) -> Vec3 | None:
    """Do nothing: a pilot flies; the mission ends when he has landed."""
    if not agent.telemetry.armed and agent.telemetry.heartbeat_s > -math.inf:
        agent.enter(Cause.DISARMED, f"{agent.reason}; the vehicle is on the ground")
    return None


DUTIES: dict[Phase, Duty] = {
    Phase.CONNECTING: connect,
    Phase.READY: wait_for_start,
    Phase.ARMING: arm,
    Phase.TAKEOFF: take_off,
    Phase.EXPLORING: explore,
    Phase.AVOIDING: explore,
    Phase.HOLDING: hold,
    Phase.RETURNING: come_home,
    Phase.LANDING: land,
    Phase.YIELDED: give_way,
    Phase.LOST: listen,
}


def _leave_landing_mode(agent: Agent) -> None:
    """Change the mode in which the last flight ended: no autopilot is ready in it."""
    pilot = agent.telemetry.autopilot
    if pilot and agent.telemetry.custom_mode == pilot.land_mode:
        agent.commands.request(
            command(commands.DO_SET_MODE, CUSTOM_MODE_FLAG, *pilot.waiting_parameters)
        )


def _settle(agent: Agent, cause: Cause, reason: str) -> Vec3 | None:
    """Come to rest, then enter what ends in a landing."""
    is_at_rest = math.hypot(*agent.telemetry.velocity_ned_m_s) < SETTLED_M_S
    if is_at_rest or agent.homeward.waits_s(agent.now) > SETTLE_S:
        agent.enter(cause, reason)
        return None
    return _at_height(agent, ZERO)


def _is_free_below(agent: Agent) -> bool:
    """Whether the vehicle is over the floor it started from, and no peer is near or below."""
    telemetry = agent.telemetry
    return telemetry.ranges_m[DOWN] > telemetry.height_m - ON_GROUND_M and all(
        math.hypot(peer.offset_ned_m.x, peer.offset_ned_m.y) > agent.orders.limits.separation_m
        for peer in agent.neighbours
    )


def _is_below_somebody(agent: Agent) -> bool:
    """Whether a peer flies where this vehicle is about to climb."""
    return any(
        peer.offset_ned_m.z < -ON_GROUND_M
        and math.hypot(peer.offset_ned_m.x, peer.offset_ned_m.y) < agent.orders.limits.separation_m
        for peer in agent.neighbours
    )


def _at_height(agent: Agent, velocity: Vec3) -> Vec3:
    """Keep the mission's height when it flies in two dimensions."""
    if agent.orders.planner.dimensions == 3:
        return velocity
    climb_m_s = agent.orders.flight.climb_m_s
    short_m = agent.orders.flight.height_m - agent.telemetry.height_m
    return Vec3(velocity.x, velocity.y, -max(-climb_m_s, min(climb_m_s, short_m)))


def _towards(target: Vec3, place: Vec3) -> Vec3:
    """Drift to a place close by, slowly."""
    return Vec3(*(_clip(HOLD_GAIN * (t - p)) for t, p in zip(target, place, strict=True)))


def _clip(speed_m_s: float) -> float:
    return max(-HOLD_M_S, min(HOLD_M_S, speed_m_s))
