"""Controllers and mock fleet in one process, in virtual time: no sockets, tasks or threads."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from mock_vehicle.errors import MockVehicleError
from mock_vehicle.faults import parse_fault
from mock_vehicle.fleet import STEP_S, Fleet
from mock_vehicle.trouble import FleetKilled
from mock_vehicle.vehicle import personalities
from mock_vehicle.world import World, load_world
from swarm_ctl.controller import KILLED
from swarm_ctl.errors import MockError
from swarm_ctl.flight import GRACE_S, MOCK_DIED, TRUTH, Faults, controllers_for
from swarm_ctl.mission import Mission
from swarm_ctl.model import Operator
from swarm_ctl.record.unrecorded import Record

STEPS_PER_TICK = 5
"""Physics steps between two ticks of a controller; vehicle i ticks in step i of each five."""
GARBAGE = 10_000
"""Objects made between two looks for garbage: flights make hardly any that refer to each other."""


class Arena:
    """Fly one mission in lockstep; the same seed gives the same frames, bit for bit."""

    def __init__(
        self,
        mission: Mission,
        folder: Record,
        faults: Faults | None = None,
        world: World | None = None,
    ) -> None:
        """Put everybody on the ground of the mission's world, or of another one.

        `Unrecorded` for a folder leaves nothing on the disk.
        """
        faults = faults or Faults()
        self.now = 0.0
        self.controllers = controllers_for(mission, folder)
        self.notes: list[str] = []
        self.fleet = _fleet(mission, faults, world)
        self.fleet.compile()
        self.fleet.referee.keeps_tracks = folder.is_kept
        self._is_mock_alive = True
        self._given_up_s = math.inf
        """When vehicles of a dead mock are given up."""
        self._link_lost_s = mission.limits.link_lost_s
        self._folder = folder
        self._kills = list(faults.controllers)
        self._step = 0

    @property
    def is_over(self) -> bool:
        """Whether every vehicle's mission has ended."""
        return all(controller.agent.is_ended for controller in self.controllers)

    def fly(
        self, progress: Callable[[Arena], None] | None = None, *, until_s: float = float("inf")
    ) -> None:
        """Fly until the mission is over or mission time has come; report every tick."""
        with _collecting_seldom():
            while not self.is_over and self.now < until_s:
                self.step()
                if progress is not None and self._step % STEPS_PER_TICK == 0:
                    progress(self)

    def step(self) -> None:
        """Advance physics by one step, and those controllers whose turn it is."""
        self._step += 1
        self.now = now = self._step * STEP_S
        while self._kills and self._kills[0][0] <= now:
            _, sysid = self._kills.pop(0)
            self.controllers[sysid - 1].kill(KILLED, now)
        if self._is_mock_alive:
            self._step_fleet(now)
        elif now >= self._given_up_s:
            for controller in self.controllers:
                controller.kill(MOCK_DIED, now)
        for controller in self.controllers[self._step % STEPS_PER_TICK :: STEPS_PER_TICK]:
            try:
                data = controller.tick(now)
            except Exception as error:  # noqa: BLE001 - one vehicle never stops another
                controller.break_down(error, now)
                continue
            if data and self._is_mock_alive:
                self.fleet.receive(controller.index, data, now)
        self._folder.tick(now)

    def order(self, operator: Operator) -> None:
        """Pass an operator's order to everybody."""
        for controller in self.controllers:
            controller.order(operator, self.now)

    def write_truth(self, run: Path) -> None:
        """Let the referee write into a run folder what really happened, unless it was killed."""
        if self._is_mock_alive:
            self.fleet.write(run / TRUTH)

    def _step_fleet(self, now: float) -> None:
        try:
            datagrams = self.fleet.step(now)
        except FleetKilled:
            self._is_mock_alive = False
            self._given_up_s = now + self._link_lost_s + GRACE_S
            self.notes.append(f"the mock fleet died at {now:.1f} s")
            return
        for index, data in datagrams:
            controller = self.controllers[index]
            try:
                controller.receive(data, now)
            except Exception as error:  # noqa: BLE001 - one vehicle never stops another
                controller.break_down(error, now)


@contextmanager
def _collecting_seldom() -> Iterator[None]:
    before = gc.get_threshold()
    gc.set_threshold(GARBAGE, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


def _fleet(mission: Mission, faults: Faults, world: World | None) -> Fleet:
    try:
        return Fleet(
            world or load_world(mission.simulated),
            personalities(mission.autopilot, mission.vehicles),
            seed=mission.seed,
            faults=[parse_fault(text) for text in faults.mock],
        )
    except (MockVehicleError, ValueError) as error:
        raise MockError(str(error)) from error
