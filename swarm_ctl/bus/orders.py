"""Orders over MQTT: hearing them for vehicles, and giving them."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
from collections.abc import Callable, Sequence
from typing import NamedTuple

import aiomqtt

from swarm_ctl.bus.messages import Ack, Order, ack_topic, order_topic
from swarm_ctl.bus.mqtt import Broker, in_words, may_hear, stay_connected
from swarm_ctl.errors import SwarmError
from swarm_ctl.model import Operator

LOG = logging.getLogger(__name__)

MOST_ACKS = 1000
"""Acknowledgements that wait for a slow broker; further ones are lost."""
ANSWERED_PER_S = 20
"""Messages that are acknowledged within a second; in a flood, flying goes first."""
ACKS_AT_ONCE = 8
"""Acknowledgements that are on their way together."""


class Outcome(NamedTuple):
    """What a vehicle made of an order."""

    accepted: bool
    phase: str
    time_s: float
    """Mission time."""


Obey = Callable[[int, Operator | None], Outcome]
"""Hands an order to the vehicle of a sysid; None is no order and only asks how it is."""


class OrderDesk:
    """Hears the orders for the vehicles of a mission, and acknowledges them."""

    def __init__(self, broker: Broker, mission: str, sysids: Sequence[int], obey: Obey) -> None:
        self.sessions = 0
        """How often the broker was found, and has let us hear the orders."""
        self.bad = 0
        """Payloads that were no order."""
        self.retained = 0
        """Orders that were kept by the broker since who knows when: not obeyed."""
        self._broker = broker
        self._mission = mission
        self._obey = obey
        self._for = {order_topic(mission, sysid): [sysid] for sysid in sysids}
        self._for[order_topic(mission)] = list(sysids)
        self._second = 0
        self._heard = 0
        self._acks: asyncio.Queue[tuple[int, Ack]] = asyncio.Queue(MOST_ACKS)

    async def run(self) -> None:
        """Serve until cancelled, whatever becomes of the broker."""
        await stay_connected(self._broker, self._serve)

    async def _serve(self, client: aiomqtt.Client) -> None:
        await may_hear(client, list(self._for), 1)
        self.sessions += 1
        async with asyncio.TaskGroup() as tasks:
            for _ in range(ACKS_AT_ONCE):
                tasks.create_task(self._acknowledge(client), name="bus acknowledgements")
            async for message in client.messages:
                self.hear(message)

    def hear(self, message: aiomqtt.Message) -> None:
        """Obey at once; the acknowledgements follow as fast as the broker takes them."""
        if message.retain:
            self.retained += 1
            LOG.warning("%s: a retained order on %s is ignored", self._broker, message.topic)
            return
        order = Order.load(bytes(message.payload))
        self.bad += order.operator is None
        is_calm = self._is_calm()
        if order.operator is None and not is_calm:
            return
        for sysid in self._for.get(str(message.topic), ()):
            outcome = self._obey(sysid, order.operator)
            if is_calm and not self._acks.full():
                ack = Ack(order.id, order.operator or "", *outcome, order.error)
                self._acks.put_nowait((sysid, ack))

    def _is_calm(self) -> bool:
        """Count a message, and tell whether there is time to answer it."""
        second = int(asyncio.get_running_loop().time())
        self._heard = self._heard + 1 if second == self._second else 1
        self._second = second
        return self._heard <= ANSWERED_PER_S

    async def _acknowledge(self, client: aiomqtt.Client) -> None:
        while True:
            sysid, ack = await self._acks.get()
            with contextlib.suppress(aiomqtt.MqttError):  # orders matter more than their echo
                await client.publish(ack_topic(self._mission, sysid), ack.dump(), qos=1)


async def give(
    broker: Broker,
    mission: str,
    sysid: int | None,
    operator: Operator,
    heard: Callable[[int, Ack], bool],
) -> None:
    """Order one vehicle, or all, until `heard` says of an acknowledgement that it is the last.

    SwarmError when the broker cannot be reached, or is lost.
    """
    order = Order(operator, secrets.token_hex(8))
    try:
        async with broker.client() as client:
            await client.subscribe(ack_topic(mission, sysid), qos=1)
            await client.publish(order_topic(mission, sysid), order.dump(), qos=1)
            async for message in client.messages:
                ack, sender = Ack.load(bytes(message.payload)), str(message.topic).split("/")[-2]
                is_ours = ack is not None and ack.id == order.id and sender.isdecimal()
                if ack is not None and is_ours and heard(int(sender), ack):
                    return
    except aiomqtt.MqttError as error:
        raise SwarmError(f"{broker}: {in_words(error)}") from None
