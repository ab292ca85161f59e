"""Vehicles on loopback sockets, flown by a thread of the test's own process."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import TypeVar

from mock_vehicle.ports import LOCALHOST
from mock_vehicle.server import Server
from mock_vehicle.testing.truth import Truth
from mock_vehicle.testing.vehicle import MockSwarm, MockVehicle
from mock_vehicle.testing.watched import WatchedFleet
from mock_vehicle.trouble import FleetKilled

PATIENCE_S = 30.0
"""Mission time that something takes at most, unless the test says otherwise."""
LOOK_EVERY_S = 0.01

Seen = TypeVar("Seen")


class Pilot:
    """Runs a server in a thread until closed."""

    def __init__(self, fleet: WatchedFleet, server: Server) -> None:
        self.fleet = fleet
        self._server = server
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="mock-vehicle", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop, free the ports, and raise what went wrong in the thread."""
        self._server.stop()
        self._thread.join()
        if self._failure is not None:
            raise self._failure

    def wait_until(
        self, look: Callable[[], Seen], predicate: Callable[[Seen], object], timeout_s: float
    ) -> Seen:
        """Look after every step; TimeoutError when `timeout_s` of mission time have passed."""
        deadline_s = self.fleet.now + timeout_s
        while not predicate(seen := look()):
            self._check(deadline_s, timeout_s, seen)
            with self.fleet.stepped:
                self.fleet.stepped.wait(LOOK_EVERY_S)
        return seen

    async def wait_until_async(
        self, look: Callable[[], Seen], predicate: Callable[[Seen], object], timeout_s: float
    ) -> Seen:
        """Wait as `wait_until` does, and let other tasks run."""
        deadline_s = self.fleet.now + timeout_s
        while not predicate(seen := look()):
            self._check(deadline_s, timeout_s, seen)
            await asyncio.sleep(LOOK_EVERY_S)
        return seen

    def _check(self, deadline_s: float, timeout_s: float, seen: object) -> None:
        if not self._thread.is_alive():
            raise RuntimeError(f"the mock vehicles fly no more: {seen}") from self._failure
        if self.fleet.now > deadline_s:
            raise TimeoutError(f"not reached within {timeout_s:g} s: {seen}")

    def _run(self) -> None:
        try:
            asyncio.run(self._server.run())
        except FleetKilled:
            pass
        except BaseException as error:  # noqa: BLE001 - it belongs to the test, who asks for it
            self._failure = error


class RealVehicle(MockVehicle):
    """A vehicle that calls a UDP port of the client, as a real one would."""

    def __init__(self, pilot: Pilot, index: int, *, port: int, gcs_port: int, bind: int) -> None:
        super().__init__(pilot.fleet, index)
        self._pilot = pilot
        self.port = port
        """Where the client listens and is called."""
        self.gcs_port = gcs_port
        """Where a ground station listens and is called; with ArduPilot the same port."""
        self.address = (LOCALHOST, bind)
        """Where the vehicle listens, for clients that call first."""

    @property
    def url(self) -> str:
        """Where to listen, as MAVSDK writes it."""
        return f"udpin://{LOCALHOST}:{self.port}"

    @property
    def pymavlink_url(self) -> str:
        """Where to listen, as pymavlink, MAVProxy and DroneKit write it."""
        return f"udpin:{LOCALHOST}:{self.port}"

    def wait_until(
        self, predicate: Callable[[Truth], object], timeout_s: float = PATIENCE_S
    ) -> Truth:
        """Wait for a truth and give it; TimeoutError after `timeout_s` of mission time."""
        return self._pilot.wait_until(lambda: self.truth, predicate, timeout_s)

    async def wait_until_async(
        self, predicate: Callable[[Truth], object], timeout_s: float = PATIENCE_S
    ) -> Truth:
        """Wait as `wait_until` does, while other tasks of the test's loop run."""
        return await self._pilot.wait_until_async(lambda: self.truth, predicate, timeout_s)


class RealSwarm(MockSwarm[RealVehicle]):
    """Vehicles that fly together, each calling its own port, or all of them one."""

    def __init__(self, pilot: Pilot, vehicles: list[RealVehicle]) -> None:
        super().__init__(vehicles)
        self._pilot = pilot

    def wait_until(
        self, predicate: Callable[[list[Truth]], object], timeout_s: float = PATIENCE_S
    ) -> list[Truth]:
        """Wait for the truths of all and give them; TimeoutError as with a vehicle alone."""
        return self._pilot.wait_until(lambda: self.truths, predicate, timeout_s)

    async def wait_until_async(
        self, predicate: Callable[[list[Truth]], object], timeout_s: float = PATIENCE_S
    ) -> list[Truth]:
        """Wait as `wait_until` does, while other tasks of the test's loop run."""
        return await self._pilot.wait_until_async(lambda: self.truths, predicate, timeout_s)
