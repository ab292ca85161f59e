"""What an operator may order of a vehicle, and how ground stations say it over MAVLink."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

from swarm_ctl import wire
from swarm_ctl.agent.phases import BEFORE_START, STEERING, Cause, Phase
from swarm_ctl.autopilot import command as commands
from swarm_ctl.autopilot.base import AUTOPILOT_COMPONENT, COMPANION_COMPONENT
from swarm_ctl.model import Operator

if TYPE_CHECKING:
    from swarm_ctl.agent.agent import Agent

NAV_RETURN_TO_LAUNCH = 20
DO_PAUSE_CONTINUE = 193
OVERRIDE_GOTO = 252
MISSION_START = 300

ORDERS: Mapping[tuple[int, float | None], Operator] = {
    (NAV_RETURN_TO_LAUNCH, None): Operator.RETURN,
    (commands.NAV_LAND, None): Operator.LAND,
    (MISSION_START, None): Operator.RESUME,
    (DO_PAUSE_CONTINUE, 0.0): Operator.PAUSE,
    (DO_PAUSE_CONTINUE, 1.0): Operator.RESUME,
    (OVERRIDE_GOTO, 0.0): Operator.PAUSE,  # MAV_GOTO_DO_HOLD
    (OVERRIDE_GOTO, 1.0): Operator.RESUME,  # MAV_GOTO_DO_CONTINUE
}
"""By MAV_CMD and its first parameter; None stands for whatever it is."""
_KNOWN = frozenset(command for command, _ in ORDERS)

COMMANDS = ("COMMAND_LONG", "COMMAND_INT")
COMMAND_IDS = frozenset(wire.message(name).id for name in COMMANDS)
_COMMAND_LONG = wire.message("COMMAND_LONG").id
GROUND_STATION = 190
"""MAV_COMP_ID_MISSIONPLANNER, by which ground stations and their libraries call themselves."""
FIRST_STATION = 240
"""MAVLink leaves the sysids from here on to ground stations."""
MOST_PER_TICK = 4
"""Further commands of a burst are left to be sent again, as PX4 does."""
AGAIN_S, CONFIRM_S = 1.0, 10.0
"""An order that comes again within this time, or says that it is a repetition, is a copy."""

_BEFORE_FLIGHT = frozenset({Phase.CONNECTING, Phase.READY, Phase.ARMING})
_LANDS = STEERING | {Phase.ARMING, Phase.LOST}
_DOWN = frozenset({Phase.LANDING, Phase.DONE})
_ALREADY: Mapping[Operator, frozenset[Phase]] = {
    Operator.START: STEERING | {Phase.ARMING, Phase.TAKEOFF},
    Operator.RETURN: frozenset({Phase.RETURNING, Phase.DONE}),
    Operator.LAND: _DOWN,
    Operator.ABORT: _DOWN,
}
"""Phases in which there is nothing left to do."""


# Obeying.


def obey(agent: Agent, operator: Operator) -> bool:
    """Do what the operator wants; False when it makes no sense now, which changes nothing."""
    if agent.phase in _ALREADY.get(operator, ()):
        return True
    if agent.is_ended:
        return False
    agent.note("OperatorOrder", order=operator.value)
    match operator:
        case Operator.START:
            is_done = _start(agent)
        case Operator.PAUSE:
            is_done = _pause(agent)
        case Operator.RESUME:
            is_done = _resume(agent)
        case _:
            is_done = _end(agent, operator)
    if not is_done:
        agent.note("OrderRefused", order=operator.value, phase=agent.phase.value)
    return is_done


def _start(agent: Agent) -> bool:
    """Let a vehicle that stands ready, or soon will, take its turn; most do without an order."""
    if agent.phase not in BEFORE_START:
        return False
    if agent.awaits_start:
        agent.awaits_start, agent.began_s = False, agent.now
    return True


def _pause(agent: Agent) -> bool:
    """Hold; a vehicle that cannot be told now will hold when its link is back."""
    if agent.phase not in STEERING | {Phase.LOST}:
        return False
    if agent.phase in STEERING - {Phase.HOLDING}:
        agent.enter(Cause.HOLD, "paused by the operator")
    agent.is_paused = True
    return True


def _resume(agent: Agent) -> bool:
    """End a pause; it is also how a ground station starts what waits for it (MISSION_START)."""
    if agent.awaits_start and agent.phase in BEFORE_START:
        return _start(agent)
    if agent.phase is Phase.YIELDED:
        agent.is_given = True
        agent.enter(Cause.RESUMED, "the operator gave the vehicle back")
        return True
    was_paused, agent.is_paused = agent.is_paused, False
    return was_paused


def _end(agent: Agent, operator: Operator) -> bool:
    """Bring the vehicle down: home first when asked to and in flight, else here."""
    words, phase = f"{operator.value} ordered by the operator", agent.phase
    goes_home = operator is Operator.RETURN
    if phase in _BEFORE_FLIGHT and not agent.telemetry.armed:
        agent.enter(Cause.CANCELLED, words)
    elif goes_home and phase in STEERING:
        agent.enter(Cause.RETURN, words)
    elif goes_home and phase is Phase.LOST:
        agent.homebound = words
    elif phase is Phase.TAKEOFF or (phase in _LANDS and not goes_home):
        agent.enter(Cause.LAND, words)  # home is right below who takes off
    else:
        return False
    return True


# Hearing.


class Request(NamedTuple):
    """A command of a ground station to this controller."""

    command: int
    """MAV_CMD."""
    operator: Operator | None
    """What it orders; None when we have no such command, or not with this parameter."""
    sysid: int
    """The sender's, who gets the acknowledgement."""
    compid: int


