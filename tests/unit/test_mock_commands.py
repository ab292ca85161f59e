from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mock_client import (
    ACCEPTED,
    AP_BRAKE,
    AP_GUIDED,
    DENIED,
    FAILED,
    NAN,
    PERSONALITIES,
    POSITION,
    PX4_AUTO,
    PX4_LAND,
    PX4_LOITER,
    PX4_OFFBOARD,
    PX4_POSCTL,
    PX4_RTL,
    REJECTED,
    UNSUPPORTED,
    VELOCITY,
    VELOCITY_YAW,
    Client,
    airborne,
    both,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.autopilot.traits import Rates
from mock_vehicle.sensors.readings import PeerFix
from mock_vehicle.vehicle import Personality

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


@pytest.mark.parametrize(
    ("personality", "rates", "answers"),
    [("px4", "full", 4), ("px4", "lean", 5), ("ardupilot", "full", 5)],
)
def test_a_real_px4_acknowledges_four_commands_of_a_burst(
    personality: Personality, rates: Rates, answers: int
) -> None:
    client = Client(personality, rates=rates)
    client.fly(1.5)
    request = mavlink.MAVLink_command_long_message(7, 1, 512, 0, 148, *(0,) * 6)
    for _ in range(4):
        client.send(request)
    client.command(512, 148)
    assert len(client.times("COMMAND_ACK")) == answers
    assert len(client.times("AUTOPILOT_VERSION")) == 5, "all are executed"
    client.command(512, 148)
    assert len(client.times("COMMAND_ACK")) == answers + 1


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
    client.readings.peers[0].append(PeerFix(9, 4.0, (1.0, 0.0, 0.0), 0.0))
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
