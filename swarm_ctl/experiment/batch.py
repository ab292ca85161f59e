"""The paper's experiment for many trials at once: kinematic, one planner step after another.

Robots are squares, in 3-D cubes, that keep their axes; NE(D) metres throughout. The decisions are
those of `explore/` (`minds.py`); here are only what a robot senses, how it moves, and the score.
With numba (extra `fast`) the hot parts (`hot.py`, `explore/rows.py`) are compiled; both ways give
the same numbers: they do the same operations in the same order and leave sin and cos to numpy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_ctl.experiment import walls
from swarm_ctl.experiment.case import FAILS, TINY, Case, Counts, Field
from swarm_ctl.experiment.hot import Tools, compiled, has_numba, interpreted
from swarm_ctl.experiment.minds import make_minds
from swarm_ctl.experiment.room import Room
from swarm_ctl.explore.chance import Bools, Floats
from swarm_ctl.explore.planner import RANGE_ORDER

__all__ = ["Case", "Field", "Outcome", "has_numba", "simulate"]

VICTIM_M = 1.0
"""A victim this near and in line of sight is found: "a basic camera sensor or infrared"."""
TOGETHER = 5
"""Trials of explorers side by side: their memories take some MB per trial."""
_FAILURES = 1_000_001
"""In the place of a robot's index: the generator of a trial's failures."""
_BEAMS = tuple(RANGE_ORDER.index(name) for name in ("front", "left", "right"))
_UP, _DOWN = RANGE_ORDER.index("up"), RANGE_ORDER.index("down")


class Outcome(NamedTuple):
    """What came of each trial."""

    coverage: Floats
    """(trials, samples) covered share of the free cells."""
    found_step: Counts
    """(trials, victims) step at which each was found, 0 for the start; -1: not found."""
    collisions: Counts
    """(trials,) times that two bodies began to overlap: centres nearer than `body_m`."""
    bumps: Counts
    """(trials,) times that a wall or a box began to stop a robot."""
    path_m: Floats
    """(trials,) path of all robots together."""
    tracks_m: Floats
    """(trials, steps + 1, robots, d), empty unless asked for."""


def simulate(
    case: Case, seed: int, trials: range, *, fast: bool | None = None, tracks: bool = False
) -> Outcome:
    """Run trials; each depends on the case, the seed and its own number, not on the others.

    `fast` compiles the hot parts, by default where numba is installed.
    """
    tools = compiled() if (has_numba() if fast is None else fast) else interpreted()
    room, side_by_side = Room(case), TOGETHER if case.planner.kind == "explore" else len(trials)
    parts = [
        _run(_Batch(case, room, seed, trials[i : i + side_by_side], tools), case, tracks=tracks)
        for i in range(0, len(trials), side_by_side)
    ]
    return Outcome(*map(np.concatenate, zip(*parts, strict=True)))


def _run(batch: _Batch, case: Case, *, tracks: bool) -> Outcome:
    coverage, places = [], [batch.position_m]
    for step in range(1, case.steps + 1):
        batch.step()
        if step % case.sample_steps == 0 or step == case.steps:
            coverage.append(batch.ground.share())
        if tracks:
            places.append(batch.position_m)
    shape = (-1, len(batch.path_m), case.robots, case.dimensions)
    return Outcome(
        np.stack(coverage, axis=1),
        batch.found_step,
        batch.collisions,
        batch.bumps,
        batch.path_m,
        np.swapaxes(np.reshape(places if tracks else np.empty(0), shape), 0, 1),
    )


class _Batch:
    """Trials side by side; robot i of trial t is row t * robots + i of every array."""

    def __init__(self, case: Case, room: Room, seed: int, trials: range, tools: Tools) -> None:
        self._case, self._field, self._tools = case, case.field, tools
        self._count, robots, d = len(trials), case.robots, case.dimensions
        rows = self._count * robots
        self._minds = make_minds(case, seed, trials, tools.planner)
        starts = [room.starts(seed, trial) for trial in trials]
        self.position_m: Floats = np.concatenate([place for place, _ in starts])
        self._heading_rad: Floats = np.concatenate([heading for _, heading in starts])
        self._fails_s: Floats = np.concatenate([_failures(case, seed, trial) for trial in trials])
        self._alive: Bools = np.ones(rows, dtype=np.bool_)
        self._boxes, self._outlines = case.boxes, case.boxes[:, [0, 1, d, d + 1]]
        self._slide = tools.slide if d == 2 else walls.slide_all
        self._victims: Floats = np.array(case.field.victims_m, dtype=np.float64).reshape(-1, d)
        self._ranges_m: Floats = np.full((rows, len(RANGE_ORDER)), np.inf)
        is_social = case.planner.kind != "levy" and case.planner.social > 0.0
        hears = is_social or case.planner.kind == "explore"
        self._peers_m: Floats = np.full((rows, robots if hears else 0, d), np.nan)
        self._touching = np.zeros((self._count, robots, robots), dtype=np.bool_)
        self._stopped = np.zeros(rows, dtype=np.bool_)
        self.found_step: Counts = np.full((self._count, len(self._victims)), -1, dtype=np.int64)
        self._steps = 0
        self.collisions: Counts = np.zeros(self._count, dtype=np.int64)
        self.bumps: Counts = np.zeros(self._count, dtype=np.int64)
        self.path_m: Floats = np.zeros(self._count)
        self.ground = tools.ground(case, room, self._count)
        self._meet()
        self.collisions[:] = 0  # who starts in one place has not collided
        self._score()

    def step(self) -> None:
        """Sense, plan, move and score once."""
        period_s = self._case.planner.period_s
        if self._case.failures:
            self._alive = self._fails_s > self._steps * period_s
        velocity_m_s, heading_rad = self._minds.decide(
            self.position_m, self._heading_rad, self._sense(), self._peers_m, self._alive
        )
        self._steps += 1
        last_m, self._heading_rad = self.position_m, heading_rad
        self._move(velocity_m_s * period_s)
        self._meet()
        self._minds.notice(last_m, self.position_m, self._peers_m, self._alive)
        self._score()

    def _sense(self) -> Floats:
        """Measure all around; only who has something within reach casts level rays."""
        reach_m = self._case.sight_m
        low, high = self._field.low_m, self._field.high_m
        rows = self._tools.near(self.position_m, low, high, self._outlines, reach_m)
        self._ranges_m[:] = np.inf
        if rows.size:
            place_m, heading_rad = self.position_m.take(rows, axis=0), self._heading_rad[rows]
            cos, sin = np.cos(heading_rad), np.sin(heading_rad)
            beams = self._tools.cast(place_m, cos, sin, low, high, self._boxes)
            for column, beam in enumerate(_BEAMS):
                self._ranges_m[:, beam][rows] = beams[:, column]
        if self._case.dimensions == 3:
            vertical_m = walls.plumb(self.position_m, low, high, self._boxes)
            self._ranges_m[:, _UP], self._ranges_m[:, _DOWN] = vertical_m
        if self._case.planner.kind == "explore":
            self._ranges_m[self._ranges_m > reach_m] = np.inf
        return self._ranges_m

    def _move(self, motion_m: Floats) -> None:
        if self._case.failures:
            motion_m = np.where(self._alive[:, None], motion_m, 0.0)
        wanted_m = self.position_m + motion_m
        half_m = self._case.body_m / 2.0
        low, high = self._field.low_m, self._field.high_m
        last_m, was_stopped = self.position_m, self._stopped
        self.position_m, moved_m, self._stopped = self._slide(
            last_m, wanted_m, low, high, self._boxes, half_m
        )
        self.path_m += moved_m.reshape(self._count, -1).sum(axis=1)
        self.bumps += (self._stopped & ~was_stopped).reshape(self._count, -1).sum(axis=1)

    def _meet(self) -> None:
        """Find who hears whom now, and whose bodies begin to overlap; who failed is left out."""
        shape, d = (self._count, self._case.robots), self._case.dimensions
        place_m = self.position_m
        if self._case.failures:
            place_m = np.where(self._alive[:, None], place_m, np.nan)
        self._tools.meet(
            place_m.reshape(*shape, d),
            self._case.radio_m**2,
            self._case.body_m**2,
            self._peers_m.reshape(*shape, self._peers_m.shape[1], d),
            self._touching,
            self.collisions,
            self._minds.is_chained,
        )

    def _score(self) -> None:
        self.ground.mark(self.position_m)
        missing = self.found_step < 0
        if not missing.any():
            return
        each = self.position_m.reshape(self._count, -1, 1, self._case.dimensions)
        near = ((each - self._victims) ** 2).sum(axis=3) <= VICTIM_M**2
        near &= missing[:, None, :]
        trial, robot, victim = near.nonzero()
        seen = _sees(each[trial, robot, 0], self._victims[victim], self._boxes)
        self.found_step[trial[seen], victim[seen]] = self._steps


def _failures(case: Case, seed: int, trial: int) -> Floats:
    """Draw when each robot of a trial fails (robots,), s; never: inf."""
    fails_s: Floats = np.full(case.robots, np.inf)
    if case.failures:
        chance = np.random.default_rng([seed, trial, _FAILURES])
        failing = chance.permutation(case.robots)[: case.failures]
        duration_s = case.steps * case.planner.period_s
        fails_s[failing] = chance.uniform(*FAILS, case.failures) * duration_s
    return fails_s


def _sees(from_m: Floats, to_m: Floats, boxes: Floats) -> Bools:
    """Tell for pairs of points (n, d) whether no box lies between, (n,)."""
    ray = to_m - from_m
    ray = np.where(np.abs(ray) < TINY, TINY, ray)[:, None, :]
    d = from_m.shape[1]
    first = (boxes[:, :d] - from_m[:, None, :]) / ray
    second = (boxes[:, d:] - from_m[:, None, :]) / ray
    enters = np.minimum(first, second).max(axis=2)
    leaves = np.maximum(first, second).min(axis=2)
    clear: Bools = ~((enters <= leaves) & (leaves >= 0.0) & (enters <= 1.0)).any(axis=1)
    return clear
