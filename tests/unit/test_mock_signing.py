"""Who holds the key is obeyed; who does not is told so, once."""

from __future__ import annotations

from typing import Any

import pytest
from mock_client import ACCEPTED, AP_GUIDED, NAN, Client, both
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.dynamics import Dynamics
from mock_vehicle.sensors.readings import Readings
from mock_vehicle.vehicle import LIMITS, Personality, Vehicle
from swarm_ctl.signing import Verdict, key_of

KEY, OTHER = key_of("swarm"), key_of("another")
NOW = 1 << 45
UNSIGNED = "Unsigned commands refused"
FORGED = "Commands with a wrong signature refused"
REPLAYED = "Replayed commands refused"
OLD = "Commands with an old signature refused"


def hold_key(client: Client, key: bytes = KEY, timestamp: int = NOW) -> None:
    """Let the client sign what it sends, and check what it hears."""
    for mav in (client.mav, client.oracle):
        mav.signing.secret_key, mav.signing.timestamp = key, timestamp
    client.mav.signing.sign_outgoing = True


def signed_vehicle(personality: Personality) -> Client:
    client = Client(personality)
    client.vehicle.sign_with(KEY, NOW)
    client.fly(1.5)
    return client


def arm() -> Any:
    return mavlink.MAVLink_command_long_message(7, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


def setup(key: bytes, timestamp: int = NOW) -> Any:
    return mavlink.MAVLink_setup_signing_message(7, 1, list(key), timestamp)


@both
def test_a_client_with_the_key_flies_it(personality: Personality) -> None:
    client = signed_vehicle(personality)
    hold_key(client)
    client.take_off()
    client.go_offboard()
    client.fly(2.0, vx=1.0)
    assert client.velocity[0] == pytest.approx(1.0, abs=0.3)
    assert all(message.get_signed() for at, message in client.heard if at > 1.5)
    assert client.vehicle.refused == 0


@both
def test_a_client_without_the_key_is_refused_and_told_once(personality: Personality) -> None:
    client = signed_vehicle(personality)
    for _ in range(1000):
        assert client.command(400, 1) == []
        client.gcs_heartbeat()
        client.setpoint(vz=-1.0)
    assert not client.vehicle.armed
    assert client.texts == [UNSIGNED]
    assert client.vehicle.autopilot.gate.refused == {Verdict.UNSIGNED: 3000}


@both
def test_mavlink_1_has_no_signatures_and_is_refused(personality: Personality) -> None:
    client = signed_vehicle(personality)
    client.vehicle.receive(arm().pack(client.mav, force_mavlink1=True), client.now)
    client.tick()
    assert not client.vehicle.armed
    assert client.texts == [UNSIGNED]


@both
def test_another_key_is_refused_and_told_once(personality: Personality) -> None:
    client = signed_vehicle(personality)
    hold_key(client, OTHER)
    client.oracle.signing.secret_key = None
    for _ in range(10):
        assert client.command(400, 1) == []
    assert not client.vehicle.armed
    assert client.texts == [FORGED]


@both
def test_a_captured_command_sent_again_is_refused_and_told_once(personality: Personality) -> None:
    client = signed_vehicle(personality)
    hold_key(client)
    if personality == "ardupilot":
        client.set_mode(AP_GUIDED)
    captured = arm().pack(client.mav)
    client.vehicle.receive(captured, client.now)
    client.tick()
    assert client.vehicle.armed
    assert client.command(400, 0) == [(400, ACCEPTED)]
    for _ in range(10):
        client.vehicle.receive(captured, client.now)
        client.tick()
    assert not client.vehicle.armed
    assert client.texts.count(REPLAYED) == 1


@both
def test_a_clock_more_than_a_minute_behind_is_refused(personality: Personality) -> None:
    client = signed_vehicle(personality)
    hold_key(client, timestamp=NOW - 70 * 100_000)
    assert client.command(400, 1) == []
    assert client.texts == [OLD]


@both
def test_each_kind_is_told_once(personality: Personality) -> None:
    client = signed_vehicle(personality)
    hold_key(client, OTHER)
    client.oracle.signing.secret_key = None
    for _ in range(3):
        client.mav.signing.sign_outgoing = True
        client.send(arm())
        client.mav.signing.sign_outgoing = False
        client.send(arm())
        client.tick()
    assert client.texts == [FORGED, UNSIGNED]


def test_a_command_captured_on_one_link_is_refused_on_the_other() -> None:
    start = [0.0, 0.0, 0.0]
    dynamics = Dynamics(1, [start], [0.0], [LIMITS["px4"]])
    readings = Readings.blank(1)
    vehicle = Vehicle(0, 7, "px4", dynamics, readings, start, rates="full", uid=1)
    vehicle.sign_with(KEY, NOW)
    mav: Any = mavlink.MAVLink(None, 7, 191)
    hearer: Any = mavlink.MAVLink(None)
    mav.signing.secret_key, mav.signing.timestamp = KEY, NOW
    mav.signing.sign_outgoing = True
    captured = arm().pack(mav)
    for link in (0, 1):
        vehicle.receive(captured, 5.0, link)
    heard = [hearer.parse_buffer(b"".join(vehicle.take(link))) for link in (0, 1)]
    assert [message.get_type() for message in heard[0]] == ["COMMAND_ACK"]
    assert heard[1][-1].text == REPLAYED
    assert [messages[0].get_msgbuf()[-13] for messages in heard] == [0, 1]  # their link ids


@both
def test_the_radio_carries_signed_beacons_as_they_are(personality: Personality) -> None:
    client = signed_vehicle(personality)
    hold_key(client)
    beacon = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
    signed = bytes(beacon.pack(client.mav))
    assert client.vehicle.receive(signed, client.now) == [signed]
    client.mav.signing.sign_outgoing = False
    assert client.vehicle.receive(beacon.pack(client.mav), client.now) == []
    peer = mavlink.MAVLink(None, srcSystem=8, srcComponent=191)
    peer.signing.secret_key, peer.signing.timestamp = KEY, NOW
    peer.signing.sign_outgoing = True
    heard = bytes(beacon.pack(peer))
    client.vehicle.deliver(heard)
    client.vehicle.tick(client.now)
    assert heard in client.vehicle.take()


def test_ardupilot_takes_a_key_without_a_word_and_is_signed_from_then_on() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.send(setup(KEY))
    assert client.tick("COMMAND_ACK") == []
    assert client.command(400, 1) == []
    assert client.texts == [UNSIGNED]
    hold_key(client)
    assert client.command(400, 1) == [(400, ACCEPTED)]
    assert client.last("COMMAND_ACK").get_signed()


def test_a_key_is_changed_by_its_holder_alone() -> None:
    client = signed_vehicle("ardupilot")
    client.send(setup(OTHER))
    assert client.texts == []
    hold_key(client)
    assert client.command(520) == [(520, ACCEPTED)]
    client.send(setup(OTHER, NOW + 1_000_000))
    client.oracle.signing.secret_key = None
    assert client.command(520) == []
    hold_key(client, OTHER, NOW + 1_000_000)
    assert client.command(520) == [(520, ACCEPTED)]


def test_zeros_take_the_key_away() -> None:
    client = signed_vehicle("ardupilot")
    hold_key(client)
    client.send(setup(bytes(32), 0))
    client.mav.signing.sign_outgoing = False
    client.oracle.signing.secret_key = None
    assert client.command(400, 1) == [(400, ACCEPTED)]
    assert client.last("COMMAND_ACK").get_msgbuf()[2] == 0


def test_ardupilot_takes_no_key_while_armed() -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.command(400, 1)
    client.send(setup(KEY))
    client.tick()
    assert client.texts[-1] == "ERROR: Won't setup signing when armed"
    assert client.command(400, 0) == [(400, ACCEPTED)]


def test_the_recorded_px4_does_not_know_setup_signing() -> None:
    client = Client("px4")
    client.fly(1.5)
    client.send(setup(KEY))
    assert client.command(400, 1) == [(400, ACCEPTED)]


@pytest.mark.parametrize("timestamp", [0, 1, (1 << 48) - 1, 1 << 48, (1 << 64) - 1])
def test_no_timestamp_of_a_key_stops_it(timestamp: int) -> None:
    client = Client("ardupilot")
    client.fly(1.5)
    client.send(setup(KEY, timestamp))
    client.fly(2.0)
    assert client.times("HEARTBEAT")[-1] > 2.0


@both
def test_a_signed_vehicle_swallows_nan_and_nonsense(personality: Personality) -> None:
    client = signed_vehicle(personality)
    frame = bytearray(arm().pack(client.mav))
    frame[2] = 1
    for length in range(20):
        client.vehicle.receive(bytes(frame) + bytes(length), client.now)
        client.tick()
    hold_key(client)
    client.setpoint(vx=NAN)
    assert client.command(520) == [(520, ACCEPTED)]
