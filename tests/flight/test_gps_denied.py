"""Flights without satellites, and in frames that vehicles share; closest approaches are printed."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from flight_log import Flight

from mock_vehicle.fleet import Fleet
from swarm_ctl import wire
from swarm_ctl.experiment.arena import Arena
from swarm_ctl.frames import turn
from swarm_ctl.mission import load_mission
from swarm_ctl.model import Vec3
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.record.journal import read_journal

Launch = Callable[..., Flight]
MISSIONS = Path(__file__).parents[2] / "missions"
EXPLORES = ("exploring", "avoiding")
STARTS = {1: [3, 3, 0], 2: [5, 3, 0], 3: [3, 5, 0], 4: [5, 5, 0]}
SURVEYED = {"shared": "surveyed", "starts_m": STARTS}
GNSS = {"shared": "gnss"}
DENIED = {"reception": "denied"}
ROOM: dict[str, Any] = {
    "size_m": [10, 10],
    "starts": {"grid": {"origin_m": [3, 3], "spacing_m": 2.0, "columns": 2}},
    "radio": {"radius_m": 50.0, "ranging": False},
}
"""A room too small for four, whose radios carry beacons and measure nobody."""


def truly_m(flight: Flight, sysid: int) -> np.ndarray[Any, Any]:
    """Give where a vehicle is, NED in the world."""
    place: np.ndarray[Any, Any] = flight.arena.fleet.dynamics.position_ned_m[sysid - 1]
    return place


def seen_wrong_m(flight: Flight) -> float:
    """Give how far from the truth a vehicle sees any of its peers, at most."""
    worst = 0.0
    for controller in flight.arena.controllers:
        agent = controller.agent
        for sysid, peer in zip(agent.peers.heard(agent.now), agent.neighbours, strict=True):
            gap = truly_m(flight, sysid) - truly_m(flight, agent.sysid)
            worst = max(worst, math.dist(gap, peer.offset_ned_m))
    return worst


def explore_together(flight: Flight) -> float:
    """Fly to the end; give how far from the truth a peer was seen while all explored."""
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    worst = 0.0
    while flight.all_in(*EXPLORES):
        flight.fly(0.5)
        worst = max(worst, seen_wrong_m(flight))
    flight.fly_to_the_end()
    assert [c.agent.trouble for c in flight.arena.controllers] == [""] * len(
        flight.arena.controllers
    )
    print(f"closest approach {flight.truth()['min_separation_m']:.2f} m, seen {worst:.2f} m off")  # noqa: T201
    return worst


def events(flight: Flight, name: str) -> list[dict[str, Any]]:
    """Give the events of a name that the run's journals hold."""
    journals = flight.folder.path.rglob("*.jsonl")
    entries = [entry for path in sorted(journals) for entry in read_journal(path)]
    return [entry for entry in entries if entry["event"] == name]


# -- without satellites ----------------------------------------------------------------------------


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_without_satellites_vehicles_explore_and_come_home(launch: Launch, autopilot: str) -> None:
    sensors = {"odometry_drift_fraction": 0.01}
    flight = launch(autopilot=autopilot, world={"gnss": DENIED, "sensors": sensors})
    explore_together(flight)
    assert flight.all_in("done")
    assert flight.truth()["coverage_fraction"] > 0.1
    assert flight.truth()["collisions"] == 0
    for vehicle, controller in zip(
        flight.arena.fleet.vehicles, flight.arena.controllers, strict=True
    ):
        assert not vehicle.autopilot.navigation.has_origin, "nobody has told it where on the globe"
        assert controller.agent.telemetry.origin is None
        assert math.dist(truly_m(flight, vehicle.sysid), vehicle.home_ned_m) < 1.5


def test_an_autopilot_without_satellites_is_told_its_origin(launch: Launch) -> None:
    frame = {**SURVEYED, "origin": [-33.9, 151.2, 20.0]}
    flight = launch(autopilot="mixed", world={**ROOM, "gnss": DENIED}, frame=frame)
    flight.fly_until(lambda: all(c.agent.telemetry.origin for c in flight.arena.controllers))
    one, two = (c.agent.telemetry.origin for c in flight.arena.controllers)
    assert one is not None
    assert two is not None
    assert (two.longitude_deg - one.longitude_deg) * 92_400 == pytest.approx(2.0, abs=0.05)
    assert one.latitude_deg == pytest.approx(-33.9 + 3.0 / 110_900, abs=1e-6)
    assert not any(vehicle.armed for vehicle in flight.arena.fleet.vehicles)


