"""One link and the vehicles behind it, each known by its sysid and answered where it is."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from swarm_ctl import wire
from swarm_ctl.link.base import Heard, Link, Source
from swarm_ctl.link.url import parse

AUTOPILOT_COMPONENT, COMPANION_COMPONENT, NO_AUTOPILOT = 1, 191, 8
MOVED_S = 2.0
"""Wall time that a vehicle is silent before another address may speak for it."""
MOST_SOURCES = 1024
"""Addresses listened to; more of them is an attack, not a swarm."""

Clock = Callable[[], float]


class SharedLink:
    """Hands what comes over a link to the vehicle that said it.

    A vehicle is met by a heartbeat of its autopilot, and then has the address that it came from:
    all that comes from there is for it, also what its radio heard of its peers. Where several
    speak from one address (a router, a radio on a serial port), each gets its own frames and those
    of the others' companions.
    """

    def __init__(self, link: Link, clock: Clock = time.monotonic) -> None:
        self.link = link
        self.clock = clock
        self.is_listening = parse(link.url).scheme == "udpin"
        """Whether nobody is known before he calls."""
        self.autopilots: dict[int, Any] = {}
        """The latest heartbeat of every autopilot heard, by sysid."""
        self._members: dict[int, Member] = {}
        self._behind: dict[Source, _Behind] = {}
        self._is_watched = False

    def member(self, sysid: int) -> Member:
        """Give the link of one vehicle; the same one every time."""
        return self._members.setdefault(sysid, Member(self, sysid))

    @property
    def is_noise(self) -> bool:
        """Whether bytes came and none of them was MAVLink, as with a wrong baud rate."""
        stats = [behind.heartbeats.stats for behind in self._behind.values()]
        return bool(stats) and not any(one.frames or one.unknown for one in stats)

    def watch(self) -> None:
        """Let the running event loop listen from now on."""
        if not self._is_watched:
            self._is_watched = True
            self.link.watch(self._take)

    def close(self) -> None:
        """Close the link of all."""
        self.link.close()

    def _take(self, data: bytes, source: Source) -> None:
        behind = self._behind.get(source)
        if behind is None:
            if len(self._behind) >= MOST_SOURCES:
                return
            behind = self._behind[source] = _Behind()
        for frame in behind.heartbeats.feed(data):
            if frame.compid == AUTOPILOT_COMPONENT and frame.values.autopilot != NO_AUTOPILOT:
                self.autopilots[frame.sysid] = frame.values
                self._meet(frame.sysid, source, behind)
        if len(behind.members) == 1:
            behind.members[0].take(data, source)
        elif behind.members:
            behind.share(data, source)

    def _meet(self, sysid: int, source: Source, behind: _Behind) -> None:
        """Note where a vehicle is; it may move when it is silent, as after a restart."""
        member = self._members.get(sysid)
        if member is None or member in behind.members:
            return
        before = member.source
        if before is not None and self.clock() - member.heard_s < MOVED_S:
            return
        if before in self._behind:
            self._behind[before].members.remove(member)
        member.source = source
        behind.members.append(member)


class Member:
    """One vehicle's way over a shared link."""

    def __init__(self, shared: SharedLink, sysid: int) -> None:
        self.url = shared.link.url
        self.sysid = sysid
        self.source: Source | None = None
        """Where it speaks from; None until its autopilot's heartbeat was heard."""
        self.heard_s = -math.inf
        self.shared = shared
        self._heard: Heard | None = None

    def watch(self, heard: Heard) -> None:
        """Let the running event loop give what is for this vehicle to `heard`."""
        self._heard = heard
        self.shared.watch()

    def send(self, data: bytes, to: Source | None = None) -> bool:
        """Send to where the vehicle speaks from; before it has spoken, where the address leads."""
        to = to or self.source
        return (to is not None or not self.shared.is_listening) and self.shared.link.send(data, to)

    def reach(self, to: Source | None = None) -> str:
        """Give an address by which another process reaches the vehicle; empty if none can."""
        return self.shared.link.reach(to or self.source)

    def close(self) -> None:
        """Hear nothing any more; the link stays open for the others."""
        self._heard = None

    def take(self, data: bytes, source: Source) -> None:
        """Take what is for this vehicle."""
        self.heard_s = self.shared.clock()
        if self._heard is not None:
            self._heard(data, source)


class _Behind:
    """Who is behind one address."""

    def __init__(self) -> None:
        self.members: list[Member] = []
        self.heartbeats = wire.Parser(("HEARTBEAT",))
        self._frames = wire.Parser(None)

    def share(self, data: bytes, source: Source) -> None:
        """Give each its own frames, and those of the others' companions."""
        frames = self._frames.feed(data)
        for member in self.members:
            own = [frame.raw for frame in frames if _is_for(member.sysid, frame)]
            if own:
                member.take(b"".join(own), source)


def _is_for(sysid: int, frame: wire.Frame) -> bool:
    return frame.sysid == sysid or frame.compid == COMPANION_COMPONENT
