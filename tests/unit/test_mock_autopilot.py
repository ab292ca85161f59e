"""A raw MAVLink client against one mock vehicle, in virtual time; pymavlink is the oracle."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.dynamics import Dynamics
from mock_vehicle.sensors.readings import PeerFix, Readings, VictimFix
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
        self, personality: Personality, *, boot_s: float = 1.0, start_ned_m: Any = None
    ) -> None:
        start = [3.0, -2.0, 0.0] if start_ned_m is None else start_ned_m
        self.dynamics = Dynamics(1, [start], [0.5], [LIMITS[personality]])
        self.readings = Readings.blank(1)
        self.vehicle = Vehicle(
            0, 7, personality, self.dynamics, self.readings, start, boot_s=boot_s, uid=4711
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
        refresh_all([self.vehicle], self.dynamics, self.readings)
        heard = []
        for datagram in self.vehicle.tick(self.now):
            assert len(datagram) <= 1400
            heard += self.oracle.parse_buffer(datagram) or []
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
            self.command(22, NAN, NAN, NAN, NAN, NAN, NAN, height_m)
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


# Whole flights.


@both
def test_it_arms_takes_off_flies_lands_and_disarms(personality: Personality) -> None:
    client = airborne(personality)
    assert client.height_m == pytest.approx(5.0, abs=0.4)
    client.fly(5.0, vx=1.0, vy=-0.5)
    assert client.velocity[:2] == pytest.approx([1.0, -0.5], abs=0.1)
    assert client.command(21) == [(21, ACCEPTED)]
    client.fly_until(lambda: not client.vehicle.armed)
    client.fly(1.0)
    assert client.landed_states == [1, 3, 2, 4, 1]
    assert not client.last("HEARTBEAT").base_mode & 128
    assert client.height_m == 0.0


def test_ardupilot_climbs_and_lands_in_the_recorded_time() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.command(511, 245, 100_000)
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    client.command(22, 0, 0, 0, 0, 0, 0, 5.0)
    took_s = client.fly_until(lambda: client.height_m > 1.0)
    took_s += client.fly_until(lambda: client.height_m > 4.5)
    assert took_s == pytest.approx(7.2, abs=0.6)
    client.fly(8.0)
    client.command(21)
    assert client.last("EXTENDED_SYS_STATE").landed_state == 4
    touched_s = client.fly_until(lambda: bool(client.dynamics.on_ground[0]))
    assert touched_s == pytest.approx(10.5, abs=1.0)
    down_s = client.fly_until(lambda: client.landed_states[-1] == 1)
    disarmed_s = client.fly_until(lambda: not client.vehicle.armed)
    assert touched_s + down_s + disarmed_s == pytest.approx(12.8, abs=1.0)
    assert disarmed_s == pytest.approx(0.5, abs=0.15)


def test_px4_climbs_and_lands_in_the_recorded_time() -> None:
    client = Client("px4")
    client.fly(1.5)
    client.command(22, NAN, NAN, NAN, NAN, NAN, NAN, 10.0)
    client.command(400, 1)
    took_s = client.fly_until(lambda: client.height_m > 1.0)
    assert took_s == pytest.approx(5.6, abs=0.6)
    took_s += client.fly_until(lambda: client.height_m > 8.0)
    assert took_s == pytest.approx(11.0, abs=1.0)
    took_s += client.fly_until(lambda: client.vehicle.mode == PX4_LOITER)
    assert took_s == pytest.approx(12.2, abs=1.2)
    client.command(21)
    client.fly_until(lambda: client.landed_states[-1] == 1)
    assert client.fly_until(lambda: not client.vehicle.armed) == pytest.approx(2.0, abs=0.3)
    assert client.vehicle.mode == PX4_LAND


def test_px4_takes_off_by_an_offboard_setpoint() -> None:
    client = Client("px4")
    client.fly(1.5, mask=POSITION, z=-5.0)
    client.set_mode(PX4_OFFBOARD)
    assert client.command(400, 1) == [(400, ACCEPTED)]
    took_s = client.fly_until(lambda: client.height_m > 1.0, mask=POSITION, z=-5.0)
    assert took_s == pytest.approx(4.1, abs=0.5)
    took_s += client.fly_until(lambda: client.height_m > 4.7, mask=POSITION, z=-5.0)
    assert took_s == pytest.approx(6.4, abs=0.9)
    assert client.landed_states == [1, 2]


@both
def test_return_flies_home_and_lands(personality: Personality) -> None:
    client = airborne(personality)
    client.fly(4.0, vx=2.0)
    assert client.dynamics.position_ned_m[0, 0] > 7.0
    assert client.command(20) == [(20, ACCEPTED)]
    client.fly_until(lambda: not client.vehicle.armed)
    assert client.dynamics.position_ned_m[0, :2] == pytest.approx([3.0, -2.0], abs=0.7)
    assert client.vehicle.mode == (PX4_RTL if personality == "px4" else AP_RTL)


# Boot, heartbeat, streams.


def test_px4_heartbeat_is_uninit_until_it_can_arm() -> None:
    client = Client("px4")
    client.fly(0.5)
    first = client.last("HEARTBEAT")
    assert (first.type, first.autopilot, first.base_mode) == (2, 12, 29)
    assert (first.custom_mode, first.system_status) == (PX4_LOITER, 0)
    client.fly(1.0)
    assert client.last("HEARTBEAT").system_status == 3
    client.set_mode(PX4_OFFBOARD)
    client.fly(1.0)
    silent = client.last("HEARTBEAT")
    assert (silent.base_mode, silent.system_status) == (1, 0)
    client.fly(2.0, vx=0.0)
    client.command(400, 1)
    client.fly(0.9, vx=0.0)
    assert (client.last("HEARTBEAT").base_mode, client.last("HEARTBEAT").system_status) == (145, 4)


def test_ardupilot_heartbeat_follows_the_record() -> None:
    client = Client("ardupilot")
    client.fly(0.5)
    assert client.last("HEARTBEAT").system_status == 1
    client.fly(1.5)
    ready = client.last("HEARTBEAT")
    assert (ready.autopilot, ready.base_mode, ready.custom_mode) == (3, 81, 0)
    assert ready.system_status == 3
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    client.fly(1.0)
    armed = client.last("HEARTBEAT")
    assert (armed.base_mode, armed.custom_mode, armed.system_status) == (217, 4, 3)
    client.command(22, 0, 0, 0, 0, 0, 0, 3.0)
    client.fly(5.0)
    assert client.last("HEARTBEAT").system_status == 4


def test_ardupilot_tells_a_mode_change_at_once_and_px4_does_not() -> None:
    for personality in PERSONALITIES:
        extra = {"ardupilot": 1, "px4": 0}[personality]
        client = Client(personality)
        client.fly(1.5)
        before = len(client.times("HEARTBEAT"))
        client.set_mode(AP_LAND if personality == "ardupilot" else PX4_LAND)
        assert len(client.times("HEARTBEAT")) - before == extra


@both
def test_heartbeats_come_once_a_second(personality: Personality) -> None:
    client = Client(personality)
    client.fly(10.0)
    assert np.diff(client.times("HEARTBEAT")) == pytest.approx([1.0] * 9, abs=1e-6)


def test_px4_streams_by_itself_and_ardupilot_waits_to_be_asked() -> None:
    px4, ardupilot = Client("px4"), Client("ardupilot")
    px4.fly(3.0)
    ardupilot.fly(3.0)
    assert {m.get_type() for _, m in ardupilot.heard} == {"HEARTBEAT"}
    assert {m.get_type() for _, m in px4.heard} >= {
        "ATTITUDE",
        "LOCAL_POSITION_NED",
        "SYS_STATUS",
        "EXTENDED_SYS_STATE",
        "BATTERY_STATUS",
        "DISTANCE_SENSOR",
        "ATTITUDE_QUATERNION",
        "VFR_HUD",
    }
    assert len(px4.times("ATTITUDE")) == 30
    assert len(px4.times("EXTENDED_SYS_STATE")) == 15


@both
@pytest.mark.parametrize(("hz", "per_5_s"), [(2, 10), (5, 25), (10, 50), (50, 50), (4, 20)])
def test_an_interval_is_served_up_to_the_tick_rate(
    personality: Personality, hz: int, per_5_s: int
) -> None:
    client = Client(personality)
    client.fly(2.0)
    assert client.command(511, 30, 1e6 / hz) == [(511, ACCEPTED)]
    before = len(client.times("ATTITUDE"))
    client.fly(5.0)
    assert len(client.times("ATTITUDE")) - before == pytest.approx(per_5_s, abs=1)
    assert client.command(510, 30) == [(510, ACCEPTED)]
    assert client.last("MESSAGE_INTERVAL").interval_us == 1_000_000 // hz


@both
def test_an_interval_of_minus_one_stops_and_zero_restores(personality: Personality) -> None:
    client = Client(personality)
    client.fly(2.0)
    client.command(511, 30, 100_000)
    client.command(511, 30, -1)
    client.command(510, 30)
    assert client.last("MESSAGE_INTERVAL").interval_us == -1
    client.command(511, 30, 0)
    client.command(510, 30)
    default_us = 100_000 if personality == "px4" else -1
    assert client.last("MESSAGE_INTERVAL").interval_us == default_us


def test_intervals_are_refused_as_recorded() -> None:
    px4, ardupilot = Client("px4"), Client("ardupilot")
    assert px4.command(511, 9999, 1e5) == [(511, FAILED)]
    assert px4.command(511, 0, 1e5) == [(511, FAILED)]  # HEARTBEAT is strictly 1 Hz
    assert px4.command(510, 9999) == [(510, ACCEPTED)]
    assert px4.last("MESSAGE_INTERVAL").interval_us == -1
    assert ardupilot.command(511, 9999, 1e5) == [(511, DENIED)]
    assert ardupilot.command(511, 30, -5) == [(511, DENIED)]
    assert ardupilot.command(511, 30, 1e5, 1) == [(511, DENIED)]
    assert ardupilot.command(511, 30, 1000) == [(511, DENIED)]
    assert ardupilot.texts[0].startswith("Requested rate is too fast.")
    assert ardupilot.command(510, 9999) == [(510, FAILED)]
    assert ardupilot.last("MESSAGE_INTERVAL").interval_us == 0
    assert ardupilot.command(511, 30, 120e6) == [(511, ACCEPTED)]
    ardupilot.command(510, 30)
    assert ardupilot.last("MESSAGE_INTERVAL").interval_us == 60_000_000


def test_request_data_stream_works_on_ardupilot_only() -> None:
    for personality in PERSONALITIES:
        streams = personality == "ardupilot"
        client = Client(personality)
        client.fly(2.0)
        client.command(511, 30, -1)
        client.heard.clear()
        client.send(mavlink.MAVLink_request_data_stream_message(7, 1, 0, 4, 1))
        client.fly(2.0)
        assert bool(client.times("ATTITUDE")) == streams
        assert not client.times("COMMAND_ACK")


@both
def test_sequence_numbers_have_no_gaps_per_component(personality: Personality) -> None:
    client = Client(personality)
    client.readings.peers[0].append(PeerFix(9, 4.0, (1.0, 0.0, 0.0)))
    client.command(511, 32, 1e5)
    client.fly(40.0)
    for compid in (1, 68):
        numbers = [m.get_seq() for _, m in client.heard if m.get_srcComponent() == compid]
        assert len(numbers) > 256
        assert set(np.diff(numbers) % 256) == {1}


# What stands in the messages.


@both
def test_the_estimate_is_truth_minus_home_plus_drift(personality: Personality) -> None:
    client = airborne(personality)
    client.command(511, 32, 1e5)
    client.readings.drift_ned_m[:] = (0.5, -0.25, 0.125)
    client.fly(1.0, vx=1.0)
    seen = client.last("LOCAL_POSITION_NED")
    north, east, down = client.dynamics.position_ned_m[0]
    assert [seen.x, seen.y, seen.z] == pytest.approx(
        [north - 3.0 + 0.5, east + 2.0 - 0.25, down + 0.125], abs=1e-5
    )
    assert seen.vx == pytest.approx(client.velocity[0], abs=1e-5)


@both
def test_a_position_setpoint_is_flown_in_the_estimated_frame(personality: Personality) -> None:
    client = airborne(personality)
    client.readings.drift_ned_m[:] = (1.0, 0.0, 0.0)
    client.fly(15.0, mask=POSITION, x=2.0, y=1.0, z=-4.0)
    assert client.dynamics.position_ned_m[0] == pytest.approx([3.0 + 1.0, -1.0, -4.0], abs=0.1)


@both
def test_six_rangefinders_come_together(personality: Personality) -> None:
    client = Client(personality)
    client.readings.ranges_m[0] = (1.0, 2.0, 3.004, math.inf, 5.0, 0.5)
    client.command(511, 132, 1e5)
    six = client.tick("DISTANCE_SENSOR")
    assert [m.orientation for m in six] == [0, 12, 6, 2, 24, 25]
    assert [m.id for m in six] == [0, 1, 2, 3, 4, 5]
    assert [m.current_distance for m in six] == [100, 200, 300, 1001, 500, 50]
    assert {m.max_distance for m in six} == {1000}


@both
def test_the_ring_comes_on_request_alone(personality: Personality) -> None:
    client = Client(personality)
    client.readings.ring_m[0] = 3.0 + 0.05 * np.arange(72)
    client.readings.ring_m[0, 10:20] = math.inf
    client.fly(3.0)
    assert not client.times("OBSTACLE_DISTANCE")
    assert client.command(511, 330, 2e5) == [(511, ACCEPTED)]
    client.fly(2.0)
    assert len(client.times("OBSTACLE_DISTANCE")) in {10, 11}
    ring = client.last("OBSTACLE_DISTANCE")
    assert (ring.get_srcComponent(), ring.frame, ring.sensor_type) == (1, 12, 0)
    assert (ring.increment, ring.increment_f, ring.angle_offset) == (5, 5.0, 0.0)
    assert (ring.min_distance, ring.max_distance) == (0.2 * 100, 1000)
    expected = [300 + 5 * ray for ray in range(72)]
    expected[10:20] = [1001] * 10
    assert ring.distances == expected
    client.command(511, 330, -1)
    client.heard.clear()
    client.fly(1.0)
    assert not client.times("OBSTACLE_DISTANCE")


@both
def test_a_broken_ring_is_not_sent(personality: Personality) -> None:
    client = Client(personality)
    client.command(511, 330, 1e5)
    client.readings.ring_m[:] = math.nan
    assert not client.tick("OBSTACLE_DISTANCE")


@both
def test_a_range_that_fits_no_field_is_nothing_in_range(personality: Personality) -> None:
    client = Client(personality)
    client.readings.range_max_m = 900.0
    client.readings.ranges_m[0] = client.readings.ring_m[0, :6] = (1.0, 654.0, 656.0, 800, 900, 5)
    client.command(511, 132, 1e5)
    client.command(511, 330, 1e5)
    heard = client.tick()
    six = [m.current_distance for m in heard if m.get_type() == "DISTANCE_SENSOR"]
    (ring,) = (m.distances for m in heard if m.get_type() == "OBSTACLE_DISTANCE")
    assert six == ring[:6] == [100, 65400, 65401, 65401, 65401, 500]
    assert ring[6:] == [65401] * 66


@both
def test_a_peer_comes_from_the_radio_with_its_bearing(personality: Personality) -> None:
    client = Client(personality)
    directions = [(0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.6, 0.0, -0.8)]
    client.readings.peers[0] += [PeerFix(20 + i, 12.34, d) for i, d in enumerate(directions)]
    fixes = [m for m in client.tick("DISTANCE_SENSOR") if m.get_srcComponent() == 68]
    assert [(m.id, m.orientation, m.current_distance) for m in fixes] == [
        (20, 100, 1234),
        (21, 100, 1234),
        (22, 100, 1234),
    ]
    for fix, direction in zip(fixes, directions, strict=True):
        w, x, y, z = fix.quaternion
        turned = (w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y))
        assert turned == pytest.approx(direction, abs=1e-6)


@both
def test_a_victim_is_a_landing_target(personality: Personality) -> None:
    client = Client(personality)
    client.readings.victims[0].append(VictimFix(3, 1.0, -2.0, 2.0))
    (target,) = client.tick("LANDING_TARGET")
    assert (target.target_num, target.frame, target.position_valid) == (3, 12, 1)
    assert (target.x, target.y, target.z, target.distance) == (1.0, -2.0, 2.0, 3.0)
    assert target.get_srcComponent() == 1


@both
def test_the_battery_is_told_twice(personality: Personality) -> None:
    client = Client(personality)
    client.readings.battery_fraction[:] = 0.42
    client.readings.battery_voltage_v[:] = 14.8
    client.readings.battery_current_a[:] = 12.5
    client.command(511, 1, 1e5)
    client.command(511, 147, 1e5)
    client.tick()
    status, battery = client.last("SYS_STATUS"), client.last("BATTERY_STATUS")
    assert status.voltage_battery == battery.voltages[0] == 14_800
    assert status.current_battery == battery.current_battery == 1250
    assert status.battery_remaining == battery.battery_remaining == 42


@both
def test_the_prearm_bit_shows_when_it_may_arm(personality: Personality) -> None:
    client = Client(personality)
    client.command(511, 1, 1e5)
    client.tick()
    assert not client.last("SYS_STATUS").onboard_control_sensors_health & 0x10000000
    client.fly(1.5)
    assert client.last("SYS_STATUS").onboard_control_sensors_health & 0x10000000


@both
def test_requested_messages_come_after_their_acknowledgement(personality: Personality) -> None:
    client = Client(personality)
    client.send(mavlink.MAVLink_command_long_message(7, 1, 512, 0, 148, *(NAN,) * 6))
    kinds = [m.get_type() for m in client.tick()]
    assert kinds.index("COMMAND_ACK") < kinds.index("AUTOPILOT_VERSION")
    version = client.last("AUTOPILOT_VERSION")
    assert version.capabilities == {"px4": 59647, "ardupilot": 64495}[personality]
    assert bytes(version.uid2)[-2:] == (4711).to_bytes(2, "big")
    refusal = {"px4": DENIED, "ardupilot": FAILED}[personality]
    assert client.command(512, 9999) == [(512, refusal)]
    assert client.command(520) == [(520, ACCEPTED)]


# Commands.


@both
def test_acknowledgements_are_addressed_to_the_sender(personality: Personality) -> None:
    client = Client(personality)
    client.mav.srcSystem, client.mav.srcComponent = 255, 190
    client.command(31999)
    ack = client.last("COMMAND_ACK")
    assert (ack.target_system, ack.target_component) == (255, 190)
    assert (ack.command, ack.result) == (31999, UNSUPPORTED)


@both
@pytest.mark.parametrize(
    ("system", "component", "by_px4", "by_ardupilot"),
    [(7, 0, 1, 1), (7, 50, 0, 1), (0, 0, 0, 1), (0, 1, 0, 1), (8, 1, 0, 0)],
)
def test_targets_are_read_as_each_autopilot_does(
    personality: Personality, system: int, component: int, by_px4: int, by_ardupilot: int
) -> None:
    client = Client(personality)
    acks = client.command(31999, system=system, component=component)
    assert len(acks) == (by_px4 if personality == "px4" else by_ardupilot)


@both
def test_a_command_int_is_obeyed_like_a_command_long(personality: Personality) -> None:
    client = Client(personality)
    client.fly(1.5)
    if personality == "ardupilot":
        client.set_mode(AP_GUIDED)
    client.send(mavlink.MAVLink_command_int_message(7, 1, 0, 400, 0, 0, 1, 0, 0, 0, 0, 0, 0.0))
    (ack,) = client.tick("COMMAND_ACK")
    assert (ack.command, ack.result) == (400, ACCEPTED)
    assert client.vehicle.armed


@both
def test_every_copy_of_a_command_is_acknowledged_once(personality: Personality) -> None:
    client = Client(personality)
    frame = mavlink.MAVLink_command_long_message(7, 1, 31999, 0, *(0.0,) * 7).pack(client.mav)
    client.vehicle.receive(frame * 3, client.now)
    assert len(client.tick("COMMAND_ACK")) == 3


@both
def test_a_frame_may_come_in_two_datagrams(personality: Personality) -> None:
    client = Client(personality)
    frame = mavlink.MAVLink_command_long_message(7, 1, 31999, 0, *(1.0,) * 7).pack(client.mav)
    client.vehicle.receive(frame[:17], client.now)
    client.vehicle.receive(frame[17:], client.now)
    assert len(client.tick("COMMAND_ACK")) == 1


def test_px4_acknowledges_do_set_mode_twice_and_set_mode_once() -> None:
    client = Client("px4")
    client.fly(1.5)
    assert client.set_mode(PX4_LAND) == [(176, ACCEPTED), (176, ACCEPTED)]
    assert client.command(176, 1, PX4_AUTO, 77) == [(176, ACCEPTED), (176, REJECTED)]
    assert client.command(176, 1, 99) == [(176, ACCEPTED), (176, ACCEPTED)]
    assert client.vehicle.mode == PX4_LAND
    client.send(mavlink.MAVLink_set_mode_message(7, 1, PX4_LOITER))
    assert [(m.command, m.result) for m in client.tick("COMMAND_ACK")] == [(176, ACCEPTED)]
    assert client.vehicle.mode == PX4_LOITER


def test_ardupilot_refuses_modes_with_a_reason_and_set_mode_is_silent() -> None:
    client = Client("ardupilot")
    assert client.command(176, 1, 99) == [(176, FAILED)]
    assert client.command(176, 0, AP_GUIDED) == [(176, DENIED)]
    assert client.command(176, 1, 14) == [(176, FAILED)]
    assert client.texts == ["No such mode 99", "Mode change to FLIP failed: init failed"]
    client.send(mavlink.MAVLink_set_mode_message(7, 1, AP_GUIDED))
    assert not client.tick("COMMAND_ACK")
    assert client.vehicle.mode == AP_GUIDED
    assert client.vehicle.mode_name == "GUIDED"


@both
def test_a_pilot_takes_the_mode_away_and_is_obeyed(personality: Personality) -> None:
    client = airborne(personality)
    client.fly(2.0, vx=1.0)
    client.mav.srcSystem, client.mav.srcComponent = 255, 190
    client.set_mode(PX4_LOITER if personality == "px4" else AP_BRAKE)
    client.mav.srcSystem, client.mav.srcComponent = 7, 191
    client.fly(4.0, vx=1.0)
    assert client.velocity[0] == pytest.approx(0.0, abs=0.05)
    assert client.vehicle.mode == (PX4_LOITER if personality == "px4" else AP_BRAKE)


def test_px4_refuses_a_mode_it_cannot_fly_and_says_so_to_a_ground_station() -> None:
    client = airborne("px4")
    client.fly(0.5, vx=0.0)
    client.set_mode(PX4_LOITER)
    client.fly(1.5)
    client.gcs_heartbeat()
    for number in (PX4_OFFBOARD, PX4_POSCTL, 4 << 16 | 4 << 24):
        assert client.set_mode(number) == [(176, ACCEPTED), (176, REJECTED)]
    assert client.vehicle.mode == PX4_LOITER
    assert client.texts[0] == "Switching to Offboard is currently not available\t"


def test_px4_is_silent_without_a_ground_station() -> None:
    client = airborne("px4")
    client.command(400, 0)
    assert not client.texts
    client.gcs_heartbeat()
    client.command(400, 0)
    assert client.texts == ["Disarming denied: not landed\t"]
    client.fly(4.0, vx=0.0)
    client.command(400, 0)
    assert len(client.texts) == 1


# Arming.


def test_arming_before_the_boot_is_over_is_refused() -> None:
    px4, ardupilot = Client("px4"), Client("ardupilot")
    assert px4.command(400, 1) == [(400, REJECTED)]
    assert ardupilot.command(400, 1) == [(400, FAILED)]
    assert ardupilot.texts == ["Arm: System not initialised"]


def test_px4_arms_only_in_modes_that_fly() -> None:
    client = Client("px4")
    client.fly(1.5)
    for number in (PX4_OFFBOARD, PX4_POSCTL, PX4_RTL, PX4_LAND):
        client.set_mode(number)
        assert client.command(400, 1) == [(400, REJECTED)]
    client.set_mode(PX4_OFFBOARD)
    client.setpoint()
    assert client.command(400, 1) == [(400, ACCEPTED)]


def test_ardupilot_does_not_arm_in_brake() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.set_mode(AP_BRAKE)
    assert client.command(400, 1) == [(400, FAILED)]
    assert client.texts == ["Arm: BRAKE mode not armable"]


@both
def test_arming_twice_and_disarming_twice_are_accepted(personality: Personality) -> None:
    client = Client(personality)
    client.fly(1.5)
    for wish in (1, 1, 0, 0):
        assert client.command(400, wish) == [(400, ACCEPTED)]
        assert client.vehicle.armed == bool(wish)
    if personality == "ardupilot":
        assert client.texts == ["Arming motors", "Disarming motors"]


def test_odd_arm_parameters_are_answered_as_recorded() -> None:
    px4, ardupilot = Client("px4"), Client("ardupilot")
    px4.fly(1.5)
    ardupilot.fly(1.5)
    assert px4.command(400, NAN) == [(400, ACCEPTED)]
    assert px4.command(400, 5) == []
    for wish in (2, 0.5, NAN):
        assert ardupilot.command(400, wish) == [(400, UNSUPPORTED)]
    assert not px4.vehicle.armed
    assert not ardupilot.vehicle.armed


@both
def test_disarming_in_the_air_needs_force(personality: Personality) -> None:
    client = airborne(personality)
    refusal = REJECTED if personality == "px4" else FAILED
    assert client.command(400, 0) == [(400, refusal)]
    assert client.vehicle.armed
    assert client.command(400, 0, 21196) == [(400, ACCEPTED)]
    client.fly(2.0)
    assert client.dynamics.on_ground[0]
    assert client.last("EXTENDED_SYS_STATE").landed_state == 1


@both
def test_armed_and_idle_it_disarms_by_itself(personality: Personality) -> None:
    client = Client(personality)
    client.fly(1.5)
    if personality == "ardupilot":
        client.set_mode(AP_GUIDED)
    client.command(400, 1)
    took_s = client.fly_until(lambda: not client.vehicle.armed)
    assert took_s == pytest.approx({"px4": 10.0, "ardupilot": 10.4}[personality], abs=0.2)


# Take-off.


def test_px4_takes_off_to_the_default_height_for_nan_and_does_not_arm() -> None:
    client = Client("px4")
    client.fly(1.5)
    assert client.command(22, *(NAN,) * 7) == [(22, ACCEPTED)]
    assert client.vehicle.mode == PX4_TAKEOFF
    assert not client.vehicle.armed
    client.command(400, 1)
    client.fly(12.0)
    assert client.height_m == pytest.approx(2.5, abs=0.1)


def test_px4_accepts_a_take_off_at_latitude_zero_and_does_not_climb() -> None:
    client = Client("px4")
    client.fly(1.5)
    assert client.command(22, 0, 0, 0, 0, 0, 0, 5.0) == [(22, ACCEPTED)]
    client.command(400, 1)
    client.fly(15.0)
    assert client.height_m < 0.1


def test_ardupilot_takes_off_only_in_guided_and_armed_and_once() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    five = (0, 0, 0, 0, 0, 0, 5.0)
    client.set_mode(AP_GUIDED)
    assert client.command(22, *five) == [(22, FAILED)]
    client.command(400, 1)
    assert client.command(22, *five[:6], NAN) == [(22, FAILED)]
    client.set_mode(2)
    assert client.command(22, *five) == [(22, FAILED)]
    client.set_mode(AP_GUIDED)
    assert client.command(22, *five) == [(22, ACCEPTED)]
    client.fly(6.0)
    assert client.command(22, *five) == [(22, FAILED)]


def test_a_velocity_setpoint_right_after_the_take_off_cancels_it_on_ardupilot() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    client.command(22, 0, 0, 0, 0, 0, 0, 5.0)
    client.fly(12.0, vx=0.0, vz=-1.0)
    assert client.height_m == 0.0
    assert not client.vehicle.armed


def test_a_setpoint_during_the_climb_stops_it_there_on_ardupilot() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    client.command(22, 0, 0, 0, 0, 0, 0, 6.0)
    client.fly_until(lambda: client.height_m > 2.0)
    client.fly(5.0, vx=0.0)
    assert 2.5 < client.height_m < 4.5  # recorded 3.9


def test_ardupilot_setpoints_do_nothing_on_the_ground() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.set_mode(AP_GUIDED)
    client.command(400, 1)
    client.fly(8.0, vz=-2.0)
    assert client.height_m == 0.0


# Setpoints.


def test_px4_needs_setpoints_to_enter_offboard_in_the_air() -> None:
    client = Client("px4")
    client.take_off()
    client.fly(2.0)
    assert client.set_mode(PX4_OFFBOARD) == [(176, ACCEPTED), (176, REJECTED)]
    client.setpoint()
    assert client.set_mode(PX4_OFFBOARD) == [(176, ACCEPTED), (176, ACCEPTED)]


def test_px4_loses_offboard_after_a_second_descends_lands_and_disarms() -> None:
    client = airborne("px4")
    client.fly(2.0, vx=1.0)
    client.gcs_heartbeat()
    lost_s = client.fly_until(lambda: client.vehicle.mode == PX4_POSCTL)
    assert lost_s == pytest.approx(1.1, abs=0.15)
    client.fly(1.0)
    beat = client.last("HEARTBEAT")
    assert (beat.custom_mode, beat.system_status) == (PX4_POSCTL, 5)
    assert "Failsafe activated\t" in client.texts
    client.fly(2.0)
    assert client.velocity == pytest.approx([0.0, 0.0, 0.6], abs=0.1)
    client.fly_until(lambda: not client.vehicle.armed, 30.0)
    assert client.vehicle.mode == PX4_OFFBOARD


def test_px4_resumes_offboard_by_itself_when_setpoints_resume() -> None:
    client = airborne("px4")
    client.fly(3.0)
    assert client.vehicle.mode == PX4_POSCTL
    client.fly(3.0, vx=1.0)
    assert client.vehicle.mode == PX4_OFFBOARD
    assert client.velocity[0] == pytest.approx(1.0, abs=0.15)


def test_px4_does_not_resume_offboard_when_another_mode_was_chosen() -> None:
    client = airborne("px4")
    client.fly(3.0)
    client.set_mode(PX4_LOITER)
    client.fly(2.0, vx=1.0)
    assert client.vehicle.mode == PX4_LOITER


def test_ardupilot_brakes_after_three_seconds_and_stays_in_guided() -> None:
    client = airborne("ardupilot")
    client.fly(4.0, vx=2.0)
    client.fly(2.9)
    assert client.velocity[0] == pytest.approx(2.0, abs=0.1)
    client.fly(1.9)
    assert client.velocity[0] < 0.15
    assert client.vehicle.mode == AP_GUIDED


def test_ardupilot_holds_a_single_position_setpoint_for_ever() -> None:
    client = airborne("ardupilot")
    client.setpoint(mask=POSITION, x=3.0, y=4.0, z=-5.0)
    client.fly(15.0)
    assert client.dynamics.position_ned_m[0] == pytest.approx([6.0, 2.0, -5.0], abs=0.1)


MOVING = {"vx": 1.0, "vy": 0.5}


@pytest.mark.parametrize(
    ("mask", "frame", "values", "velocity"),
    [
        (VELOCITY, 1, MOVING, (1.0, 0.5)),
        (VELOCITY_YAW, 1, MOVING, (1.0, 0.5)),
        (VELOCITY_YAW_RATE, 1, MOVING, (1.0, 0.5)),
        (VELOCITY | 0xF000, 1, MOVING, (1.0, 0.5)),
        (VELOCITY | 0x200, 1, MOVING, (1.0, 0.5)),  # force, acceleration ignored
        (VELOCITY | 0x020, 1, MOVING, (0.0, 0.0)),  # one bit ignores the group
        (VELOCITY | 0x008, 1, MOVING, (0.0, 0.0)),
        (0xFFF, 1, MOVING, (0.0, 0.0)),  # nothing used
        (0xC07 | 0x200, 1, MOVING, (0.0, 0.0)),  # force, acceleration used
        (0xC38, 1, MOVING, (0.0, 0.0)),  # position and acceleration without velocity
        (VELOCITY, 7, MOVING, (1.0, 0.5)),
        (VELOCITY, 0, MOVING, (0.0, 0.0)),
        (VELOCITY, 12, MOVING, (0.0, 0.0)),
        (VELOCITY, 1, {"vx": 2000.0}, (0.0, 0.0)),
        (VELOCITY, 1, {"vx": NAN, "vy": 1.0}, (0.0, 0.0)),
        (VELOCITY, 1, {"vx": math.inf}, (0.0, 0.0)),
        (VELOCITY, 8, {"vx": 1.0}, (math.cos(0.5), math.sin(0.5))),
        (VELOCITY, 9, {"vy": 1.0}, (-math.sin(0.5), math.cos(0.5))),
    ],
)
def test_ardupilot_reads_the_type_mask_by_groups(
    mask: int, frame: int, values: dict[str, float], velocity: tuple[float, float]
) -> None:
    client = airborne("ardupilot")
    client.dynamics.yaw_rad[:] = 0.5
    client.tick()
    client.fly(3.0, vx=-1.0)
    client.fly(6.0, mask=mask | 0x400, frame=frame, **values)
    assert client.velocity[:2] == pytest.approx(velocity, abs=0.1)
    assert client.vehicle.mode == AP_GUIDED


@pytest.mark.parametrize(
    ("mask", "frame", "values", "velocity"),
    [
        (VELOCITY, 1, MOVING, (1.0, 0.5)),
        (VELOCITY_YAW_RATE, 1, MOVING, (1.0, 0.5)),
        (0xDE3, 1, {"vx": 1.0, "vy": 0.5, "z": -5.0}, (1.0, 0.5)),  # velocity xy, position z
        (VELOCITY | 0x200, 1, MOVING, (1.0, 0.5)),
        (VELOCITY | 0x030, 1, MOVING, (0.0, 0.0)),  # only vx
        (VELOCITY | 0x020, 1, MOVING, (0.0, 0.0)),  # nothing vertical
        (0xDFC, 1, {"x": 9.0}, (0.0, 0.0)),  # only x and y
        (VELOCITY, 1, {"vx": NAN, "vy": 1.0}, (0.0, 0.0)),
        (VELOCITY, 1, {"vx": math.inf}, (0.0, 0.0)),
        (VELOCITY, 8, {"vx": 1.0}, (math.cos(0.5), math.sin(0.5))),
    ],
)
def test_px4_flies_whole_setpoints_and_stops_on_half_ones(
    mask: int, frame: int, values: dict[str, float], velocity: tuple[float, float]
) -> None:
    client = airborne("px4")
    client.dynamics.yaw_rad[:] = 0.5
    client.fly(2.0, vx=-1.0)
    client.fly(10.0, mask=mask, frame=frame, **values)
    if frame == 8 or not mask & 0x800:
        yaw = client.dynamics.yaw_rad[0]
        velocity = velocity if mask & 0x800 == 0 else (math.cos(yaw), math.sin(yaw))
    assert client.velocity[:2] == pytest.approx(velocity, abs=0.1)
    assert client.vehicle.mode == PX4_OFFBOARD


@pytest.mark.parametrize(
    ("mask", "frame", "target", "values", "text"),
    [
        (0xDFF, 1, (7, 1), {}, "SET_POSITION_TARGET_LOCAL_NED invalid"),
        (0x9FF, 1, (7, 1), {"yaw": 1.0}, "SET_POSITION_TARGET_LOCAL_NED invalid"),
        (VELOCITY, 1, (7, 1), {"vx": NAN, "vy": NAN, "vz": NAN}, "invalid"),
        (0xC3F | 0x200, 1, (7, 1), {"afx": 1.0}, "force not supported"),
        (POSITION, 8, (7, 1), {"x": 1.0}, "invalid"),
        (VELOCITY, 5, (7, 1), MOVING, "coordinate frame 5 unsupported"),
        (VELOCITY, 7, (7, 1), MOVING, "coordinate frame 7 unsupported"),
        (VELOCITY, 9, (7, 1), MOVING, "coordinate frame 9 unsupported"),
        (VELOCITY, 12, (7, 1), MOVING, "coordinate frame 12 unsupported"),
        (VELOCITY, 1, (8, 1), MOVING, None),
        (VELOCITY, 1, (7, 50), MOVING, None),
    ],
)
def test_px4_does_not_count_what_is_no_setpoint(
    mask: int, frame: int, target: tuple[int, int], values: dict[str, float], text: str | None
) -> None:
    client = airborne("px4")
    client.gcs_heartbeat()
    accepted = len(client.vehicle.setpoint_times)
    client.fly(1.0, mask=mask, frame=frame, target=target, **values)
    complaints = "".join(client.texts)
    assert text in complaints if text else "SET_POSITION" not in complaints
    client.fly(0.5, mask=mask, frame=frame, target=target, **values)
    assert client.vehicle.mode == PX4_POSCTL
    assert len(client.vehicle.setpoint_times) == accepted


@both
def test_a_broadcast_setpoint_is_obeyed(personality: Personality) -> None:
    client = airborne(personality)
    client.fly(4.0, target=(0, 0), vx=1.0)
    assert client.velocity[0] == pytest.approx(1.0, abs=0.15)


def test_ardupilot_obeys_setpoints_for_other_components_but_not_for_other_systems() -> None:
    client = airborne("ardupilot")
    client.fly(4.0, target=(7, 50), vx=1.0)
    assert client.velocity[0] == pytest.approx(1.0, abs=0.1)
    client.fly(6.0, target=(8, 1), vx=1.0)
    assert client.velocity[0] == pytest.approx(0.0, abs=0.1)


@both
def test_position_with_velocity_feeds_forward(personality: Personality) -> None:
    client = airborne(personality)
    start = client.dynamics.position_ned_m[0].copy() - np.array([3.0, -2.0, 0.0])
    for step in range(60):
        client.setpoint(mask=0xDC0, x=start[0] + 0.1 * step, y=start[1], z=-5.0, vx=1.0)
        client.tick()
    lag = start[0] + 0.1 * 60 - (client.dynamics.position_ned_m[0, 0] - 3.0)
    assert abs(lag) < 0.6
    assert client.velocity[0] == pytest.approx(1.0, abs=0.15)


@both
def test_acceleration_alone_is_flown(personality: Personality) -> None:
    client = airborne(personality)
    client.fly(2.0, mask=0xC3F, afx=1.0)
    assert client.velocity[0] > 0.8
    assert client.height_m == pytest.approx(5.0, abs=0.5)


def test_an_ardupilot_offset_runs_away_when_it_is_repeated() -> None:
    client = airborne("ardupilot")
    north = client.dynamics.position_ned_m[0, 0]
    client.fly(5.0, mask=POSITION, frame=7, x=2.0)
    assert client.dynamics.position_ned_m[0, 0] > north + 3.5


@both
def test_yaw_and_yaw_rate_are_followed(personality: Personality) -> None:
    client = airborne(personality)
    client.fly(5.0, mask=VELOCITY_YAW, yaw=-1.0)
    assert client.dynamics.yaw_rad[0] == pytest.approx(-1.0, abs=0.05)
    client.fly(2.0, mask=VELOCITY_YAW_RATE, yaw_rate=0.5)
    assert client.dynamics.yaw_rate_rad_s[0] == pytest.approx(0.5, abs=0.02)


@both
def test_setpoint_times_are_arrivals(personality: Personality) -> None:
    client = airborne(personality)
    client.vehicle.setpoint_times.clear()
    client.fly(1.0, vx=0.0)
    assert np.diff(client.vehicle.setpoint_times) == pytest.approx([0.1] * 9)


@both
def test_landing_by_a_setpoint_is_noticed(personality: Personality) -> None:
    client = airborne(personality, 2.0)
    took_s = client.fly_until(lambda: not client.vehicle.armed, vz=0.5)
    assert client.height_m == 0.0
    assert took_s < (12.0 if personality == "px4" else 20.0)


# Time, radio, death.


@both
def test_timesync_is_answered_with_the_boot_time(personality: Personality) -> None:
    client = Client(personality)
    client.fly(2.0)
    client.send(mavlink.MAVLink_timesync_message(0, 123456789))
    client.send(mavlink.MAVLink_timesync_message(5, 99))
    (answer,) = client.tick("TIMESYNC")
    assert answer.ts1 == 123456789
    assert answer.tc1 == pytest.approx(2.0e9)


def test_only_px4_answers_a_ping() -> None:
    for personality in PERSONALITIES:
        client = Client(personality)
        client.send(mavlink.MAVLink_ping_message(55, 3, 0, 0))
        answers = client.tick("PING")
        assert len(answers) == (1 if personality == "px4" else 0)
        assert [(m.seq, m.target_system, m.target_component) for m in answers] == [
            (3, 7, 191)
        ] * len(answers)


@both
def test_the_radio_gets_the_companions_beacons_and_nothing_else(personality: Personality) -> None:
    client = Client(personality)
    beacon = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
    payload = [1] * 128
    tunnel = mavlink.MAVLink_tunnel_message(0, 0, 40417, 5, payload)
    private = mavlink.MAVLink_tunnel_message(9, 0, 40417, 5, payload)
    assert client.send(beacon) == [bytes(beacon.get_msgbuf())]
    assert client.send(tunnel) == [bytes(tunnel.get_msgbuf())]
    assert client.send(private) == []
    assert client.send(mavlink.MAVLink_timesync_message(0, 1)) == []
    client.mav.srcSystem = 9
    assert client.send(beacon) == []
    client.mav.srcSystem, client.mav.srcComponent = 7, 1
    assert client.send(beacon) == []


@both
def test_a_peers_frame_is_delivered_as_it_is(personality: Personality) -> None:
    client = Client(personality)
    peer = mavlink.MAVLink(None, srcSystem=9, srcComponent=191)
    frame = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(peer)
    client.vehicle.deliver(frame)
    client.tick()
    assert any(bytes(m.get_msgbuf()) == bytes(frame) for _, m in client.heard)


@both
def test_a_dead_vehicle_falls_and_answers_nothing(personality: Personality) -> None:
    client = airborne(personality)
    client.vehicle.alive = False
    client.heard.clear()
    assert client.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)) == []
    client.vehicle.deliver(b"frame")
    client.command(400, 1)
    client.fly(2.0)
    assert not client.heard
    assert client.dynamics.on_ground[0]


@both
def test_a_peer_that_is_not_heard_any_more_is_not_reported(personality: Personality) -> None:
    client = Client(personality)
    client.readings.peers[0].append(PeerFix(9, 4.0, (1.0, 0.0, 0.0)))
    client.tick()
    client.readings.peers = [[]]
    assert not [m for m in client.tick("DISTANCE_SENSOR") if m.get_srcComponent() == 68]


# Robustness.

WEIRD = (NAN, math.inf, -math.inf, 1e30, -1e30, -1.0, 0.0, 3.0e38)


@both
def test_a_storm_of_nan_never_raises(personality: Personality) -> None:
    client = airborne(personality)
    table = client.vehicle.autopilot.command_table
    for number in (*table, 0, 16, 65535):
        for value in WEIRD:
            client.command(number, *(value,) * 7)
            client.command(number, 1, value, value, value, value, value, value)
    client.go_offboard()
    for frame in range(13):
        for mask in (0, VELOCITY, POSITION, VELOCITY_YAW, 0xC3F, 0x5C7, 0xFFF):
            for value in WEIRD:
                names = ("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
                client.setpoint(mask=mask, frame=frame, **dict.fromkeys(names, value))
        client.tick()
    for array in (client.dynamics.position_ned_m, client.dynamics.velocity_ned_m_s):
        assert np.isfinite(array).all()
    assert np.isfinite(client.dynamics.yaw_rad).all()


@both
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.binary(max_size=300))
def test_garbage_never_raises(personality: Personality, data: bytes) -> None:
    client = Client(personality)
    client.vehicle.receive(data, client.now)
    client.vehicle.receive(b"\xfd" + data, client.now)
    client.tick()


@both
def test_random_good_frames_never_raise(personality: Personality) -> None:
    rng = np.random.default_rng(4711)
    client = Client(personality)
    client.fly(1.5)
    listened = [mavlink.mavlink_map[number] for number in client.vehicle.autopilot.message_table]
    for _ in range(1500):
        message = listened[rng.integers(len(listened))]
        payload = bytearray(rng.bytes(message.unpacker.size))
        if rng.random() < 0.7 and "target_system" in message.ordered_fieldnames:
            at = message.ordered_fieldnames.index("target_system")
            offset = sum(_sizes(message)[:at])
            payload[offset : offset + 2] = bytes([7, 1])
        client.vehicle.receive(_frame(message, bytes(payload)), client.now)
        if rng.random() < 0.3:
            client.tick()
    assert client.vehicle.received > 1000


def _sizes(message: Any) -> list[int]:
    size = {"B": 1, "b": 1, "c": 1, "H": 2, "h": 2, "I": 4, "i": 4, "f": 4, "Q": 8, "q": 8, "d": 8}
    codes = message.native_format.decode().lstrip("<")
    return [size[code] * max(n, 1) for code, n in zip(codes, message.array_lengths, strict=True)]


def _frame(message: Any, payload: bytes) -> bytes:
    header = bytes([len(payload), 0, 0, 0, 255, 190, *message.id.to_bytes(3, "little")])
    crc = mavlink.x25crc(header + payload)
    crc.accumulate(bytes([message.crc_extra]))
    return b"\xfd" + header + payload + int(crc.crc).to_bytes(2, "little")
