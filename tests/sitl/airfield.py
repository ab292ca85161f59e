"""An airfield: vehicles that stand ready, their ground stations, and the missions they fly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from sitl.flown import Flown
from sitl.simulators import Hangar
from sitl.station import Station

DOWN_S = 60.0
Report = Callable[[str, object], None]
"""Takes a figure, and what it is, to be told at the end of the session."""


class Airfield:
    """Vehicles on the ground, their ground stations, and the missions that are flown with them."""

    def __init__(self, hangar: Hangar, folder: Path) -> None:
        self._hangar, self._folder = hangar, folder
        self._flights: list[Flown] = []
        self._stations: list[Station] = []
        self._retired: list[Station] = []

    def ready(self, autopilot: str, count: int = 2) -> list[Station]:
        """Give vehicles that are ready to arm, each by its ground station."""
        stations = self.started(autopilot, count)
        for station in stations:
            station.stands_ready()
        return stations

    def started(self, autopilot: str, count: int = 2) -> list[Station]:
        """Give vehicles however they are."""
        stations = [Station(one) for one in self._hangar.have(autopilot, count)]
        for station in stations:
            station.opens()
        self._stations += stations
        return stations

    def flies(self, stations: Sequence[Station], *options: object, **changes: object) -> Flown:
        """Fly a mission with options of `swarm-ctl fly` and changes of its section `flight`."""
        folder = self._folder / f"run{len(self._flights)}"
        vehicles = [one.vehicle for one in stations]
        self._flights.append(Flown(folder, vehicles, *options, **changes))
        return self._flights[-1]

    def retire(self, station: Station) -> None:
        """Let nobody use a vehicle after this test, because it will remember what happened."""
        self._retired.append(station)

    def close(self) -> None:
        """Leave no controller running and nobody in the air."""
        for flight in self._flights:
            flight.killed()
        for station in self._stations:
            if not station.lands(DOWN_S) or station in self._retired:
                self._hangar.discard(station.vehicle)
            station.closes()
