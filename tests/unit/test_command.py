import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.autopilot.command import (
    ACCEPTED,
    COMPONENT_ARM_DISARM,
    DO_SET_MODE,
    NAV_LAND,
    SET_MESSAGE_INTERVAL,
    Ack,
    CommandQueue,
    command,
)

ARM = command(COMPONENT_ARM_DISARM, 1.0)
MODE = command(DO_SET_MODE, 1.0, 6.0)
LAND = command(NAV_LAND)
STREAM, OTHER_STREAM = (command(SET_MESSAGE_INTERVAL, number, 1e5) for number in (32.0, 30.0))
REJECTED, DENIED = 1, 2
RESULTS = st.tuples(st.sampled_from([ARM.id, LAND.id, MODE.id]), st.integers(0, 11))


def test_a_command_is_repeated_until_it_is_answered() -> None:
    queue = CommandQueue(retry_s=0.5)
    queue.request(ARM)
    assert queue.poll(0.0) == ((ARM, 0), None)
    assert queue.poll(0.4) == (None, None)
    assert queue.poll(0.5) == ((ARM, 1), None)
    answer = queue.acknowledge(Ack(ARM.id, 0), 0.6)
    assert answer is not None
    assert answer.is_accepted
    assert queue.poll(10.0) == (None, None)


def test_the_second_command_waits_for_the_first_ones_answer() -> None:
    queue = CommandQueue()
    queue.request(MODE)
    queue.request(ARM)
    assert queue.poll(0.0)[0] == (MODE, 0)
    assert queue.poll(0.1)[0] is None
    queue.acknowledge(Ack(MODE.id, 0), 0.2)
    assert queue.poll(0.2)[0] == (ARM, 0)


def test_a_mode_that_px4_takes_back_counts_as_refused() -> None:
    queue = CommandQueue()
    queue.request(MODE)
    queue.request(ARM)
    queue.poll(0.0)
    accepted = queue.acknowledge(Ack(MODE.id, ACCEPTED), 0.1)
    queue.poll(0.1)
    refused = queue.acknowledge(Ack(MODE.id, REJECTED), 0.116)
    assert accepted is not None
    assert accepted.is_accepted
    assert refused is not None
    assert refused.words == "the change of mode was temporarily rejected"
    assert queue.is_waiting(ARM.id)  # the answer was not the next command's
    queue.acknowledge(Ack(ARM.id, ACCEPTED), 0.2)
    assert queue.poll(0.9)[0] is None
    assert queue.poll(1.2)[0] == (MODE, 0)


def test_a_second_acceptance_says_nothing_new() -> None:
    queue = CommandQueue()
    queue.request(MODE)
    queue.poll(0.0)
    queue.acknowledge(Ack(MODE.id, ACCEPTED), 0.1)
    assert queue.acknowledge(Ack(MODE.id, ACCEPTED), 0.11) is None


def test_an_answer_that_comes_much_later_takes_nothing_back() -> None:
    queue = CommandQueue()
    queue.request(MODE)
    queue.poll(0.0)
    queue.acknowledge(Ack(MODE.id, ACCEPTED), 0.1)
    assert queue.acknowledge(Ack(MODE.id, DENIED), 5.0) is None


def test_what_is_temporarily_rejected_is_asked_for_again_a_few_times() -> None:
    queue = CommandQueue()
    queue.request(ARM)
    sent_s = []
    for tenth in range(100):
        now = tenth / 10
        due, timed_out = queue.poll(now)
        assert timed_out is None
        if due is not None:
            assert due == (ARM, 0)  # answered, so it is no copy of the last one
            sent_s.append(now)
            answer = queue.acknowledge(Ack(ARM.id, REJECTED), now)
            assert answer is not None
            assert not answer.is_accepted
    assert sent_s == [0.0, 1.0, 2.0, 3.0]
    assert not queue.is_waiting(ARM.id)


@pytest.mark.parametrize("result", [2, 3, 4, 6, 7, 8, 9, 10, 77])
def test_any_other_refusal_is_final(result: int) -> None:
    queue = CommandQueue()
    queue.request(ARM)
    queue.poll(0.0)
    answer = queue.acknowledge(Ack(ARM.id, result), 0.1)
    assert answer is not None
    assert not answer.is_accepted
    assert not answer.is_in_progress
    assert answer.words.startswith("arming was ")
    assert queue.poll(99.0) == (None, None)


