"""Fly a mission with real vehicles: over the links that lead to their autopilots."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from swarm_ctl.agent.phases import Phase
from swarm_ctl.controller import TICK_S, Controller
from swarm_ctl.flight import controllers_for, sign_with
from swarm_ctl.link.shared import Member
from swarm_ctl.mission import Mission
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.record.resume import JOURNALS
from swarm_ctl.run.fleet import Fleet
from swarm_ctl.run.guard import Guard
from swarm_ctl.run.places import HEARD_S, unheard

START_S = 3.0
"""Mission time from ready to take-off: for the operator to read who is there, and to say no."""
WAITING = {Phase.CONNECTING, Phase.READY}
NAMES = {"px4": "PX4", "ardupilot": "ArduPilot"}


class RealRun(Fleet):
    """One mission with the vehicles behind some links."""

    mode = "fly"

    def __init__(
        self,
        mission: Mission,
        folder: RunFolder,
        links: Sequence[Member],
        *,
        speed: float = 1.0,
        key: bytes | None = None,
    ) -> None:
        """Prepare a run; with a key of 32 bytes all that is sent is signed."""
        sysids = [link.sysid for link in links]
        controllers = controllers_for(mission, folder, sysids, delay_s=START_S)
        super().__init__(controllers, folder, speed=speed)
        self.found: list[str] = []
        """A sentence for every vehicle that was found."""
        self._links = links
        self._key = key
        if key is not None:
            sign_with(key, self.controllers, folder.started_utc)

    async def fly(self, progress: Callable[[], None]) -> None:
        """Fly every vehicle until its mission ends, one way or the other."""
        journals = self.folder.path / JOURNALS
        with (
            self.interruptible(),
            Guard(journals, speed=self.clock.speed, key=self._key) as guard,
        ):
            self.tell = guard.tell
            await self.fly_over(self._links, progress, [self._find()])

    async def _find(self) -> None:
        """Say who is there, and give up on who is not heard in time."""
        until_s = self.now + HEARD_S
        waiting = list(zip(self.controllers, self._links, strict=True))
        while waiting:
            waiting = [pair for pair in waiting if not self._is_settled(*pair, until_s)]
            await self.clock.sleep_until(self.now + TICK_S)

    def _is_settled(self, controller: Controller, link: Member, until_s: float) -> bool:
        agent = controller.agent
        if agent.telemetry.autopilot is not None:
            if agent.telemetry.battery_fraction is not None or agent.phase not in WAITING:
                self.found.append(portrait(controller, link))
                return True
        elif self.now > until_s and (link.source is None or agent.sender.gate.refused):
            controller.kill(unheard(link), self.now)
        return agent.is_ended


def portrait(controller: Controller, link: Member) -> str:
    """Say in one line what was found at the other end of a link."""
    telemetry = controller.agent.telemetry
    name = telemetry.autopilot.name if telemetry.autopilot else "unknown"
    battery = telemetry.battery_fraction
    return (
        f"vehicle {link.sysid} at {link.url}: {NAMES.get(name, name)}, mode {telemetry.mode_name}, "
        f"{'armed' if telemetry.armed else 'disarmed'}, "
        f"battery {'unknown' if battery is None else f'{battery:.0%}'}"
    )
