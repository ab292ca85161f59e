"""Peers' frames over MQTT, for vehicles whose IP links share a broker and no network."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable

import aiomqtt

from swarm_ctl.bus.messages import peers_topic
from swarm_ctl.bus.mqtt import Broker, may_hear, stay_connected

LATE_S = 0.5
"""Frames that take longer are no news: a peer at 1 m/s is half a separation elsewhere."""
FORGOTTEN_S = 5.0
"""What has not come back for so long never will."""
LONGEST_RETRY_S = 4.0
"""Longest wait between two attempts to connect; peers are missed sooner than orders."""
MOST_WAITING, MOST_BYTES = 64, 2048

Arrived = Callable[[bytes, int | None], None]


class Echo:
    """How late a broker is: by what comes back of what was said, on one's own clock alone."""

    def __init__(self) -> None:
        self._late_s = 0.0
        self._said: deque[tuple[float, bytes]] = deque(maxlen=MOST_WAITING)

    def say(self, data: bytes, now: float) -> None:
        """Take what is sent now."""
        self._said.append((now, data))

    def hear(self, data: bytes, now: float) -> None:
        """Take what came back; what was said before it has been lost."""
        while any(said == data for _, said in self._said):
            said_s, said = self._said.popleft()
            if said == data:
                self._late_s = now - said_s
                return

    def late_s(self, now: float) -> float:
        """Tell how long what is sent is on its way there and back."""
        waiting_s = now - self._said[0][0] if self._said else 0.0
        if waiting_s > FORGOTTEN_S:
            self._said.clear()
            self._late_s = waiting_s
        return max(self._late_s, waiting_s)

    def may_say(self, now: float) -> bool:
        """Whether it is in time; when it is late, only to try it, with nothing on its way."""
        return self.late_s(now) <= LATE_S or not self._said


class PeersOverMqtt:
    """Each vehicle's frames on a topic of its own, QoS 0, never retained.

    A broker or a link that is slow would pass old places off as new ones: while this vehicle's
    own frames come back late, it neither tells nor believes anything.
    """

    def __init__(self, broker: Broker, mission: str) -> None:
        self.sessions = 0
        """How often the broker was found, and has let us hear the peers."""
        self.unsent = self.refused = self.late = 0
        """Datagrams that did not leave, were too long or retained, or came too late."""
        self._broker = broker
        self._mission = mission
        self._echo = Echo()
        self._ours: set[int] = set()
        self._waiting: asyncio.Queue[tuple[int, bytes]] = asyncio.Queue(MOST_WAITING)
        self._is_connected = False

    def send(self, sysid: int, data: bytes) -> bool:
        """Leave it to be sent at once; False when it is not."""
        now = asyncio.get_running_loop().time()
        self._ours.add(sysid)
        if self._is_connected and self._echo.may_say(now) and not self._waiting.full():
            self._echo.say(data, now)
            self._waiting.put_nowait((sysid, data))
            return True
        self.unsent += 1
        return False

    async def carry(self, arrived: Arrived) -> None:
        """Give what arrives to `arrived` until cancelled, whatever becomes of the broker."""

        async def serve(client: aiomqtt.Client) -> None:
            try:
                await self._serve(client, arrived)
            finally:
                self._is_connected = False

        words = "peers over it"
        await stay_connected(self._broker, serve, without=words, longest_retry_s=LONGEST_RETRY_S)

    def account(self) -> list[str]:
        """Say what did not arrive."""
        counts = {
            "did not leave": self.unsent,
            "came too late": self.late,
            "were no peer's": self.refused,
        }
        words = ", ".join(f"{count} datagrams {what}" for what, count in counts.items() if count)
        return [f"peers over {self._broker}: {words}"] if words else []

    def close(self) -> None:
        """Do nothing: the connection ends with `carry`."""

    async def _serve(self, client: aiomqtt.Client, arrived: Arrived) -> None:
        await may_hear(client, [peers_topic(self._mission)], 0, "peers")
        self._echo, self._waiting = Echo(), asyncio.Queue(MOST_WAITING)
        self._is_connected = True
        self.sessions += 1
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._publish(client), name="peers over MQTT")
            async for message in client.messages:
                self._hear(message, arrived)

    async def _publish(self, client: aiomqtt.Client) -> None:
        while True:
            sysid, data = await self._waiting.get()
            await client.publish(peers_topic(self._mission, sysid), data, qos=0)

    def _hear(self, message: aiomqtt.Message, arrived: Arrived) -> None:
        sender, data = str(message.topic).split("/")[-2], bytes(message.payload)
        now = asyncio.get_running_loop().time()
        if message.retain or len(data) > MOST_BYTES or not sender.isdecimal():
            self.refused += 1
        elif int(sender) in self._ours:
            self._echo.hear(data, now)
        elif self._echo.late_s(now) > LATE_S:
            self.late += 1
        else:
            arrived(data, int(sender))
