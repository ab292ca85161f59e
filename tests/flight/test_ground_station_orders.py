"""A ground station orders a vehicle's controller about, through the autopilot between them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from flight_log import Flight
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mock_vehicle.faults import Fault
from swarm_ctl.agent.phases import Phase
from swarm_ctl.controller import TICK_S
from swarm_ctl.model import Operator

Launch = Callable[..., Flight]
Report = Callable[[str, object], None]
EXPLORES = ("exploring", "avoiding")
RTL, LAND, PAUSE_CONTINUE = 20, 21, 193
ACCEPTED, REJECTED = 0, 1
both = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])


class Station:
    """A ground station on the link of one vehicle's autopilot."""

    def __init__(self, flight: Flight, sysid: int) -> None:
        self.flight, self.agent = flight, flight.agent(sysid)
        self.index, self.sysid = sysid - 1, sysid
        self.arrived_s: list[float] = []
        self.acks: list[Any] = []
        self._codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._oracle = mavlink.MAVLink(None)
        self._listen_to_the_link()

    def _listen_to_the_link(self) -> None:
        """Hear what the autopilot passes on, and when the controller hears an order."""
        controller = self.flight.arena.controllers[self.index]
        receive = controller.receive

        def listen(data: bytes, now: float) -> None:
            heard: list[Any] = self._oracle.parse_buffer(data) or []
            self.acks += [
                m for m in heard if m.get_type() == "COMMAND_ACK" and m.target_system == 255
            ]
            self.arrived_s += [now for m in heard if m.get_type() == "COMMAND_LONG"]
            receive(data, now)

        controller.receive = listen  # type: ignore[method-assign]

    def order(self, command: int, first: float = 0.0, *, component: int = 191) -> None:
        seven = (first, *(0.0,) * 6)
        message = self._codec.command_long_encode(self.sysid, component, command, 0, *seven)
        data = bytes(message.pack(self._codec))
        self.flight.arena.fleet.receive(self.index, data, self.flight.arena.now)

    def order_and_wait(self, command: int, first: float, phase: Phase) -> None:
        self.order(command, first)
        self.flight.fly_until(lambda: self.agent.phase is phase, within_s=1.0)

    def answers(self) -> list[tuple[int, int, int, int]]:
        self.flight.fly(0.3)
        return [(m.get_srcSystem(), m.get_srcComponent(), m.command, m.result) for m in self.acks]


@both
@pytest.mark.parametrize(
    ("command", "phase"),
    [(RTL, Phase.RETURNING), (LAND, Phase.LANDING), (PAUSE_CONTINUE, Phase.HOLDING)],
)
def test_a_ground_station_orders_one_vehicle_and_the_others_fly_on(
    launch: Launch, record_property: Report, autopilot: str, command: int, phase: Phase
) -> None:
    flight = launch(vehicles=2, autopilot=autopilot, duration_s=500.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    flight.fly(10)
    station = Station(flight, 2)
    ordered_s = flight.arena.now
    station.order(command)
    flight.fly_until(lambda: station.agent.phase is phase, within_s=1.0)
    (arrived_s,), obeyed_s = station.arrived_s, station.agent.entered_s
    assert 0.0 <= obeyed_s - arrived_s <= TICK_S + 1e-9
    row = f"ground station orders: {phase}"
    record_property("detected", (row, round(obeyed_s - ordered_s, 2), TICK_S))
    assert station.answers() == [(2, 191, command, ACCEPTED)]
    assert flight.agent(1).phase.value in EXPLORES
    mode = flight.arena.fleet.vehicles[1].mode_name
    lands = phase is Phase.LANDING
    assert ("LAND" in mode) == lands, "the autopilot does nothing but what its controller asks"


@both
def test_a_vehicle_on_its_way_home_is_paused_goes_on_and_lands(
    launch: Launch, autopilot: str
) -> None:
    flight = launch(vehicles=1, autopilot=autopilot, duration_s=500.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    flight.fly(10)
    station = Station(flight, 1)
    station.order_and_wait(RTL, 0.0, Phase.RETURNING)
    station.order_and_wait(PAUSE_CONTINUE, 0.0, Phase.HOLDING)
    flight.fly(20)
    assert station.agent.phase is Phase.HOLDING
    station.order_and_wait(PAUSE_CONTINUE, 1.0, Phase.RETURNING)
    flight.fly_to_the_end()
    assert flight.all_in("done")
    assert flight.truth()["collisions"] == 0


def test_an_order_that_makes_no_sense_is_refused(launch: Launch) -> None:
    flight = launch(vehicles=1, duration_s=500.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    station = Station(flight, 1)
    station.order(PAUSE_CONTINUE, 1.0)
    assert station.answers() == [(1, 191, PAUSE_CONTINUE, REJECTED)]
    assert station.agent.phase.value in EXPLORES


@both
def test_a_station_that_speaks_to_the_autopilot_takes_the_vehicle(
    launch: Launch, autopilot: str
) -> None:
    flight = launch(vehicles=1, autopilot=autopilot, duration_s=500.0)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    station = Station(flight, 1)
    station.order(RTL, component=1)
    flight.fly_until(lambda: station.agent.phase is Phase.YIELDED, within_s=3)
    assert "RTL" in station.agent.reason
    station.order(LAND)
    flight.fly(1)
    assert station.agent.phase is Phase.YIELDED, "the pilot wins"
    assert station.acks[-1].result == REJECTED


# -- a pause and what the failsafe says to it -----------------------------------------------------


def paused(launch: Launch, **changes: Any) -> Flight:
    flight = launch(vehicles=1, duration_s=500.0, **changes)
    flight.fly_until(lambda: flight.all_in(*EXPLORES))
    flight.fly(5)
    flight.agent(1).order(Operator.PAUSE, flight.arena.now)
    flight.fly(20)
    assert flight.all_in("holding")
    return flight


def strike(flight: Flight, kind: str) -> None:
    flight.arena.fleet.strike(Fault(0.0, 1, kind), flight.arena.now)


def test_a_paused_vehicle_without_rangefinders_lands_as_any_other(launch: Launch) -> None:
    flight = paused(launch)
    strike(flight, "rangefinder")
    flight.fly_until(lambda: flight.all_in("landing"), within_s=12.0)
    assert "held for 10 s without recovery" in flight.agent(1).reason


def test_a_paused_vehicle_comes_home_with_a_low_battery(launch: Launch) -> None:
    flight = paused(launch, limits={"battery_critical": 0.05})
    strike(flight, "battery")
    flight.fly_until(lambda: flight.all_in("returning"), within_s=5.0)
    assert not flight.agent(1).is_paused


def test_a_pause_outlives_a_lost_link(launch: Launch) -> None:
    flight = paused(launch, limits={"link_lost_s": 2.0})
    strike(flight, "freeze")
    flight.fly_until(lambda: flight.all_in("lost"), within_s=5.0)
    flight.fly_until(lambda: flight.all_in("holding"), within_s=30.0)
    flight.fly(5)
    assert flight.all_in("holding")
    flight.agent(1).order(Operator.RESUME, flight.arena.now)
    flight.fly_until(lambda: flight.all_in(*EXPLORES), within_s=1.0)
