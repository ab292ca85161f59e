"""One mission in several shards: who flies what, what crosses the border, and what does not."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_vehicle.cli import check_sysids, take_part
from mock_vehicle.errors import WorldError
from mock_vehicle.fleet import WIND, Fleet, streams
from mock_vehicle.radio.figures import Fate
from mock_vehicle.shards import GROUP_MAX, choose, divide, parse_addresses
from mock_vehicle.shards.abroad import Abroad
from mock_vehicle.shards.letter import LETTER_BYTES, ROW, read, write_frames, write_rows
from mock_vehicle.world import World, load_world
from swarm_ctl import wire

YARD = """
name: yard
size_m: [40, 40]
closed: false
starts: {grid: {origin_m: [5, 5], spacing_m: 2, columns: 10}}
radio: {radius_m: 6.0}
wind: {speed_m_s: 3, from_deg: 90, gust_m_s: 1}
"""
HEARTBEAT = wire.message("HEARTBEAT")
STEP_S = 0.02
FRONT, BACK = 0, 1


@pytest.fixture
def yard(tmp_path: Path) -> World:
    file = tmp_path / "yard.yaml"
    file.write_text(YARD)
    return load_world(file)


class Shards:
    """Fleets that tell each other all, as if over a network that loses nothing."""

    def __init__(self, world: World, vehicles: int, shards: int, **options: Any) -> None:
        self.parts = divide(vehicles, shards)
        self.fleets = [
            Fleet(world, ["px4"] * len(part.own), seed=5, part=part, **options)
            for part in self.parts
        ]
        self.steps = 0
        self.delivered: list[list[tuple[int, bytes]]] = [[] for _ in self.fleets]

    @property
    def now(self) -> float:
        return self.steps * STEP_S

    def fly(self, seconds: float = 0.2) -> None:
        """Step all, and let each tell the others what it has to tell after each step."""
        for _ in range(round(seconds / STEP_S)):
            self.steps += 1
            for fleet, delivered in zip(self.fleets, self.delivered, strict=True):
                delivered.extend(fleet.step(self.now))
            for fleet in self.fleets:
                self.tell(fleet)

    def tell(self, fleet: Fleet) -> None:
        """Tell all others."""
        part, abroad = fleet.part, fleet.abroad
        assert abroad is not None
        letters = write_rows(abroad.tag, part.shard, self.now, abroad.rows)
        letters += write_frames(abroad.tag, part.shard, self.now, abroad.outgoing)
        abroad.outgoing.clear()
        for other in self.fleets:
            if other is not fleet:
                for letter in letters:
                    assert other.learn(letter, part.shard, part.own, self.now)

    def put(self, shard: int, index: int, *place_ned_m: float) -> None:
        """Hang a vehicle into the air."""
        body = self.fleets[shard - 1].dynamics
        body.position_ned_m[index], body.on_ground[index] = place_ned_m, False

    def heard(self, shard: int, index: int) -> list[int]:
        """Give the sysids of the companions that a vehicle's companion was passed."""
        parser = wire.Parser(("HEARTBEAT",))
        datagrams = (data for to, data in self.delivered[shard - 1] if to == index)
        frames = (frame for data in datagrams for frame in parser.feed(data))
        return sorted({frame.sysid for frame in frames if frame.compid == 191})


def beacon(sysid: int) -> bytes:
    return HEARTBEAT.pack(0, sysid, 191, 18, 8, 0, 0, 4, 3)


@given(st.integers(1, 10_000), st.integers(1, 80))
def test_every_vehicle_flies_once_and_no_network_has_more_than_250(v: int, k: int) -> None:
    groups = math.ceil(v / GROUP_MAX)
    if k % groups or k > v:
        with pytest.raises(ValueError, match="--shards"):
            divide(v, k)
        return
    parts = divide(v, k)
    assert [vehicle for part in parts for vehicle in part.own] == list(range(v))
    for part in parts:
        assert len(part.members) <= GROUP_MAX
        assert set(part.own) <= set(part.members)
    sysids = {(part.group, v - part.members.start + 1) for part in parts for v in part.own}
    assert len(sysids) == v
    assert max(sysid for _, sysid in sysids) <= GROUP_MAX


