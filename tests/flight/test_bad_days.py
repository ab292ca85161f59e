"""A swarm loses vehicles, hears them again, meets strangers: what becomes of what was shared."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from flight_log import Flight, strike

from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.beacon import mission_tag
from swarm_ctl.agent.phases import EXPLORES, STEERING
from swarm_ctl.controller import Controller
from swarm_ctl.explore.trails import log_of
from swarm_ctl.model import Operator

Launch = Callable[..., Flight]
SWARM: dict[str, Any] = {
    "planner": {"kind": "explore", "footprint_m": 0.8, "cell_m": 0.4, "levy_min_m": 2.0},
    "duration_s": 400.0,
    "world": {"radio": {"radius_m": 30.0}, "victims": []},
}


def all_explore(flight: Flight) -> bool:
    return all(controller.agent.phase in EXPLORES for controller in flight.arena.controllers)


def trails(flight: Flight, sysid: int) -> Any:
    explorer = flight.agent(sysid).explorer
    assert explorer is not None
    return explorer.trails


def unseen_m(flight: Flight, here: Any, there: Any) -> float:
    """How much of a straight way nobody has seen, of what can be seen."""
    grid = flight.arena.fleet.referee.coverage
    missing = np.any(grid.free & np.isnan(grid.seen_s), axis=0)
    along = np.arange(0.0, math.dist(here, there), 0.1)[:, None]
    points = here[:2] + along / math.dist(here, there) * (there - here)[:2]
    i, j = ((points - grid.origin_ne_m) / grid.cell_m).astype(int).T
    inside = (i < missing.shape[0]) & (j < missing.shape[1])
    return 0.1 * float(missing[i[inside], j[inside]].sum())


# -- who is lost ---------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [1, 4])
def test_the_strip_of_a_vehicle_that_dies_in_it_is_flown_by_another(
    launch: Launch, seed: int
) -> None:
    flight = launch(vehicles=3, seed=seed, **SWARM)
    agent, fleet = flight.agent(1), flight.arena.fleet
    flight.fly_until(lambda: all_explore(flight))

    def strip() -> tuple[Any, Any]:
        target = agent.target_ned_m or agent.telemetry.position_ned_m
        return fleet.dynamics.position_ned_m[0].copy(), target + fleet.starts_ned_m[0]

    flight.fly_until(lambda: agent.phase in EXPLORES and unseen_m(flight, *strip()) > 2.0)
    here, there = strip()
    strike(flight, "dead")
    flight.fly_until(lambda: unseen_m(flight, here, there) == 0.0, within_s=200.0)


@pytest.mark.parametrize("order", [Operator.RETURN, Operator.PAUSE])
def test_who_explores_no_more_claims_no_ground(launch: Launch, order: Operator) -> None:
    flight = launch(vehicles=2, **SWARM)
    agent, peer = flight.agent(1), flight.agent(2)

    def is_claimed() -> bool:
        assert peer.explorer is not None
        return len(peer.explorer.company.claims(peer.now)) > 0

    flight.fly_until(lambda: all_explore(flight))
    flight.fly(12.0)
    flight.fly_until(is_claimed)
    assert agent.order(order, flight.arena.now)
    flight.fly(2.0)
    assert agent.phase in STEERING - EXPLORES
    assert not is_claimed()


# -- who comes back ------------------------------------------------------------------------------


def test_who_was_silent_and_is_heard_again_tells_what_it_saw(launch: Launch) -> None:
    flight = launch(vehicles=2, **SWARM)
    flight.fly_until(lambda: all_explore(flight))
    flight.fly(10)
    strike(flight, "silent-radio", 40.0)
    flight.fly(39)
    heard_of, seen = trails(flight, 2).length(1), flight.truth()["coverage_fraction"]
    assert heard_of < 0.7 * trails(flight, 1).length(1)
    flight.fly(6)
    assert trails(flight, 2).length(1) > 0.9 * trails(flight, 1).length(1)
    assert trails(flight, 1).length(2) > 0.9 * trails(flight, 2).length(2)
    assert flight.truth()["coverage_fraction"] >= seen


def test_who_begins_anew_elsewhere_is_heard_from_its_first_word(launch: Launch) -> None:
    flight = launch(vehicles=3, **SWARM)
    fleet = flight.arena.fleet
    flight.fly_until(lambda: all_explore(flight))
    flight.fly(30)
    assert flight.agent(1).order(Operator.LAND, flight.arena.now)
    flight.fly_until(lambda: flight.agent(1).phase.value == "done")
    flight.fly(2)
    written = trails(flight, 2).length(1)
    assert written > 20
    shift = trails(flight, 2)._logs[1].shift_m

    born = fleet.dynamics.position_ned_m[0].copy()
    assert math.dist(born[:2], fleet.starts_ned_m[0][:2]) > 2.0
    successor = Agent(1, flight.agent(1).orders, birth=77)
    flight.arena.controllers[0] = Controller(0, successor, flight.folder)
    flight.fly_until(lambda: all_explore(flight))
    flight.fly(15)

    log = log_of(1, 77)
    assert trails(flight, 1).own == log
    for reader in (2, 3):
        told = trails(flight, reader)
        assert told.length(log) > 0.8 * trails(flight, 1).length(log) > 0
        assert told.length(1) == written
        away = born[:2] - fleet.starts_ned_m[reader - 1][:2]
        assert told._logs[log].shift_m == pytest.approx(away, abs=0.5)
    assert trails(flight, 2)._logs[1].shift_m == pytest.approx(shift, abs=0.1)
    # and it has learnt what it saw in its first life, where it saw it
    assert trails(flight, 1).length(1) == written
    back = fleet.starts_ned_m[0][:2] - born[:2]
    assert trails(flight, 1)._logs[1].shift_m == pytest.approx(back, abs=0.5)


def test_a_swarm_that_fell_apart_knows_again_what_each_half_saw(launch: Launch) -> None:
    apart = {"from_s": 15.0, "until_s": 45.0, "groups": [[1, 2], [3, 4]]}
    world = {**SWARM["world"], "radio": {"radius_m": 30.0, "partitions": [apart]}}
    flight = launch(vehicles=4, **{**SWARM, "world": world})
    flight.fly(44.0)
    assert flight.agent(1).peers.heard(flight.arena.now) == (2,)
    lacks = [1.0 - trails(flight, 1).length(3) / trails(flight, 3).length(3)]
    flight.fly(8.0)
    assert flight.agent(1).peers.heard(flight.arena.now) == (2, 3, 4)
    lacks.append(1.0 - trails(flight, 1).length(3) / trails(flight, 3).length(3))
    assert lacks[0] > 0.4
    assert lacks[1] < 0.1
    for one, other in itertools.permutations((1, 2, 3, 4), 2):
        copy = trails(flight, one).entries(other)
        assert copy == trails(flight, other).entries(other)[: len(copy)]
    assert flight.truth()["collisions"] == 0


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_a_vehicle_whose_frame_jumps_is_found_again_and_hits_nobody(
    launch: Launch, autopilot: str
) -> None:
    flight = launch(vehicles=3, autopilot=autopilot, **SWARM)
    flight.fly_until(lambda: all_explore(flight))
    flight.fly(15)
    before = trails(flight, 2)._contacts._peers[1].shift_m
    strike(flight, "drift", fraction=0.0, jump_m=6.0, towards_deg=90.0)
    flight.fly(10)
    after = trails(flight, 2)._contacts._peers[1].shift_m
    assert np.subtract(before, after) == pytest.approx([6.0, 0.0], abs=0.7)
    seen = flight.truth()["coverage_fraction"]
    flight.fly(60)
    assert all_explore(flight)
    assert flight.truth()["coverage_fraction"] > min(seen + 0.2, 0.9)
    assert flight.truth()["collisions"] == 0
    assert flight.truth()["min_separation_m"] > 0.75


# -- strangers -----------------------------------------------------------------------------------


def count_planned_with(agent: Agent) -> list[int]:
    """Write down how many peers the planner is told of, each time it is asked."""
    counts: list[int] = []
    ask = agent._ask

    def witness(position: Any, heading: Any, ranges: Any, peers: Any) -> Any:
        counts.append(len(peers))
        return ask(position, heading, ranges, peers)

    agent._ask = witness
    return counts


@pytest.mark.parametrize("together_s", [0.0, 20.0])
def test_vehicles_of_another_mission_are_kept_away_from_and_else_ignored(
    launch: Launch, together_s: float
) -> None:
    flight = launch(vehicles=4, **SWARM)
    agents = [controller.agent for controller in flight.arena.controllers]
    friends, everybody = {1: 2, 2: 1, 3: 4, 4: 3}, {1, 2, 3, 4}
    if together_s:
        flight.fly_until(lambda: all_explore(flight))
        flight.fly(together_s)
    for agent in agents[2:]:
        agent.talk.tag = mission_tag("another")
    flight.fly(1.0)
    known = {
        (reader, writer): trails(flight, reader).length(writer)
        for reader in everybody
        for writer in everybody - {reader, friends[reader]}
    }
    counts = [count_planned_with(agent) for agent in agents]
    flight.fly_until(lambda: all_explore(flight))
    flight.fly(60.0)
    for agent, planned_with in zip(agents, counts, strict=True):
        assert agent.peers.heard(flight.arena.now) == tuple(sorted(everybody - {agent.sysid}))
        assert max(planned_with) == 1
    for (reader, writer), length in known.items():
        assert trails(flight, reader).length(writer) == length
    assert flight.truth()["collisions"] == 0
    assert flight.truth()["min_separation_m"] > 0.75


def test_two_of_one_number_in_two_missions_are_nobodys_peer(launch: Launch) -> None:
    flight = launch(vehicles=3, **SWARM)
    flight.fly_until(lambda: all_explore(flight))
    double, reader = flight.agent(3), flight.agent(1)
    counts = count_planned_with(reader)

    def fly_as_two() -> None:
        double.talk.tag = mission_tag("another" if double.talk.tag == reader.talk.tag else "hall")
        flight.fly(0.2)

    for _ in range(10):
        fly_as_two()
    known = trails(flight, 1).length(3)
    counts.clear()
    for _ in range(100):
        fly_as_two()
    assert max(counts) == 1
    assert trails(flight, 1).length(3) == known
