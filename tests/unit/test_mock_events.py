"""PX4's messages that pymavlink does not know: EVENT and CURRENT_MODE."""

import struct
from typing import Any

from mock_client import ACCEPTED, PX4_LOITER, PX4_OFFBOARD, PX4_POSCTL, REJECTED, Client

from swarm_ctl import wire

CURRENT_MODE, EVENT = wire.message("CURRENT_MODE"), wire.message("EVENT")
ARM_DENIED, CHECKS_BEGIN, CHECKS_END = 16910493, 27825120, 18691879
NO_POSITION, NO_SETPOINTS, NO_GROUND_STATION = 30612409, 19865031, 23579003
OFFBOARD_BIT = 1 << 14


class Companion(Client):
    """One that reads what the oracle cannot."""

    def __init__(self, **options: Any) -> None:
        super().__init__("px4", **options)
        self.parser = wire.Parser([CURRENT_MODE, EVENT])
        self.frames: list[tuple[float, Any]] = []

    def tick(self, kind: str = "") -> list[Any]:
        heard = super().tick(kind)
        for message in (m for at, m in self.heard if at == self.now):
            for frame in self.parser.feed(bytes(message.get_msgbuf())):
                self.frames.append((self.now, frame.values))
        return heard

    def take(self, message: wire.Message) -> list[Any]:
        found = [v for _, v in self.frames if isinstance(v, message.values)]
        self.frames.clear()
        return found


def test_an_arming_that_is_denied_is_an_event_for_who_is_no_ground_station() -> None:
    client = Companion(boot_s=None)
    client.fly(1.0)
    assert client.command(400, 1) == [(400, REJECTED)]
    (denied,) = client.take(EVENT)
    assert (denied.id, denied.log_levels) == (ARM_DENIED, 0x62)
    assert not client.texts


def test_checks_are_reported_when_asked_for() -> None:
    client = Companion(boot_s=None, parameters={"NAV_DLL_ACT": 2.0})
    client.fly(1.0)
    assert client.command(401) == [(401, ACCEPTED)]
    begin, *checks, end = client.take(EVENT)
    assert (begin.id, end.id) == (CHECKS_BEGIN, CHECKS_END)
    assert [check.id for check in checks] == [NO_POSITION, NO_SETPOINTS, NO_GROUND_STATION]
    assert [event.sequence for event in (begin, *checks, end)] == [1, 2, 3, 4, 5]
    assert not struct.unpack_from("<9xI", begin.arguments)[0] & OFFBOARD_BIT


def test_a_vehicle_that_would_fly_by_setpoints_has_nothing_against_offboard() -> None:
    client = Companion()
    client.fly(3.0, vz=-0.1)
    client.command(401)
    begin, _end = client.take(EVENT)
    assert struct.unpack_from("<9xI", begin.arguments)[0] & OFFBOARD_BIT


def test_the_mode_is_told_at_once_and_twice_a_second() -> None:
    client = Companion()
    client.fly(2.0)
    client.command(511, 436, 1e5)
    client.take(CURRENT_MODE)
    client.fly(4.0)
    assert 7 <= len(client.take(CURRENT_MODE)) <= 9
    client.command(176, 1, 6)
    client.fly(0.2)
    assert client.take(CURRENT_MODE)[0][1:] == (PX4_OFFBOARD, PX4_OFFBOARD)


def test_a_failsafe_flies_another_mode_than_the_chosen_one() -> None:
    client = Companion()
    client.fly(2.0, vz=-0.1)
    client.command(511, 436, 1e5)
    client.command(176, 1, 6)
    client.command(400, 1)
    client.fly(3.0, vz=-1.0)
    client.take(CURRENT_MODE)
    client.fly(1.3)
    assert client.take(CURRENT_MODE)[-1] == (1, PX4_POSCTL, PX4_OFFBOARD)
    client.command(176, 1, 4, 3)
    client.fly(0.2)
    assert client.take(CURRENT_MODE)[-1] == (0, PX4_LOITER, PX4_LOITER)
