"""What a mock autopilot passes on between a ground station and the companion, and what it keeps."""

from __future__ import annotations

from typing import Any

import pytest
from mock_client import ACCEPTED, Client, both
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.vehicle import Personality

SYSID, COMPANION = 7, 191
LAND = 21
STATION = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)


def command(component: int, system: int = SYSID) -> bytes:
    values = (system, component, LAND, 0, *(0.0,) * 7)
    return bytes(mavlink.MAVLink_command_long_message(*values).pack(STATION))


def named(frames: list[bytes], name: str) -> list[Any]:
    heard: list[Any] = mavlink.MAVLink(None).parse_buffer(b"".join(frames)) or []
    return [message for message in heard if message.get_type() == name]


@both
def test_an_order_reaches_the_companion_and_its_answer_the_station(
    personality: Personality,
) -> None:
    client = Client(personality)
    vehicle = client.vehicle
    client.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    vehicle.take()
    vehicle.receive(command(COMPANION), 0.0)
    (order,) = named(vehicle.take(), "COMMAND_LONG")
    assert (order.get_srcSystem(), order.target_component, order.command) == (255, COMPANION, LAND)
    assert "LAND" not in vehicle.mode_name
    client.send(mavlink.MAVLink_command_ack_message(LAND, ACCEPTED, 0, 0, 255, 190))
    (ack,) = named(vehicle.take(), "COMMAND_ACK")
    assert (ack.get_srcComponent(), ack.target_system) == (COMPANION, 255)


def test_a_station_on_a_link_of_its_own_hears_the_answer_there() -> None:
    client = Client("px4", rates="full")
    vehicle = client.vehicle
    client.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    vehicle.receive(command(COMPANION), 0.0, 1)
    assert named(vehicle.take(1), "COMMAND_LONG") == []
    assert len(named(vehicle.take(0), "COMMAND_LONG")) == 1
    client.send(mavlink.MAVLink_command_ack_message(LAND, ACCEPTED, 0, 0, 255, 190))
    assert named(vehicle.take(0), "COMMAND_ACK") == []
    assert len(named(vehicle.take(1), "COMMAND_ACK")) == 1


@both
def test_without_a_companion_an_order_for_one_is_what_it_is_for_the_real_ones(
    personality: Personality,
) -> None:
    client = Client(personality)
    client.vehicle.receive(command(COMPANION), 0.0)
    acks = named(client.vehicle.take(), "COMMAND_ACK")
    executed = personality == "ardupilot"
    assert [ack.result for ack in acks] == ([ACCEPTED] if executed else [])
    assert ("LAND" in client.vehicle.mode_name) == executed


@both
def test_nobody_takes_the_autopilots_own_commands(personality: Personality) -> None:
    client = Client(personality)
    impostor = mavlink.MAVLink(None, srcSystem=SYSID, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)
    client.vehicle.receive(bytes(beat.pack(impostor)), 0.0)
    client.vehicle.receive(command(1), 0.0)
    frames = client.vehicle.take()
    assert named(frames, "COMMAND_LONG") == []
    assert [ack.result for ack in named(frames, "COMMAND_ACK")] == [ACCEPTED]


@pytest.mark.parametrize("target", [(SYSID, 0), (9, 1), (9, COMPANION)])
@both
def test_what_is_for_everybody_or_for_nobody_here_is_not_passed_on(
    personality: Personality, target: tuple[int, int]
) -> None:
    client = Client(personality)
    client.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    client.vehicle.take()
    client.vehicle.receive(command(target[1], target[0]), 0.0)
    assert named(client.vehicle.take(), "COMMAND_LONG") == []
