"""What a controller must know about an autopilot, as data; one value per autopilot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

AUTOPILOT_COMPONENT = 1
RADIO_COMPONENT = 68
COMPANION_COMPONENT = 191
"""MAV_COMPONENT of an autopilot, a telemetry radio, and a companion computer, which we are."""
ARMED_FLAG = 0x80
"""MAV_MODE_FLAG_SAFETY_ARMED."""
CUSTOM_MODE_FLAG = 1.0
"""MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, as DO_SET_MODE's first parameter."""


@dataclass(frozen=True, slots=True)
class Autopilot:
    """One autopilot's dialect of being flown from a companion computer."""

    name: str
    heartbeat_id: int
    """HEARTBEAT.autopilot (MAV_AUTOPILOT)."""
    offboard_mode: int
    """HEARTBEAT.custom_mode of the mode that obeys a companion's setpoints."""
    offboard_parameters: tuple[float, float]
    """DO_SET_MODE parameters 2 and 3 that ask for it."""
    waiting_parameters: tuple[float, float]
    """The same for a mode in which it may stand armed and wait; a landing leaves it in none."""
    land_mode: int
    """HEARTBEAT.custom_mode while it lands by itself."""
    takeoff_by_command: bool
    """Climbs on NAV_TAKEOFF and must not hear a setpoint meanwhile; else climbs on setpoints."""
    resumes_from_failsafe: bool
    """Comes back to the offboard mode by itself when it left it for want of setpoints."""
    setpoint_frames: frozenset[int]
    """MAV_FRAMEs of setpoints that it obeys."""
    streams_hz: Mapping[str, float]
    """What a controller needs of it, and how often; asked for by SET_MESSAGE_INTERVAL."""
    mode_names: Mapping[int, str]
    """As its pilots call them, by custom_mode."""
    failsafe_modes: frozenset[int]
    """Modes that its own failsafes choose: they return, land, brake, or fall back on the sticks."""

    def mode_name(self, custom_mode: int) -> str:
        """Name a mode as pilots know it."""
        return self.mode_names.get(custom_mode, f"mode {custom_mode:#x}")
