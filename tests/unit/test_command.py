import math

import pytest

from swarm_ctl.autopilot.command import (
    COMPONENT_ARM_DISARM,
    DO_SET_MODE,
    CommandQueue,
    command,
)

ARM = command(COMPONENT_ARM_DISARM, 1.0)
MODE = command(DO_SET_MODE, 1.0, 6.0)


def test_a_command_is_repeated_until_it_is_answered() -> None:
    queue = CommandQueue(retry_s=0.5)
    queue.request(ARM)
    assert queue.poll(0.0) == ((ARM, 0), None)
    assert queue.poll(0.4) == (None, None)
    assert queue.poll(0.5) == ((ARM, 1), None)
    answer = queue.acknowledge(ARM.id, 0, 0.6)
    assert answer is not None
    assert answer.is_accepted
    assert queue.poll(10.0) == (None, None)


def test_the_second_command_waits_for_the_first_ones_answer() -> None:
    queue = CommandQueue()
    queue.request(MODE)
    queue.request(ARM)
    assert queue.poll(0.0)[0] == (MODE, 0)
    assert queue.poll(0.1)[0] is None
    queue.acknowledge(MODE.id, 0, 0.2)
    assert queue.poll(0.2)[0] == (ARM, 0)


def test_a_second_acknowledgement_of_the_same_command_is_not_the_next_ones() -> None:
    queue = CommandQueue()
    queue.request(MODE)
    queue.request(ARM)
    queue.poll(0.0)
    queue.acknowledge(MODE.id, 0, 0.1)
    queue.poll(0.1)
    assert queue.acknowledge(MODE.id, 1, 0.15) is None  # PX4 acknowledges DO_SET_MODE twice
    assert queue.is_waiting(ARM.id)


def test_silence_ends_after_the_last_attempt() -> None:
    queue = CommandQueue(retry_s=1.0, attempts=3)
    queue.request(ARM)
    assert [queue.poll(t)[0] is not None for t in (0.0, 1.0, 2.0)] == [True] * 3
    due, timed_out = queue.poll(3.0)
    assert due is None
    assert timed_out is not None
    assert timed_out.reason == "no answer"


def test_progress_stretches_the_wait() -> None:
    queue = CommandQueue(retry_s=0.5)
    queue.request(ARM)
    queue.poll(0.0)
    assert queue.acknowledge(ARM.id, 5, 0.1) is None
    assert queue.poll(1.9)[0] is None
    assert queue.poll(2.1)[0] == (ARM, 1)


def test_the_same_request_is_not_queued_twice() -> None:
    queue = CommandQueue()
    queue.request(ARM)
    queue.request(ARM)
    queue.poll(0.0)
    queue.acknowledge(ARM.id, 4, 0.1)
    assert queue.poll(0.1) == (None, None)


def test_a_refusal_is_said_in_words() -> None:
    queue = CommandQueue()
    queue.request(ARM)
    queue.poll(0.0)
    answer = queue.acknowledge(ARM.id, 1, 0.1)
    assert answer is not None
    assert not answer.is_accepted
    assert answer.reason == "temporarily rejected"


def test_a_parameter_that_stops_a_real_autopilot_is_refused_here() -> None:
    with pytest.raises(ValueError, match="finite"):
        command(COMPONENT_ARM_DISARM, math.nan)
