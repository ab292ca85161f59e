"""Clients that speak MAVLink 1 are obeyed, and answered in MAVLink 2, as both recorded ones do."""

from __future__ import annotations

from typing import Any

import pytest
from mock_client import ACCEPTED, AP_GUIDED, PX4_OFFBOARD, Client, both
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.vehicle import Personality


class OldClient(Client):
    """A companion that packs all it says in MAVLink 1."""

    def send(self, message: Any) -> list[bytes]:
        frame = message.pack(self.mav, force_mavlink1=True)
        assert frame[0] == 0xFE
        return self.vehicle.receive(frame, self.now)


def request(number: int = 148) -> Any:
    return mavlink.MAVLink_command_long_message(7, 1, 512, 0, number, 0, 0, 0, 0, 0, 0)


@both
def test_a_whole_flight_is_flown_in_mavlink_1(personality: Personality) -> None:
    client = OldClient(personality)
    client.take_off()
    client.go_offboard()
    client.fly(3.0, vx=1.0)
    assert client.vehicle.mode == {"px4": PX4_OFFBOARD, "ardupilot": AP_GUIDED}[personality]
    assert client.velocity[0] == pytest.approx(1.0, abs=0.2)
    assert client.command(21) == [(21, ACCEPTED)]
    client.fly_until(lambda: not client.vehicle.armed)
    assert {message.get_msgbuf()[0] for _, message in client.heard} == {0xFD}


@both
def test_the_beacon_of_an_old_companion_is_broadcast_as_it_is(personality: Personality) -> None:
    client = OldClient(personality)
    (beacon,) = client.send(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    assert beacon[0] == 0xFE


@both
def test_both_versions_may_share_a_datagram(personality: Personality) -> None:
    client = Client(personality)
    data = b"".join(
        bytes(request().pack(client.mav, force_mavlink1=is_old)) for is_old in (True, False) * 3
    )
    client.vehicle.receive(data, client.now)
    assert [ack.result for ack in client.tick("COMMAND_ACK")] == [ACCEPTED] * 6


@both
@pytest.mark.parametrize("at", [1, 5, 6, 20, 40])
def test_a_frame_may_come_in_two_datagrams(personality: Personality, at: int) -> None:
    client = Client(personality)
    frame = bytes(request().pack(client.mav, force_mavlink1=True))
    for part in (frame[:at], frame[at:]):
        client.vehicle.receive(part, client.now)
    assert [ack.result for ack in client.tick("COMMAND_ACK")] == [ACCEPTED]


@both
def test_a_wrong_crc_is_met_with_silence(personality: Personality) -> None:
    client = Client(personality)
    frame = bytearray(request().pack(client.mav, force_mavlink1=True))
    for at in range(1, len(frame)):
        broken = frame.copy()
        broken[at] ^= 0x10
        client.vehicle.receive(bytes(broken), client.now)
        assert client.tick("COMMAND_ACK") == []
