"""The vehicles of other shards as this one knows them: bodies to see and to touch, and radios."""

from __future__ import annotations

import json
import math
import zlib
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.shards import Part
from mock_vehicle.shards.letter import GROUNDED, ON_AIR, ROW, Letter, Rows, Sent, read
from swarm_ctl.wire import split

if TYPE_CHECKING:
    from mock_vehicle.world import World

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]
INDICES = NDArray[np.intp]

MAVLINK_1 = 0xFE
NOWHERE_M = 1e7
"""Where those are of whom nothing is known: nobody sees or hears them."""
GUESS_S = 0.5
"""Mission time for which who was told of is taken to fly straight on; then it stays."""


class Strangers(NamedTuple):
    """Vehicles of other shards that are near, (q,) each, at one time."""

    vehicles: INDICES
    """Counted from 0 through the mission."""
    position_ned_m: FLOATS
    """(q, 3)."""
    velocity_ned_m_s: FLOATS
    """(q, 3)."""
    grounded: BOOLS
    counts_here: BOOLS
    """Whether this shard counts contacts with it: of two shards the lower one does."""


NO_STRANGERS = Strangers(
    np.empty(0, dtype=np.intp),
    np.empty((0, 3)),
    np.empty((0, 3)),
    np.empty(0, dtype=bool),
    np.empty(0, dtype=bool),
)


def tag_of(world: World, part: Part, seed: int) -> int:
    """Give the tag of a mission, which is another one in another world or fleet."""
    facts = (world.outline(), part.vehicles, part.shards, seed)
    return zlib.crc32(json.dumps(facts).encode())


