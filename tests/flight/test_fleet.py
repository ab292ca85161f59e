from __future__ import annotations

import hashlib
import importlib
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest

from mock_vehicle.autopilot.link import OUTBOX_FRAMES
from mock_vehicle.errors import WorldError
from mock_vehicle.faults import Fault, parse_fault
from mock_vehicle.fleet import STEP_S, Fleet, apart
from mock_vehicle.referee import write_files
from mock_vehicle.trouble import FleetKilled
from mock_vehicle.world import load_world
from swarm_ctl import wire

PX4_OFFBOARD = 6 << 16
GUIDED = 4
CUSTOM_MODE_ENABLED = 1
VELOCITY_AND_YAW_RATE = 0b0000_0101_1100_0111
HALL = "size_m: [30, 20]\nceiling_m: 4\n"
TELEMETRY = ("HEARTBEAT", "LOCAL_POSITION_NED", "DISTANCE_SENSOR", "LANDING_TARGET", "TUNNEL")


class Flight:
    """A fleet in virtual time, and for each vehicle a companion that streams a velocity."""

    def __init__(self, fleet: Fleet) -> None:
        self.fleet = fleet
        self.now = 0.0
        self.velocity = [(0.0, 0.0, 0.0)] * fleet.n
        self.heard: list[list[wire.Frame]] = [[] for _ in range(fleet.n)]
        self.digest = hashlib.sha256()
        self._streaming = False
        self._steps = 0
        self._parsers = [wire.Parser(TELEMETRY) for _ in range(fleet.n)]

    def send(self, index: int, name: str, *values: object) -> None:
        frame = wire.message(name).pack(0, self.fleet.sysids[index], 191, *values)
        self.fleet.receive(index, frame, self.now)

    def command(self, index: int, number: int, *parameters: float) -> None:
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        self.send(index, "COMMAND_LONG", self.fleet.sysids[index], 1, number, 0, *padded)

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            if self._streaming and self._steps % 5 == 0:
                for index, velocity in enumerate(self.velocity):
                    self._stream(index, velocity)
            self._steps += 1
            self.now = self._steps * STEP_S
            for index, data in self.fleet.step(self.now):
                self.digest.update(bytes([index]) + data)
                self.heard[index] += self._parsers[index].feed(data)

    def _stream(self, index: int, velocity: tuple[float, float, float]) -> None:
        target = (int(self.now * 1000), self.fleet.sysids[index], 1, 1, VELOCITY_AND_YAW_RATE)
        zeros = (0.0, 0.0, 0.0)
        self.send(
            index, "SET_POSITION_TARGET_LOCAL_NED", *target, *zeros, *velocity, *zeros, 0.0, 0.0
        )

    def take_off(self, height_m: float = 1.5) -> None:
        """Arm everybody and climb to about a height."""
        self._streaming = True
        self.fly(2.0)
        for index in range(self.fleet.n):
            self.command(index, 176, CUSTOM_MODE_ENABLED, 6)
        self.fly(0.5)
        for index in range(self.fleet.n):
            self.command(index, 400, 1)
        self.velocity = [(0.0, 0.0, -1.0)] * self.fleet.n
        down = self.fleet.dynamics.position_ned_m[:, 2]
        for _ in range(200):
            self.fly(0.1)
            for index in np.nonzero(down < -height_m)[0].tolist():
                self.velocity[index] = (0.0, 0.0, 0.0)
            if (down < -height_m).all():
                break
        self.fly(2.0)
        assert (down < -0.8 * height_m).all()

    def count(self, index: int, name: str, compid: int = 1) -> int:
        number = wire.message(name).id
        return sum(f.id == number and f.compid == compid for f in self.heard[index])


Launch = Callable[..., Flight]


@pytest.fixture
def launch(tmp_path: Path) -> Launch:
    def start(
        *starts_xy: tuple[float, float],
        world: str = HALL,
        autopilot: str = "px4",
        seed: int = 1,
        faults: list[Fault] | None = None,
    ) -> Flight:
        file = tmp_path / "world.yaml"
        starts = ", ".join(f"{{position_m: [{x}, {y}]}}" for x, y in starts_xy)
        file.write_text(f"name: hall\n{dedent(world)}\nstarts: [{starts}]\n")
        personalities = [autopilot] * len(starts_xy)
        return Flight(Fleet(load_world(file), personalities, seed=seed, faults=faults or []))

    return start


