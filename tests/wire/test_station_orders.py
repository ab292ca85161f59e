"""A ground station on UDP orders the controller of a vehicle that `swarm-ctl fly` flies."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from session import Session

from mock_vehicle.testing import RealVehicle

pytestmark = pytest.mark.wire

PATIENCE_S = 30.0
SYSID, CONTROLLER = 3, 191
LAND, PAUSE_CONTINUE = 21, 193
vehicle = pytest.mark.mock_vehicle.with_args(sysid=SYSID, rates="full", speed=4)


class Station:
    """QGroundControl's socket and codec: PX4 calls its port, ArduPilot is called where it is."""

    def __init__(self, vehicle: RealVehicle) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(0.1)
        self.address: Any = vehicle.address
        self.codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.codec.robust_parsing = True
        if vehicle.gcs_port != vehicle.port:
            self.socket.bind(("127.0.0.1", vehicle.gcs_port))
            _, self.address = self.socket.recvfrom(2048)

    def order(self, command: int, first: float = 0.0) -> int:
        """Give a command, again and again as stations do, until the controller has answered."""
        values = (SYSID, CONTROLLER, command, 0, first, *(0.0,) * 6)
        frame = bytes(mavlink.MAVLink_command_long_message(*values).pack(self.codec))
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            self.socket.sendto(frame, self.address)
            again_s = time.monotonic() + 1.0
            while time.monotonic() < again_s:
                for message in self.heard():
                    is_answer = message.get_type() == "COMMAND_ACK" and message.command == command
                    if is_answer and message.get_srcComponent() == CONTROLLER:
                        return int(message.result)
        return pytest.fail("the controller does not answer")

    def heard(self) -> list[Any]:
        with contextlib.suppress(TimeoutError):
            return self.codec.parse_buffer(self.socket.recv(2048)) or []
        return []


@pytest.fixture
def station(mock_vehicle: RealVehicle) -> Iterator[Station]:
    station = Station(mock_vehicle)
    with contextlib.closing(station.socket):
        yield station


@pytest.mark.parametrize("mock_vehicle", ["px4", "ardupilot"], indirect=True)
@vehicle
def test_a_ground_station_pauses_and_lands_a_vehicle_through_its_autopilot(
    hall: Callable[..., Path],
    swarm_ctl_run: Callable[..., Session],
    mock_vehicle: RealVehicle,
    station: Station,
) -> None:
    mission = hall(duration_s=1500.0, flight={"open_air": True})
    links = ("--connect", mock_vehicle.url, "--sysid", SYSID)
    session = swarm_ctl_run(mission, *links, "--speed", 4, command="fly")
    session.wait_for("exploring", sysid=SYSID)
    assert station.order(PAUSE_CONTINUE, 0.0) == mavlink.MAV_RESULT_ACCEPTED
    session.wait_for("holding", sysid=SYSID)
    assert station.order(mavlink.MAV_CMD_DO_SET_MODE) == mavlink.MAV_RESULT_UNSUPPORTED
    assert station.order(LAND) == mavlink.MAV_RESULT_ACCEPTED
    session.wait_for("landing", sysid=SYSID)
    assert session.end()[0] == 0
    assert session.phases() == ["done"]
