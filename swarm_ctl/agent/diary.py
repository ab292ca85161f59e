"""What a controller writes down of its agent, and how an agent goes on from it after a restart.

A page holds what is new since the last one: what changed of the state, and where the lists that
only ever grow have grown (trail, logs of the explorer, ground written off). It is written before
the frames of its tick leave: peers are never told of a log entry that a restart would not know.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from swarm_ctl.agent.phases import Phase
from swarm_ctl.agent.victims import Report
from swarm_ctl.autopilot.status import AUTOPILOTS
from swarm_ctl.explore.explorer import WrittenOff
from swarm_ctl.explore.pieces import START
from swarm_ctl.frames import Geodetic
from swarm_ctl.model import Vec3

if TYPE_CHECKING:
    from swarm_ctl.agent.agent import Agent

PAGE_S = 1.0
"""Mission time between two pages, at most."""
PADDING = 256
"""Log entries that a power failure may have taken from us and not from our peers: more than two
seconds see. As many are skipped, so that no number ever stands for two entries."""
_AS_BEFORE = frozenset({Phase.YIELDED, Phase.DONE, Phase.FAILED})
"""Phases that a restart changes nothing about."""
_STATE = (
    *("reason", "trouble", "homebound", "is_paused", "began_s"),
    *("explored_from_s", "explored_to_s"),
)
"""Attributes of an agent that are written and read as they are."""

Page = dict[str, Any]
"""JSON values, ready to be written as a line."""


class Diary:
    """Give page after page of what is new about an agent; nothing twice."""

    def __init__(self, agent: Agent) -> None:
        """Begin with an agent of whom nothing is written down, or all that it knows now."""
        self._agent = agent
        self._phase: Phase | None = None
        self._state: Page = {}
        self._due_s = -math.inf
        agent.trail.fresh = agent.trail.fresh or []
        self._marks = len(agent.trail.fresh)
        """Those of an earlier process, which are written down already."""
        self._seen, self._known = len(agent.victims.seen), len(agent.victims.known)
        self._told: dict[int, int] = {}
        self._written_off = 0
        if (explorer := agent.explorer) is not None:
            explorer.trails.beyond(self._told)
            self._written_off = len(explorer.written_off)

    def wait(self) -> None:
        """Write nothing until the phase changes: a journal that grows says who has the stick."""
        self._phase = _phase(self._agent)
        self._due_s = math.inf

    def page(self, now: float) -> Page | None:
        """Give what is new, if anything important is or a second has passed."""
        if now < self._due_s and not self._has_news():
            return None
        self._due_s = now + PAGE_S
        self._phase = _phase(self._agent)
        before, self._state = self._state, _state(self._agent)
        new = dict(item for item in self._state.items() if item not in before.items())
        return {"time_s": round(now, 3), **new, **self._grown()}

    def _has_news(self) -> bool:
        """Whether something has happened that may not wait: what peers are told least of all."""
        agent, explorer = self._agent, self._agent.explorer
        if agent.phase is not self._phase and _phase(agent) is not self._phase:
            return True
        if self._due_s == math.inf:
            return False
        if self._has_new_victims():
            return True
        if explorer is None or not agent.neighbours:
            return False
        return explorer.trails.length(explorer.trails.own) > self._told.get(explorer.trails.own, 0)

    def _has_new_victims(self) -> bool:
        victims = self._agent.victims
        return len(victims.seen) > self._seen or len(victims.known) > self._known

    def _grown(self) -> Page:
        """Give the new ends of the lists."""
        agent, grown = self._agent, Page()
        fresh, agent.trail.fresh = agent.trail.fresh or [], []
        if marks := fresh[self._marks :]:
            grown["trail"] = marks  # exact: rounding could change its cells
        self._marks = 0
        if self._has_new_victims():
            seen = list(agent.victims.seen.items())[self._seen :]
            known = list(agent.victims.known.values())[self._known :]
            grown["victims"] = [[number, *_rounded(place)] for number, place in seen]
            grown["told"] = [[number, finder, *_rounded(place)] for number, finder, place in known]
            self._seen, self._known = self._seen + len(seen), self._known + len(known)
        if (explorer := agent.explorer) is not None:
            if logs := explorer.trails.beyond(self._told):
                grown["logs"] = [base64.b64encode(payload).decode() for payload in logs]
            if written_off := explorer.written_off[self._written_off :]:
                grown["written_off"] = written_off
                self._written_off += len(written_off)
        return grown


def resume(
    agent: Agent, pages: Sequence[Page], now: float, away_s: float, *, is_whole: bool = True
) -> Diary:
    """Let a new agent go on where the pages of an earlier process end; give the diary to go on in.

    Nobody was there for `away_s`. Pages that are not `is_whole` lack an end that peers may have
    heard of. In flight the agent begins as if its autopilot had been silent all the while.
    """
    state: Page = {}
    for page in pages:
        state |= page
    phase = Phase(state.get("phase", Phase.CONNECTING))
    if phase in {Phase.CONNECTING, Phase.READY}:
        return Diary(agent)
    _remember(agent, state, pages, now)
    diary = Diary(agent)
    if not is_whole:
        _pad(agent)
    agent.now = agent.entered_s = agent.telemetry.heard_s = now
    agent.vigil.lost_from = Phase(state["lost_from"] or phase)
    agent.phase = phase if phase in _AS_BEFORE else Phase.LOST
    if agent.is_ended:  # nobody will ask any more what it was
        named = (pilot for pilot in AUTOPILOTS.values() if pilot.name == state["autopilot"])
        agent.telemetry.autopilot = next(named, None)
    if agent.phase is Phase.LOST:
        agent.reason = f"its controller was away for {away_s:.1f} s"
        diary.wait()
    agent.note("ControllerRestarted", phase=phase.value, away_s=round(away_s, 1))
    return diary


def distrust(agent: Agent, why: str, now: float) -> Diary:
    """Let a new agent land a vehicle of which it cannot know what it was doing, if it flies.

    Without a reason `why`, nothing was ever written: a vehicle that stands may still begin.
    """
    agent.now = agent.entered_s = agent.telemetry.heard_s = now
    agent.phase, agent.vigil.lost_from = Phase.LOST, None if why else Phase.ARMING
    agent.reason = agent.vigil.distrust = why or "its journal says nothing of the flight"
    diary = Diary(agent)
    diary.wait()
    agent.note("JournalUnusable", reason=agent.reason)
    return diary


def _state(agent: Agent) -> Page:
    telemetry, explorer = agent.telemetry, agent.explorer
    was = agent.vigil.lost_from if agent.phase is Phase.LOST else None
    return {
        "phase": _phase(agent).value,
        "lost_from": was and was.value,
        **{name: getattr(agent, name) for name in _STATE},
        "autopilot": telemetry.autopilot and telemetry.autopilot.name,
        "boot_s": round(telemetry.boot_s, 1),
        "origin": telemetry.origin and list(telemetry.origin),
        "start_ned_m": _rounded(telemetry.start_ned_m),
        "position_ned_m": _rounded(telemetry.position_ned_m),
        "target_ned_m": agent.target_ned_m and _rounded(agent.target_ned_m),
        "head_m": _rounded(explorer.head_m if explorer else ()),
        "peers": agent.peers.heard(agent.now),
        "messages": [agent.sender.sent, agent.parser.stats.frames, agent.messages_lost],
    }


def _phase(agent: Agent) -> Phase:
    """Give the phase; avoiding is a part of exploring."""
    return Phase.EXPLORING if agent.phase is Phase.AVOIDING else agent.phase


def _rounded(place: Iterable[float]) -> list[float]:
    return [round(value, 3) for value in place]


def _remember(agent: Agent, state: Page, pages: Sequence[Page], now: float) -> None:
    """Put back what was known."""
    for name in _STATE:
        setattr(agent, name, state[name])
    if state["phase"] == Phase.EXPLORING:
        agent.explored_to_s = state["time_s"]
    agent.vigil.boot_s, agent.vigil.left_ned_m = state["boot_s"], Vec3(*state["position_ned_m"])
    agent.telemetry.start_ned_m = Vec3(*state["start_ned_m"])
    agent.telemetry.origin = Geodetic(*state["origin"]) if state["origin"] else None
    agent.telemetry.position_ned_m = agent.hold_ned_m = agent.vigil.left_ned_m
    agent.sender.sent, agent.parser.stats.frames, agent.lost_before = state["messages"]
    agent.victims.remember(
        {number: Vec3(*place) for number, *place in _all(pages, "victims")},
        (Report(number, by, Vec3(*place)) for number, by, *place in _all(pages, "told")),
    )
    agent.trail.fresh = []
    for place in _all(pages, "trail"):
        agent.trail.mark(Vec3(*place))
    if agent.explorer is not None:
        logs = [base64.b64decode(payload) for payload in _all(pages, "logs")]
        written_off = [WrittenOff(*values) for values in _all(pages, "written_off")]
        agent.explorer.resume(logs, written_off, state["head_m"], now)


def _pad(agent: Agent) -> None:
    """Leave room in the own log for what peers have heard and we have lost."""
    explorer = agent.explorer
    place = explorer.trails.last_m(explorer.trails.own) if explorer else []
    if explorer and place:
        for _ in range(PADDING):
            explorer.trails.append(START, place)


def _all(pages: Sequence[Page], key: str) -> Iterable[Any]:
    return (value for page in pages for value in page.get(key, ()))