@pytest.mark.parametrize(
    ("vehicles", "text", "shard", "words"),
    [
        (500, "127.0.0.1:1", 1, "500 vehicles are 2 groups of at most 250, each a MAVLink net"),
        (251, "127.0.0.1:1,127.0.0.1:2,127.0.0.1:3", 1, "name 2 addresses or a multiple, not 3"),
        (1, "127.0.0.1:1,127.0.0.1:2", 1, "2 shards for 1 vehicles; name fewer"),
        (4, "127.0.0.1:1,127.0.0.1:2", 3, "--shard 3: say which of the 2 --shards this one is"),
        (4, "127.0.0.1:1,127.0.0.1:2", None, "--shard is missing: say which of the 2 --shards"),
        (4, "127.0.0.1", 1, "--shards 127.0.0.1: expected IP:PORT for each shard"),
        (4, "127.0.0.1:1,", 1, "expected IP:PORT for each shard"),
        (4, "far.example:14700", 1, "expected IP:PORT for each shard"),
        (4, "127.0.0.1:70000", 1, "expected IP:PORT for each shard"),
        (4, "127.0.0.1:1,127.0.0.1:1", 1, "names an address twice"),
    ],
)
def test_a_mission_that_cannot_be_shared_out_says_why(
    vehicles: int, text: str, shard: int | None, words: str
) -> None:
    with pytest.raises(ValueError, match=words) as raised:
        choose(vehicles, parse_addresses(text), shard)
    assert "\n" not in str(raised.value)


def test_251_vehicles_or_more_without_shards_are_told_of_groups() -> None:
    with pytest.raises(ValueError, match=r"--vehicles 500: .* fly in groups, .* by --shards"):
        check_sysids(1, 500)
    with pytest.raises(ValueError, match="--shard 1: of which"):
        take_part(4, [], 1)


def test_letters_say_what_was_written_and_fit_into_a_datagram() -> None:
    rows = np.zeros(250, ROW)
    rows["vehicle"] = np.arange(250)
    rows["position_ned_m"] = np.arange(750).reshape(-1, 3)
    frames = [(vehicle, beacon(vehicle + 1) * (1 + vehicle % 9)) for vehicle in range(250)]
    letters = write_rows(7, 2, 1.5, rows) + write_frames(7, 2, 1.5, frames)
    assert max(map(len, letters)) <= LETTER_BYTES
    read_back = [letter for data in letters if (letter := read(data))]
    assert len(read_back) == len(letters)
    assert {letter[:3] for letter in read_back} == {(7, 2, 1.5)}
    assert np.concatenate([letter.rows for letter in read_back]).tobytes() == rows.tobytes()
    assert [frame for letter in read_back for frame in letter.frames] == frames


def _some_letters() -> list[bytes]:
    rows = np.zeros(3, ROW)
    rows["vehicle"] = [3, 4, 5]
    return write_rows(7, 2, 1.5, rows) + write_frames(7, 2, 1.5, [(3, beacon(4)), (5, beacon(6))])


@given(
    st.sampled_from(_some_letters()),
    st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)), max_size=6),
    st.integers(0, 200),
    st.binary(max_size=20),
)
def test_no_letter_raises_whatever_became_of_it(
    letter: bytes, changes: list[tuple[int, int]], length: int, tail: bytes
) -> None:
    broken = bytearray(letter)
    for at, value in changes:
        broken[at % len(broken)] = value
    abroad = Abroad(divide(6, 2)[0], 7)
    data = bytes(broken[:length]) + tail
    heard = abroad.learn(data, 2, range(3, 6))
    assert (heard is None) == (abroad.refused["malformed"] + abroad.refused["other mission"] == 1)
    near = abroad.choose(np.zeros((3, 3)), 1e6, 1.6).position_ned_m
    assert np.isfinite(near).all()


def test_what_is_not_the_senders_to_tell_is_counted() -> None:
    abroad = Abroad(divide(6, 2)[0], 7)
    rows, frames = _some_letters()
    assert abroad.learn(rows, 3, range(3, 6)) is None, "another shard's number"
    assert abroad.learn(rows, 2, range(4, 6)) is None, "a vehicle that it does not fly"
    assert abroad.learn(frames, 2, range(3, 5)) is None, "a frame of such a vehicle"
    assert abroad.refused == {"malformed": 3}
    (foreign,) = write_frames(8, 2, 1.5, [(3, beacon(4))])
    assert abroad.learn(foreign, 2, range(3, 6)) is None
    assert abroad.refused["other mission"] == 1
    odd = [(3, beacon(5)), (3, beacon(4)[:-3]), (3, beacon(4) * 2), (3, b""), (3, beacon(4))]
    (letter,) = write_frames(7, 2, 1.5, odd)
    assert abroad.learn(letter, 2, range(3, 6)) == odd[-1:]
    assert abroad.refused["frames"] == 4