def test_the_cellar_is_searched_by_vehicles_that_know_their_starts(tmp_path: Path) -> None:
    mission = load_mission(MISSIONS / "gps_denied.yaml", duration_s=60.0)
    with RunFolder.create(
        tmp_path / "run", mission.name, mission.dump(), seed=mission.seed, mode="virtual"
    ) as folder:
        flight = Flight(Arena(mission, folder), folder)
        assert explore_together(flight) < 0.6
        assert flight.truth()["min_separation_m"] > 0.85
        assert flight.truth()["coverage_fraction"] > 0.7


def test_a_frame_of_satellites_is_not_flown_without_them(launch: Launch) -> None:
    flight = launch(world={"gnss": DENIED}, frame=GNSS)
    flight.fly_to_the_end()
    assert flight.all_in("failed")
    assert "no origin on the globe" in flight.agent(1).trouble
    assert not any(vehicle.armed for vehicle in flight.arena.fleet.vehicles)


# -- in a shared frame, by beacons alone -----------------------------------------------------------


@pytest.mark.parametrize(
    ("frame", "gnss"), [(SURVEYED, DENIED), (GNSS, {})], ids=["surveyed", "gnss"]
)
def test_vehicles_whom_nobody_measures_keep_apart_by_what_they_tell(
    launch: Launch, frame: dict[str, Any], gnss: dict[str, Any]
) -> None:
    world = {**ROOM, "gnss": gnss}
    flight = launch(vehicles=4, autopilot="mixed", duration_s=60.0, world=world, frame=frame)
    assert explore_together(flight) < 0.4
    assert flight.truth()["min_separation_m"] > 0.85
    assert flight.truth()["collisions"] == 0


def test_without_a_shared_frame_the_same_vehicles_come_too_close(launch: Launch) -> None:
    flight = launch(vehicles=4, autopilot="mixed", duration_s=60.0, world={**ROOM, "gnss": DENIED})
    explore_together(flight)
    assert all(not c.agent.peers.heard(c.agent.now) for c in flight.arena.controllers)
    assert flight.truth()["min_separation_m"] < 0.8