def test_every_vehicle_speaks_ten_times_a_second(launch: Launch) -> None:
    flight = launch((5, 5), (10, 10))
    flight.fly(5.0)
    for index in range(2):
        assert 3 <= flight.count(index, "HEARTBEAT") <= 6
        assert {frame.sysid for frame in flight.heard[index]} == {index + 1}
        orientations = Counter(
            frame.values.orientation
            for frame in flight.heard[index]
            if frame.id == wire.message("DISTANCE_SENSOR").id
        )
        assert set(orientations) == {0, 12, 6, 2, 24, 25}


def test_a_fleet_at_full_rates_does_not_speak_all_at_once(tmp_path: Path) -> None:
    file = tmp_path / "world.yaml"
    file.write_text("name: field\nsize_m: [60, 60]\n")
    fleet = Fleet(load_world(file), ["px4"] * 25, seed=1, rates="full")
    datagrams = [len(fleet.step(fleet.step_s * step)) for step in range(1, 501)]
    assert sum(datagrams) > 25 * 200 * 500 * fleet.step_s
    assert max(datagrams[200:]) < 150  # the receive buffer of a client takes about 250


def test_vehicles_that_take_turns_say_as_much_and_never_speak_in_one_step(launch: Launch) -> None:
    places = [(4.0 * index + 2.0, 5.0) for index in range(6)]
    together, in_turn = launch(*places), launch(*places)
    in_turn.fleet.takes_turns = True
    together.fly(5.0)
    in_turn.fly(5.0)
    for index in range(6):
        kinds = [Counter(f.id for f in flight.heard[index]) for flight in (together, in_turn)]
        assert kinds[0].keys() == kinds[1].keys()
        assert all(abs(kinds[0][kind] - kinds[1][kind]) <= 6 for kind in kinds[0])
    steps = [[i for i, _ in in_turn.fleet.step(5.0 + STEP_S * k)] for k in range(1, 11)]
    assert max(map(len, steps)) == 2
    assert Counter(index for step in steps for index in step) == dict.fromkeys(range(6), 2)