def test_no_number_is_taken_that_is_none() -> None:
    for value in (math.nan, math.inf, -math.inf, 3e7):
        for column in ("position_ned_m", "velocity_ned_m_s"):
            rows = np.zeros(3, ROW)
            rows["vehicle"] = [3, 4, 5]
            rows[column][1, 2] = value
            assert read(*write_rows(7, 2, 1.5, rows)) is None
    for time_s in (math.nan, math.inf, -0.1, 1e300):
        assert read(*write_rows(7, 2, time_s, np.zeros(1, ROW))) is None


def test_a_letter_that_was_overtaken_moves_nobody_back() -> None:
    abroad = Abroad(divide(6, 2)[0], 7)
    rows = np.zeros(3, ROW)
    rows["vehicle"] = [3, 4, 5]
    for time_s in (2.0, 1.9):
        rows["position_ned_m"] = time_s
        (letter,) = write_rows(7, 2, time_s, rows)
        assert abroad.learn(letter, 2, range(3, 6)) == []
    near = abroad.choose(np.zeros((3, 3)), 10.0, 2.0)
    np.testing.assert_allclose(near.position_ned_m, 2.0)


def test_a_beacon_is_heard_across_the_border_in_the_radius_and_not_beyond(yard: World) -> None:
    both = Shards(yard, 4, 2)
    assert [fleet.sysids for fleet in both.fleets] == [[1, 2], [3, 4]]
    both.put(1, 0, 10, 10, -20)
    both.put(1, 1, 30, 10, -20)
    both.put(2, 0, 12, 10, -20)
    both.put(2, 1, 30, 12, -20)
    both.fly(0.2)
    both.fleets[1].receive(0, beacon(3), both.now)
    both.fleets[1].receive(1, beacon(4), both.now)
    both.fly(0.2)
    assert [both.heard(1, 0), both.heard(1, 1)] == [[3], [4]]
    assert [both.heard(2, 0), both.heard(2, 1)] == [[], []]
    links = both.fleets[0].radio.figures.report()["links"]
    assert {(one["from"], one["to"]) for one in links if one["delivered"]} == {(3, 1), (4, 2)}


def test_a_beacon_never_crosses_into_another_network(yard: World) -> None:
    both = Shards(yard, 252, 2)
    assert [fleet.sysids[:2] for fleet in both.fleets] == [[1, 2], [1, 2]]
    uids = {vehicle.autopilot.uid for fleet in both.fleets for vehicle in fleet.vehicles}
    assert len(uids) == 252
    both.put(1, 0, 10, 10, -20)
    both.put(2, 1, 12, 10, -20)
    both.fly(0.2)
    both.fleets[1].receive(1, beacon(2), both.now)
    frames = both.fleets[1].abroad
    assert frames is not None
    both.fly(0.2)
    assert both.heard(1, 0) == []
    assert both.fleets[0].vehicles[0].autopilot.peers == []


def test_a_vehicle_of_another_shard_is_seen_and_measured(yard: World) -> None:
    both = Shards(yard, 4, 2)
    both.put(1, 0, 10, 10, -20)
    both.put(2, 1, 13, 10, -20)
    both.fleets[0].dynamics.yaw_rad[0] = 0.0
    both.fly(0.2)
    both.put(1, 0, 10, 10, -20)
    both.put(2, 1, 13, 10, -20)
    both.tell(both.fleets[1])
    both.fly(0.1)
    readings = both.fleets[0].readings
    assert readings.ranges_m[0, FRONT] == pytest.approx(3.0 - 0.3, abs=0.1)
    assert readings.ranges_m[0, BACK] > 3.5
    assert [fix.sysid for fix in readings.peers[0]] == [4]
    assert readings.peers[0][0].range_m == pytest.approx(3.0, abs=0.2)
    assert readings.peers[0][0].direction_body[0] > 0.99


def test_a_contact_across_the_border_is_counted_once_and_pushes_both(yard: World) -> None:
    both = Shards(yard, 4, 2)
    both.put(1, 0, 10, 10, -20)
    both.put(2, 0, 10, 10.5, -20)
    both.fly(0.4)
    assert [fleet.referee.collisions for fleet in both.fleets] == [1, 0]
    gap = both.fleets[1].dynamics.position_ned_m[0] - both.fleets[0].dynamics.position_ned_m[0]
    assert 0.55 < np.linalg.norm(gap) < 0.75
    assert 0.45 < both.fleets[0].referee.min_separation_m < 0.7


