"""One mock vehicle on the wire, sans I/O: bytes and `now` in, frames out."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from mock_vehicle.autopilot import ardupilot_traits, px4_traits
from mock_vehicle.autopilot.ardupilot import ArduPilot
from mock_vehicle.autopilot.base import Autopilot
from mock_vehicle.autopilot.px4 import Px4
from mock_vehicle.autopilot.state import State
from mock_vehicle.autopilot.traits import Rates
from mock_vehicle.dynamics import Control, Dynamics, Limits
from mock_vehicle.geodesy import TESTING_GROUND, Origin
from mock_vehicle.sensors.readings import PeerFix, Readings, VictimFix
from swarm_ctl import wire

Personality = Literal["px4", "ardupilot"]
PERSONALITIES: Mapping[str, type[Autopilot]] = {"px4": Px4, "ardupilot": ArduPilot}
LIMITS: Mapping[str, Limits] = {
    "px4": px4_traits.TRAITS.limits,
    "ardupilot": ardupilot_traits.TRAITS.limits,
}
"""How each personality flies, for `Dynamics`."""

MIXED = "mixed"
"""A fleet in which the personalities take turns."""

COMPANION_COMPID = 191
DATAGRAM_BYTES = 1400
"""What fits into one datagram without fragments."""
HEARTBEAT_ID = wire.message("HEARTBEAT").id
TUNNEL_ID = wire.message("TUNNEL").id


def personalities(kind: str, vehicles: int) -> list[str]:
    """Name one personality per vehicle: all of a kind, or in turn when they are mixed."""
    kinds = list(PERSONALITIES) if kind == MIXED else [kind]
    return [kinds[index % len(kinds)] for index in range(vehicles)]


class Vehicle:
    """An autopilot, its link to the companion, and its place in the fleet.

    Each telemetry tick the fleet calls `refresh_all` for everybody, then `tick` for each.
    """

    def __init__(
        self,
        index: int,
        sysid: int,
        personality: Personality,
        dynamics: Dynamics,
        readings: Readings,
        home_ned_m: Sequence[float],
        *,
        boot_s: float | None = 1.0,
        rates: Rates = "lean",
        origin: Origin = TESTING_GROUND,
        uid: int,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        north, east, down = map(float, home_ned_m)
        self.index = index
        self.sysid = sysid
        self.personality = personality
        self.home_ned_m = (north, east, down)
        self.alive = True
        """A dead vehicle falls, and answers nothing."""
        self.frozen = False
        """A frozen autopilot is silent and hears nothing, and its motors run on."""
        self.received = 0
        """Frames understood."""
        self._dynamics = dynamics
        self.autopilot = PERSONALITIES[personality](
            sysid=sysid,
            index=index,
            uid=uid,
            boot_s=boot_s,
            home_ned_m=self.home_ned_m,
            origin=origin.to_global(*self.home_ned_m),
            truth=dynamics,
            rates=rates,
            parameters=parameters,
        )
        readings.home_ned_m[index] = self.home_ned_m
        refresh_all([self], dynamics, readings)

    @property
    def hears(self) -> bool:
        """Whether its autopilot works: it is alive and not frozen."""
        return self.alive and not self.frozen

    @property
    def links(self) -> int:
        """How many links it has: to its companion, and perhaps to a ground station."""
        return len(self.autopilot.links)

    @property
    def refused(self) -> int:
        """Frames understood and not obeyed, for want of a good signature."""
        return self.autopilot.gate.refused.total()

    @property
    def armed(self) -> bool:
        """Whether the motors run."""
        return self.autopilot.armed

    @property
    def mode(self) -> int:
        """HEARTBEAT.custom_mode."""
        return self.autopilot.reported_mode

    @property
    def mode_name(self) -> str:
        """The mode's name in the autopilot's own words."""
        return self.autopilot.traits.modes[self.mode].name

    @property
    def flying(self) -> bool:
        """From leaving the ground to the landing detected."""
        return self.autopilot.flying

    @property
    def setpoint_times(self) -> array[float]:
        """Arrivals of accepted setpoints."""
        return self.autopilot.setpoint_times

    def die(self) -> None:
        """Fall silent and drop."""
        self.alive = False
        self._dynamics.control[self.index] = Control.OFF

    def sign_with(self, key: bytes, timestamp: int) -> None:
        """Sign what leaves and obey only who signs; `timestamp` is that of `now` 0."""
        self.autopilot.gate.take_key(key, timestamp)

    def refresh(
        self, state: State, peers: list[PeerFix], victims: list[VictimFix], readings: Readings
    ) -> None:
        """Take what this vehicle knows; only `refresh_all` tells it."""
        autopilot = self.autopilot
        autopilot.state = state
        autopilot.peers, autopilot.victims = peers, victims
        autopilot.readings = readings

    def receive(self, data: bytes, now: float, link: int = 0) -> list[bytes]:
        """Obey all frames in `data`; give those of the companion that the radio broadcasts.

        Answers wait in the outbox of the link for `answers`, or leave with the next tick. Never
        raises, whatever arrives.
        """
        broadcast: list[bytes] = []
        if not self.alive:
            return broadcast
        autopilot = self.autopilot
        gate, via = autopilot.gate, autopilot.links[link]
        gate.advance(now)
        for frame in via.parser.feed(data):
            self.received += 1
            if not (gate.is_open or autopilot.admits(frame, via)):
                continue
            if frame.compid == COMPANION_COMPID and _is_broadcast(frame, autopilot.sysid):
                broadcast.append(frame.raw)
            autopilot.receive(frame, via, now)
        return broadcast

    def deliver(self, frame: bytes) -> None:
        """Queue a peer's frame, brought by the radio, for the companion as it is."""
        if self.alive:
            self.autopilot.links[0].queue(frame)

    def take(self, link: int = 0) -> list[bytes]:
        """Take the frames that wait to leave over a link."""
        return self.autopilot.links[link].take()

    def tick(self, now: float) -> None:
        """Run timers, steer, and queue answers, peers' frames and due telemetry."""
        if self.alive:
            self.autopilot.tick(now)
            return
        self._dynamics.control[self.index] = Control.OFF
        for link in self.autopilot.links:
            link.outbox.clear()


