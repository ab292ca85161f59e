"""The life of a vehicle in one literal table; a change that is not in it does not happen."""

from __future__ import annotations

from enum import StrEnum

from swarm_ctl.errors import PhaseError


class Phase(StrEnum):
    """What a controller is doing with its vehicle."""

    CONNECTING = "connecting"
    READY = "ready"
    ARMING = "arming"
    TAKEOFF = "takeoff"
    EXPLORING = "exploring"
    AVOIDING = "avoiding"
    HOLDING = "holding"
    RETURNING = "returning"
    LANDING = "landing"
    YIELDED = "yielded"
    DONE = "done"
    FAILED = "failed"
    LOST = "lost"


class Cause(StrEnum):
    """What makes a phase end."""

    CHECKED = "checked"
    STARTED = "started"
    ARMED = "armed"
    AIRBORNE = "airborne"
    OBSTACLE = "obstacle"
    CLEAR = "clear"
    HOLD = "hold"
    RECOVERED = "recovered"
    SILENT = "silent"
    RETURN = "return"
    LAND = "land"
    HOME = "home"
    DISARMED = "disarmed"
    PILOT = "pilot"
    RESUMED = "resumed"
    CANCELLED = "cancelled"
    FAULT = "fault"


P, C = Phase, Cause

TABLE: dict[tuple[Phase, Cause], Phase] = {
    (P.CONNECTING, C.CHECKED): P.READY,
    (P.CONNECTING, C.CANCELLED): P.DONE,
    (P.CONNECTING, C.FAULT): P.FAILED,
    (P.READY, C.STARTED): P.ARMING,
    (P.READY, C.CANCELLED): P.DONE,
    (P.READY, C.FAULT): P.FAILED,
    (P.ARMING, C.ARMED): P.TAKEOFF,
    (P.ARMING, C.LAND): P.LANDING,
    (P.ARMING, C.PILOT): P.YIELDED,
    (P.ARMING, C.CANCELLED): P.DONE,
    (P.ARMING, C.FAULT): P.FAILED,
    (P.TAKEOFF, C.AIRBORNE): P.EXPLORING,
    (P.TAKEOFF, C.LAND): P.LANDING,
    (P.TAKEOFF, C.CANCELLED): P.DONE,
    (P.TAKEOFF, C.SILENT): P.LOST,
    (P.TAKEOFF, C.PILOT): P.YIELDED,
    (P.TAKEOFF, C.DISARMED): P.FAILED,
    (P.TAKEOFF, C.FAULT): P.FAILED,
    (P.EXPLORING, C.OBSTACLE): P.AVOIDING,
    (P.EXPLORING, C.HOLD): P.HOLDING,
    (P.EXPLORING, C.RETURN): P.RETURNING,
    (P.EXPLORING, C.LAND): P.LANDING,
    (P.EXPLORING, C.SILENT): P.LOST,
    (P.EXPLORING, C.PILOT): P.YIELDED,
    (P.EXPLORING, C.DISARMED): P.FAILED,
    (P.EXPLORING, C.FAULT): P.FAILED,
    (P.AVOIDING, C.CLEAR): P.EXPLORING,
    (P.AVOIDING, C.HOLD): P.HOLDING,
    (P.AVOIDING, C.RETURN): P.RETURNING,
    (P.AVOIDING, C.LAND): P.LANDING,
    (P.AVOIDING, C.SILENT): P.LOST,
    (P.AVOIDING, C.PILOT): P.YIELDED,
    (P.AVOIDING, C.DISARMED): P.FAILED,
    (P.AVOIDING, C.FAULT): P.FAILED,
    (P.HOLDING, C.RECOVERED): P.EXPLORING,
    (P.HOLDING, C.RETURN): P.RETURNING,
    (P.HOLDING, C.LAND): P.LANDING,
    (P.HOLDING, C.SILENT): P.LOST,
    (P.HOLDING, C.PILOT): P.YIELDED,
    (P.HOLDING, C.DISARMED): P.FAILED,
    (P.HOLDING, C.FAULT): P.FAILED,
    (P.RETURNING, C.HOME): P.LANDING,
    (P.RETURNING, C.HOLD): P.HOLDING,
    (P.RETURNING, C.LAND): P.LANDING,
    (P.RETURNING, C.SILENT): P.LOST,
    (P.RETURNING, C.PILOT): P.YIELDED,
    (P.RETURNING, C.DISARMED): P.FAILED,
    (P.RETURNING, C.FAULT): P.FAILED,
    (P.LANDING, C.DISARMED): P.DONE,
    (P.LANDING, C.SILENT): P.LOST,
    (P.LANDING, C.PILOT): P.YIELDED,
    (P.LANDING, C.FAULT): P.FAILED,
    (P.YIELDED, C.RESUMED): P.ARMING,
    (P.YIELDED, C.DISARMED): P.DONE,
    (P.YIELDED, C.LAND): P.LANDING,
    (P.YIELDED, C.FAULT): P.FAILED,
    (P.LOST, C.CHECKED): P.READY,
    (P.LOST, C.ARMED): P.TAKEOFF,
    (P.LOST, C.RECOVERED): P.HOLDING,
    (P.LOST, C.LAND): P.LANDING,
    (P.LOST, C.PILOT): P.YIELDED,
    (P.LOST, C.DISARMED): P.DONE,
    (P.LOST, C.FAULT): P.FAILED,
}

BEFORE_START = frozenset({P.CONNECTING, P.READY})
"""A vehicle's own frame begins where it stands when it is armed; what is told before is in none."""
ENDED = frozenset({P.DONE, P.FAILED})
"""Nothing leads out of these."""
EXPLORES = frozenset({P.EXPLORING, P.AVOIDING})
"""Avoiding is a part of exploring."""
STEERING = EXPLORES | {P.HOLDING, P.RETURNING}
"""The controller steers: setpoints stream, and a lost mode means that a pilot took over."""
STREAMING = STEERING | {P.ARMING, P.TAKEOFF, P.LANDING}
"""The only phases in which a setpoint may leave."""
SILENT = frozenset({P.YIELDED, P.LOST}) | ENDED
"""The controller listens and tells its peers; its autopilot hears neither setpoint nor command."""


def advance(phase: Phase, cause: Cause) -> Phase:
    """Look up where a cause leads; raise PhaseError when the table has no such pair."""
    try:
        return TABLE[phase, cause]
    except KeyError:
        raise PhaseError(phase, cause) from None
