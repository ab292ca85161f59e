from __future__ import annotations

from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.explore.explorer import Explorer
from swarm_ctl.explore.memory import VISITED
from swarm_ctl.explore.pieces import (
    LINE,
    PAYLOAD_BYTES,
    START,
    WALL_X,
    WALL_Z,
    Entry,
    decode,
    encode,
    points,
)
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.explore.trails import SUMMARY_BYTES, Trails

PARAMS = PlannerParams(kind="explore", period_s=1.0)
HERE, THERE = (3.017, -1.023), (-2.033, 4.011)


def explorer(sysid: int) -> Explorer:
    vehicle = Explorer(PARAMS, speed_m_s=0.2, climb_m_s=0.2, seed=[1, sysid], sysid=sysid)
    stand(vehicle, (0.0, 0.0))
    return vehicle


def stand(vehicle: Explorer, place: tuple[float, float]) -> None:
    ranges = np.full((1, 6), np.inf)
    vehicle.step(np.array([place]), np.zeros(1), ranges, np.zeros((1, 0, 2)))


def write(vehicle: Explorer, count: int, seed: int = 5) -> None:
    chance = np.random.default_rng(seed)
    for _ in range(count):
        point = chance.uniform(-5.0, 5.0, 2).tolist()
        if chance.random() < 0.3:
            vehicle.observe_hits(np.array([point]))
        else:
            vehicle.memory.sweep(vehicle._logbook._vertex, point)
            vehicle._logbook._append(LINE, point)


def meet(one: Explorer, other: Explorer, offset: tuple[float, float], now: float = 0.0) -> None:
    """One hears the other, who stands at its own origin."""
    one.hear_peer(other.trails.sysid, now, offset, (0.0, 0.0), own_position_m=(0.0, 0.0))
    one.hear_summary(other.trails.sysid, other.summary())


def everything(vehicle: Explorer, reader: Explorer) -> list[bytes]:
    meet(vehicle, reader, HERE)
    return vehicle.outbox(1000)


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_pieces_in_any_order_doubled_or_lost_once_give_the_same_map(data: st.DataObject) -> None:
    teller, plain, shaken = explorer(1), explorer(2), explorer(2)
    write(teller, 90)
    payloads = everything(teller, plain)
    assert len(payloads) > 3
    for reader in (plain, shaken):
        meet(reader, teller, HERE)
    for payload in payloads:
        plain.hear_chunk(1, payload)
    order = data.draw(st.lists(st.sampled_from(payloads), max_size=12))
    order += data.draw(st.permutations(payloads))
    for payload in order:
        shaken.hear_chunk(1, payload)
    assert shaken.trails.entries(1) == plain.trails.entries(1) == teller.trails.entries(1)
    assert shaken.memory.grid.tobytes() == plain.memory.grid.tobytes()


def test_a_log_ends_with_the_ground_however_long_the_flight() -> None:
    vehicle = explorer(1)
    round_trip = [(0.5 * step, 0.0) for step in (*range(13), *range(11, -1, -1))]
    for place in round_trip:
        stand(vehicle, place)
    vehicle.outbox(0)
    told = vehicle.trails.length(1)
    known = vehicle.memory.grid.tobytes()
    for place in round_trip * 5:
        stand(vehicle, place)
        vehicle.outbox(0)
    assert vehicle.trails.length(1) == told
    assert vehicle.memory.grid.tobytes() == known


def test_new_ground_beyond_old_is_told_as_a_trail_of_its_own() -> None:
    vehicle, reader = explorer(1), explorer(2)
    out_back_and_aside = [(0.5 * step, 0.0) for step in (*range(13), *range(11, 5, -1))]
    out_back_and_aside += [(3.0, 0.5 * step) for step in range(1, 9)]
    for place in out_back_and_aside:
        stand(vehicle, place)
    vehicle._logbook.write_out(0.0)
    kinds = [entry.kind for entry in vehicle.trails.entries(1)]
    assert kinds.count(START) == 2
    meet(reader, vehicle, (0.0, 0.0))
    for payload in everything(vehicle, reader):
        reader.hear_chunk(1, payload)
    flown = vehicle.memory.grid & VISITED
    for index in np.argwhere(flown):
        assert reader.memory.flags(vehicle.memory.metres((index + 0.5).tolist())) & VISITED


@pytest.mark.parametrize("aside", [0, 1, 3])
def test_who_begins_anew_knows_no_ground_that_nobody_has_flown(aside: int) -> None:
    before = explorer(1)
    after = Explorer(PARAMS, speed_m_s=0.2, climb_m_s=0.2, seed=[1, 2], sysid=1)
    for step in (*range(13), *range(11, 5, -1)):
        stand(before, (0.5 * step, 0.0))
    for step in range(1, aside + 1):  # new ground that no line of the log leads to yet
        stand(before, (3.0, 0.5 * step))
    after.resume(before.trails.beyond({}), [], before.head_m, 0.0)
    for index in np.argwhere(after.memory.grid & VISITED):
        assert before.memory.flags(after.memory.metres((index + 0.5).tolist())) & VISITED
    seen = [np.count_nonzero(one.memory.grid & VISITED) for one in (before, after)]
    assert seen[0] == seen[1]


