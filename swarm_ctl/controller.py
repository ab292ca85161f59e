"""One controller per vehicle: an agent, its record, and the asyncio shell that flies it."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import deque
from collections.abc import Callable

from swarm_ctl.agent.agent import Agent
from swarm_ctl.agent.diary import Diary, distrust, resume
from swarm_ctl.link import MESH, Link, Source
from swarm_ctl.model import Event, Operator, Vec3
from swarm_ctl.record.paths import WAYPOINT_S
from swarm_ctl.record.summary import VehicleResult
from swarm_ctl.record.unrecorded import Record

TICK_S = 0.1
"""Mission time between two decisions and two setpoints."""
LATE_S = 0.02
"""Mission time after which a tick that has not begun has missed its deadline."""
WAITING_MAX = 1000
"""Datagrams that wait for the next tick; the oldest of more are dropped."""
KILLED = "its controller was killed"


class Controller:
    """An agent together with what it leaves behind; still without sockets and clocks."""

    def __init__(self, index: int, agent: Agent, folder: Record) -> None:
        self.index = index
        self.agent = agent
        self._folder = folder
        self._tlog = folder.tlog(agent.sysid)
        self._waypoints = folder.waypoints(agent.sysid)
        self._next_waypoint_s = 0.0
        self._target: Vec3 | None = None
        self._diary = self._take_over()
        self._flight_journal = folder.flight_journal(agent.sysid)
        if self._flight_journal is None:
            agent.trail.fresh = None  # which nobody would take away
        self.tell: Callable[[Event], None] = lambda _: None
        """Is told of every event as it is written down."""
        self.ticks_due = 0
        """Ticks that real time asked for."""
        self.ticks_late = 0
        """Those of them that began late, or not at all."""
        self.unsent = 0
        """Datagrams that did not leave, though somebody had been heard: a full buffer."""
        self.unheard = 0
        """Datagrams that arrived and were dropped: too many waited for a tick."""

    def _take_over(self) -> Diary:
        """Go on where an earlier process was killed, if there was one."""
        folder, agent = self._folder, self.agent
        story, now = folder.story(agent.sysid), folder.resumed_s
        if story is None or now is None:
            return Diary(agent)
        if not story.fault and story.pages:
            away_s = now - story.pages[-1]["time_s"]
            return resume(agent, story.pages, now, away_s, is_whole=story.is_whole)
        return distrust(agent, story.fault, now)

    def receive(self, data: bytes, now: float) -> None:
        """Take a datagram from the vehicle."""
        self._folder.hash.frame(self.index, False, data)
        self._tlog.write(data, now)
        self.agent.receive(data, now)

    def overhear(self, data: bytes, now: float) -> None:
        """Take what peers tell beside the vehicle's own link."""
        self._folder.hash.frame(self.index, False, data)
        self._tlog.write(data, now)
        self.agent.overhear(data, now)

    def tick(self, now: float) -> bytes:
        """Decide; give the datagram to send."""
        data = self.agent.tick(now)
        if data:
            self._folder.hash.frame(self.index, True, data)
            self._tlog.write(data, now)
        self.record(now)
        return data

    def keep_time(self, late_s: float) -> int:
        """Count a tick that begins so late; give the number of those left out because of it."""
        left_out = max(0, int(late_s / TICK_S))
        self.ticks_due += 1 + left_out
        self.ticks_late += left_out + (late_s > LATE_S)
        return left_out

    def record(self, now: float) -> None:
        """Write down what happened since the last call."""
        agent = self.agent
        for event in agent.drain_events():
            self.tell(event)
            self._folder.journal.write(event)
        if self._flight_journal is not None and (page := self._diary.page(now)) is not None:
            self._flight_journal.append(page)
        if agent.explored_from_s is None:
            return
        if now >= self._next_waypoint_s:
            self._next_waypoint_s = now + WAYPOINT_S
            peers = agent.peers.heard(now)
            self._waypoints.visited(now, agent.telemetry.position_ned_m, peers)
        if agent.target_ned_m is not None and agent.target_ned_m != self._target:
            self._target = agent.target_ned_m
            self._waypoints.target(now, self._target)

    def order(self, operator: Operator, now: float) -> bool:
        """Pass on an operator's order; False for one that makes no sense now."""
        is_obeyed = self.agent.order(operator, now)
        with contextlib.suppress(OSError):  # it is done, also when it cannot be written down
            self.record(now)
        return is_obeyed

    def kill(self, reason: str, now: float) -> None:
        """End this controller; its vehicle is left to its autopilot's own failsafe."""
        self.agent.fail(reason, now)
        with contextlib.suppress(OSError):  # it ends, also when its record cannot be written
            self.record(now)

    def break_down(self, error: Exception, now: float) -> None:
        """End this controller by what it raised: one vehicle never stops another."""
        self.kill(f"its controller broke: {type(error).__name__}: {error}", now)

    def result(self) -> VehicleResult:
        """Sum up this vehicle's flight."""
        agent = self.agent
        return VehicleResult(
            sysid=agent.sysid,
            phase=agent.phase.value,
            reason=agent.trouble,
            messages_sent=agent.sender.sent,
            messages_received=agent.parser.stats.frames,
            messages_lost=agent.messages_lost,
            victims=sorted(agent.victims.seen),
            explored_from_s=agent.explored_from_s,
            explored_to_s=agent.explored_to_s,
            autopilot=agent.telemetry.autopilot.name if agent.telemetry.autopilot else "",
            path_length_m=self._waypoints.length_m,
            ticks_due=self.ticks_due,
            ticks_late=self.ticks_late,
            unsent=self.unsent,
            unheard=self.unheard,
        )