@pytest.mark.parametrize(
    ("frame", "learns"), [({}, False), (SURVEYED, True)], ids=["none", "surveyed"]
)
def test_the_ground_that_others_have_seen_is_shared_in_a_shared_frame(
    launch: Launch, frame: dict[str, Any], learns: bool
) -> None:
    flight = launch(world=ROOM, frame=frame, planner={"kind": "explore"}, duration_s=100.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    flight.fly(20)
    sharing = flight.agent(1)._sharing
    assert sharing is not None
    place = (
        truly_m(flight, 2) - truly_m(flight, 1) + np.array(flight.agent(1).telemetry.position_ned_m)
    )
    flight.fly(5)  # until it has been told of
    assert bool(sharing.explorer.trails.length(2)) == learns
    assert bool(sharing.explorer.memory.flags(place[:2])) == learns


def test_a_vehicle_that_waits_on_the_ground_is_where_its_start_was_surveyed(
    launch: Launch,
) -> None:
    """Both estimators began 6 m away from where the vehicles stand."""
    spaced = {"start_spacing_s": 15.0}
    moved = ("drift@0,fraction=0,jump_m=6",)
    world = {**ROOM, "gnss": DENIED}
    flight = launch(world=world, frame=SURVEYED, flight=spaced, faults=moved)
    flight.fly_until(lambda: flight.agent(1).phase.value in EXPLORES)
    assert flight.agent(2).phase.value == "ready"
    assert flight.agent(1).peers.heard(flight.arena.now) == (2,)
    assert seen_wrong_m(flight) < 0.4


def test_a_peer_that_the_radio_measures_elsewhere_than_it_says_is_noted_once(
    launch: Launch,
) -> None:
    world = {**ROOM, "gnss": DENIED, "radio": {"radius_m": 50.0}}
    lost = ("drift:1@25,fraction=0,jump_m=6",)
    flight = launch(world=world, frame=SURVEYED, duration_s=40.0, faults=lost)
    flight.fly_to_the_end()
    noted = events(flight, "PeerElsewhere")
    assert sorted((event["sysid"], event["data"]["peer"]) for event in noted) == [(1, 2), (2, 1)]
    assert noted[0]["data"]["apart_m"] == pytest.approx(6.0, abs=1.0)
    assert flight.truth()["min_separation_m"] > 0.75


# -- estimators that begin anywhere and point anywhere ---------------------------------------------


class Estimator(NamedTuple):
    """An estimator that began elsewhere and that has its x axis to somewhere else than north."""

    began_ned_m: Vec3
    """From where it began to the vehicle's start."""
    yaw_rad: float
    """Where its x axis points, clockwise from north."""

    def tell(self, data: bytes) -> bytes:
        """Turn what the autopilot says of north into what this estimator would have said."""
        return rewrite(data, {"LOCAL_POSITION_NED": self._position, "ATTITUDE": self._attitude})

    def obey(self, data: bytes) -> bytes:
        """Turn setpoints in this estimator's axes into setpoints along north."""
        return rewrite(data, {"SET_POSITION_TARGET_LOCAL_NED": self._setpoint})

    def _position(self, values: Any) -> Any:
        place = Vec3(*(p + b for p, b in zip(values[1:4], self.began_ned_m, strict=True)))
        velocity = turn(Vec3(*values[4:7]), -self.yaw_rad)
        return type(values)(values.time_boot_ms, *turn(place, -self.yaw_rad), *velocity)

    def _attitude(self, values: Any) -> Any:
        return values._replace(yaw=math.remainder(values.yaw - self.yaw_rad, math.tau))

    def _setpoint(self, values: Any) -> Any:
        north = turn(Vec3(values.vx, values.vy, values.vz), self.yaw_rad)
        return values._replace(vx=north.x, vy=north.y, vz=north.z, yaw=values.yaw + self.yaw_rad)


def rewrite(data: bytes, changes: dict[str, Callable[[Any], Any]]) -> bytes:
    """Change some of the messages in a datagram."""
    parser, packed = wire.Parser(changes), []
    ids = {wire.message(name).id: name for name in changes}
    for raw in wire.split(data):
        frame = next(iter(parser.feed(raw)), None)
        if frame is None:
            packed.append(raw)
        else:
            values = changes[ids[frame.id]](frame.values)
            message = wire.message(frame.id)
            packed.append(message.pack(frame.seq, frame.sysid, frame.compid, *values))
    return b"".join(packed)


def give(fleet: Fleet, estimators: list[Estimator], monkeypatch: pytest.MonkeyPatch) -> None:
    """Put an estimator between each vehicle of a fleet and its controller."""
    step, receive = fleet.step, fleet.receive

    def tell(now: float) -> list[tuple[int, bytes]]:
        return [(index, estimators[index].tell(data)) for index, data in step(now)]

    def obey(index: int, data: bytes, now: float, link: int = 0) -> None:
        receive(index, estimators[index].obey(data), now, link)

    monkeypatch.setattr(fleet, "step", tell)
    monkeypatch.setattr(fleet, "receive", obey)


def test_estimators_without_a_compass_are_flown_in_one_surveyed_frame(
    launch: Launch, monkeypatch: pytest.MonkeyPatch
) -> None:
    estimators = [
        Estimator(Vec3(40.0, -7.0, 2.0), math.radians(yaw_deg)) for yaw_deg in (90, -135, 180, 20)
    ]
    frame = {**SURVEYED, "yaw_offset_deg": {1: 90, 2: -135, 3: 180, 4: 20}}
    world = {**ROOM, "gnss": DENIED}
    flight = launch(
        vehicles=4,
        autopilot="mixed",
        duration_s=60.0,
        world=world,
        frame=frame,
        planner={"kind": "explore"},
    )
    give(flight.arena.fleet, estimators, monkeypatch)
    assert explore_together(flight) < 0.4
    assert flight.truth()["min_separation_m"] > 0.85
    assert flight.truth()["collisions"] == 0
    assert flight.truth()["coverage_fraction"] > 0.9
    for vehicle in flight.arena.fleet.vehicles:
        assert math.dist(truly_m(flight, vehicle.sysid), vehicle.home_ned_m) < 1.0


def test_a_second_flight_from_elsewhere_is_one_in_the_same_frame(launch: Launch) -> None:
    """Origins stay where the autopilots were switched on; starts are where the first one ended."""
    world = {**ROOM, "size_m": [30, 30]}
    first = launch(autopilot="mixed", world=world, flight={"return_home": False}, duration_s=30.0)
    first.fly_to_the_end()
    late = {"ready_timeout_s": 3600.0}
    second = launch(autopilot="mixed", world=world, frame=GNSS, flight=late)
    second.arena.fleet, second.arena.now = first.arena.fleet, first.arena.now
    second.arena._step = first.arena._step
    assert explore_together(second) < 0.4
    for controller in second.arena.controllers:
        assert math.hypot(*controller.agent.telemetry.start_ned_m) > 3.0
    assert second.truth()["min_separation_m"] > 0.85