class Abroad:
    """What other shards have told, and what they shall be told."""

    def __init__(self, part: Part, tag: int, first_sysid: int = 1) -> None:
        """Know nothing yet; `tag` is that of the mission, which all shards must share."""
        self.part = part
        self.tag = tag
        self.outgoing: list[Sent] = []
        """Frames that own vehicles broadcast, for the other shards of the group."""
        self.rows: Rows = np.zeros(len(part.own), ROW)
        """Where the own vehicles are."""
        self.refused: Counter[str] = Counter()
        """Letters and frames not taken, by why."""
        self.latest_s: dict[int, float] = {}
        """The mission time of each shard that is heard and flies."""
        n = part.vehicles
        self._sysids = {v: first_sysid + v - part.members.start for v in part.members}
        self._position_ned_m = np.full((n, 3), NOWHERE_M)
        self._velocity_ned_m_s = np.zeros((n, 3))
        self._told_s = np.zeros(n)
        self._shard = np.zeros(n, dtype=np.intp)
        """Who told of it; 0 is nobody."""
        self._flags = np.zeros(n, dtype=np.uint8)
        self._loss = np.zeros(n)
        self._near: INDICES = np.empty(0, dtype=np.intp)
        self.rows["vehicle"] = part.own

    def learn(self, data: bytes, shard: int, vehicles: range) -> list[Sent] | None:
        """Take what a shard that flies these `vehicles` told; give what they broadcast.

        Never raises: what is no letter, or tells of what is not the sender's, is counted, and
        gives None.
        """
        letter = read(data)
        if letter is None or letter.shard != shard or not _tells_of(letter, vehicles):
            self.refused["malformed"] += 1
            return None
        if letter.tag != self.tag:
            self.refused["other mission"] += 1
            return None
        if letter.time_s > 0.0:  # else it waits for somebody, and nobody for it
            self.latest_s[shard] = max(self.latest_s.get(shard, 0.0), letter.time_s)
        self._place(letter)
        heard = [sent for sent in letter.frames if self._is_theirs(*sent)]
        if len(heard) < len(letter.frames):
            self.refused["frames"] += len(letter.frames) - len(heard)
        return heard

    def is_of_another(self, data: bytes) -> bool:
        """Tell whether it is a letter, of another mission."""
        letter = read(data)
        return letter is not None and letter.tag != self.tag

    def _place(self, letter: Letter) -> None:
        at = letter.rows["vehicle"].astype(np.intp)
        news = letter.time_s >= self._told_s[at]  # datagrams overtake one another
        at, rows = at[news], letter.rows[news]
        self._position_ned_m[at] = rows["position_ned_m"]
        self._velocity_ned_m_s[at] = rows["velocity_ned_m_s"]
        self._told_s[at], self._shard[at] = letter.time_s, letter.shard
        self._flags[at], self._loss[at] = rows["flags"], rows["loss"] / 255.0

    def _is_theirs(self, vehicle: int, frame: bytes) -> bool:
        """Tell whether it is one whole frame of a vehicle of our group, under its own sysid."""
        if not frame or next(split(frame), b"") != frame:
            return False
        return frame[3 if frame[0] == MAVLINK_1 else 5] == self._sysids.get(vehicle)

    def forget(self, shard: int) -> int:
        """Let the vehicles of a shard that is not heard any more be nowhere; count who flew."""
        self.latest_s.pop(shard, None)
        gone = self._shard == shard
        flew = int(np.count_nonzero(gone & (self._flags & GROUNDED == 0)))
        self._position_ned_m[gone], self._velocity_ned_m_s[gone] = NOWHERE_M, 0.0
        self._told_s[gone], self._shard[gone], self._flags[gone] = 0.0, 0, 0
        return flew

    def note(
        self,
        position_ned_m: FLOATS,
        velocity_ned_m_s: FLOATS,
        on_air: BOOLS,
        grounded: BOOLS,
        loss: FLOATS,
    ) -> None:
        """Note of the own vehicles what the other shards shall be told."""
        rows = self.rows
        rows["position_ned_m"], rows["velocity_ned_m_s"] = position_ned_m, velocity_ned_m_s
        rows["flags"] = on_air * ON_AIR + grounded * GROUNDED
        rows["loss"] = np.rint(loss * 255.0)

    def choose(self, position_ned_m: FLOATS, reach_m: float, now: float) -> Strangers:
        """Find the strangers within reach of the box around the own vehicles, (n, 3)."""
        low, high = position_ned_m.min(axis=0) - reach_m, position_ned_m.max(axis=0) + reach_m
        there = self._at(np.arange(self.part.vehicles), now)
        within = ((there >= low) & (there <= high)).all(axis=1) & (self._shard > 0)
        (self._near,) = np.nonzero(within)
        return self.strangers(now)

    def strangers(self, now: float) -> Strangers:
        """Tell where those who were near when last chosen are now."""
        near = self._near
        grounded = (self._flags[near] & GROUNDED) > 0
        counts_here = self._shard[near] > self.part.shard
        place, velocity = self._at(near, now), self._velocity_ned_m_s[near]
        return Strangers(near, place, velocity, grounded, counts_here)

    def group(
        self, position_ned_m: FLOATS, alive: BOOLS, loss: FLOATS, now: float
    ) -> tuple[FLOATS, BOOLS, FLOATS]:
        """Give all of the group, (g, 3), (g,) and (g,), with these values for the own vehicles."""
        members = self.part.members
        everybody = self._at(np.arange(members.start, members.stop), now)
        on_air = (self._flags[members.start : members.stop] & ON_AIR) > 0
        losses = self._loss[members.start : members.stop].copy()
        own = slice(self.part.own.start - members.start, self.part.own.stop - members.start)
        everybody[own], on_air[own], losses[own] = position_ned_m, alive, loss
        return everybody, on_air, losses

    def _at(self, vehicles: INDICES, now: float) -> FLOATS:
        """Guess where vehicles are now, (k, 3)."""
        since_s = np.clip(now - self._told_s[vehicles], 0.0, GUESS_S)[:, None]
        guess: FLOATS = self._position_ned_m[vehicles] + since_s * self._velocity_ned_m_s[vehicles]
        return guess

    def slowest_s(self) -> float:
        """Give the mission time of the slowest shard that is heard; `inf` when none is."""
        return min(self.latest_s.values(), default=math.inf)


def _tells_of(letter: Letter, vehicles: range) -> bool:
    """Tell whether a letter speaks of these vehicles alone."""
    rows = letter.rows["vehicle"]
    inside = (rows >= vehicles.start) & (rows < vehicles.stop)
    return bool(inside.all()) and all(vehicle in vehicles for vehicle, _ in letter.frames)