def test_frames_that_full_queues_drop_are_counted(
    launch: Launch, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mock_vehicle.lossy.HELD_MAX", 3)
    flight = launch((5, 5), faults=[parse_fault("link-freeze:1@3,direction=downlink")])
    flight.fly(2.9)
    assert flight.fleet.dropped == 0
    flight.fly(1.0)
    held_back = flight.fleet.dropped
    assert held_back > 50
    link = flight.fleet.vehicles[0].autopilot.links[0]
    for _ in range(OUTBOX_FRAMES + 5):
        link.queue(b"")
    assert flight.fleet.dropped == held_back + 5


def test_same_seed_same_bytes(launch: Launch) -> None:
    noisy = (
        HALL
        + """
sensors: {range_noise_m: 0.05, odometry_drift_fraction: 0.02}
wind: {speed_m_s: 2, gust_m_s: 0.5}
radio: {radius_m: 20, loss_fraction: 0.2, delay_s: 0.05, jitter_s: 0.05, duplicate_fraction: 0.1,
        path_loss: {shadowing_db: 6}, channel: {bit_rate_bit_s: 19200},
        ranging: {bearing_noise_deg: 3, range_noise_m: 0.1}}
"""
    )

    def digest(seed: int) -> str:
        flight = launch((5, 5), (8, 5), (11, 5), world=noisy, seed=seed)
        flight.take_off()
        flight.velocity = [(0.5, 0.0, 0.0), (0.0, 1.0, 0.0), (0.3, -0.3, 0.0)]
        flight.fly(5.0)
        return flight.digest.hexdigest()

    assert digest(1) == digest(1)
    assert digest(1) != digest(2)


def test_a_vehicle_pressed_into_a_wall_stops_there_and_collides_once(launch: Launch) -> None:
    flight = launch((15, 10))
    flight.take_off()
    flight.velocity = [(3.0, 0.5, 0.0)]
    flight.fly(8.0)
    north, east, _ = flight.fleet.dynamics.position_ned_m[0]
    assert north == pytest.approx(20.0 - 0.3, abs=0.05)
    assert east > 17.0  # it slides along
    assert flight.fleet.referee.collisions == 1
    flight.velocity = [(-2.0, 0.0, 0.0)]
    flight.fly(2.0)
    flight.velocity = [(3.0, 0.0, 0.0)]
    flight.fly(4.0)
    assert flight.fleet.referee.collisions == 2


def test_landing_and_taking_off_is_no_collision(launch: Launch) -> None:
    flight = launch((15, 10))
    flight.take_off()
    flight.velocity = [(0.0, 0.0, 0.7)]
    flight.fly(6.0)
    assert flight.fleet.dynamics.on_ground[0]
    assert flight.fleet.referee.collisions == 0


@pytest.mark.parametrize("compiled", [False, True])
def test_who_is_landed_on_a_box_stands_there_and_takes_off_from_it(
    launch: Launch, *, compiled: bool
) -> None:
    box = "boxes: [{center_m: [15, 10], size_m: [2, 2], height_m: 0.5}]"
    flight = launch((12, 10), world=f"{HALL}\n{box}")
    if compiled:
        pytest.importorskip("numba")
        flight.fleet.compile()
    flight.take_off()
    flight.velocity = [(0.0, 1.0, 0.0)]
    flight.fly(3.0)
    flight.velocity = [(0.0, 0.0, 0.0)]
    flight.fly(2.0)
    flight.command(0, 176, CUSTOM_MODE_ENABLED, 4, 6)  # AUTO.LAND
    flight.fly(10.0)
    body = flight.fleet.dynamics
    assert body.on_ground[0]
    assert body.position_ned_m[0, 2] == pytest.approx(-0.8, abs=0.02)
    assert not flight.fleet.vehicles[0].autopilot.armed
    flight.take_off(2.0)
    flight.velocity = [(0.0, -1.0, 0.0)]
    flight.fly(4.0)
    flight.velocity = [(0.0, 0.0, 0.7)]
    flight.fly(6.0)
    assert body.on_ground[0]
    assert body.position_ned_m[0, 2] == 0.0


def test_compiled_distances_are_the_plain_ones_bit_for_bit() -> None:
    pytest.importorskip("numba")
    loops = importlib.import_module("mock_vehicle.world.loops")
    rng = np.random.default_rng(5)
    here, there = rng.normal(0.0, 50.0, (40, 3)), rng.normal(0.0, 50.0, (57, 3))
    plain = apart(here, there)
    assert plain == pytest.approx(np.linalg.norm(there - here[:, None], axis=2))
    assert np.array_equal(apart(here, there, loops), plain)


def test_two_that_meet_collide_once_and_hold_each_other_off(launch: Launch) -> None:
    flight = launch((10, 10), (14, 10))
    flight.take_off()
    assert flight.fleet.referee.snapshot()["min_separation_m"] == pytest.approx(4.0, abs=0.1)
    flight.velocity = [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0)]
    flight.fly(6.0)
    apart = np.linalg.norm(np.diff(flight.fleet.dynamics.position_ned_m, axis=0))
    assert apart == pytest.approx(0.6, abs=0.05)
    assert flight.fleet.referee.collisions == 1
    flight.velocity = [(0.0, -1.0, 0.0), (0.0, 1.0, 0.0)]
    flight.fly(3.0)
    assert flight.fleet.referee.collisions == 1
    assert flight.fleet.referee.snapshot()["min_separation_m"] == pytest.approx(0.6, abs=0.06)


def test_neighbours_on_the_ground_have_no_separation(launch: Launch) -> None:
    flight = launch((10, 10), (10.8, 10))
    flight.fly(2.0)
    assert flight.fleet.referee.snapshot()["min_separation_m"] is None
    assert flight.fleet.referee.collisions == 0


def test_beacons_reach_peers_in_the_radius_alone(launch: Launch) -> None:
    flight = launch((5, 5), (7, 5), (9, 5), world=HALL + "radio: {radius_m: 2.5}")
    flight.fly(1.5)
    flight.send(0, "TUNNEL", 0, 0, 40417, 5, b"hello")
    flight.fly(0.5)
    assert [flight.count(index, "TUNNEL", 191) for index in range(3)] == [0, 1, 0]
    assert [flight.count(index, "DISTANCE_SENSOR", 68) > 0 for index in range(3)] == [True] * 3
    flight.fleet.radio.silence(2)
    flight.fly(0.5)
    flight.send(0, "TUNNEL", 0, 0, 40417, 5, b"hello")
    flight.fly(0.5)
    assert flight.count(1, "TUNNEL", 191) == 1


