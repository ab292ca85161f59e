"""What a controller asks its autopilot to send, and when it asks again."""

import pytest

from swarm_ctl import wire
from swarm_ctl.autopilot.ardupilot import ARDUPILOT
from swarm_ctl.autopilot.base import Autopilot
from swarm_ctl.autopilot.command import SET_MESSAGE_INTERVAL, Command
from swarm_ctl.autopilot.px4 import PX4
from swarm_ctl.autopilot.streams import Streams
from swarm_ctl.autopilot.telemetry import SUBSCRIBED

RATES_HZ = {"ATTITUDE": 10.0, "SYS_STATUS": 1.0}


@pytest.fixture
def streams() -> Streams:
    streams = Streams()
    streams.want(RATES_HZ)
    return streams


def names(requests: list[Command]) -> list[str]:
    return [wire.message(int(request.parameters[0])).name for request in requests]


def hear(streams: Streams, *heard: str, now: float) -> None:
    for name in heard:
        streams.heard_s[wire.message(name).id] = now


def test_everything_is_asked_for_once_though_it_may_flow_already(streams: Streams) -> None:
    hear(streams, "ATTITUDE", now=0.0)
    (attitude, status) = streams.due(0.0, starts=True)
    assert attitude == (SET_MESSAGE_INTERVAL, (30.0, 1e5, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert status == (SET_MESSAGE_INTERVAL, (1.0, 1e6, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_what_does_not_come_is_asked_for_again_every_two_seconds(streams: Streams) -> None:
    asked_s = []
    for tenth in range(60):
        now = tenth / 10
        hear(streams, "SYS_STATUS", now=now)
        if "ATTITUDE" in names(streams.due(now, starts=True)):
            asked_s.append(now)
    assert asked_s == [0.0, 2.0, 4.0]


def test_in_flight_what_stops_or_never_came_is_asked_for_again(streams: Streams) -> None:
    hear(streams, "ATTITUDE", now=0.0)
    assert "ATTITUDE" not in names(streams.due(1.9, starts=False))
    assert "SYS_STATUS" in names(streams.due(4.0, starts=False))  # a short start did not ask for it
    assert "ATTITUDE" in names(streams.due(6.1, starts=False))
    assert streams.due(7.0, starts=False) == []


def test_a_slow_stream_is_given_three_of_its_periods(streams: Streams) -> None:
    hear(streams, "ATTITUDE", "SYS_STATUS", now=0.0)
    assert streams.missing(2.5) == ["ATTITUDE"]
    assert streams.missing(3.1) == ["ATTITUDE", "SYS_STATUS"]


def test_what_is_refused_is_left_for_half_a_minute(streams: Streams) -> None:
    (_attitude, status) = streams.due(0.0, starts=True)
    streams.refused(status, 0.1)
    asked_s = []
    for second in range(70):
        hear(streams, "ATTITUDE", now=float(second))
        asked_s += [second] * ("SYS_STATUS" in names(streams.due(float(second), starts=True)))
    assert asked_s[:2] == [31, 33]


@pytest.mark.parametrize("pilot", [PX4, ARDUPILOT])
def test_every_stream_that_is_asked_for_is_listened_to(pilot: Autopilot) -> None:
    assert set(pilot.streams_hz) <= set(SUBSCRIBED)


def test_each_autopilot_is_asked_for_its_own_estimators_word() -> None:
    assert "ESTIMATOR_STATUS" in set(PX4.streams_hz) - set(ARDUPILOT.streams_hz)
    assert "EKF_STATUS_REPORT" in set(ARDUPILOT.streams_hz) - set(PX4.streams_hz)
