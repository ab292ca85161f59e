"""A ground station beside one mock vehicle, in virtual time; pymavlink is the oracle."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.autopilot.traits import Rates
from mock_vehicle.dynamics import Dynamics
from mock_vehicle.sensors.readings import Readings
from mock_vehicle.vehicle import LIMITS, Personality, Vehicle, refresh_all

PHYSICS_S = 0.02
TICK_S = 0.1
PX4_OFFBOARD, PX4_POSCTL = 6 << 16, 3 << 16
PX4_AUTO = 4
PX4_TAKEOFF, PX4_LOITER, PX4_RTL, PX4_LAND = (4 << 16 | sub << 24 for sub in (2, 3, 5, 6))
AP_GUIDED, AP_RTL, AP_LAND, AP_BRAKE = 4, 6, 9, 17
VELOCITY, VELOCITY_YAW, VELOCITY_YAW_RATE, POSITION = 0xDC7, 0x9C7, 0x5C7, 0xDF8
ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED = range(5)
NAN = math.nan
PERSONALITIES: tuple[Personality, ...] = ("px4", "ardupilot")
both = pytest.mark.parametrize("personality", PERSONALITIES)


class Client:
    """A companion computer with a mock vehicle of sysid 7 behind its link."""

    def __init__(
        self,
        personality: Personality,
        *,
        boot_s: float | None = 1.0,
        start_ned_m: Any = None,
        rates: Rates = "lean",
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        start = [3.0, -2.0, 0.0] if start_ned_m is None else start_ned_m
        self.dynamics = Dynamics(1, [start], [0.5], [LIMITS[personality]])
        self.readings = Readings.blank(1)
        self.vehicle = Vehicle(
            0,
            7,
            personality,
            self.dynamics,
            self.readings,
            start,
            boot_s=boot_s,
            rates=rates,
            uid=4711,
            parameters=parameters,
        )
        self.now = 0.0
        self.mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=191)
        self.oracle = mavlink.MAVLink(None)
        self.heard: list[tuple[float, Any]] = []
        self.before_tick: Callable[[], None] = lambda: None
        self.ticks = 0

    # Talking.

    def send(self, message: Any) -> list[bytes]:
        return self.vehicle.receive(message.pack(self.mav), self.now)

    def command(
        self, number: int, *params: float, system: int = 7, component: int = 1
    ) -> list[tuple[int, int]]:
        """Send a COMMAND_LONG, tick once, and give the acknowledgements."""
        seven = (*params, *(0.0,) * 7)[:7]
        self.send(mavlink.MAVLink_command_long_message(system, component, number, 0, *seven))
        return [(ack.command, ack.result) for ack in self.tick("COMMAND_ACK")]

    def setpoint(
        self, mask: int = VELOCITY, frame: int = 1, target: Any = (7, 1), **v: float
    ) -> None:
        names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
        values = [v.get(name, 0.0) for name in names]
        self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, target[0], target[1], frame, mask, *values
            )
        )

    def gcs_heartbeat(self) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    # Time.

    def tick(self, kind: str = "") -> list[Any]:
        """Fly one telemetry tick, and give what was heard in it."""
        self.ticks += 1
        for _ in range(round(TICK_S / PHYSICS_S)):
            self.dynamics.step(PHYSICS_S, (0.0, 0.0, 0.0))
        self.now = self.ticks * TICK_S
        self.before_tick()
        self.readings.scans_cm = None
        refresh_all([self.vehicle], self.dynamics, self.readings)
        heard = []
        self.vehicle.tick(self.now)
        for frame in self.vehicle.take():
            heard += self.oracle.parse_buffer(frame) or []
        self.heard += [(self.now, message) for message in heard]
        return [m for m in heard if m.get_type() == kind] if kind else heard

    def fly(self, seconds: float, **setpoint: Any) -> None:
        """Let time pass, perhaps with a setpoint each tick."""
        for _ in range(round(seconds / TICK_S)):
            if setpoint:
                self.setpoint(**setpoint)
            self.tick()

    def fly_until(self, done: Callable[[], bool], within_s: float = 60.0, **setpoint: Any) -> float:
        start = self.now
        while not done():
            assert self.now - start < within_s, "it never happened"
            self.fly(TICK_S, **setpoint)
        return self.now - start

    # Hearing.

    def last(self, kind: str) -> Any:
        return next(m for _, m in reversed(self.heard) if m.get_type() == kind)

    def times(self, kind: str) -> list[float]:
        return [at for at, m in self.heard if m.get_type() == kind]

    @property
    def texts(self) -> list[str]:
        return [m.text for _, m in self.heard if m.get_type() == "STATUSTEXT"]

    @property
    def landed_states(self) -> list[int]:
        """EXTENDED_SYS_STATE.landed_state, changes only."""
        states = [m.landed_state for _, m in self.heard if m.get_type() == "EXTENDED_SYS_STATE"]
        return [s for i, s in enumerate(states) if i == 0 or s != states[i - 1]]

    @property
    def height_m(self) -> float:
        return -float(self.dynamics.position_ned_m[0, 2])

    @property
    def velocity(self) -> Any:
        return self.dynamics.velocity_ned_m_s[0]

    def amsl_m(self, height_m: float) -> float:
        """Give the altitude of a height above its home."""
        return self.vehicle.autopilot.origin.amsl_m + height_m

    def set_mode(self, number: int) -> list[tuple[int, int]]:
        """DO_SET_MODE in the autopilot's own way."""
        if self.vehicle.personality == "px4":
            return self.command(176, 1, number >> 16 & 0xFF, number >> 24)
        return self.command(176, 1, number)

    def take_off(self, height_m: float = 5.0) -> None:
        """Arm, take off by command, and wait until it hovers in the air."""
        self.fly(1.5)
        self.command(511, 245, 100_000)
        if self.vehicle.personality == "px4":
            self.command(22, NAN, NAN, NAN, NAN, NAN, NAN, self.amsl_m(height_m))
            assert self.command(400, 1) == [(400, ACCEPTED)]
            self.fly_until(lambda: self.vehicle.mode == PX4_LOITER)
        else:
            self.set_mode(AP_GUIDED)
            assert self.command(400, 1) == [(400, ACCEPTED)]
            assert self.command(22, 0, 0, 0, 0, 0, 0, height_m) == [(22, ACCEPTED)]
            self.fly_until(lambda: self.height_m > height_m - 0.15)
        self.fly(2.0)

    def go_offboard(self) -> None:
        self.setpoint()
        self.set_mode(PX4_OFFBOARD if self.vehicle.personality == "px4" else AP_GUIDED)


def airborne(personality: Personality, height_m: float = 5.0) -> Client:
    client = Client(personality)
    client.take_off(height_m)
    client.go_offboard()
    return client
