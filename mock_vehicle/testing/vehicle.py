"""What a test holds of one vehicle, in whatever time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Generic, TypeVar

from mock_vehicle.faults import Fault
from mock_vehicle.testing.truth import Truth
from mock_vehicle.testing.watched import Message, WatchedFleet

AnyVehicle = TypeVar("AnyVehicle", bound="MockVehicle")


class MockVehicle:
    """One vehicle of a test; what follows needs neither sockets nor a clock."""

    def __init__(self, fleet: WatchedFleet, index: int) -> None:
        self._fleet = fleet
        self._index = index
        self.sysid = fleet.sysids[index]
        self.autopilot = fleet.personalities[index]
        """Its personality."""
        self.faults = Faults(fleet, self.sysid)
        """What goes wrong when the test says so."""

    @property
    def truth(self) -> Truth:
        """How it really is now."""
        return self._fleet.truth(self._index)

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters as they are now, by name."""
        with self._fleet.stepped:
            return dict(self._fleet.vehicles[self._index].autopilot.parameters)

    @property
    def refused(self) -> int:
        """Frames that it has refused, for want of a good signature."""
        with self._fleet.stepped:
            return self._fleet.vehicles[self._index].refused

    @property
    def setpoint_times(self) -> list[float]:
        """Mission times of the setpoints that it accepted."""
        with self._fleet.stepped:
            return list(self._fleet.vehicles[self._index].setpoint_times)

    def received(self, name: str | None = None) -> list[Message]:
        """Give the messages that the client has sent, all or those of a name, oldest first."""
        return self._fleet.received(self._index, name)


class Faults:
    """Strikes one vehicle; `mock-vehicle --list-faults` knows the kinds and their parameters."""

    def __init__(self, fleet: WatchedFleet, sysid: int) -> None:
        self._fleet = fleet
        self._sysid = sysid

    def strike(
        self, kind: str, *, duration_s: float | None = None, **values: float | str | None
    ) -> None:
        """Let something go wrong at once, as `strike("link-delay", duration_s=5, delay_s=0.3)`.

        ValueError names the nearest kind or parameter there is.
        """
        now = self._fleet.now
        self._fleet.strike(Fault(now, self._sysid, kind, duration_s, values), now)

    def heal(self, kind: str | None = None) -> None:
        """End at once what is broken for a while: all of it, or one kind."""
        self._fleet.heal(self._fleet.now, vehicle=self._sysid, kind=kind)


class MockSwarm(Generic[AnyVehicle]):
    """Vehicles that fly together; iterates over them, and finds them by sysid."""

    def __init__(self, vehicles: Sequence[AnyVehicle]) -> None:
        self._vehicles = {vehicle.sysid: vehicle for vehicle in vehicles}

    def __len__(self) -> int:
        return len(self._vehicles)

    def __iter__(self) -> Iterator[AnyVehicle]:
        return iter(self._vehicles.values())

    def __getitem__(self, sysid: int) -> AnyVehicle:
        return self._vehicles[sysid]

    @property
    def sysids(self) -> list[int]:
        """Who flies."""
        return list(self._vehicles)

    @property
    def truths(self) -> list[Truth]:
        """How all of them really are now, in the order of their sysids."""
        return [vehicle.truth for vehicle in self]