class Ack(NamedTuple):
    """What COMMAND_ACK tells a ground station."""

    command: int
    result: int
    """MAV_RESULT."""
    sysid: int
    """The receiver's."""
    compid: int


class Inbox:
    """The commands of ground stations, from their arrival to the tick that obeys them."""

    def __init__(self, sysid: int) -> None:
        self._address = sysid, COMPANION_COMPONENT
        self._waiting: list[tuple[Request, bool]] = []
        self._obeyed: Request | None = None
        self._obeyed_s = -math.inf

    def receive(self, frame: wire.Frame) -> None:
        """Take a COMMAND_LONG or COMMAND_INT if it is ours and comes from a ground station.

        Broadcasts are the autopilot's, and so are modes: we follow what becomes of them.
        """
        values = frame.values
        is_ours = (values.target_system, values.target_component) == self._address
        if not is_ours or not is_ground_station(frame.sysid, frame.compid):
            return
        if len(self._waiting) < MOST_PER_TICK:
            operator = meaning(values.command, values.param1)
            request = Request(values.command, operator, frame.sysid, frame.compid)
            is_copy = frame.id == _COMMAND_LONG and values.confirmation > 0
            self._waiting.append((request, is_copy))

    @property
    def has_any(self) -> bool:
        """Whether a command waits to be obeyed."""
        return bool(self._waiting)

    def forget(self) -> None:
        """Take what comes next for no copy: something else was ordered meanwhile."""
        self._obeyed = None

    def answer(self, order: Callable[[Operator], bool], now: float) -> Iterator[Ack]:
        """Give what has come to `order`, each order once, and the acknowledgements."""
        waiting, self._waiting = self._waiting, []
        for request, is_copy in waiting:
            result = self._result(request, order, now, CONFIRM_S if is_copy else AGAIN_S)
            yield Ack(request.command, result, request.sysid, request.compid)

    def _result(
        self, request: Request, order: Callable[[Operator], bool], now: float, copy_s: float
    ) -> int:
        if request.operator is None:
            return commands.DENIED if request.command in _KNOWN else commands.UNSUPPORTED
        if request != self._obeyed or now - self._obeyed_s > copy_s:
            if not order(request.operator):
                return commands.TEMPORARILY_REJECTED
            self._obeyed = request
        self._obeyed_s = now
        return commands.ACCEPTED


def is_ground_station(sysid: int, compid: int) -> bool:
    """Whether a sender may give orders: no autopilot and no companion of the swarm may.

    A swarm may be so large that its vehicles have the sysids of ground stations.
    """
    is_vehicle = compid in {AUTOPILOT_COMPONENT, COMPANION_COMPONENT}
    return compid == GROUND_STATION or (sysid >= FIRST_STATION and not is_vehicle)


def meaning(command: int, parameter: float) -> Operator | None:
    """Look up what a command with this first parameter orders."""
    return ORDERS.get((command, None)) or ORDERS.get((command, parameter))
