"""SETUP_SIGNING: how ArduPilot comes by a key over the wire."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.traits import Severity
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

SETUP_SIGNING = wire.message("SETUP_SIGNING")


def on_setup_signing(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Take a key without a word, from anybody as long as there is none, and while disarmed."""
    v = frame.values
    if not autopilot.accepts_setpoint(v.target_system, v.target_component):
        return
    if autopilot.armed:
        autopilot.say(Severity.INFO, "ERROR: Won't setup signing when armed", now)
        return
    autopilot.gate.take_key(v.secret_key, v.initial_timestamp, now)


MESSAGES: Mapping[int, Callable[..., None]] = {SETUP_SIGNING.id: on_setup_signing}