def test_one_that_waits_to_be_asked_again_lets_others_pass() -> None:
    queue = CommandQueue()
    queue.request(ARM)
    queue.poll(0.0)
    queue.acknowledge(Ack(ARM.id, REJECTED), 0.1)
    queue.request(LAND)
    assert queue.poll(0.2)[0] == (LAND, 0)


def test_what_moves_the_vehicle_goes_before_what_asks_for_streams() -> None:
    queue = CommandQueue()
    queue.request(STREAM)
    queue.request(OTHER_STREAM)
    assert queue.poll(0.0)[0] == (STREAM, 0)
    queue.request(LAND)
    assert queue.poll(0.1)[0] == (LAND, 0)
    queue.acknowledge(Ack(LAND.id, ACCEPTED), 0.2)
    assert queue.poll(0.2)[0] == (OTHER_STREAM, 0)
    queue.acknowledge(Ack(STREAM.id, ACCEPTED), 0.6)
    assert queue.poll(0.6)[0] == (STREAM, 0)


@given(st.lists(st.tuples(st.sampled_from(["poll", "land", "arm", "ack"]), RESULTS), max_size=60))
def test_whatever_is_answered_one_command_is_on_its_way(
    story: list[tuple[str, tuple[int, int]]],
) -> None:
    queue, now, on_its_way, counts = CommandQueue(), 0.0, None, []
    for what, (command_id, result) in story:
        now += 0.1
        match what:
            case "poll":
                due, timed_out = queue.poll(now)
                if timed_out is not None:
                    on_its_way = None
                if due is not None:
                    wanted, confirmation = due
                    assert on_its_way in {None, wanted}
                    counts = [*counts, confirmation] if on_its_way else [confirmation]
                    assert counts == list(range(len(counts)))
                    assert len(counts) <= queue.attempts
                    on_its_way = wanted
            case "ack":
                answer = queue.acknowledge(Ack(command_id, result), now)
                if on_its_way is not None and on_its_way.id == command_id:
                    assert answer is not None
                    assert answer.command == on_its_way
                    on_its_way = on_its_way if answer.is_in_progress else None
            case _:
                queue.request({"land": LAND, "arm": ARM}[what])


def test_silence_ends_after_the_last_attempt() -> None:
    queue = CommandQueue(retry_s=1.0, attempts=3)
    queue.request(ARM)
    assert [queue.poll(t)[0] is not None for t in (0.0, 1.0, 2.0)] == [True] * 3
    due, timed_out = queue.poll(3.0)
    assert due is None
    assert timed_out is not None
    assert timed_out.words == "arming was not answered"


def test_progress_is_told_and_stretches_the_wait() -> None:
    queue = CommandQueue(retry_s=0.5)
    queue.request(ARM)
    queue.poll(0.0)
    answer = queue.acknowledge(Ack(ARM.id, 5, progress=40), 0.1)
    assert answer is not None
    assert answer.is_in_progress
    assert answer.progress == 40
    assert queue.poll(1.9)[0] is None
    assert queue.poll(2.1)[0] == (ARM, 1)


def test_the_same_request_is_not_queued_twice() -> None:
    queue = CommandQueue()
    queue.request(ARM)
    queue.request(ARM)
    queue.poll(0.0)
    queue.acknowledge(Ack(ARM.id, 4), 0.1)
    assert queue.poll(0.1) == (None, None)


def test_a_refusal_is_said_in_words() -> None:
    queue = CommandQueue()
    queue.request(ARM)
    queue.poll(0.0)
    answer = queue.acknowledge(Ack(ARM.id, 1), 0.1)
    assert answer is not None
    assert not answer.is_accepted
    assert answer.reason == "temporarily rejected"


def test_a_parameter_that_stops_a_real_autopilot_is_refused_here() -> None:
    with pytest.raises(ValueError, match="finite"):
        command(COMPONENT_ARM_DISARM, math.nan)


def test_what_is_forgotten_is_what_moves_the_vehicle_not_the_streams() -> None:
    queue = CommandQueue()
    for wanted in (STREAM, OTHER_STREAM, ARM):
        queue.request(wanted)
    assert queue.poll(0.0)[0] == (ARM, 0)
    queue.clear()
    assert queue.poll(0.1)[0] == (STREAM, 0)
    queue.clear()
    queue.acknowledge(Ack(STREAM.id, ACCEPTED), 0.2)
    assert queue.poll(0.2)[0] == (OTHER_STREAM, 0)
    assert not queue.is_waiting(ARM.id)