def test_a_silenced_radio_is_not_heard_in_another_shard(yard: World) -> None:
    both = Shards(yard, 4, 2)
    both.put(1, 0, 10, 10, -20)
    both.put(2, 0, 11, 10, -20)
    both.fly(0.1)
    assert both.fleets[0].readings.peers[0] == []  # nothing was told when it looked
    both.fly(0.1)
    assert [fix.sysid for fix in both.fleets[0].readings.peers[0]] == [3]
    both.fleets[1].radio.silence(3)
    both.fly(0.3)
    both.fleets[1].receive(0, beacon(3), both.now)
    both.fly(0.1)
    assert both.fleets[0].readings.peers[0] == []
    assert both.heard(1, 0) == []


def test_a_weak_radio_is_weak_in_another_shard(yard: World) -> None:
    both = Shards(yard, 4, 2)
    both.fleets[1].radio.weaken(0, 0.8)
    both.fly(0.3)
    assert both.fleets[0].radio.extra_loss.round(2).tolist() == [0.0, 0.0, 0.8, 0.0]


def test_a_lost_shard_takes_its_vehicles_along_and_may_come_back(yard: World) -> None:
    both = Shards(yard, 4, 2)
    both.put(1, 0, 10, 10, -20)
    both.put(2, 0, 11, 10, -20)
    both.fly(0.2)
    abroad = both.fleets[0].abroad
    assert abroad is not None
    assert len(abroad.strangers(both.now).position_ned_m) == 2
    assert abroad.forget(2) == 1, "one of its two was in the air"
    assert abroad.forget(2) == 0
    assert abroad.slowest_s() == math.inf
    both.fleets[0].step(both.now + STEP_S)
    for _ in range(4):
        both.fleets[0].step(both.now + STEP_S)
    assert both.fleets[0].readings.peers[0] == []
    assert len(abroad.strangers(both.now).position_ned_m) == 0
    both.tell(both.fleets[1])
    both.fly(0.2)
    assert [fix.sysid for fix in both.fleets[0].readings.peers[0]] == [3]


def test_all_shards_have_one_wind_and_chances_of_their_own(yard: World) -> None:
    both = Shards(yard, 4, 2)
    both.fly(1.0)
    nobody = np.zeros(2, dtype=bool)
    one, other = (fleet.wind.over(nobody) for fleet in both.fleets)
    np.testing.assert_array_equal(one, other)
    assert np.linalg.norm(one - [-3, 0, 0]) > 0.01, "it has gusts"
    for number, pair in enumerate(zip(streams(5, 1), streams(5, 2), strict=True)):
        (first, biases), (second, others) = ((one, one.spawn(1)[0]) for one in pair)
        assert (first.random() == second.random()) == (number == WIND)
        assert biases.random() == others.random()


def test_shards_agree_about_the_walls_of_the_radio(tmp_path: Path) -> None:
    file = tmp_path / "faded.yaml"
    radio = "radio: {radius_m: 8.0, path_loss: {exponent: 3, shadowing_db: 6}}"
    file.write_text(YARD.replace("radio: {radius_m: 6.0}", radio))
    both = Shards(load_world(file), 20, 2)
    both.fly(0.5)
    one, other = (fleet.radio.linked for fleet in both.fleets)
    hears, is_heard = other[:10, 10:], one[10:, :10].T
    assert 0 < np.count_nonzero(hears) < hears.size
    np.testing.assert_array_equal(hears, is_heard)
    assert not one[:, 10:].any(), "whom they hear is for their own shard to tell"


def test_a_shard_of_one_flies_as_a_fleet_without_shards(yard: World) -> None:
    alone = Fleet(yard, ["px4"] * 4, seed=5)
    one = Shards(yard, 4, 1)
    for step in range(1, 51):
        assert alone.step(step * STEP_S) == one.fleets[0].step(step * STEP_S)


def test_a_shared_frequency_is_not_simulated_across_shards(tmp_path: Path) -> None:
    file = tmp_path / "busy.yaml"
    file.write_text(YARD.replace("radius_m: 6.0", "radius_m: 6.0, channel: {}"))
    with pytest.raises(WorldError, match=r"busy.yaml: radio.channel: slots of a frequency cannot"):
        Shards(load_world(file), 4, 2)


def test_a_frame_from_abroad_is_lost_as_any_other(yard: World) -> None:
    both = Shards(yard, 4, 2)
    both.fly(0.2)
    both.fleets[0].radio.weaken(0, 1.0)
    both.put(1, 0, 10, 10, -20)
    both.put(2, 0, 11, 10, -20)
    both.fly(0.2)
    both.fleets[1].receive(0, beacon(3), both.now)
    both.fly(0.2)
    assert both.heard(1, 0) == []
    fates = both.fleets[0].radio.figures.totals().fates
    assert fates[Fate.LOSS, 2, 0] == 1
