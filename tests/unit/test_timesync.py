"""How long a link takes, there and back."""

import pytest

from swarm_ctl.autopilot.timesync import MOST_WAITING, PERIOD_S, VALID_S, Timesync


def ask(timesync: Timesync, now: float, takes_s: float) -> None:
    stamp = timesync.request(now)
    assert stamp is not None
    timesync.answered(stamp, now + takes_s)


def test_a_link_that_is_slow_now_and_then_counts_as_slow_for_a_while() -> None:
    timesync = Timesync()
    for index, takes_s in enumerate((0.1, 0.4, 0.2, 0.1)):
        ask(timesync, index * PERIOD_S, takes_s)
    now = 4 * PERIOD_S
    assert timesync.round_trip_s(now) == pytest.approx(0.1)
    assert timesync.slowest_s(now) == pytest.approx(0.4)
    assert timesync.slowest_s(PERIOD_S + 0.41 + VALID_S) == pytest.approx(0.2)
    assert timesync.slowest_s(now + 2 * VALID_S) == 0.0


def test_a_stamp_that_is_not_ours_says_nothing() -> None:
    timesync = Timesync()
    timesync.answered(12345, 1.0)
    assert timesync.slowest_s(1.0) == timesync.round_trip_s(1.0) == 0.0


def test_of_what_is_never_answered_only_the_latest_is_waited_for() -> None:
    timesync = Timesync()
    stamps = [timesync.request(number * PERIOD_S) for number in range(MOST_WAITING + 1)]
    now = MOST_WAITING * PERIOD_S
    for stamp, taken_s in ((stamps[0], 0.0), (stamps[1], now - PERIOD_S)):
        assert stamp is not None
        timesync.answered(stamp, now)
        assert timesync.round_trip_s(now) == pytest.approx(taken_s)
