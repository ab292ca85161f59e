"""Whole missions in virtual time: controllers, MAVLink, mock fleet, radio; no sockets."""

from collections.abc import Callable
from typing import Any

from mock_vehicle.faults import Fault
from swarm_ctl import wire
from swarm_ctl.agent.agent import Agent
from swarm_ctl.experiment.arena import Arena
from swarm_ctl.record.folder import RunFolder


class Flight:
    """A mission in the air, and the words to tell its story."""

    def __init__(self, arena: Arena, folder: RunFolder) -> None:
        self.arena = arena
        self.folder = folder

    def agent(self, sysid: int) -> Agent:
        return self.arena.controllers[sysid - 1].agent

    def fly(self, seconds: float) -> None:
        self.arena.fly(until_s=self.arena.now + seconds)

    def fly_until(self, condition: Callable[[], bool], within_s: float = 120.0) -> None:
        end_s = self.arena.now + within_s
        while not condition():
            assert self.arena.now < end_s, "it did not happen in time"
            assert not self.arena.is_over, [c.agent.trouble for c in self.arena.controllers]
            self.arena.fly(until_s=self.arena.now + 0.1)

    def fly_to_the_end(self) -> None:
        self.arena.fly(until_s=1000.0)
        assert self.arena.is_over

    def all_in(self, *phases: str) -> bool:
        return all(c.agent.phase.value in phases for c in self.arena.controllers)

    def truth(self) -> dict[str, Any]:
        return self.arena.fleet.referee.snapshot()


def strike(flight: Flight, kind: str, duration_s: float | None = None, **values: Any) -> None:
    """Break something of vehicle 1."""
    flight.arena.fleet.strike(Fault(0.0, 1, kind, duration_s, values), flight.arena.now)


def choose_mode(flight: Flight, autopilot: str, number: int) -> None:
    """Let a pilot choose a mode of vehicle 1 from a ground station."""
    modes = {"px4": (1.0, 4.0, float(number)), "ardupilot": (1.0, float(number), 0.0)}
    values = (1, 1, 176, 0, *modes[autopilot], 0.0, 0.0, 0.0, 0.0)
    frame = wire.message("COMMAND_LONG").pack(0, 255, 190, *values)
    flight.arena.fleet.receive(0, frame, flight.arena.now)
