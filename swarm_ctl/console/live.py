"""What the bus tells, for all browsers that look at it; and what their operators order."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from typing import Any

import aiomqtt

from swarm_ctl.bus.messages import (
    ANY,
    Order,
    ack_topic,
    event_topic,
    info_topic,
    order_topic,
    topic,
)
from swarm_ctl.bus.mqtt import Broker, may_hear, stay_connected
from swarm_ctl.console.picture import Grid, Picture
from swarm_ctl.console.watch import Watch
from swarm_ctl.model import Operator

RETRY_S = 2.0
"""Longest wait between two attempts to reach a broker that is away."""
MOST_ORDERS = 100
"""Orders that wait for a slow broker; further ones are refused."""
NO_MISSION = Picture({"mode": "live", "mission": "", "unit": "m²"}, Grid(0.0))


class Live:
    """One mission of a broker, or every one; the broker may be away and come back."""

    def __init__(self, broker: Broker, mission: str | None, clock: Callable[[], float]) -> None:
        """Watch by a clock in seconds."""
        self.watches = {} if mission is None else {mission: Watch(mission)}
        """By the missions' names."""
        self._broker = broker
        self._mission = ANY if mission is None else mission
        self._clock = clock
        self._is_there = False
        self._orders: asyncio.Queue[tuple[str, bytes]] = asyncio.Queue(MOST_ORDERS)

    async def run(self) -> None:
        """Hear and order until cancelled, whatever becomes of the broker."""
        await stay_connected(
            self._broker, self._serve, without="this console", longest_retry_s=RETRY_S
        )

    async def _serve(self, client: aiomqtt.Client) -> None:
        mission = self._mission
        leaves = ("status", "state", "coverage", "coverage/all")
        told = [topic(mission, ANY, leaf) for leaf in leaves]
        told += [info_topic(mission), event_topic(mission), ack_topic(mission)]
        await may_hear(client, told, 1, "what the swarm tells")
        while not self._orders.empty():
            self._orders.get_nowait()  # an order is never older than its connection
        self._is_there = True
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._publish(client), name="console orders")
                async for message in client.messages:
                    self.hear(str(message.topic), bytes(message.payload))
        finally:
            self._is_there = False

    async def _publish(self, client: aiomqtt.Client) -> None:
        while True:
            where, payload = await self._orders.get()
            await client.publish(where, payload, qos=1)

    def hear(self, where: str, payload: bytes) -> None:
        """Take a message of any mission."""
        name = where.split("/")[1]
        if payload:  # an empty one takes back what was retained
            self.watches.setdefault(name, Watch(name)).hear(where, payload, self._clock())

    @property
    def newest(self) -> str | None:
        """Name the mission that began last."""
        begun = {name: max(watch.runs.values(), default="") for name, watch in self.watches.items()}
        return max(begun, key=lambda name: begun[name], default=None)

    def look(self, mission: str) -> Picture:
        """Give the picture of a mission."""
        return self.watches[mission].look(self._clock())

    @property
    def warning(self) -> str:
        """Say what is wrong; empty when nothing is."""
        if self._is_there:
            return ""
        return (
            f"The broker {self._broker} is away: what is shown is old, and orders cannot leave. "
            "It is looked for again every few seconds; the vehicles fly on without it."
        )

    def give(self, mission: str, sysid: int | None, operator: Operator) -> None:
        """Publish an order now, or not at all: none waits for a broker that is away."""
        if self._is_there and not self._orders.full():
            order = Order(operator, secrets.token_hex(8))
            self._orders.put_nowait((order_topic(mission, sysid), order.dump()))
            self.watches[mission].give(order, sysid)


class View:
    """What one browser looks at: the mission that began last, or the one chosen."""

    period_s = 0.5
    """Between two frames, as often as vehicles tell their state."""

    def __init__(self, live: Live) -> None:
        self._live = live
        self._chosen: str | None = None

    @property
    def _name(self) -> str | None:
        return self._chosen or self._live.newest

    def picture(self) -> Picture:
        """Give the mission as it is now."""
        name = self._name
        return NO_MISSION if name is None else self._live.look(name)

    def state(self) -> dict[str, Any]:
        """Say what is wrong, what became of the last order, and what else there is to see."""
        name = self._name
        return {
            "warning": self._live.warning,
            "answer": None if name is None else self._live.watches[name].answer,
            "missions": sorted(self._live.watches),
        }

    def handlers(self) -> dict[str, Callable[[Any], None]]:
        """Order, and choose another mission."""
        return {"order": self.order, "choose": self.choose}

    def order(self, asked: object) -> None:
        """Give `{"mission": name, "order": word, "sysid": number or null}`, if it is one.

        It goes to the mission that was on the page when it was asked for: another one may have
        begun since.
        """
        match asked:
            case {"mission": str(name), "order": str(word), "sysid": int() | None as sysid}:
                watch = self._live.watches.get(name)
                is_known = watch is not None and (sysid is None or sysid in watch.picture.vehicles)
                if is_known and word in {operator.value for operator in Operator}:
                    self._live.give(name, sysid, Operator(word))

    def choose(self, mission: object) -> None:
        """Look at another mission."""
        if isinstance(mission, str) and mission in self._live.watches:
            self._chosen = mission
