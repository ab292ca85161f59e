"""What flies controllers over links: clock, turns, interrupts, progress."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import heapq
import signal
from collections.abc import Callable, Coroutine, Iterator, Sequence
from typing import Any

from swarm_ctl.agent.agent import Agent
from swarm_ctl.bus.messages import Info
from swarm_ctl.bus.mqtt import Broker
from swarm_ctl.bus.orders import OrderDesk, Outcome
from swarm_ctl.bus.publisher import Publisher
from swarm_ctl.controller import TICK_S, Clock, Controller, Flight, Tell
from swarm_ctl.link import Link
from swarm_ctl.link.mesh import Mesh
from swarm_ctl.model import Operator, Vec3
from swarm_ctl.record.folder import Mode, RunFolder

REPORT_S = 0.25
SET_ASIDE_S = 1.0
TOGETHER, MOST_TICKS = 25, 10
"""As many vehicles may beat in the same tick; what recurs does so at least once a second."""
SOON_S, MOST_TURNS = 0.004, 16
"""Who is due so soon has his turn with who is due now; after so many turns others are heard."""
SYNC_S = 1.0
"""Wall time; what a power failure may take of the journals."""
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
TWICE = "interrupted twice: ended without waiting for the landings"


class Fleet:
    """Controllers on one clock, each with its own link; one that breaks never stops another."""

    mode: Mode

    def __init__(
        self, controllers: Sequence[Controller], folder: RunFolder, *, speed: float
    ) -> None:
        self.controllers = controllers
        self.folder = folder
        self.clock = Clock(speed)
        self.notes: list[str] = []
        self.interrupted = False
        self.broker: Broker | None = None
        """Where orders come from, and what is told of the vehicles, if anywhere."""
        self.plan: dict[str, Any] | None = None
        """Outline of the simulated world, in the launch frame, for operators' eyes only."""
        self.origins: dict[int, Vec3] = {}
        """Where the vehicles' own frames begin in the launch frame; for operators' eyes, too."""
        self.mesh: Mesh | None = None
        """What carries peers' frames beside the vehicles' links, if anything does."""
        self.tell: Tell | None = None
        """Is told of every vehicle each tick, and how it is reached."""

    @property
    def now(self) -> float:
        """Give mission time."""
        return self.clock.now()

    def wait_for_start(self) -> None:
        """Let nobody take off before `start` is ordered."""
        for controller in self.controllers:
            controller.agent.awaits_start = True

    def interrupt(self) -> None:
        """Land everybody; asked twice, end at once."""
        if not self.interrupted:
            self.interrupted = True
            for controller in self.controllers:
                self._order(controller, Operator.LAND)
        elif not all(controller.agent.is_ended for controller in self.controllers):
            self.notes.append(TWICE)
            for controller in self.controllers:
                controller.kill(TWICE, self.now)

    async def fly_over(
        self,
        links: Sequence[Link],
        progress: Callable[[], None],
        aside: Sequence[Coroutine[Any, Any, None]] = (),
    ) -> None:
        """Fly each vehicle over its link until all have ended; do what is aside as long."""
        gc.collect()
        gc.freeze()  # a collection of everything would hold up the setpoints
        self.clock = Clock(self.clock.speed, self.folder.now(self.clock.speed))
        if (mesh := self.mesh) is not None:
            sysids = [controller.agent.sysid for controller in self.controllers]
            links = [mesh.join(*both) for both in zip(links, sysids, strict=True)]
            aside = [*aside, mesh.run()]
        async with asyncio.TaskGroup() as group:
            publisher = self._publisher()
            works = (
                self._report(progress),
                self._sync(),
                _set_aside(),
                *aside,
                *self._bus(publisher),
            )
            tasks = [group.create_task(work) for work in works]
            await self._fly_all(links)
            self.notes += [] if publisher is None else await publisher.finish()
            for task in tasks:
                task.cancel()
        self.notes += [] if mesh is None else mesh.account()

    @contextlib.contextmanager
    def interruptible(self) -> Iterator[None]:
        """Take Ctrl-C and SIGTERM for `interrupt` while this is open."""
        loop = asyncio.get_running_loop()
        before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
        for number in STOP_SIGNALS:
            loop.add_signal_handler(number, self.interrupt)
        try:
            yield
        finally:
            for number, handler in before.items():
                loop.remove_signal_handler(number)
                signal.signal(number, handler)

    async def _fly_all(self, links: Sequence[Link]) -> None:
        """Tick whoever is due, the first first, until all flights are over."""
        flights = [
            Flight(each, link, self.clock, offset_s=offset(each.index, len(links)), tell=self.tell)
            for each, link in zip(self.controllers, links, strict=True)
        ]
        due = [(flight.due_s, number) for number, flight in enumerate(flights)]
        heapq.heapify(due)
        for flight in flights:
            self._contain(flight, flight.listen)
        try:
            while due:
                await self.clock.sleep_until(due[0][0])
                until_s = max(due[0][0], self.now + SOON_S)
                turns: list[Flight] = []
                while due and due[0][0] <= until_s and len(turns) < MOST_TURNS:
                    number = due[0][1]
                    turns.append(flight := flights[number])
                    if not flight.is_over:
                        self._contain(flight, flight.tick)
                    if flight.is_over:
                        heapq.heappop(due)
                    else:
                        heapq.heapreplace(due, (flight.due_s, number))
                for flight in turns:
                    self._contain(flight, flight.send)
                    if flight.is_over:
                        self._contain(flight, flight.close)
        finally:
            for _, number in due:
                self._contain(flights[number], flights[number].close)

    def _contain(self, flight: Flight, action: Callable[[], None]) -> None:
        """Do something for one vehicle; whatever breaks in it stays with it."""
        try:
            action()
        except Exception as error:  # noqa: BLE001 - one vehicle never stops another
            flight.controller.break_down(error, self.now)

    def _bus(self, publisher: Publisher | None) -> Iterator[Coroutine[Any, Any, None]]:
        if self.broker is not None and publisher is not None:
            agents = [controller.agent for controller in self.controllers]
            mission, sysids = agents[0].orders.mission, [agent.sysid for agent in agents]
            yield OrderDesk(self.broker, mission, sysids, self._obey).run()
            yield publisher.run()

    def _publisher(self) -> Publisher | None:
        """Let the controllers tell of themselves over the bus, if there is one."""
        if self.broker is None:
            return None
        agents = [controller.agent for controller in self.controllers]
        publisher = Publisher(
            self.broker,
            self._info(agents),
            agents,
            restarts=self.folder.restarts,
            origins=self.origins,
        )
        for controller in self.controllers:
            controller.tell = publisher.event
        looks = self.tell

        def tell(agent: Agent, reach: str) -> None:
            if looks is not None:
                looks(agent, reach)
            publisher.look(agent)

        self.tell = tell
        return publisher

    def _info(self, agents: Sequence[Agent]) -> Info:
        orders, plan = agents[0].orders, self.plan
        return Info(
            run=self.folder.started_utc.isoformat(),
            mission=orders.mission,
            mode=self.mode,
            vehicles=[agent.sysid for agent in agents],
            planner=orders.planner.kind,
            dimensions=orders.planner.dimensions,
            duration_s=orders.duration_s,
            seed=orders.seed,
            world=None if plan is None else str(plan["name"]),
            plan=plan,
        )

    def _obey(self, sysid: int, operator: Operator | None) -> Outcome:
        (controller,) = (c for c in self.controllers if c.agent.sysid == sysid)
        accepted = operator is not None and self._order(controller, operator)
        return Outcome(accepted, controller.agent.phase.value, round(self.now, 3))

    def _order(self, controller: Controller, operator: Operator) -> bool:
        """Pass on an order; what breaks in one vehicle keeps it from no other."""
        try:
            return controller.order(operator, self.now)
        except Exception as error:  # noqa: BLE001 - see _fly_one
            controller.break_down(error, self.now)
            return False

    async def _sync(self) -> None:
        """Let the disk have the journals once a second, for a power failure."""
        while True:
            await asyncio.sleep(SYNC_S)
            try:
                await asyncio.to_thread(self.folder.sync)
            except OSError as error:  # after which a restart lands its vehicle
                self._note_unwritten(error)

    def _note_unwritten(self, error: OSError) -> None:
        note = f"not everything could be written: {error.strerror or error}"
        if note not in self.notes:
            self.notes.append(note)

    async def _report(self, progress: Callable[[], None]) -> None:
        while True:
            try:
                self.folder.tick(self.now)
                progress()
            except OSError as error:  # a full disk, a terminal that is gone: no reason to fall
                self._note_unwritten(error)
            await asyncio.sleep(REPORT_S)


def offset(index: int, vehicles: int) -> float:
    """Give how much later than the first vehicle's the first tick of another one is, s.

    Ticks are spread over TICK_S; those of many vehicles start in different ones, too, or all would
    beat, plan and write in the same one of each second.
    """
    ticks = index % min(MOST_TICKS, 1 + vehicles // TOGETHER)
    return TICK_S * (ticks + index / vehicles)


async def _set_aside() -> None:
    """Collect what is young and spare what has lived for a while: to search it takes too long."""
    gc.disable()
    try:
        while True:
            await asyncio.sleep(SET_ASIDE_S)
            gc.collect(1)
            gc.freeze()
    finally:
        gc.enable()