def _is_broadcast(frame: wire.Frame, sysid: int) -> bool:
    if frame.sysid != sysid:
        return False
    return frame.id == HEARTBEAT_ID or (frame.id == TUNNEL_ID and not frame.values.target_system)


def packed(frames: Sequence[bytes]) -> list[bytes]:
    """Join whole frames into datagrams of at most 1400 bytes, in order."""
    joined = b"".join(frames)
    if len(joined) <= DATAGRAM_BYTES:
        return [joined] if joined else []
    datagrams: list[bytes] = []
    pending: list[bytes] = []
    size = 0
    for frame in frames:
        if size + len(frame) > DATAGRAM_BYTES and pending:
            datagrams.append(b"".join(pending))
            pending, size = [], 0
        pending.append(frame)
        size += len(frame)
    if pending:
        datagrams.append(b"".join(pending))
    return datagrams


def refresh_all(
    vehicles: Sequence[Vehicle], dynamics: Dynamics, readings: Readings, *, sensed: bool = True
) -> None:
    """Hand every vehicle its row of truth and readings; once per telemetry tick, before the ticks.

    One bulk `tolist` instead of numpy on 3-vectors in each vehicle. `sensed` says that the sensors
    have measured since the last time: peers and victims are told once per measurement.
    """
    roll_rad, pitch_rad = dynamics.lean_rad()
    error = readings.drift_ned_m
    if not readings.has_odometry:
        error = error + readings.gnss_error_ned_m
    rows = np.column_stack(
        (
            dynamics.position_ned_m - readings.home_ned_m + error,
            dynamics.velocity_ned_m_s,
            roll_rad,
            pitch_rad,
            dynamics.yaw_rad,
            dynamics.yaw_rate_rad_s,
            dynamics.on_ground,
            error,
            readings.battery_fraction,
            readings.battery_voltage_v,
            readings.battery_current_a,
            readings.gnss_reception,
            readings.gnss_error_ned_m,
        )
    )
    indices = [vehicle.index for vehicle in vehicles]
    columns = rows[indices].tolist(), readings.ranges_m[indices].tolist()
    for vehicle, index, row, ranges_m in zip(vehicles, indices, *columns, strict=True):
        peers = readings.peers[index] if sensed else []
        victims = readings.victims[index] if sensed else []
        vehicle.refresh(State._make((*row, ranges_m)), peers, victims, readings)
