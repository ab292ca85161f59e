"""What telling 20 vehicles over MQTT costs: CPU of the process that flies them, and of a broker."""

from __future__ import annotations

import asyncio
import math
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.phases import Phase
from swarm_ctl.bus.embedded import embedded_broker
from swarm_ctl.bus.messages import Info
from swarm_ctl.bus.mqtt import Broker
from swarm_ctl.bus.publisher import Publisher
from swarm_ctl.flight import orders_of
from swarm_ctl.mission import load_mission
from swarm_ctl.model import Event, Vec3

MOSQUITTO = shutil.which("mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin")
VEHICLES, TOLD_S, TICK_S, EVENTS_EVERY_S = 20, 20.0, 0.1, 5.0
MISSION = Path(__file__).parents[1] / "missions" / "usar_office.yaml"


async def tell(broker: Broker) -> float:
    """Fly 20 vehicles on paper for 20 s and tell of them; give the CPU time it took, s."""
    orders = orders_of(load_mission(MISSION))
    agents = [Agent(sysid, orders) for sysid in range(1, VEHICLES + 1)]
    info = Info("now", "bench", "udp", [], "explore", 2, 60.0, 1, None, None)
    publisher = Publisher(broker, info, agents)
    async with asyncio.TaskGroup() as tasks:
        telling = tasks.create_task(publisher.run())
        while not publisher.sessions:  # noqa: ASYNC110 - another process
            await asyncio.sleep(0.01)
        await asyncio.sleep(1.0)
        began_s, steps = time.process_time(), round(TOLD_S / TICK_S)
        for step in range(steps):
            now = step * TICK_S
            for agent in agents:
                move(agent, now)
                publisher.look(agent)
                if step % round(EVENTS_EVERY_S / TICK_S) == 0:
                    publisher.event(Event(now, agent.sysid, "VictimFound", {"victim": step}))
            await asyncio.sleep(TICK_S)
        spent_s = time.process_time() - began_s
        telling.cancel()
    return spent_s


def move(agent: Agent, now: float) -> None:
    """Fly a spiral at 1 m/s."""
    agent.now, agent.phase = now, Phase.EXPLORING
    turned = math.sqrt(2.0 * now / 0.3)
    north, east = 0.3 * turned * math.cos(turned), 0.3 * turned * math.sin(turned)
    agent.telemetry.position_ned_m = Vec3(north, east, -1.5)


@contextmanager
def mosquitto() -> Iterator[Broker]:
    """Start a broker in a process of its own."""
    with tempfile.NamedTemporaryFile("w", suffix=".conf") as settings:
        settings.write("listener 18831 127.0.0.1\nallow_anonymous true\nlog_dest none\n")
        settings.flush()
        process = subprocess.Popen([MOSQUITTO or "", "-c", settings.name])  # noqa: S603
        try:
            yield Broker("127.0.0.1", 18831)
        finally:
            process.kill()
            process.wait()


def main() -> None:
    """Print a row per broker."""
    print(f"{VEHICLES} vehicles, state at 2 Hz, ground at 1 Hz, an event each {EVENTS_EVERY_S:g} s")
    brokers = {"mosquitto": mosquitto()} if MOSQUITTO else {}
    for name, broker in {**brokers, "embedded": embedded_broker(18832)}.items():
        with broker as at:
            spent_s = asyncio.run(tell(at))
        print(f"{name:10}  {spent_s / TOLD_S:6.2%} of a core in the process that flies")


if __name__ == "__main__":
    main()