class Clock:
    """Mission time that follows the machine's clock, `speed` times as fast."""

    def __init__(self, speed: float = 1.0, now: float = 0.0) -> None:
        """Start it at a mission time."""
        self.speed = speed
        self._began = time.monotonic() - now / speed

    def now(self) -> float:
        """Give mission time in seconds."""
        return (time.monotonic() - self._began) * self.speed

    async def sleep_until(self, moment_s: float) -> None:
        """Sleep until a moment of mission time."""
        await asyncio.sleep(max(0.0, (moment_s - self.now()) / self.speed))


Tell = Callable[[Agent, str], None]
"""Is told of an agent, and how its vehicle is reached; empty when nobody steers it any more."""


class Flight:
    """One vehicle over a link, tick by tick, until its mission ends.

    Deadlines are absolute, so ticks do not drift; a tick that was missed is left out, so a
    process that stalled does not send a burst of stale setpoints. `offset_s` spreads vehicles.
    What arrives waits for the tick, with the time of its arrival: decisions are made there, and
    were each datagram read at once, who serves many would keep other vehicles' ticks waiting. What
    was decided waits for `send`: who hears many is woken once for those who tick together.
    Each tick, and when all is over, `tell` is told of the agent and how its vehicle is reached.
    """

    def __init__(
        self,
        controller: Controller,
        link: Link,
        clock: Clock,
        *,
        offset_s: float = 0.0,
        tell: Tell | None = None,
    ) -> None:
        """Prepare it; the first tick is due in `offset_s`."""
        self.controller = controller
        self.due_s = clock.now() + offset_s
        """Mission time of the next tick."""
        self._link, self._clock, self._tell = link, clock, tell
        self._waiting: deque[tuple[bytes, Source, float]] = deque(maxlen=WAITING_MAX)
        self._decided: bytes | None = None

    @property
    def is_over(self) -> bool:
        """Whether no tick is to come."""
        return self.controller.agent.is_ended

    def listen(self) -> None:
        """Let what arrives wait for the next tick."""
        self._link.watch(self._hear)

    def tick(self) -> None:
        """Read what has arrived and decide; when it raises, the vehicle stands still."""
        try:
            self._decided = self._decide()
        except Exception:
            last_word = self.controller.agent.standstill()  # it would fly on for a while
            self._link.send(last_word)
            raise

    def send(self) -> None:
        """Send what the last tick has decided, and tell of it; nothing without one."""
        data, self._decided = self._decided, None
        if data is None:
            return
        controller = self.controller
        if data and not self._link.send(data):
            controller.unsent += controller.agent.parser.stats.frames > 0
        if self._tell is not None:
            self._tell(controller.agent, self._link.reach())

    def close(self) -> None:
        """Hear and send nothing any more."""
        if self._tell is not None:
            self._tell(self.controller.agent, "")
        self._link.close()

    def _hear(self, data: bytes, source: Source) -> None:
        waiting = self._waiting
        self.controller.unheard += len(waiting) == WAITING_MAX
        waiting.append((data, source, self._clock.now()))

    def _decide(self) -> bytes:
        controller, waiting, now = self.controller, self._waiting, self._clock.now()
        left_out = controller.keep_time(now - self.due_s)
        while waiting:
            data, source, arrived_s = waiting.popleft()
            take = controller.overhear if source == MESH else controller.receive
            take(data, arrived_s)
        data = controller.tick(now)
        self.due_s += TICK_S * (1 + left_out)
        return data


async def fly(
    controller: Controller,
    link: Link,
    clock: Clock,
    *,
    offset_s: float = 0.0,
    tell: Tell | None = None,
) -> None:
    """Fly one vehicle over a link until its mission ends; `Flight` tells of the arguments."""
    flight = Flight(controller, link, clock, offset_s=offset_s, tell=tell)
    with contextlib.closing(flight):
        flight.listen()
        while not flight.is_over:
            await clock.sleep_until(flight.due_s)
            flight.tick()
            flight.send()
