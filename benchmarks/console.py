"""A hundred vehicles at 2 Hz in the console: what its server and its page cost.

    python benchmarks/console.py [--vehicles 100] [--seconds 20]

Needs mosquitto and chromium. A real console in a real browser hears a real broker; only the
vehicles are made up: they fly circles, and tell as controllers do.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import multiprocessing
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import aiomqtt
import psutil

sys.path.append(str(Path(__file__).parents[1] / "tests"))

import mosquitto
from browser import chromium

from swarm_ctl.bus.messages import Coverage, Info, State, info_topic, topic

RUN, MISSION = "2026-11-22T09:00:00+00:00", "bench"
STATE_S = 0.5
CELL_M = 0.25
SPACING_M = 12.0
JANK = """
window.gaps = [];
new PerformanceObserver((list) => list.getEntries().forEach((e) => gaps.push(e.duration)))
  .observe({ entryTypes: ["longtask"] });
"""


def state(sysid: int, now: float) -> State:
    """Fly a circle of 4 m radius in 20 s."""
    angle = sysid + now * math.tau / 20.0
    north, east = divmod(sysid - 1, 10)
    return State(
        run=RUN,
        sysid=sysid,
        time_s=round(now, 3),
        phase="exploring",
        words="",
        is_paused=False,
        is_waiting=False,
        position_ned_m=[round(4.0 * math.cos(angle), 3), round(4.0 * math.sin(angle), 3), -1.5],
        velocity_ned_m_s=[0.0, 1.26, 0.0],
        yaw_rad=round(math.remainder(angle + 0.5 * math.pi, math.tau), 3),
        target_ned_m=None,
        origin_ned_m=[SPACING_M * north, SPACING_M * east, 0.0],
        origin_geodetic=None,
        battery=0.8,
        link_age_s=0.05,
        neighbours=[other for other in range(sysid - 3, sysid + 4) if 1 <= other != sysid],
        ranges_m=[None] * 6,
        victims=[],
        seen_m2=10.0,
        autopilot="PX4",
    )


def ground(sysid: int, number: int, now: float) -> Coverage:
    """Tell forty new squares a second, a patch of ten by four."""
    row, column = 4 * (number % 10), 10 * ((number // 10) % 4)
    rows = [[row + i - 20, column - 20, 10] for i in range(4)]
    return Coverage(RUN, sysid, number, round(now, 3), CELL_M, rows)


async def tell(url: str, vehicles: int) -> None:
    """Publish as so many controllers do, until cancelled."""
    host, port = url.removeprefix("mqtt://").split(":")
    sysids = range(1, vehicles + 1)
    async with aiomqtt.Client(host, int(port)) as client:
        client.pending_calls_threshold = 2 * vehicles  # one connection stands for all of theirs
        info = Info(RUN, MISSION, "udp", [*sysids], "explore", 2, 600.0, 1, None, None)
        await client.publish(info_topic(MISSION), info.dump(), qos=1, retain=True)
        async with asyncio.TaskGroup() as tasks:
            for sysid in sysids:
                tasks.create_task(fly(client, sysid), name=f"vehicle {sysid}")


async def fly(client: aiomqtt.Client, sysid: int) -> None:
    """Tell of one vehicle on the beat."""
    began = time.monotonic()
    for tick in range(10**9):
        await asyncio.sleep(max(0.0, began + tick * STATE_S - time.monotonic()))
        told = state(sysid, tick * STATE_S)
        await client.publish(topic(MISSION, sysid, "state"), told.dump(), retain=True)
        if tick % 2:
            news = ground(sysid, tick // 2 + 1, tick * STATE_S)
            await client.publish(topic(MISSION, sysid, "coverage"), news.dump(), qos=1)


def measure(vehicles: int, seconds: float) -> None:
    """Start all of it, and measure when it runs evenly."""
    if chromium.PROGRAM is None or mosquitto.PROGRAM is None:
        print("chromium or mosquitto is not installed: nothing to measure the console with")
        return
    with tempfile.TemporaryDirectory() as name:
        broker = mosquitto.Mosquitto(Path(name))
        broker.start()
        words = [sys.executable, "-m", "swarm_ctl", "console", "--port", "0", "--mqtt", broker.url]
        server = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)  # noqa: S603 - our own
        telling = multiprocessing.Process(target=run, args=(broker.url, vehicles), daemon=True)
        telling.start()
        try:
            address = server.stdout.readline().split()[-1] if server.stdout else ""
            look(address, server.pid, seconds, vehicles, Path(name))
        finally:
            telling.terminate()
            server.terminate()
            server.communicate()
            broker.kill()


def run(url: str, vehicles: int) -> None:
    """Be the swarm, in a process of its own."""
    asyncio.run(tell(url, vehicles))


def look(address: str, pid: int, seconds: float, vehicles: int, folder: Path) -> None:
    """Open the page and print what it costs."""
    with chromium.Chromium(folder) as browser:
        browser.open(address)
        browser.until(f"document.querySelectorAll('tbody tr').length === {vehicles}")
        time.sleep(5.0)  # noqa: TID251 - other processes are watched
        browser.run(JANK)
        process = psutil.Process(pid)  # type: ignore[no-untyped-call]
        before, bytes_before, frames_before = process.cpu_times(), browser.bytes, browser.frames
        began = time.monotonic()
        time.sleep(seconds)  # noqa: TID251 - as above
        gaps = browser.run("gaps")
        after, seconds = process.cpu_times(), time.monotonic() - began
        browser.picture(Path(tempfile.gettempdir()) / "console_bench.png")
        spent_s = after.user + after.system - before.user - before.system
        print(f"{vehicles} vehicles, 2 Hz, {seconds:.1f} s")
        print(f"server: {spent_s / seconds:.1%} of a core")
        print(f"page: {(browser.bytes - bytes_before) / seconds / 1000:.1f} kB/s")
        print(f"drawn: {(browser.frames - frames_before) / seconds:.2f} frames a second")
        print(f"scripts longer than 50 ms: {len(gaps)}, the longest {max(gaps, default=0):.0f} ms")
        print(f"the page said: {browser.said}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    measure(options.vehicles, options.seconds)
