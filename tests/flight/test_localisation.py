"""Swarms whose radios measure badly, tell late and lose a third, or whose peers fall silent."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from flight_log import Flight

from swarm_ctl.agent import beacon as beacons
from swarm_ctl.agent.peer import WARY_S, ZONE_S, minus, plus
from swarm_ctl.agent.phases import Phase
from swarm_ctl.agent.sender import Sender
from swarm_ctl.model import ZERO, Vec3

Launch = Callable[..., Flight]
CROWD: dict[str, Any] = {"vehicles": 6, "duration_s": 60.0}
ARENA: dict[str, Any] = {
    "size_m": [9, 9],
    "starts": {"grid": {"origin_m": [2.5, 2.5], "spacing_m": 2.0, "columns": 3}},
}
BAD_RADIO: dict[str, Any] = {
    "radius_m": 3.0,
    "delay_s": 0.2,
    "loss_fraction": 0.3,
    "ranging": {
        "range_noise_m": 0.05,
        "bearing_noise_deg": 3.0,
        "range_bias_m": 0.05,
        "outlier_fraction": 0.05,
        "delay_s": 0.2,
        "blind": [{"from_deg": 150, "to_deg": 210}],
    },
}


def errors_m(flight: Flight) -> list[float]:
    """Give how far off the place of each peer is that each vehicle knows, now."""
    place = flight.arena.fleet.dynamics.position_ned_m
    return [
        math.dist(neighbour.offset_ned_m, (place[sysid - 1] - place[index]).tolist())
        for index, controller in enumerate(flight.arena.controllers)
        for sysid, neighbour in zip(
            controller.agent.peers.heard(controller.agent.now),
            controller.agent.neighbours,
            strict=True,
        )
    ]


def test_a_crowd_with_bad_radios_keeps_apart_and_comes_home(launch: Launch) -> None:
    flight = launch(world={**ARENA, "radio": BAD_RADIO}, **CROWD)
    flight.fly_until(lambda: flight.all_in("exploring", "avoiding"))
    errors: list[float] = []
    for _ in range(50):
        flight.fly(seconds=1.0)
        errors += errors_m(flight)
    flight.fly_to_the_end()
    assert flight.truth()["min_separation_m"] > 0.7
    assert flight.all_in("done")
    assert math.sqrt(sum(error**2 for error in errors) / len(errors)) < 0.35


def test_one_whose_radio_dies_nearby_is_kept_clear_of_for_a_while_and_all_come_home(
    launch: Launch,
) -> None:
    flight = launch(world={**ARENA, "radio": {"radius_m": 3.0}}, **CROWD)
    flight.fly_until(lambda: flight.all_in("exploring", "avoiding"))
    one, other = (flight.agent(sysid).telemetry for sysid in (1, 2))
    starts_apart = Vec3(0.0, 2.0, 0.0)

    def apart_m() -> float:
        offset = plus(minus(other.position_ned_m, one.position_ned_m), starts_apart)
        return math.hypot(*offset)

    flight.fly_until(lambda: apart_m() < 1.3)
    flight.arena.fleet.radio.silence(sysid=1)
    flight.fly(seconds=1.5)
    peers, here = flight.agent(2).peers, other.position_ned_m
    assert 1 not in peers.heard(flight.arena.now)
    assert len(peers.zones(here, 2.0, flight.arena.now)) == 1
    assert apart_m() > 0.7
    flight.fly(seconds=ZONE_S)
    assert peers.zones(here, 2.0, flight.arena.now) == []
    flight.fly_to_the_end()
    assert flight.all_in("done")


@pytest.mark.parametrize("way", ["radio", "network", "no way"])
def test_who_hears_somebody_not_measured_yet_stops_for_a_moment(launch: Launch, way: str) -> None:
    flight = launch(vehicles=1)
    agent = flight.agent(1)

    def speed_m_s() -> float:
        return math.hypot(*agent.telemetry.velocity_ned_m_s)

    flight.fly_until(lambda: flight.all_in("exploring") and speed_m_s() > 0.9)
    stranger = beacons.Beacon(agent.talk.tag, Phase.EXPLORING, ZERO, ZERO, None, ())
    told = Sender(2).broadcast(beacons.BEACON_TYPE, beacons.encode(stranger))
    if way == "radio":
        agent.receive(told, flight.arena.now)
    elif way == "network":  # which reaches farther than radios measure
        agent.overhear(told, flight.arena.now)
    flight.fly(WARY_S)
    assert (speed_m_s() < 0.5) == (way == "radio")
    flight.fly_until(lambda: speed_m_s() > 0.9, within_s=10.0)