def test_what_peers_have_flown_is_told_again_by_who_flies_it() -> None:
    one, other = explorer(1), explorer(2)
    meet(other, one, (0.0, 0.0))
    for vehicle in (one, other):
        for step in range(9):
            stand(vehicle, (0.5 * step, 0.0))
        vehicle._logbook.write_out(0.0)
        for payload in everything(one, other):
            other.hear_chunk(1, payload)
    assert other.trails.entries(1) == other.trails.entries(2) == one.trails.entries(1)


def test_a_lost_piece_is_sent_again_until_the_summary_tells_that_it_came() -> None:
    teller, reader = explorer(1), explorer(2)
    write(teller, 60)
    meet(reader, teller, HERE)
    lost = everything(teller, reader)
    assert not teller.outbox(1000)  # on its way
    for second in range(1, 20):
        meet(teller, reader, HERE, now=float(second))
        for index, payload in enumerate(teller.outbox(2)):
            if (second + index) % 3:
                reader.hear_chunk(1, payload)
    assert lost
    assert reader.trails.entries(1) == teller.trails.entries(1)
    meet(teller, reader, HERE, now=99.0)
    assert teller.outbox(1000) == []


def test_what_a_third_vehicle_did_lands_in_the_right_place() -> None:
    far, relay, reader = explorer(1), explorer(2), explorer(3)
    stand(far, (1.0, 2.0))
    stand(far, (1.0, 4.0))
    far._logbook._append(LINE, [1.0, 4.0])
    meet(relay, far, HERE)  # far stands at HERE in the relay's frame
    for payload in everything(far, relay):
        relay.hear_chunk(1, payload)
    meet(reader, relay, THERE)
    meet(relay, reader, (-THERE[0], -THERE[1]))
    for payload in relay.outbox(1000):
        reader.hear_chunk(2, payload)
    shift = np.add(HERE, THERE)
    assert reader.trails.length(1) == far.trails.length(1)
    assert reader.memory.flags(shift + np.array([1.0, 3.0])) & 1
    assert not reader.memory.flags(shift + np.array([1.0, 5.0])) & 1


@pytest.mark.parametrize(("away_m", "is_told"), [(300.0, True), (400.0, False)])
def test_what_lies_farther_off_than_a_shift_can_say_is_not_passed_on(
    away_m: float, is_told: bool
) -> None:
    far, between, near = explorer(1), explorer(2), explorer(3)
    write(far, 20)
    meet(far, between, (-away_m, 0.0))
    meet(between, far, (away_m, 0.0))
    for payload in far.outbox(1000):
        between.hear_chunk(1, payload)
    assert between.trails.length(1) == far.trails.length(1)
    meet(between, near, HERE)
    origins = {piece.origin for data in between.outbox(1000) if (piece := decode(data, 2))}
    assert (1 in origins) == is_told


def test_a_piece_of_a_stranger_waits_for_nobody() -> None:
    teller, reader = explorer(1), explorer(2)
    write(teller, 10)
    for payload in everything(teller, reader):
        reader.hear_chunk(1, payload)
    assert reader.trails.dropped
    assert reader.trails.length(1) == 0


def flat(entries: list[Entry]) -> tuple[bytearray, array[int]]:
    """Give entries as a log holds them."""
    kinds = bytearray(entry.kind for entry in entries)
    return kinds, array("h", (cm for entry in entries for cm in entry.point_cm))


def test_a_log_is_never_rewritten_by_others() -> None:
    reader = explorer(2)
    before = reader.trails.entries(2)
    meet(reader, explorer(1), HERE)
    forged, _ = encode(2, 0, (0.0, 0.0), *flat([Entry(START, (7, 7))] * 9))
    reader.hear_chunk(1, forged)
    assert reader.trails.entries(2) == before


