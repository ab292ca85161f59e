"""What a process that flies vehicles tells a broker, as long as there is one."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
from collections.abc import Callable, Sequence

import aiomqtt

from swarm_ctl import model
from swarm_ctl.agent.agent import Agent
from swarm_ctl.bus.messages import Info, info_topic
from swarm_ctl.bus.mqtt import Broker, stay_connected
from swarm_ctl.bus.voice import Voice
from swarm_ctl.model import Vec3

LONGEST_RETRY_S = 4.0
"""Longest wait between two attempts to connect."""
AT_ONCE = 2
"""Vehicles that connect together: connecting takes a thread, and others wait for those, too."""
LAST_WORDS_S = 5.0
"""How long the last words of all vehicles may take when their missions have ended."""


class Publisher:
    """Each vehicle with a connection and last will of its own, behind one that finds the broker.

    `event` and `look` are called while vehicles fly: they only take notes.
    """

    def __init__(
        self,
        broker: Broker,
        info: Info,
        agents: Sequence[Agent],
        *,
        restarts: Callable[[int], int] = lambda _: 0,
        origins: dict[int, Vec3] | None = None,
    ) -> None:
        """Tell of these agents; `origins` are their starts in the launch frame, if known."""
        self._broker = broker
        self._info = info
        origins, token = origins or {}, secrets.token_hex(4)
        self._voices = {
            agent.sysid: Voice(
                agent,
                info,
                f"swarm-{token}-{agent.sysid}",
                origin=origins.get(agent.sysid),
                restarts=restarts(agent.sysid),
            )
            for agent in agents
        }
        self.sessions = 0
        """How often the broker was found."""
        self._gate = asyncio.Semaphore(AT_ONCE)

    def event(self, event: model.Event) -> None:
        """Note a fact about a vehicle."""
        self._voices[event.sysid].note(event)

    def look(self, agent: Agent) -> None:
        """Note where a vehicle is; call it every tick."""
        self._voices[agent.sysid].look()

    async def run(self) -> None:
        """Tell until cancelled, whatever becomes of the broker."""
        await stay_connected(
            self._broker, self._serve, longest_retry_s=LONGEST_RETRY_S, is_quiet=True
        )

    async def finish(self) -> list[str]:
        """Wait for the last words, but not for long; say what did not get out."""
        patience_s = LAST_WORDS_S if self.sessions else 0.0
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                for voice in self._voices.values():
                    await voice.is_silent.wait()
        lost = sum(voice.journal.lost for voice in self._voices.values())
        waiting = sum(voice.journal.waiting for voice in self._voices.values())
        counts = {"were lost": lost, "were never taken": waiting}
        words = ", ".join(f"{count} events {what}" for what, count in counts.items() if count)
        return [f"{self._broker}: {words}"] if words else []

    async def _serve(self, client: aiomqtt.Client) -> None:
        await client.publish(info_topic(self._info.mission), self._info.dump(), qos=1, retain=True)
        self.sessions += 1
        async with asyncio.TaskGroup() as tasks:
            for sysid, voice in self._voices.items():
                tasks.create_task(self._speak(voice), name=f"bus of vehicle {sysid}")
            async for _ in client.messages:
                pass

    async def _speak(self, voice: Voice) -> None:
        async with contextlib.AsyncExitStack() as stack:
            async with self._gate:
                connection = self._broker.client(voice.name, voice.will)
                client = await stack.enter_async_context(connection)
            await voice.speak(client)