def test_a_victim_is_found_once_by_the_first_to_see_it(launch: Launch) -> None:
    flight = launch(
        (5, 5),
        (25, 5),
        world=HALL + "victims: [{name: ann, position_m: [10, 5, 0.3]}]\ninfrared: {range_m: 2}",
    )
    flight.take_off()
    assert flight.fleet.referee.snapshot()["victims_found"] == 0
    flight.velocity = [(0.0, 1.0, 0.0), (0.0, 0.0, 0.0)]
    flight.fly(6.0)
    assert flight.fleet.referee.snapshot()["victims_found"] == 1
    assert flight.fleet.referee.victim_found_by.tolist() == [1]
    assert flight.count(0, "LANDING_TARGET") > 5
    assert flight.count(1, "LANDING_TARGET") == 0


def test_odometry_drifts_with_the_way_flown(launch: Launch) -> None:
    flight = launch((5, 10), world=HALL + "sensors: {odometry_drift_fraction: 0.05}")
    flight.take_off()
    flight.velocity = [(0.0, 2.0, 0.0)]
    flight.fly(10.0)
    drift = np.linalg.norm(flight.fleet.readings.drift_ned_m[0])
    way = flight.fleet.referee.path_length_m[0]
    assert 0.5 * 0.05 * way < drift <= 0.05 * way + 1e-9
    assert flight.fleet.readings.drift_ned_m[0, 2] == 0.0


def test_wind_comes_from_where_the_world_says(launch: Launch) -> None:
    flight = launch((15, 10), world=HALL + "wind: {from_deg: 0, speed_m_s: 8}")
    start = flight.fleet.dynamics.position_ned_m.copy()
    flight.fly(5.0)
    assert np.array_equal(flight.fleet.dynamics.position_ned_m, start)  # parked
    flight.take_off()
    blown = flight.fleet.dynamics.position_ned_m[0] - start[0]
    assert blown[1] < 0.0  # from the east, so to the west
    assert abs(blown[0]) < 0.05


def test_the_truth_is_written(launch: Launch, tmp_path: Path) -> None:
    world = HALL + "victims: [{name: ann, position_m: [10, 5, 0.3]}]"
    flight = launch((5, 5), (25, 5), world=world)
    flight.take_off()
    flight.velocity = [(0.0, 1.0, 0.0), (0.0, 0.0, 0.0)]
    flight.fly(6.0)
    folder = tmp_path / "run" / "truth"
    write_files(folder, flight.fleet.files(so_far=True, pace={"behind_s": 0.25}))
    assert json.loads((folder / "truth.json").read_text())["behind_s"] == 0.25
    assert json.loads((folder / "truth.json").read_text())["vehicles_per_cell"] is None
    flight.fleet.write(folder)
    assert json.loads((folder / "truth.json").read_text())["vehicles_per_cell"] >= 1.0
    assert sorted(file.name for file in folder.iterdir()) == [
        "radio.json",
        "truth.json",
        "truth.npz",
        "world.json",
    ]
    truth = json.loads((folder / "truth.json").read_text())
    assert truth["victims"][0]["found_by"] == 1
    assert truth["path_lengths_m"][0] > 6.0
    assert truth["energy_kwh"] == pytest.approx(2 * 0.18 * flight.now / 3600, rel=0.5)
    assert truth["setpoint_jitter_p99_ms"] == pytest.approx(0.0, abs=1e-3)
    with np.load(folder / "truth.npz") as arrays:
        t = len(arrays["track_time_s"])
        assert t == pytest.approx(2 * flight.now, abs=1.1)
        assert arrays["track_ned_m"].shape == (t, 2, 3)
        assert arrays["seen_s"].shape == arrays["free"].shape == arrays["blocked"].shape
        assert arrays["seen_s"].dtype == np.float32
        assert (np.diff(arrays["coverage_fraction"]) >= 0.0).all()
        assert arrays["coverage_fraction"][-1] > 0.0
        assert arrays["links"].shape == (len(arrays["coverage_time_s"]), 1)
        assert not arrays["links"].any(), "20 m apart"
        assert arrays["victim_found_by"].tolist() == [1]
        assert arrays["sysids"].tolist() == [1, 2]


def strike(launch: Launch, kind: str, **options: str) -> Flight:
    """Two neighbours take off; the first is struck 20 s into the flight."""
    world = options.get("world", HALL + "radio: {radius_m: 20}")
    flight = launch((5, 10), (8, 10), world=world, faults=[Fault(20.0, 1, kind)])
    flight.take_off()
    flight.fly(19.5 - flight.now)
    for heard in flight.heard:
        heard.clear()
    flight.fly(1.0)
    for heard in flight.heard:
        heard.clear()
    return flight