@given(
    st.integers(1, 2**32 - 1),
    st.integers(0, 5000),
    st.sampled_from([2, 3]),
    st.lists(st.integers(START, WALL_Z), min_size=1, max_size=60),
)
@settings(deadline=None)
def test_a_payload_holds_what_was_put_in(origin: int, begin: int, d: int, kinds: list[int]) -> None:
    entries = [Entry(0, (0,) * d)] * begin
    entries += [Entry(kind, tuple(range(i, i + d))) for i, kind in enumerate(kinds)]
    data, count = encode(origin, begin, (1.5, -2.25, 3.0)[:d], *flat(entries))
    assert len(data) <= PAYLOAD_BYTES
    piece = decode(data, d)
    assert piece is not None
    assert (piece.origin, piece.begin) == (origin, begin)
    assert piece.shift_cm == (150, -225, 300)[:d]
    for known in (0, begin, begin + count // 2, begin + count):
        new = entries[max(begin, known) : begin + count]
        told, numbers_cm = piece.beyond(known)
        assert list(map(Entry, told, points(numbers_cm, d))) == new
    assert count == min(len(kinds), count)
    assert count >= min(len(kinds), 15)
    assert not any(decode(data[:length], d) for length in range(len(data)))


@given(st.binary(max_size=130), st.booleans())
@settings(max_examples=300, deadline=None)
def test_no_bytes_from_the_air_can_do_harm(data: bytes, dressed: bool) -> None:
    reader = explorer(2)
    meet(reader, explorer(1), HERE)
    reader.hear_chunk(1, (b"\x12" if dressed else b"") + data)
    reader.hear_summary(1, (b"\x01" if dressed else b"") + data)
    reader.outbox(5)
    assert len(reader.summary()) <= SUMMARY_BYTES


def test_noise_is_counted() -> None:
    trails = Trails(1, 2)
    trails.hear_chunk(2, b"noise", 0.0)
    trails.hear_summary(2, b"\x01\xff")
    trails.hear_summary(2, b"")
    assert trails.malformed == 3


def test_a_summary_of_a_large_swarm_takes_turns() -> None:
    trails = Trails(300, 2)
    reader = Trails(301, 2)
    for origin in range(1, 120):
        data, _ = encode(origin, 0, (0.0, 0.0), *flat([Entry(WALL_X, (1, 1))]))
        trails.meet(origin, 0.0, (0.0, 0.0))
        trails.hear_chunk(origin, data, 0.0)
    for _ in range(6):
        summary = trails.summary()
        assert len(summary) <= SUMMARY_BYTES
        reader.hear_summary(300, summary)
    contacts = reader._contacts
    peer = contacts.get(300)
    assert peer is not None
    assert 300 in contacts._places
    assert peer.has(contacts._places[300]) == 0
    assert all(peer.has(contacts._places[origin]) == 1 for origin in range(1, 120))


@pytest.mark.parametrize("bend_m", [0.05, 0.4])
def test_a_straight_way_takes_few_points(bend_m: float) -> None:
    vehicle = explorer(1)
    for step in range(1, 60):
        stand(vehicle, (0.1 * step, bend_m * (step // 10 % 2)))
    trail = [entry for entry in vehicle.trails.entries(1) if entry.kind <= LINE]
    assert len(trail) <= (4 if bend_m < 0.1 else 16)
    assert len(trail) >= (2 if bend_m < 0.1 else 8)


def begun_anew(sysid: int, birth: int) -> Explorer:
    vehicle = Explorer(PARAMS, speed_m_s=0.2, climb_m_s=0.2, seed=[1], sysid=sysid, birth=birth)
    stand(vehicle, (0.0, 0.0))
    return vehicle


def test_a_vehicle_that_begins_anew_begins_a_log_and_the_first_stays_where_it_was() -> None:
    first, second, reader = explorer(1), begun_anew(1, birth=7), explorer(2)
    write(first, 30)
    write(second, 10, seed=6)
    meet(reader, first, HERE)
    for payload in everything(first, reader):
        reader.hear_chunk(1, payload)
    for now in (30.0, 31.0):  # the first time it is heard who it is, the second time where
        meet(reader, second, THERE, now=now)
    meet(second, reader, (-THERE[0], -THERE[1]), now=30.0)
    for payload in second.outbox(1000):
        reader.hear_chunk(1, payload)
    own = second.trails.own
    assert reader.trails.entries(1) == first.trails.entries(1)
    assert reader.trails.entries(own) == second.trails.entries(own)
    shifts = [reader.trails._logs[log].shift_m for log in (1, own)]
    assert shifts == [pytest.approx(HERE), pytest.approx(THERE)]
    # and what it did in its first life it learns from its peers, in its new frame
    meet(reader, second, THERE, now=32.0)
    for payload in reader.outbox(1000):
        second.hear_chunk(2, payload)
    assert second.trails.entries(1) == first.trails.entries(1)
    moved = np.subtract(HERE, THERE)
    assert second.trails._logs[1].shift_m == pytest.approx(moved, abs=0.02)


def test_what_a_vehicle_tells_long_after_it_was_met_has_no_place() -> None:
    first, second, reader = explorer(1), begun_anew(1, birth=7), explorer(2)
    meet(reader, first, HERE)
    write(second, 10)
    payloads = everything(second, reader)
    reader._now += 30.0
    for payload in payloads:
        reader.hear_chunk(1, payload)
    assert reader.trails.length(second.trails.own) == 0
    assert reader.trails.dropped == len(payloads)
