"""Faults of links over real UDP, as a client meets them."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.testing import RealVehicle

pytestmark = pytest.mark.wire

PATIENCE_S = 30.0
ATTITUDE, AUTOPILOT_VERSION = 30, 148


class Client:
    """A companion that notes when everything arrives, by its own clock."""

    def __init__(self, vehicle: RealVehicle) -> None:
        self.vehicle = vehicle
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", vehicle.port))
        self.socket.settimeout(PATIENCE_S)
        self.codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        self.hear("HEARTBEAT", 1)

    def request(self) -> float:
        """Ask for AUTOPILOT_VERSION, and tell when."""
        parameters = (512, 0, AUTOPILOT_VERSION, *(0.0,) * 6)
        message = mavlink.MAVLink_command_long_message(1, 1, *parameters)
        self.socket.sendto(message.pack(self.codec), self.vehicle.address)
        return time.monotonic()

    def hear(self, kind: str, count: int) -> list[tuple[float, Any]]:
        """Wait for so many messages of a kind."""
        heard: list[tuple[float, Any]] = []
        while len(heard) < count:
            messages = self.codec.parse_buffer(self.socket.recv(2048)) or []
            heard += [(time.monotonic(), m) for m in messages if m.get_type() == kind]
        return heard


@pytest.fixture
def client(mock_vehicle: RealVehicle) -> Iterator[Client]:
    client = Client(mock_vehicle)
    yield client
    client.socket.close()


def test_a_late_link_answers_late_and_as_before_when_healed(client: Client) -> None:
    client.vehicle.faults.strike("link-delay", delay_s=0.2)
    asked = client.request()
    ((answered, _),) = client.hear("COMMAND_ACK", 1)
    assert 0.4 <= answered - asked < 1.0, "there and back"
    client.vehicle.faults.heal()
    asked = client.request()
    ((answered, _),) = client.hear("COMMAND_ACK", 1)
    assert answered - asked < 0.2


def test_a_frozen_link_bursts_when_it_thaws_with_nothing_lost(client: Client) -> None:
    client.vehicle.faults.strike("link-freeze", duration_s=0.4, direction="downlink")
    heard = client.hear("ATTITUDE", 120)
    times = [at for at, _ in heard]
    gap = max(b - a for a, b in pairwise(times))
    assert 0.2 < gap < 0.9
    sent_ms = [message.time_boot_ms for _, message in heard]
    assert max(b - a for a, b in pairwise(sent_ms)) <= 11


def test_a_lost_link_says_nothing_and_its_vehicle_hears_nothing(client: Client) -> None:
    client.vehicle.faults.strike("link-loss")
    struck_s = client.vehicle.truth.time_s
    client.request()
    client.vehicle.wait_until(lambda truth: truth.time_s > struck_s + 0.5)
    client.vehicle.faults.heal("link-loss")
    client.hear("ATTITUDE", 3)
    sent_ms = [m.time_boot_ms for _, m in client.hear("ATTITUDE", 1)]
    assert sent_ms[0] > struck_s * 1000 + 500
    client.request()
    assert len(client.hear("COMMAND_ACK", 1)) == 1
