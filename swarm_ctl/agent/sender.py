"""The frames a controller sends, built from named values; one sequence of numbers for all."""

from __future__ import annotations

import math

from swarm_ctl import wire
from swarm_ctl.agent.orders import Ack
from swarm_ctl.autopilot.base import AUTOPILOT_COMPONENT, COMPANION_COMPONENT, Autopilot
from swarm_ctl.autopilot.command import Command
from swarm_ctl.autopilot.setpoints import Target
from swarm_ctl.frames import Geodetic, wrap_rad
from swarm_ctl.model import ZERO, Setpoint, Vec3
from swarm_ctl.signing import Gatekeeper

_HEARTBEAT = wire.message("HEARTBEAT")
_COMMAND_ACK = wire.message("COMMAND_ACK")
_COMMAND_LONG = wire.message("COMMAND_LONG")
_SETPOINT = wire.message("SET_POSITION_TARGET_LOCAL_NED")
_SET_ORIGIN = wire.message("SET_GPS_GLOBAL_ORIGIN")
_TIMESYNC = wire.message("TIMESYNC")
_TUNNEL = wire.message("TUNNEL")

_MOVE_AND_TURN = Target(velocity_m_s=ZERO, yaw_rad=0.0)
"""What every setpoint in flight asks for; its mask is the same for all."""
_FRAME, _MASK = int(_MOVE_AND_TURN.frame), _MOVE_AND_TURN.mask
_NONE = 0.0, 0.0, 0.0
_ONBOARD_CONTROLLER, _NO_AUTOPILOT, _STATE_ACTIVE, _MAVLINK_VERSION = 18, 8, 4, 3


class Sender:
    """Pack frames from the companion computer (compid 191) of one vehicle."""

    def __init__(self, sysid: int, yaw_offset_rad: float = 0.0) -> None:
        """Turn setpoints for an estimator whose x axis points so far clockwise from north."""
        self.sysid = sysid
        self._yaw_offset_rad = yaw_offset_rad
        self._cos, self._sin = math.cos(-yaw_offset_rad), math.sin(-yaw_offset_rad)
        self.sent = 0
        self.gate = Gatekeeper()

    def heartbeat(self) -> bytes:
        """Say that the companion is alive."""
        beat = (_ONBOARD_CONTROLLER, _NO_AUTOPILOT, 0, 0, _STATE_ACTIVE, _MAVLINK_VERSION)
        return self._pack(_HEARTBEAT, *beat)

    def command(self, wanted: Command, confirmation: int) -> bytes:
        """Ask the vehicle's own autopilot for something."""
        target = (self.sysid, AUTOPILOT_COMPONENT)
        return self._pack(_COMMAND_LONG, *target, wanted.id, confirmation, *wanted.parameters)

    def timesync(self, stamp_ns: int) -> bytes:
        """Ask the autopilot to send a stamp back."""
        return self._pack(_TIMESYNC, 0, stamp_ns)

    def acknowledge(self, ack: Ack) -> bytes:
        """Tell a ground station what became of its command."""
        no_progress = (0, 0)
        return self._pack(
            _COMMAND_ACK, ack.command, ack.result, *no_progress, ack.sysid, ack.compid
        )

    def setpoint(self, wanted: Setpoint, now: float) -> bytes:
        """Demand velocity and heading in the vehicle's local NED frame; no number is a stop."""
        (x, y, z), yaw_rad = wanted
        if math.isfinite(x) and math.isfinite(y) and math.isfinite(z):
            x, y = self._cos * x - self._sin * y, self._sin * x + self._cos * y
        else:
            x, y, z = ZERO
        if not math.isfinite(yaw_rad):
            return self._target(Target(velocity_m_s=Vec3(x, y, z)), now)
        yaw = wrap_rad(yaw_rad - self._yaw_offset_rad) or 0.0  # which takes the sign off a zero
        head = int(now * 1000.0) & 0xFFFFFFFF, self.sysid, AUTOPILOT_COMPONENT, _FRAME, _MASK
        return self._pack(_SETPOINT, *head, *_NONE, x, y, z, *_NONE, yaw, 0.0)

    def target(self, wanted: Target, now: float, pilot: Autopilot | None = None) -> bytes:
        """Ask for a target; ValueError says why an autopilot would not fly it as it is meant."""
        refusal = wanted.refusal(pilot)
        if refusal:
            raise ValueError(refusal)
        return self._target(wanted, now)

    def origin(self, place: Geodetic) -> bytes:
        """Tell the vehicle's own autopilot where on the globe its local frame begins."""
        latitude, longitude = round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7)
        return self._pack(
            _SET_ORIGIN, self.sysid, latitude, longitude, round(place.altitude_m * 1e3)
        )

    def broadcast(self, payload_type: int, payload: bytes) -> bytes:
        """Tell every peer in radio range; target system 0 makes it a broadcast."""
        return self._pack(_TUNNEL, 0, 0, payload_type, len(payload), payload)

    def _target(self, wanted: Target, now: float) -> bytes:
        boot_ms, whom = int(now * 1000.0) & 0xFFFFFFFF, (self.sysid, AUTOPILOT_COMPONENT)
        return self._pack(_SETPOINT, boot_ms, *whom, wanted.frame, wanted.mask, *wanted.numbers)

    def _pack(self, message: wire.Message, *values: object) -> bytes:
        frame = message.pack(self.sent & 0xFF, self.sysid, COMPANION_COMPONENT, *values)
        self.sent += 1
        return self.gate.seal(frame)
