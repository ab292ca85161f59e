"""One vehicle's part of the bus: what it tells over its connection, and keeps for later."""

from __future__ import annotations

import asyncio
import contextlib
import json

import aiomqtt

from swarm_ctl import model
from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.phases import STEERING
from swarm_ctl.bus.ground import SeenGround
from swarm_ctl.bus.journal import EventJournal
from swarm_ctl.bus.messages import ANY, Coverage, Info, Status, event_topic, topic
from swarm_ctl.bus.mqtt import TIMEOUT_S
from swarm_ctl.bus.news import news
from swarm_ctl.bus.state import state_of
from swarm_ctl.model import Vec3

STATE_S = 0.5
SLOTS = 10
"""Vehicles tell one after the other: two hundred at once would hold up their setpoints."""
GROUND_S = 1.0
"""Between two tellings of ground newly seen."""
ALL_GROUND_S = 10.0
"""Between two tellings of all ground seen, for latecomers."""
RESTART_IDS = 1_000_000
"""Numbers that one controller may use up before its successor's begin."""


class Voice:
    """Takes notes in flight; tells a broker of them, all again when it may have forgotten."""

    def __init__(
        self, agent: Agent, info: Info, name: str, *, origin: Vec3 | None, restarts: int
    ) -> None:
        """Speak for an agent, under a name that no other connection has."""
        self.name = name
        self.journal = EventJournal()
        self.is_silent = asyncio.Event()
        """Set when the mission has ended and all of it has been told."""
        self._agent = agent
        self._origin = origin
        self._mission, self._run = info.mission, info.run
        self._ids = self._deltas = restarts * RESTART_IDS
        self._ground = SeenGround(agent.orders.planner)
        for place in agent.trail.fresh or ():  # of an earlier process
            self._ground.fly_to(place)
        self._untold: Coverage | None = None
        """A delta that was sent and perhaps not taken."""
        self._is_first = True
        self._pen = asyncio.Lock()
        """Held while an event or a delta is on its way."""

    @property
    def will(self) -> aiomqtt.Will | None:
        """What the broker tells when this connection breaks; nothing when the mission has ended."""
        if self._agent.is_ended:
            return None
        return aiomqtt.Will(self._topic("status"), self._status("offline"), qos=1, retain=True)

    # -- in flight -----------------------------------------------------------------------------

    def note(self, event: model.Event) -> None:
        """Take a fact."""
        if (told := news(event, self._run, self._ids + 1)) is not None:
            self._ids += 1
            self.journal.add(told)

    def look(self) -> None:
        """Take where the vehicle is."""
        if self._agent.phase in STEERING:
            self._ground.fly_to(self._agent.telemetry.position_ned_m)

    # -- as long as there is a broker ----------------------------------------------------------

    async def speak(self, client: aiomqtt.Client) -> None:
        """Tell until the mission has ended."""
        self.is_silent.clear()
        self.journal.begin()
        if self._is_first:
            await self._forget_earlier_runs(client)
            self._is_first = False
        await self._tell_status(client)
        await asyncio.sleep(STATE_S * (self._agent.sysid % SLOTS) / SLOTS)
        await self._tell_all_ground(client)
        async with asyncio.TaskGroup() as tasks:
            works = (self._tell_events(client), self._tell_ground(client))
            telling = [tasks.create_task(work, name=f"bus {self.name}") for work in works]
            await self._tell_states(client)
            async with self._pen:  # what is cancelled on its way would be told twice
                for task in telling:
                    task.cancel()
        await self._say_last_words(client)

    async def _tell_states(self, client: aiomqtt.Client) -> None:
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while not self._agent.is_ended:
            await self._tell(client, "state", self._state(), qos=0)
            due_s = max(due_s + STATE_S, loop.time())
            await asyncio.sleep(due_s - loop.time())

    async def _tell_events(self, client: aiomqtt.Client) -> None:
        while True:
            await self._tell_due_events(client)
            await self.journal.stir()

    async def _tell_due_events(self, client: aiomqtt.Client) -> None:
        while (event := self.journal.due()) is not None:
            where = event_topic(self._mission, event.sysid, event.id)
            async with self._pen:
                await client.publish(where, event.dump(), qos=1, retain=True)
                self.journal.taken(event)
        while (number := self.journal.retire()) is not None:
            where = event_topic(self._mission, self._agent.sysid, number)
            await client.publish(where, b"", qos=1, retain=True)

    async def _tell_ground(self, client: aiomqtt.Client) -> None:
        loop = asyncio.get_running_loop()
        all_told, all_due_s = self._deltas, loop.time() + ALL_GROUND_S
        while True:
            await asyncio.sleep(GROUND_S)
            await self._tell_new_ground(client)
            if loop.time() >= all_due_s and self._deltas > all_told:
                await self._tell_all_ground(client)
                all_told, all_due_s = self._deltas, loop.time() + ALL_GROUND_S

    async def _tell_new_ground(self, client: aiomqtt.Client) -> None:
        if self._untold is None and (rows := self._ground.news()):
            self._deltas += 1
            self._untold = self._coverage(rows)
        async with self._pen:
            if self._untold is not None:
                await self._tell(client, "coverage", self._untold.dump(), retain=False)
                self._untold = None

    async def _tell_all_ground(self, client: aiomqtt.Client) -> None:
        if self._ground.cells:
            whole = self._coverage(self._ground.told())
            await self._tell(client, "coverage/all", whole.dump())

    async def _say_last_words(self, client: aiomqtt.Client) -> None:
        await self._tell_due_events(client)
        await self._tell_new_ground(client)
        await self._tell_all_ground(client)
        await self._tell(client, "state", self._state())
        await self._tell_status(client)
        self.is_silent.set()

    async def _tell_status(self, client: aiomqtt.Client) -> None:
        status = "done" if self._agent.is_ended else "online"
        await self._tell(client, "status", self._status(status))

    async def _forget_earlier_runs(self, client: aiomqtt.Client) -> None:
        """Have the broker forget what it keeps of this vehicle from other runs of the mission.

        What it keeps comes before the echo of what is told after the subscription.
        """
        sysid = self._agent.sysid
        kept = [self._topic("state"), self._topic("coverage/all")]
        kept += [self._topic("status"), event_topic(self._mission, sysid, ANY)]
        await client.subscribe([(one, 0) for one in kept])
        await self._tell_status(client)
        old = []
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(TIMEOUT_S):
                async for message in client.messages:
                    if not message.retain:
                        break
                    if not self._is_of_this_run(bytes(message.payload)):
                        old.append(str(message.topic))
        await client.unsubscribe(kept)
        for one in old:
            if one != self._topic("status"):
                await client.publish(one, b"", qos=1, retain=True)

    def _is_of_this_run(self, payload: bytes) -> bool:
        try:
            return bool(json.loads(payload)["run"] == self._run)
        except (ValueError, RecursionError, KeyError, TypeError):
            return False

    async def _tell(
        self,
        client: aiomqtt.Client,
        what: str,
        payload: bytes,
        *,
        qos: int = 1,
        retain: bool = True,
    ) -> None:
        await client.publish(self._topic(what), payload, qos=qos, retain=retain)

    def _topic(self, what: str) -> str:
        return topic(self._mission, self._agent.sysid, what)

    # -- what is told --------------------------------------------------------------------------

    def _state(self) -> bytes:
        seen_m2 = self._ground.cells * self._ground.cell_m**2
        return state_of(self._agent, self._run, origin=self._origin, seen_m2=seen_m2).dump()

    def _status(self, status: str) -> bytes:
        return Status(self._run, self._agent.sysid, status).dump()

    def _coverage(self, rows: list[list[int]]) -> Coverage:
        agent, cell_m = self._agent, self._ground.cell_m
        time_s = round(agent.now, 3)
        return Coverage(self._run, agent.sysid, self._deltas, time_s, cell_m, rows)
