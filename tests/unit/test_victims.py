from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.agent.beacon import BEACON_TYPE, SUMMARY_TYPE, TRAIL_TYPE, Beacon
from swarm_ctl.agent.peer import Meeting
from swarm_ctl.agent.phases import Phase
from swarm_ctl.agent.victims import (
    AGAIN_S,
    PER_PAYLOAD,
    REMIND_S,
    VICTIMS_TYPE,
    Report,
    Victims,
    decode,
    encode,
)
from swarm_ctl.model import ZERO, Vec3

PLACE = Vec3(3.0, -1.5, 0.25)
EAST_M = 10.0
"""Vehicle n starts n times so far to the east."""


def meets(hearer: int, teller: int, phase: Phase = Phase.EXPLORING) -> Meeting:
    """Let both know where the teller is: at its start."""
    beacon = Beacon(1, phase, ZERO, ZERO, None, ())
    return Meeting(teller, beacon, ZERO, Vec3(0.0, EAST_M * (teller - hearer), 0.0))


def tell(now: float, teller: int, hearers: dict[int, Victims], swarm: dict[int, Victims]) -> int:
    """Let one vehicle tell the hearers, who come to know so many victims."""
    payload = swarm[teller].outgoing(hearers, now)
    return sum(
        hear(hearer, payload, meets(sysid, teller)) for sysid, hearer in hearers.items() if payload
    )


def hear(hearer: Victims, payload: bytes, meeting: Meeting | None) -> int:
    """Let one vehicle hear another; give how many victims are new to it."""
    before = len(hearer.news)
    hearer.hear(1 if meeting is None else meeting.sysid, payload, meeting)
    return len(hearer.news) - before


def swarm_of(count: int) -> dict[int, Victims]:
    return {sysid: Victims(sysid) for sysid in range(1, count + 1)}


def test_no_other_payload_has_its_number() -> None:
    assert VICTIMS_TYPE not in {BEACON_TYPE, SUMMARY_TYPE, TRAIL_TYPE}


def test_a_victim_is_news_once() -> None:
    vehicle = Victims(1)
    assert vehicle.see(7, PLACE)
    assert not vehicle.see(7, ZERO)
    assert vehicle.seen == {7: PLACE}


def test_a_victim_is_told_on_from_vehicle_to_vehicle_into_each_one_s_frame() -> None:
    swarm = swarm_of(3)
    swarm[1].see(7, PLACE)
    assert tell(1.0, 1, {2: swarm[2]}, swarm) == 1
    assert tell(1.1, 2, {1: swarm[1], 3: swarm[3]}, swarm) == 1, "news for 3 alone"
    assert swarm[3].known == {7: Report(7, 1, PLACE._replace(y=PLACE.y - 2 * EAST_M))}
    assert not swarm[3].seen


def test_what_was_told_is_no_news_when_it_is_seen_and_the_own_eyes_place_it() -> None:
    swarm = swarm_of(2)
    swarm[1].see(7, PLACE)
    tell(1.0, 1, {2: swarm[2]}, swarm)
    assert not swarm[2].see(7, ZERO)
    assert swarm[2].known == {7: Report(7, 1, ZERO)}


def test_what_is_lost_is_told_again_until_it_is_known_and_then_hardly_ever() -> None:
    swarm = swarm_of(2)
    swarm[1].see(7, PLACE)
    payloads = [swarm[1].outgoing([2], 0.1 * tick) for tick in range(21)]
    assert sum(map(bool, payloads)) == 1 + 2.0 / AGAIN_S, "nobody has answered"
    swarm[2].hear(1, payloads[0], meets(2, 1))
    swarm[1].hear(2, swarm[2].outgoing([1], 2.0), meets(1, 2))
    later = [swarm[1].outgoing([2], 2.1 + 0.1 * tick) for tick in range(600)]
    told = [payload for payload in later if payload]
    assert len(told) == 60.0 / REMIND_S
    assert max(map(len, told)) == 3, "a version, a length and a byte of known numbers"


def test_a_vehicle_that_knows_nothing_or_hears_nobody_is_silent() -> None:
    vehicle = Victims(1)
    assert not vehicle.outgoing([2], 1.0)
    vehicle.see(7, PLACE)
    assert not vehicle.outgoing([], 1.0)
    assert vehicle.outgoing([2], 1.0)


def test_a_peer_that_comes_back_is_told_again() -> None:
    swarm = swarm_of(2)
    swarm[1].see(7, PLACE)
    tell(1.0, 1, {2: swarm[2]}, swarm)
    tell(1.1, 2, {1: swarm[1]}, swarm)
    assert not swarm[1].outgoing([2], 2.0)
    swarm[1].outgoing([], 3.0)
    newborn = {2: Victims(2)}
    assert tell(4.0, 1, newborn, swarm) == 1


def test_many_victims_are_told_in_turns_also_beside_a_peer_who_never_answers() -> None:
    swarm = swarm_of(2)
    for number in range(256):
        swarm[1].see(number, PLACE)
    news = 0
    for tick in range(256 // PER_PAYLOAD + 1):
        payload = swarm[1].outgoing([2, 3], tick * AGAIN_S)
        assert len(payload) <= 128
        news += hear(swarm[2], payload, meets(2, 1))
    assert news == len(swarm[2].known) == 256


def test_without_a_way_between_the_frames_nothing_is_taken() -> None:
    swarm = swarm_of(2)
    swarm[1].see(7, PLACE)
    payload = swarm[1].outgoing([2], 1.0)
    assert not hear(swarm[2], payload, None)
    assert not hear(swarm[2], payload, meets(2, 1, Phase.READY)), "it has not begun its frame"
    assert hear(swarm[2], payload, meets(2, 1))
    assert not hear(swarm[2], payload, meets(2, 1)), "doubled"


def test_a_payload_comes_back_as_it_was() -> None:
    reports = [Report(0, 1, PLACE), Report(255, 2**32 - 1, Vec3(-90_000.0, 0.0, 0.01))]
    assert decode(encode([0, 9, 255], reports)) == (1 | 1 << 9 | 1 << 255, reports)


@given(st.binary(max_size=128))
def test_any_payload_is_read_or_counted(payload: bytes) -> None:
    vehicle = Victims(1)
    news = hear(vehicle, payload, meets(1, 2))
    assert len(vehicle.known) == news
    assert vehicle.unread in {0, 1}
    assert not (vehicle.unread and news)


def test_a_place_that_is_nowhere_near_makes_a_payload_unread() -> None:
    payload = bytearray(encode([7], [Report(7, 1, PLACE)]))
    payload[-1] = 127
    assert decode(bytes(payload)) is None


def test_what_is_known_outlives_a_restart() -> None:
    swarm = swarm_of(2)
    swarm[1].see(7, PLACE)
    swarm[1].see(8, ZERO)
    tell(1.0, 1, {2: swarm[2]}, swarm)
    swarm[2].see(7, ZERO)
    again = Victims(2)
    again.remember({7: ZERO}, [Report(7, 1, PLACE), Report(8, 1, PLACE)])
    assert again.known == {7: Report(7, 1, ZERO), 8: Report(8, 1, PLACE)}
    assert again.seen == {7: ZERO}
    assert not again.see(8, ZERO), "told before the restart"
