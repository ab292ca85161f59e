"""What every fault does to a flight, measured in virtual time."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mock_vehicle.autopilot.traits import Rates
from mock_vehicle.faults import Fault
from mock_vehicle.faults.kinds import KINDS
from mock_vehicle.fleet import Fleet
from mock_vehicle.lossy import EFFECTS
from mock_vehicle.trouble import AT_ONCE, LASTING
from mock_vehicle.world import load_world
from swarm_ctl import wire

HALL = """
name: hall
size_m: [60, 40]
ceiling_m: 8
starts: [{position_m: [10, 20], yaw_deg: 0}, {position_m: [14, 20], yaw_deg: 0}]
radio: {radius_m: 20}
"""
SEVEN = (0.0,) * 7
CLIMB_M = 4.0
MODE = {"px4": 6 << 16, "ardupilot": 4}
ARM, REQUEST_MESSAGE, VELOCITY = 400, 512, 0xDC7
MESSAGES = (
    *("HEARTBEAT", "ATTITUDE", "LOCAL_POSITION_NED", "DISTANCE_SENSOR", "COMMAND_ACK"),
    *("BATTERY_STATUS", "TUNNEL", "AUTOPILOT_VERSION", "GPS_RAW_INT", "STATUSTEXT"),
)


class Log:
    """Two neighbours in a hall; notes what each companion hears, and when."""

    def __init__(self, fleet: Fleet) -> None:
        self.fleet = fleet
        self.steps = 0
        self.velocity = [(0.0, 0.0, 0.0)] * fleet.n
        self.streaming = False
        self.parsers = [wire.Parser(MESSAGES) for _ in range(fleet.n)]
        self.heard: list[list[tuple[float, wire.Frame]]] = [[] for _ in range(fleet.n)]
        self.digest = [hashlib.sha256() for _ in range(fleet.n)]

    @property
    def now(self) -> float:
        return self.steps * self.fleet.step_s

    def send(self, index: int, name: str, *values: object) -> None:
        frame = wire.message(name).pack(0, self.fleet.sysids[index], 191, *values)
        self.fleet.receive(index, frame, self.now)

    def command(self, index: int, number: int, *parameters: float) -> None:
        padded = (*parameters, *SEVEN)[:7]
        self.send(index, "COMMAND_LONG", self.fleet.sysids[index], 1, number, 0, *padded)

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds / self.fleet.step_s)):
            if self.streaming and self.steps % 5 == 0:
                for index, velocity in enumerate(self.velocity):
                    values = (0, index + 1, 1, 1, VELOCITY, *SEVEN[:3], *velocity, *SEVEN[:5])
                    self.send(index, "SET_POSITION_TARGET_LOCAL_NED", *values)
            self.steps += 1
            for index, data in self.fleet.step(self.now):
                self.digest[index].update(b"%d:%b" % (self.steps, data))
                frames = self.parsers[index].feed(data)
                self.heard[index] += [(self.now, frame) for frame in frames]

    def take_off(self) -> None:
        """Climb to 4 m and hover there."""
        self.streaming = True
        self.fly(2.0)
        for index, kind in enumerate(self.fleet.personalities):
            if kind == "px4":
                self.command(index, 176, 1, 6)
            else:
                self.command(index, 176, 1, 4)
            self.fly(0.2)
            self.command(index, ARM, 1)
            if kind == "ardupilot":
                self.command(index, 22, 0, 0, 0, 0, 0, 0, CLIMB_M)
                self.streaming = False
        if self.streaming:
            self.velocity = [(0.0, 0.0, -1.0)] * self.fleet.n
        for _ in range(300):
            self.fly(0.1)
            if (self.height_m > CLIMB_M - 0.3).all():
                break
        self.velocity = [(0.0, 0.0, 0.0)] * self.fleet.n
        self.streaming = True
        self.fly(3.0)
        self.forget()

    def strike(
        self, kind: str, vehicle: int = 1, duration_s: float | None = None, **v: Any
    ) -> None:
        self.fleet.strike(Fault(0.0, vehicle, kind, duration_s, v), self.now)

    def forget(self) -> None:
        for heard in self.heard:
            heard.clear()

    def frames(self, name: str, index: int = 0) -> list[wire.Frame]:
        number = wire.message(name).id
        return [f for _, f in self.heard[index] if f.id == number and f.compid == 1]

    def times(self, name: str, index: int = 0) -> list[float]:
        number = wire.message(name).id
        return [at for at, f in self.heard[index] if f.id == number and f.compid == 1]

    @property
    def results(self) -> list[int]:
        return [frame.values.result for frame in self.frames("COMMAND_ACK")]

    @property
    def height_m(self) -> Any:
        return -self.fleet.dynamics.position_ned_m[:, 2]


Begin = Callable[..., Log]


@pytest.fixture
def begin(tmp_path: Path) -> Begin:
    def start(
        *faults: Fault, autopilot: str = "px4", rates: Rates = "full", seed: int = 1, more: str = ""
    ) -> Log:
        file = tmp_path / "hall.yaml"
        file.write_text(HALL + more)
        kinds = [autopilot] * 2
        return Log(Fleet(load_world(file), kinds, seed=seed, rates=rates, faults=faults))

    return start


def test_every_kind_does_something() -> None:
    assert {*AT_ONCE, *LASTING, "fleet"} == set(KINDS)
    for name, kind in KINDS.items():
        assert kind.lasts == (name in LASTING), name


# The vehicle.


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_with_a_dead_motor_it_is_on_the_ground_in_a_second_and_believes_to_fly(
    begin: Begin, autopilot: str
) -> None:
    log = begin(autopilot=autopilot)
    log.take_off()
    log.strike("motor")
    log.fly(1.3)
    assert log.height_m[0] == 0.0
    assert log.height_m[1] > 3.0
    log.fly(5.0)
    last = log.frames("HEARTBEAT")[-1].values
    assert last.base_mode & 128
    assert last.custom_mode == MODE[autopilot]
    assert log.fleet.vehicles[0].flying


def test_a_gust_blows_one_vehicle_away_from_where_it_comes(begin: Begin) -> None:
    log = begin()
    log.take_off()
    before = log.fleet.dynamics.position_ned_m.copy()
    log.strike("wind-gust", speed_m_s=12.0, from_deg=180.0, duration_s=2.0)
    log.fly(2.0)
    moved = log.fleet.dynamics.position_ned_m - before
    assert moved[0, 1] > 0.5, "a west wind blows east"
    assert abs(moved[0, 0]) < 0.1
    assert np.abs(moved[1]).max() < 0.1
    log.fly(10.0)
    assert np.abs(log.fleet.dynamics.velocity_ned_m_s[0]).max() < 0.2, "it is over"


@pytest.mark.parametrize(
    ("parameters", "kind"),
    [({"SIM_GPS1_ENABLE": 0}, "fix"), ({"SIM_ENGINE_MUL": 0, "SIM_ENGINE_FAIL": 1}, "motor")],
)
def test_the_simulators_own_parameters_break_and_mend_ardupilot(
    begin: Begin, parameters: dict[str, float], kind: str
) -> None:
    log = begin(autopilot="ardupilot", rates="lean")

    def is_broken(index: int) -> bool:
        fleet = log.fleet
        whole = (
            fleet.gnss.reception[index] > 0
            if kind == "fix"
            else not fleet.dynamics.motor_lost[index]
        )
        return not whole

    before = {name: log.fleet.vehicles[0].autopilot.parameters[name] for name in parameters}
    for values, is_expected in ((parameters, True), (before, False)):
        for name, value in values.items():
            log.send(0, "PARAM_SET", 1, 1, name, float(value), 9)
        log.fly(0.2)
        assert (is_broken(0), is_broken(1)) == (is_expected, False)


# The battery.


def test_a_battery_falls_to_the_charge_told(begin: Begin) -> None:
    log = begin()
    log.strike("battery", fraction=0.4)
    log.fly(3.0)
    told = [frame.values.battery_remaining for frame in log.frames("BATTERY_STATUS")]
    assert told[-1] in {39, 40}
    assert log.fleet.batteries.fraction[1] > 0.9


def test_a_drain_empties_the_battery_by_its_power(begin: Begin) -> None:
    log = begin()
    log.fly(1.0)
    energy_j = log.fleet.batteries.energy_j.copy()
    log.strike("battery-drain", power_w=300.0, duration_s=10.0)
    log.fly(20.0)
    drawn = log.fleet.batteries.energy_j - energy_j
    assert drawn[0] - drawn[1] == pytest.approx(3000.0, rel=0.02)


# Sensors.


def test_lost_rangefinders_are_back_after_their_time(begin: Begin) -> None:
    log = begin()
    log.strike("rangefinder", duration_s=2.0)
    log.fly(0.2)
    log.forget()
    log.fly(1.7)
    assert not log.frames("DISTANCE_SENSOR")
    log.fly(0.5)
    assert log.frames("DISTANCE_SENSOR")


def test_faults_of_one_kind_may_overlap(begin: Begin) -> None:
    log = begin()
    log.strike("rangefinder", duration_s=1.0)
    log.strike("rangefinder", duration_s=3.0)
    log.fly(2.0)
    assert np.isnan(log.fleet.readings.ranges_m[0]).all()
    log.fly(1.2)
    assert not np.isnan(log.fleet.readings.ranges_m[0]).any()


def test_stuck_rangefinders_repeat_themselves_while_the_ground_falls_away(begin: Begin) -> None:
    log = begin()
    log.take_off()
    log.strike("rangefinder-stuck")
    log.velocity[0] = (0.0, 0.0, -0.5)
    log.forget()
    log.fly(4.0)
    down = {
        f.values.current_distance
        for f in log.frames("DISTANCE_SENSOR")
        if f.values.orientation == 25
    }
    assert len(down) == 1
    assert log.height_m[0] > 5.0
    log.fleet.heal(log.now, vehicle=1)
    log.fly(0.2)
    assert log.fleet.readings.ranges_m[0, 5] == pytest.approx(log.height_m[0], abs=0.1)


def test_noisy_rangefinders_scatter_as_told(begin: Begin) -> None:
    log = begin()
    log.take_off()
    log.strike("rangefinder-noise", noise_m=0.25)
    log.forget()
    log.fly(15.0)
    down = [
        [
            f.values.current_distance / 100
            for f in log.frames("DISTANCE_SENSOR", index)
            if f.values.orientation == 25
        ]
        for index in range(2)
    ]
    assert np.std(down[0]) == pytest.approx(0.25, rel=0.2)
    assert np.std(down[1]) < 0.05


def test_a_vehicle_without_satellites_has_no_fix_until_they_are_back(begin: Begin) -> None:
    log = begin()
    log.fly(6.0)
    log.strike("gnss-loss", duration_s=3.0)
    log.fly(0.2)
    log.forget()
    log.fly(2.7)
    assert {f.values.fix_type for f in log.frames("GPS_RAW_INT")} == {1}
    assert {f.values.fix_type for f in log.frames("GPS_RAW_INT", 1)} == {3}
    log.fly(1.0)
    assert log.frames("GPS_RAW_INT")[-1].values.fix_type == 3


def test_a_glitch_moves_the_fix_and_an_estimate_that_hangs_on_it(begin: Begin) -> None:
    log = begin()
    log.fly(6.0)
    log.strike("gnss-glitch", offset_m=11.1, towards_deg=90.0, duration_s=2.0)
    before = log.frames("GPS_RAW_INT")[-1].values
    log.fly(1.0)
    glitched = log.frames("GPS_RAW_INT")[-1].values
    assert glitched.lat - before.lat == pytest.approx(1000, abs=5), "11.1 m north, in degE7"
    assert glitched.lon == pytest.approx(before.lon, abs=1)
    assert log.frames("LOCAL_POSITION_NED")[-1].values.x == pytest.approx(11.1, abs=0.01)
    log.fly(2.0)
    assert log.frames("GPS_RAW_INT")[-1].values.lat == before.lat


def test_ardupilot_lands_when_it_has_been_without_satellites_for_8_s(begin: Begin) -> None:
    log = begin(autopilot="ardupilot")
    log.take_off()
    log.forget()
    start = log.now
    log.strike("gnss-loss")
    log.fly(16.0)
    modes = [(at - start, f.values) for at, f in log.heard[0] if f.id == 0]
    at, landing = next((at, beat) for at, beat in modes if beat.custom_mode == 9)
    assert at == pytest.approx(8.2, abs=0.15)
    assert (landing.system_status, landing.base_mode & 128) == (5, 128)
    said = [(round(at - start), f.values.text) for at, f in log.heard[0] if f.id == 253]
    assert said == [
        (8, "EKF variance"),
        (8, "EKF Failsafe: changed to LAND Mode"),
        (15, "EKF3 IMU1 stopped aiding"),
        (15, "EKF3 IMU0 stopped aiding"),
    ]
    assert {f.values.custom_mode for f in log.frames("HEARTBEAT", 1)} == {4}


def test_drift_loses_a_tenth_of_the_way(begin: Begin) -> None:
    log = begin()
    log.take_off()
    log.strike("drift", fraction=0.1)
    log.velocity = [(0.0, 1.0, 0.0)] * 2
    start = log.fleet.dynamics.position_ned_m[0].copy()
    log.fly(15.0)
    way = np.linalg.norm(log.fleet.dynamics.position_ned_m[0] - start)
    off = np.linalg.norm(log.fleet.readings.drift_ned_m, axis=1)
    assert off[0] == pytest.approx(0.1 * way, rel=0.05)
    assert off[1] == 0.0


def test_a_jump_of_the_estimate_is_seen_at_once_and_stays(begin: Begin) -> None:
    log = begin()
    log.take_off()
    before = log.fleet.vehicles[0].autopilot.state
    log.strike("drift", fraction=0.0, jump_m=2.0, towards_deg=90.0, duration_s=1.0)
    log.fly(3.0)
    after = log.fleet.vehicles[0].autopilot.state
    assert after.north_m - before.north_m == pytest.approx(2.0, abs=0.1)
    assert after.east_m - before.east_m == pytest.approx(0.0, abs=0.1)


# The autopilot.


def test_a_frozen_autopilot_is_silent_and_back_after_its_time(begin: Begin) -> None:
    log = begin()
    log.take_off()
    log.strike("freeze", duration_s=3.0)
    start = log.now
    log.fly(4.0)
    assert min(log.times("ATTITUDE")) - start == pytest.approx(3.0, abs=0.03)


def test_frozen_telemetry_repeats_an_old_state_while_it_flies_and_obeys(begin: Begin) -> None:
    log = begin()
    log.take_off()
    log.velocity[0] = (0.0, 1.0, 0.0)
    log.strike("frozen-telemetry", duration_s=5.0)
    log.command(0, REQUEST_MESSAGE, 148)
    log.fly(4.0)
    positions = log.frames("LOCAL_POSITION_NED")
    assert len({frame.values.y for frame in positions}) == 1
    assert len({frame.values.time_boot_ms for frame in positions}) == len(positions)
    assert log.results == [0]
    assert log.fleet.dynamics.velocity_ned_m_s[0, 1] == pytest.approx(1.0, abs=0.1)
    log.fly(2.0)
    assert log.frames("LOCAL_POSITION_NED")[-1].values.y > positions[0].values.y + 3.0


def test_a_reboot_in_the_air_stops_the_motors_and_begins_anew(begin: Begin) -> None:
    log = begin()
    log.take_off()
    log.strike("reboot")
    log.fly(3.0)
    assert log.height_m[0] == 0.0
    assert not log.fleet.vehicles[0].armed
    assert log.frames("ATTITUDE")[-1].values.time_boot_ms < 3100


def test_lost_parameters_are_back_at_their_defaults(begin: Begin) -> None:
    log = begin()
    parameters = log.fleet.vehicles[1].autopilot.parameters
    name = "COM_OF_LOSS_T"
    default = parameters[name]
    log.fleet.vehicles[1].autopilot.set_parameter(name, default + 5.0)
    log.strike("parameters-lost", vehicle=2)
    assert parameters[name] == default
    log.strike("reboot", vehicle=2)
    assert log.fleet.vehicles[1].autopilot.sysid == 2, "but for the sysid"


def test_a_command_is_refused_as_often_as_told(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("nack", command=ARM, result="denied", count=2)
    for _ in range(3):
        log.command(0, ARM, 1)
        log.command(0, REQUEST_MESSAGE, 148)
        log.fly(0.1)
    arm = [f.values.result for f in log.frames("COMMAND_ACK") if f.values.command == ARM]
    assert arm == [2, 2, 0]
    assert log.results.count(0) == 4, "other commands are none of its business"
    assert log.fleet.vehicles[0].armed


def test_every_command_is_refused_until_it_heals(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("nack")
    log.command(0, REQUEST_MESSAGE, 148)
    log.fleet.heal(log.now, kind="nack")
    log.command(0, REQUEST_MESSAGE, 148)
    log.fly(0.1)
    assert log.results == [1, 0]


def test_late_acknowledgements_are_late_and_nothing_else_is(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("ack-late", delay_s=0.7)
    asked = log.now
    log.command(0, REQUEST_MESSAGE, 148)
    log.fly(1.0)
    assert log.times("COMMAND_ACK") == [pytest.approx(asked + 0.7, abs=0.03)]
    assert log.times("AUTOPILOT_VERSION") == [pytest.approx(asked, abs=0.03)]


def test_two_acknowledgements_are_lost_and_the_third_arrives(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("ack-lost", count=2)
    for _ in range(3):
        log.command(0, REQUEST_MESSAGE, 148)
    log.fly(0.5)
    assert len(log.frames("AUTOPILOT_VERSION")) == 3
    assert len(log.frames("COMMAND_ACK")) == 1


# The radio.


def peers_heard(log: Log, index: int) -> int:
    number = wire.message("DISTANCE_SENSOR").id
    return sum(f.id == number and f.compid == 68 for _, f in log.heard[index])


def test_a_silent_radio_is_heard_again_after_its_time(begin: Begin) -> None:
    log = begin()
    log.strike("silent-radio", duration_s=2.0)
    log.fly(1.9)
    assert peers_heard(log, 1) == 0
    log.fly(1.1)
    assert peers_heard(log, 1) == pytest.approx(10, abs=1)


def test_a_weak_radio_loses_its_share(begin: Begin) -> None:
    log = begin(rates="lean")
    log.strike("radio-loss", fraction=0.3)
    log.fly(60.0)
    for index in range(2):
        assert peers_heard(log, index) / 600 == pytest.approx(0.7, abs=0.06)


# The links.


def test_every_fault_of_a_link_leaves_the_others_as_they_were(begin: Begin) -> None:
    sound = begin()
    sound.fly(3.5)
    for kind in EFFECTS:
        log = begin(Fault(2.0, 1, kind))
        log.fly(3.5)
        assert log.digest[1].digest() == sound.digest[1].digest(), kind
        if not kind.startswith("ack"):
            assert log.digest[0].digest() != sound.digest[0].digest(), kind


@pytest.mark.parametrize("rates", ["full", "lean"])
def test_equal_seeds_lose_equally(begin: Begin, rates: Rates) -> None:
    def flown(seed: int) -> str:
        faults = [
            Fault(2.0, None, "link-loss", 4.0, {"fraction": 0.5}),
            Fault(3.0, 1, "link-delay", None, {"delay_s": 0.2, "jitter_s": 0.2}),
        ]
        log = begin(*faults, rates=rates, seed=seed)
        log.fly(8.0)
        return log.digest[0].hexdigest()

    assert flown(1) == flown(1) != flown(2)


def test_a_lost_link_is_silent_for_its_time_in_both_directions(begin: Begin) -> None:
    log = begin(Fault(5.0, 1, "link-loss", 3.0))
    log.streaming = True
    log.fly(5.0)
    log.forget()
    received = log.fleet.vehicles[0].received
    log.fly(4.0)
    assert min(log.times("ATTITUDE")) == pytest.approx(8.0, abs=0.02)
    stream = [at for at in log.fleet.vehicles[0].setpoint_times if at > 5.0]
    assert min(stream) == pytest.approx(8.0, abs=0.06)
    assert log.fleet.vehicles[0].received - received == len(stream)


@pytest.mark.parametrize(
    ("direction", "down", "up"),
    [("both", 0.7, 0.7), ("uplink", 1.0, 0.7), ("downlink", 0.7, 1.0)],
)
def test_a_share_of_frames_is_lost(begin: Begin, direction: str, down: float, up: float) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("link-loss", fraction=0.3, direction=direction)
    log.forget()
    log.streaming = True
    received = log.fleet.vehicles[0].received
    log.fly(20.0)
    counts = [len(log.frames("ATTITUDE", index)) for index in range(2)]
    assert counts[0] / counts[1] == pytest.approx(down, abs=0.03)
    assert (log.fleet.vehicles[0].received - received) / 400 == pytest.approx(up, abs=0.06)


def test_everything_is_late_by_the_delay_and_in_order(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("link-delay", delay_s=0.3)
    log.fly(0.5)
    log.forget()
    asked = log.now
    log.command(0, REQUEST_MESSAGE, 148)
    log.fly(3.0)
    assert log.times("COMMAND_ACK") == [pytest.approx(asked + 0.6, abs=0.03)], "there and back"
    ages = [at - f.values.time_boot_ms / 1000 for at, f in log.heard[0] if f.id == 30]
    assert np.mean(ages) == pytest.approx(0.3, abs=0.011)
    sequences = [f.seq for _, f in log.heard[0] if f.id in {30, 32}]
    assert all((b - a) % 256 < 128 for a, b in pairwise(sequences))


def test_with_jitter_frames_overtake_one_another(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("link-delay", delay_s=0.1, jitter_s=0.2, direction="downlink")
    log.fly(10.0)
    frames = [(at, f.values.time_boot_ms / 1000) for at, f in log.heard[0] if f.id == 30]
    ages = [at - sent for at, sent in frames if sent > 2.1]
    assert min(ages) == pytest.approx(0.1, abs=0.015)
    assert max(ages) == pytest.approx(0.3, abs=0.015)
    assert np.mean(ages) == pytest.approx(0.2, abs=0.01)
    sent = [s for _, s in frames]
    assert sent != sorted(sent)


def test_a_link_in_bursts_speaks_every_second(begin: Begin) -> None:
    log = begin()
    log.fly(2.5)
    log.strike("link-burst", period_s=1.0)
    log.forget()
    log.fly(10.0)
    bursts = Counter(round(at, 2) for at in log.times("ATTITUDE"))
    assert list(bursts) == [float(second) for second in range(3, 13)]
    assert [*bursts.values()][1:] == [pytest.approx(100, abs=1)] * 9
    sent = [f.values.time_boot_ms for f in log.frames("ATTITUDE")]
    assert sent == sorted(sent)


def test_a_link_that_stutters_says_everything_twice(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("link-duplicate")
    log.forget()
    log.fly(5.0)
    sent = Counter(f.raw for f in log.frames("ATTITUDE"))
    assert set(sent.values()) == {2}
    log.command(0, REQUEST_MESSAGE, 148)
    log.fly(0.1)
    assert len(log.frames("COMMAND_ACK")) == 4, "the command came twice, and each answer"


def test_some_frames_are_held_back_and_overtaken(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("link-reorder", fraction=0.25, hold_s=0.1)
    log.forget()
    log.fly(20.0)
    ages = np.array([at - f.values.time_boot_ms / 1000 for at, f in log.heard[0] if f.id == 30])
    assert np.mean(ages > 0.05) == pytest.approx(0.25, abs=0.03)
    assert ages.max() == pytest.approx(0.1, abs=0.015)


def test_a_frozen_link_gives_everything_at_once_when_it_thaws(begin: Begin) -> None:
    log = begin(Fault(3.0, 1, "link-freeze", 4.0))
    log.fly(3.0)
    log.forget()
    log.streaming = True
    log.fly(4.5)
    times = Counter(round(at, 2) for at in log.times("ATTITUDE"))
    assert min(times) == 7.0
    assert times[7.0] == pytest.approx(400, abs=2)
    assert max(count for at, count in times.items() if at > 7.0) == 1
    sent = [f.values.time_boot_ms for f in log.frames("ATTITUDE")]
    assert sent == sorted(sent), "nothing is lost or mixed up"
    arrived = Counter(round(at, 2) for at in log.fleet.vehicles[0].setpoint_times)
    assert arrived[7.0] == pytest.approx(80, abs=2)


def test_what_was_under_way_arrives_in_order_when_a_delay_ends(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.forget()
    log.strike("link-delay", delay_s=1.0, jitter_s=1.0, duration_s=3.0)
    log.fly(6.0)
    sent = [f.values.time_boot_ms for at, f in log.heard[0] if f.id == 30]
    assert len(sent) == len(set(sent)) == pytest.approx(600, abs=2)
    since = [f.values.time_boot_ms for at, f in log.heard[0] if f.id == 30 and at >= 5.0]
    assert since == sorted(since)


def test_the_link_to_the_ground_station_fails_alone(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("link-loss", link="ground-station")
    log.fleet.answers(0, 1)
    log.forget()
    log.fly(2.0)
    assert log.fleet.answers(0, 1) == []
    assert len(log.fleet.answers(1, 1)) > 100
    assert len(log.frames("ATTITUDE")) == pytest.approx(200, abs=2)


def test_several_faults_of_a_link_act_one_after_the_other(begin: Begin) -> None:
    log = begin()
    log.fly(2.0)
    log.strike("link-duplicate")
    log.strike("link-delay", delay_s=0.2)
    log.strike("link-delay", delay_s=0.3, direction="downlink")
    log.fly(1.0)
    log.forget()
    log.fly(4.0)
    assert set(Counter(f.raw for f in log.frames("ATTITUDE")).values()) == {2}
    ages = [at - f.values.time_boot_ms / 1000 for at, f in log.heard[0] if f.id == 30]
    assert np.mean(ages) == pytest.approx(0.5, abs=0.011)


def test_a_struck_vehicle_must_fly(begin: Begin) -> None:
    log = begin()
    with pytest.raises(ValueError, match="there is no vehicle 7; they are 1 to 2"):
        log.strike("dead", vehicle=7)