def test_the_dead_fall_silent_and_drop(launch: Launch) -> None:
    flight = strike(launch, "dead")
    flight.fly(2.0)
    assert flight.heard[0] == []
    assert flight.count(1, "DISTANCE_SENSOR", 68) == 0
    assert flight.fleet.dynamics.on_ground.tolist() == [True, False]
    assert [v["alive"] for v in flight.fleet.referee.snapshot()["vehicles"]] == [False, True]
    assert flight.fleet.referee.snapshot()["airborne"] == 1


def test_a_silent_radio_keeps_flying(launch: Launch) -> None:
    flight = strike(launch, "silent-radio")
    flight.fly(2.0)
    assert flight.count(0, "HEARTBEAT") >= 1
    assert [flight.count(index, "DISTANCE_SENSOR", 68) for index in range(2)] == [0, 0]
    assert not flight.fleet.dynamics.on_ground.any()


def test_an_empty_battery_is_seen_by_its_vehicle(launch: Launch) -> None:
    flight = strike(launch, "battery")
    assert flight.fleet.readings.battery_fraction[0] <= 0.1
    assert flight.fleet.readings.battery_fraction[1] > 0.9


def test_lost_rangefinders_report_nothing(launch: Launch) -> None:
    flight = strike(launch, "rangefinder")
    flight.fly(1.0)
    assert np.isnan(flight.fleet.readings.ranges_m[0]).all()
    assert np.isfinite(flight.fleet.readings.ranges_m[1]).any()


def test_a_frozen_autopilot_comes_back(launch: Launch) -> None:
    flight = strike(launch, "freeze")
    flight.fly(3.0)
    assert flight.heard[0] == []
    flight.fly(3.0)
    assert flight.count(0, "HEARTBEAT") >= 1


def test_the_fleet_dies_without_a_word(launch: Launch) -> None:
    flight = launch((5, 5), faults=[parse_fault("fleet@1")])
    flight.fly(0.9)
    with pytest.raises(FleetKilled):
        flight.fly(0.2)


def test_a_fault_without_a_sysid_strikes_all(launch: Launch) -> None:
    flight = launch((5, 5), (8, 5), world=HALL + "faults: [{time_s: 1, kind: dead}]")
    flight.fly(1.2)
    assert not any(vehicle.alive for vehicle in flight.fleet.vehicles)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("daed:3@60", "did you mean 'dead'"),
        ("dead:3", "expected KIND:SYSID@SECONDS"),
        ("dead:x@60", "'x' is no sysid"),
        ("dead:3@soon", "'soon' is no number"),
        ("fleet:3@60", "takes no vehicle"),
        ("dead:3@-1", "from 0 s on"),
    ],
)
def test_a_wrong_fault_is_explained(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match="--fault") as caught:
        parse_fault(text)
    assert reason in str(caught.value)


def test_a_fault_is_read() -> None:
    assert parse_fault("silent-radio:3@60.5") == Fault(60.5, 3, "silent-radio")
    assert parse_fault("fleet@60") == Fault(60.0, None, "fleet")


def test_a_fault_needs_a_vehicle_that_flies(launch: Launch) -> None:
    with pytest.raises(ValueError, match="there is no vehicle 7; they are 1 to 1"):
        launch((5, 5), faults=[Fault(1.0, 7, "dead")])


def test_a_world_with_an_unknown_fault_names_file_and_key(launch: Launch) -> None:
    with pytest.raises(WorldError, match=r"world\.yaml: faults\[0\]\.kind: .*'battery'"):
        launch((5, 5), world=HALL + "faults: [{time_s: 1, vehicle: 1, kind: batery}]")


def test_ardupilot_flies_here_too(launch: Launch) -> None:
    flight = launch((5, 5), autopilot="ardupilot")
    flight.fly(5.0)
    flight.command(0, 176, CUSTOM_MODE_ENABLED, GUIDED)
    flight.fly(0.5)
    flight.command(0, 400, 1)
    flight.fly(0.5)
    flight.command(0, 22, 0, 0, 0, 0, 0, 0, 1.5)
    flight.fly(10.0)
    assert flight.fleet.dynamics.position_ned_m[0, 2] == pytest.approx(-1.5, abs=0.2)
    assert flight.fleet.referee.snapshot()["airborne"] == 1
