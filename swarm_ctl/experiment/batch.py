"""The paper's experiment for many trials at once: 2-D, kinematic, one planner step after another.

Robots are squares that keep their axes, NE metres throughout. The decisions are those of
`explore.Planner`, one row per robot; here are only the field, what a robot senses, and the score.
With numba (extra `fast`) the hot parts (`hot.py`, `explore/rows.py`) are compiled; both ways give
the same numbers: they do the same operations in the same order and leave sin and cos to numpy.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from swarm_ctl.experiment.case import TINY, Bools, Case, Counts, Field, overlaps
from swarm_ctl.experiment.hot import Tools, compiled, has_numba, interpreted
from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.planner import RANGE_ORDER, Planner

__all__ = ["KINDS", "Case", "Field", "Outcome", "has_numba", "is_start_free", "simulate"]

KINDS = ("lf-pso", "levy", "pso")
"""The planners that the engine can drive: one row of `explore.Planner` per robot."""
VICTIM_M = 1.0
"""A victim this near and in line of sight is found: "a basic camera sensor or infrared"."""
_STARTS = 1_000_000
"""In the place of a robot's index: the generator of a trial's starts. Not 0, which numpy's
SeedSequence cannot tell from nothing."""
_BEAMS = tuple(RANGE_ORDER.index(name) for name in ("front", "left", "right"))


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
    """(trials, steps + 1, robots, 2), empty unless asked for."""


def simulate(
    case: Case, seed: int, trials: range, *, fast: bool | None = None, tracks: bool = False
) -> Outcome:
    """Run trials; each depends on the case, the seed and its own number, not on the others.

    `fast` compiles the hot parts, by default where numba is installed.
    """
    tools = compiled() if (has_numba() if fast is None else fast) else interpreted()
    batch = _Batch(case, seed, trials, tools)
    coverage, places = [], [batch.position_m]
    for step in range(1, case.steps + 1):
        batch.step()
        if step % case.sample_steps == 0 or step == case.steps:
            coverage.append(batch.ground.share())
        if tracks:
            places.append(batch.position_m)
    shape = (-1, len(trials), case.robots, 2)
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

    def __init__(self, case: Case, seed: int, trials: range, tools: Tools) -> None:
        self._case, self._field, self._tools = case, case.field, tools
        self._count, robots = len(trials), case.robots
        rows = self._count * robots
        self._planner = Planner(
            case.planner,
            speed_m_s=case.speed_m_s,
            climb_m_s=case.speed_m_s,
            seeds=[(seed, trial, robot) for trial in trials for robot in range(robots)],
            kernels=tools.planner,
        )
        starts = [_starts(case, seed, trial) for trial in trials]
        self.position_m: Floats = np.concatenate([place for place, _ in starts])
        self._heading_rad: Floats = np.concatenate([heading for _, heading in starts])
        self._boxes: Floats = np.array(case.field.boxes_m, dtype=np.float64).reshape(-1, 4)
        self._victims: Floats = np.array(case.field.victims_m, dtype=np.float64).reshape(-1, 2)
        self._ranges_m: Floats = np.full((rows, len(RANGE_ORDER)), np.inf)
        is_social = case.planner.kind != "levy" and case.planner.social > 0.0
        self._peers_m: Floats = np.full((rows, robots if is_social else 0, 2), np.nan)
        self._touching = np.zeros((self._count, robots, robots), dtype=np.bool_)
        self._stopped = np.zeros(rows, dtype=np.bool_)
        self.found_step: Counts = np.full((self._count, len(self._victims)), -1, dtype=np.int64)
        self._steps = 0
        self.collisions: Counts = np.zeros(self._count, dtype=np.int64)
        self.bumps: Counts = np.zeros(self._count, dtype=np.int64)
        self.path_m: Floats = np.zeros(self._count)
        self.ground = tools.ground(case, self._count)
        self._meet()
        self.collisions[:] = 0  # who starts in one place has not collided
        self._score()

    def step(self) -> None:
        """Sense, plan, move and score once."""
        plan = self._planner.step(self.position_m, self._heading_rad, self._sense(), self._peers_m)
        self._steps += 1
        self._heading_rad = plan.heading_rad
        self._move(plan.velocity_m_s * self._case.planner.period_s)
        self._meet()
        self._score()

    def _sense(self) -> Floats:
        """Measure front, left and right; only who has something within reach casts rays."""
        reach_m = self._case.planner.avoid_distance_m
        low, high = self._field.low_m, self._field.high_m
        rows = self._tools.near(self.position_m, low, high, self._boxes, reach_m)
        self._ranges_m[:] = np.inf
        if rows.size:
            place_m, heading_rad = self.position_m.take(rows, axis=0), self._heading_rad[rows]
            cos, sin = np.cos(heading_rad), np.sin(heading_rad)
            beams = self._tools.cast(place_m, cos, sin, low, high, self._boxes)
            for column, beam in enumerate(_BEAMS):
                self._ranges_m[:, beam][rows] = beams[:, column]
        return self._ranges_m

    def _move(self, motion_m: Floats) -> None:
        wanted_m = self.position_m + motion_m
        half_m = self._case.body_m / 2.0
        low, high = self._field.low_m, self._field.high_m
        last_m, was_stopped = self.position_m, self._stopped
        self.position_m, moved_m, self._stopped = self._tools.slide(
            last_m, wanted_m, low, high, self._boxes, half_m
        )
        self.path_m += moved_m.reshape(self._count, -1).sum(axis=1)
        self.bumps += (self._stopped & ~was_stopped).reshape(self._count, -1).sum(axis=1)

    def _meet(self) -> None:
        """Find who hears whom now, and whose bodies begin to overlap."""
        self._tools.meet(
            self.position_m.reshape(self._count, self._case.robots, 2),
            self._case.radio_m**2,
            self._case.body_m**2,
            self._peers_m.reshape(self._count, self._case.robots, self._peers_m.shape[1], 2),
            self._touching,
            self.collisions,
        )

    def _score(self) -> None:
        self.ground.mark(self.position_m)
        missing = self.found_step < 0
        if not missing.any():
            return
        each = self.position_m.reshape(self._count, -1, 1, 2)
        near = ((each - self._victims) ** 2).sum(axis=3) <= VICTIM_M**2
        near &= missing[:, None, :]
        trial, robot, victim = near.nonzero()
        seen = _sees(each[trial, robot, 0], self._victims[victim], self._boxes)
        self.found_step[trial[seen], victim[seen]] = self._steps


def _starts(case: Case, seed: int, trial: int) -> tuple[Floats, Floats]:
    """Draw places (robots, 2) free for a body, and headings (robots,) anywhere."""
    chance = np.random.default_rng([seed, trial, _STARTS])
    heading_rad = chance.uniform(-math.pi, math.pi, case.robots)
    half_m, field = case.body_m / 2.0, case.field
    low, high = np.add(field.low_m, half_m), np.subtract(field.high_m, half_m)
    boxes = np.array(field.boxes_m, dtype=np.float64).reshape(-1, 4)
    places = np.empty((0, 2))
    while len(places) < case.robots:
        if case.start_m is None:
            drawn = chance.uniform(low, high, (case.robots, 2))
        else:
            around = case.start_m + chance.normal(0.0, case.jitter_m, (case.robots, 2))
            drawn = np.clip(around, low, high)
        places = np.concatenate([places, drawn[~overlaps(drawn, boxes, half_m).any(axis=1)]])
    return places[: case.robots], heading_rad


def is_start_free(case: Case) -> bool:
    """Tell whether a robot fits at `start_m`, with a margin for the jitter."""
    if case.start_m is None:
        return True
    place, half_m = np.array([case.start_m]), case.body_m / 2.0
    boxes = np.array(case.field.boxes_m, dtype=np.float64).reshape(-1, 4)
    inside = (place >= case.field.low_m).all() and (place <= case.field.high_m).all()
    return bool(inside) and not overlaps(place, boxes, half_m + 3.0 * case.jitter_m).any()


def _sees(from_m: Floats, to_m: Floats, boxes: Floats) -> Bools:
    """Tell for pairs of points (n, 2) whether no box lies between, (n,)."""
    ray = to_m - from_m
    ray = np.where(np.abs(ray) < TINY, TINY, ray)[:, None, :]
    first = (boxes[:, :2] - from_m[:, None, :]) / ray
    second = (boxes[:, 2:] - from_m[:, None, :]) / ray
    enters = np.minimum(first, second).max(axis=2)
    leaves = np.maximum(first, second).min(axis=2)
    clear: Bools = ~((enters <= leaves) & (leaves >= 0.0) & (enters <= 1.0)).any(axis=1)
    return clear
