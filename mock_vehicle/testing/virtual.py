"""Vehicles in memory, whose time passes when the test says so: no sockets, no threads."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from mock_vehicle.testing.truth import Truth
from mock_vehicle.testing.vehicle import MockSwarm, MockVehicle
from mock_vehicle.testing.watched import Message, WatchedFleet, messages
from swarm_ctl import wire

WITHIN_S = 60.0
"""Mission time that something takes at most, unless the test says otherwise."""

Seen = TypeVar("Seen")


class Wires:
    """The links of a fleet without sockets, and its clock."""

    def __init__(self, fleet: WatchedFleet) -> None:
        self.fleet = fleet
        self._waiting: dict[tuple[int, int], list[bytes]] = {place: [] for place in fleet.places}

    def send(self, index: int, data: bytes, link: int) -> None:
        """Let a datagram arrive at a vehicle, who may answer at once."""
        self.fleet.receive(index, data, self.fleet.now, link)
        self._waiting[index, link] += self.fleet.answers(index, link)

    def take(self, index: int, link: int) -> list[bytes]:
        """Take the datagrams that have left a vehicle."""
        taken, self._waiting[index, link] = self._waiting[index, link], []
        return taken

    def step(self) -> None:
        """Let one step pass."""
        fleet = self.fleet
        for index, data in fleet.step((fleet.steps + 1) * fleet.step_s):
            self._waiting[index, 0].append(data)
        for place in fleet.places[fleet.n :]:
            self._waiting[place] += fleet.answers(*place)

    def fly(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / self.fleet.step_s)):
            self.step()

    def fly_until(
        self, look: Callable[[], Seen], predicate: Callable[[Seen], object], within_s: float
    ) -> Seen:
        """Fly until the predicate is true; TimeoutError when it does not become so."""
        deadline_s = self.fleet.now + within_s
        while not predicate(seen := look()):
            if self.fleet.now > deadline_s:
                raise TimeoutError(f"not reached within {within_s:g} s: {seen}")
            self.step()
        return seen


class VirtualVehicle(MockVehicle):
    """A vehicle to whom a test hands bytes, and from whom it takes bytes.

    Link 0 leads to the companion. PX4 at full rates has a link 1 to a ground station.
    """

    def __init__(self, wires: Wires, index: int) -> None:
        super().__init__(wires.fleet, index)
        self._wires = wires

    def send(self, data: bytes, link: int = 0) -> None:
        """Let MAVLink bytes, any number of frames, arrive at the vehicle now."""
        self._wires.send(self._index, data, link)

    def receive(self, link: int = 0) -> list[bytes]:
        """Take the datagrams that the vehicle has sent since the last time."""
        return self._wires.take(self._index, link)

    def receive_messages(self, link: int = 0) -> list[Message]:
        """Take what `receive` would, decoded."""
        frames = wire.Parser(None).feed(b"".join(self.receive(link)))
        return messages(frames, self._fleet.now)

    def fly(self, seconds: float) -> None:
        """Let time pass, for the whole swarm."""
        self._wires.fly(seconds)

    def fly_until(self, predicate: Callable[[Truth], object], within_s: float = WITHIN_S) -> Truth:
        """Let time pass until a truth comes and give it; TimeoutError when it does not come."""
        return self._wires.fly_until(lambda: self.truth, predicate, within_s)


class VirtualSwarm(MockSwarm[VirtualVehicle]):
    """Vehicles that fly together in virtual time."""

    def __init__(self, wires: Wires, vehicles: list[VirtualVehicle]) -> None:
        super().__init__(vehicles)
        self._wires = wires

    def fly(self, seconds: float) -> None:
        """Let time pass."""
        self._wires.fly(seconds)

    def fly_until(
        self, predicate: Callable[[list[Truth]], object], within_s: float = WITHIN_S
    ) -> list[Truth]:
        """Let time pass until the truths of all are so; TimeoutError when they never are."""
        return self._wires.fly_until(lambda: self.truths, predicate, within_s)
