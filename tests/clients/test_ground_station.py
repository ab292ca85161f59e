"""Connect as QGroundControl does: each step waits for an answer, whatever it says."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from mock_process import Mock
from pymavlink.dialects.v20 import ardupilotmega as mavlink

pytestmark = pytest.mark.clients

ANSWER_S = 10.0
OPEN_FILE_RO = 4
REQUEST_MESSAGE = 512
AUTOPILOT_VERSION, AVAILABLE_MODES, COMPONENT_METADATA = 148, 435, 397

Launch = Callable[..., tuple[Mock, list[int]]]


class Station:
    """A plain socket, pymavlink's codec and a clock."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.codec.robust_parsing = True
        self.socket.settimeout(0.1)
        self.heard: list[Any] = []
        """What has not been asked for yet."""

    def send(self, message: Any) -> None:
        self.socket.send(message.pack(self.codec))

    def hears(self, kind: str, is_wanted: Callable[[Any], object] = lambda _: True) -> Any:
        """Give an answer that has come, or wait for it; to wait any longer is to have none."""
        answer = self.awaits(kind, is_wanted, ANSWER_S)
        return answer or pytest.fail(f"no {kind}")

    def awaits(self, kind: str, is_wanted: Callable[[Any], object], patience_s: float) -> Any:
        """Give an answer, or None when it has not come in time."""
        deadline = time.monotonic() + patience_s
        while True:
            for message in self.heard:
                if message.get_type() == kind and is_wanted(message):
                    self.heard.remove(message)
                    return message
            if time.monotonic() > deadline:
                return None
            with contextlib.suppress(TimeoutError):
                self.heard += self.codec.parse_buffer(self.socket.recv(4096)) or []

    def asks_for_message(self, number: int) -> int:
        """Give the result of REQUEST_MESSAGE."""
        self.send(
            mavlink.MAVLink_command_long_message(1, 1, REQUEST_MESSAGE, 0, number, *(0.0,) * 6)
        )
        ack = self.hears("COMMAND_ACK", lambda m: m.command == REQUEST_MESSAGE)
        return int(ack.result)

    def opens_file(self, name: bytes) -> int:
        """Give the opcode of the answer, ACK or NAK."""
        head = bytes([0, 0, 0, OPEN_FILE_RO, len(name), *(0,) * 7])
        payload = (head + name).ljust(251, b"\0")
        self.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload))
        return int(self.hears("FILE_TRANSFER_PROTOCOL").payload[3])

    def reads_parameters(self) -> int:
        """Give how many there are once all have come."""
        self.send(mavlink.MAVLink_param_request_list_message(1, 1))
        first = self.hears("PARAM_VALUE")
        count = int(first.param_count)
        missing = set(range(count)) - {first.param_index}
        while missing:
            value = self.awaits("PARAM_VALUE", lambda m: m.param_index in missing, 1.0)
            if value is not None:
                missing.discard(value.param_index)
                continue
            for index in sorted(missing)[:10]:  # datagrams were lost
                self.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", index))
        return count

    def reads_plan(self, kind: int) -> int:
        """Give the length of a plan, and say that it has come."""
        self.send(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
        count = int(self.hears("MISSION_COUNT", lambda m: m.mission_type == kind).count)
        self.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, kind))
        return count


@pytest.fixture
def meet() -> Iterator[Callable[[int], Station]]:
    met: list[Station] = []

    def connect(port: int) -> Station:
        met.append(Station(port))
        return met[-1]

    yield connect
    for station in met:
        station.socket.close()


@pytest.mark.parametrize("personality", ["px4", "ardupilot"])
def test_every_step_of_a_connection_is_answered(
    launch: Launch, meet: Callable[[int], Station], personality: str
) -> None:
    _, (port,) = launch(personality)
    station = meet(port)
    station.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    heartbeat = station.hears("HEARTBEAT")
    assert heartbeat.autopilot == {"px4": 12, "ardupilot": 3}[personality]
    assert station.asks_for_message(AUTOPILOT_VERSION) == mavlink.MAV_RESULT_ACCEPTED
    version = station.hears("AUTOPILOT_VERSION")
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    station.asks_for_message(AVAILABLE_MODES)
    station.asks_for_message(COMPONENT_METADATA)
    assert station.opens_file(b"@PARAM/param.pck") in {128, 129}
    assert station.reads_parameters() > 90
    home = int(personality == "ardupilot")
    assert [station.reads_plan(kind) for kind in range(3)] == [home, 0, 0]
