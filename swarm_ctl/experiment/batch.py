"""The paper's experiment for many trials at once: 2-D, kinematic, one planner step after another.

Robots are squares that keep their axes, NE metres throughout. The decisions are those of
`explore.Planner`, one row per robot; here are only the field, what a robot senses, and the score.
With numba (extra `fast`) the three hot parts are compiled; both ways give the same numbers, bit
for bit, since they do the same operations in the same order and leave sin and cos to numpy.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.planner import RANGE_ORDER, Planner, PlannerParams

Bools = NDArray[np.bool_]
Counts = NDArray[np.int64]

KINDS = ("lf-pso", "levy", "pso")
"""The planners that the engine can drive: one row of `explore.Planner` per robot."""
VICTIM_M = 1.0
"""A victim this near and in line of sight is found: "a basic camera sensor or infrared"."""
_STARTS = 1_000_000
"""In the place of a robot's index: the generator of a trial's starts. Not 0, which numpy's
SeedSequence cannot tell from nothing."""
_TINY = 1e-12
"""Least component of a ray, so that nothing is divided by zero."""
_BEAMS = tuple(RANGE_ORDER.index(name) for name in ("front", "left", "right"))


@dataclass(frozen=True, slots=True)
class Field:
    """A closed rectangle with boxes along its axes, and victims; north, east, m."""

    low_m: tuple[float, float]
    high_m: tuple[float, float]
    boxes_m: tuple[tuple[float, float, float, float], ...] = ()
    """Low north, low east, high north, high east of each."""
    victims_m: tuple[tuple[float, float], ...] = ()
    cell_m: float = 0.1
    """Edge of a coverage cell."""


@dataclass(frozen=True, slots=True)
class Case:
    """One experiment: everything but the seed."""

    field: Field
    planner: PlannerParams
    robots: int
    steps: int
    """Planner steps; one takes `planner.period_s`."""
    sample_steps: int
    """Coverage is counted every so many steps, and at the end."""
    speed_m_s: float = 0.2
    start_m: tuple[float, float] | None = None
    """Where all robots start; none: anywhere, each for itself."""
    jitter_m: float = 0.01
    """Standard deviation of the starts around `start_m`."""
    radio_m: float = 2.0
    body_m: float = 0.6
    """Edge of a robot. "The area covered by a robot based on its size was treated as explored"."""
    footprint: Literal["square", "disc"] = "square"


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


def has_numba() -> bool:
    """Tell whether the compiled parts can be used."""
    return importlib.util.find_spec("numba") is not None


def simulate(
    case: Case, seed: int, trials: range, *, fast: bool | None = None, tracks: bool = False
) -> Outcome:
    """Run trials; each depends on the case, the seed and its own number, not on the others.

    `fast` compiles the hot parts, by default where numba is installed.
    """
    tools = _compiled() if (has_numba() if fast is None else fast) else _interpreted()
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

    def __init__(self, case: Case, seed: int, trials: range, tools: _Tools) -> None:
        self._case, self._field, self._tools = case, case.field, tools
        self._count, robots = len(trials), case.robots
        rows = self._count * robots
        self._planner = Planner(
            case.planner,
            speed_m_s=case.speed_m_s,
            climb_m_s=case.speed_m_s,
            seeds=[(seed, trial, robot) for trial in trials for robot in range(robots)],
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
        last_m, self._heading_rad = self.position_m, plan.heading_rad
        self._move(plan.velocity_m_s * self._case.planner.period_s)
        moved_m = np.sqrt(((self.position_m - last_m) ** 2).sum(axis=1))
        self.path_m += moved_m.reshape(self._count, -1).sum(axis=1)
        self._meet()
        self._score()

    def _sense(self) -> Floats:
        """Measure front, left and right; only who has something within reach casts rays."""
        reach_m = self._case.planner.avoid_distance_m
        rows = _near(self.position_m, self._field, self._boxes, reach_m).nonzero()[0]
        cos, sin = np.cos(self._heading_rad[rows]), np.sin(self._heading_rad[rows])
        self._ranges_m[:] = np.inf
        if rows.size:
            low, high = self._field.low_m, self._field.high_m
            beams = self._tools.cast(self.position_m[rows], cos, sin, low, high, self._boxes)
            for column, beam in enumerate(_BEAMS):
                self._ranges_m[rows, beam] = beams[:, column]
        return self._ranges_m

    def _move(self, motion_m: Floats) -> None:
        wanted_m = self.position_m + motion_m
        half_m = self._case.body_m / 2.0
        moved_m = _slide(self.position_m, wanted_m, self._field, self._boxes, half_m)
        stopped = (moved_m != wanted_m).any(axis=1)
        begun = (stopped & ~self._stopped).reshape(self._count, -1)
        self.bumps += begun.sum(axis=1)
        self.position_m, self._stopped = moved_m, stopped

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
        places = np.concatenate([places, drawn[~_overlaps(drawn, boxes, half_m).any(axis=1)]])
    return places[: case.robots], heading_rad


def is_start_free(case: Case) -> bool:
    """Tell whether a robot fits at `start_m`, with a margin for the jitter."""
    if case.start_m is None:
        return True
    place, half_m = np.array([case.start_m]), case.body_m / 2.0
    boxes = np.array(case.field.boxes_m, dtype=np.float64).reshape(-1, 4)
    inside = (place >= case.field.low_m).all() and (place <= case.field.high_m).all()
    return bool(inside) and not _overlaps(place, boxes, half_m + 3.0 * case.jitter_m).any()


def _overlaps(place_m: Floats, boxes: Floats, half_m: float) -> Bools:
    """Tell which boxes the bodies of (n, 2) places overlap, (n, b)."""
    north, east = place_m[:, :1], place_m[:, 1:]
    over: Bools = (north > boxes[:, 0] - half_m) & (north < boxes[:, 2] + half_m)
    over &= (east > boxes[:, 1] - half_m) & (east < boxes[:, 3] + half_m)
    return over


def _near(place_m: Floats, field: Field, boxes: Floats, reach_m: float) -> Bools:
    """Tell who (n,) has a wall or a box near enough for a ray to hit it within reach."""
    north, east = place_m[:, 0], place_m[:, 1]
    near: Bools = (north < field.low_m[0] + reach_m) | (north > field.high_m[0] - reach_m)
    near |= (east < field.low_m[1] + reach_m) | (east > field.high_m[1] - reach_m)
    if len(boxes):
        near |= _overlaps(place_m, boxes, reach_m).any(axis=1)
    return near


def _slide(last_m: Floats, wanted_m: Floats, field: Field, boxes: Floats, half_m: float) -> Floats:
    """Keep bodies inside and out of boxes; who would end in one slides along the side it hit."""
    low, high = np.add(field.low_m, half_m), np.subtract(field.high_m, half_m)
    place_m: Floats = np.clip(wanted_m, low, high)
    if not len(boxes):
        return place_m
    row, box = _overlaps(place_m, boxes, half_m).nonzero()
    sides = boxes[box] + np.array([-half_m, -half_m, half_m, half_m])
    outward = np.array([-1.0, -1.0, 1.0, 1.0])
    was_beyond = outward * (np.tile(last_m[row], 2) - sides) > -1e-9
    deep_m = np.where(was_beyond, outward * (sides - np.tile(place_m[row], 2)), np.inf)
    side = deep_m.argmin(axis=1)
    place_m[row, side % 2] = sides[np.arange(len(row)), side]
    # Between two boxes nothing but to stay is sure to be free.
    stuck = row[_overlaps(place_m[row], boxes, half_m - 1e-9).any(axis=1)]
    place_m[stuck] = last_m[stuck]
    return place_m


def _sees(from_m: Floats, to_m: Floats, boxes: Floats) -> Bools:
    """Tell for pairs of points (n, 2) whether no box lies between, (n,)."""
    ray = to_m - from_m
    ray = np.where(np.abs(ray) < _TINY, _TINY, ray)[:, None, :]
    first = (boxes[:, :2] - from_m[:, None, :]) / ray
    second = (boxes[:, 2:] - from_m[:, None, :]) / ray
    enters = np.minimum(first, second).max(axis=2)
    leaves = np.maximum(first, second).min(axis=2)
    clear: Bools = ~((enters <= leaves) & (leaves >= 0.0) & (enters <= 1.0)).any(axis=1)
    return clear


class _Tools(NamedTuple):
    """The hot parts, in numpy or compiled."""

    cast: Callable[..., Floats]
    meet: Callable[..., None]
    ground: Callable[[Case, int], _Ground]


class _Ground:
    """Which cells have been under a body, trial by trial: a cell counts if its centre was."""

    def __init__(self, case: Case, trials: int) -> None:
        field, cell = case.field, case.field.cell_m
        self._origin_m = field.low_m
        self._shape = (
            math.ceil((field.high_m[0] - field.low_m[0]) / cell - 1e-9),
            math.ceil((field.high_m[1] - field.low_m[1]) / cell - 1e-9),
        )
        self._cell_m, self._half_m = cell, case.body_m / 2.0
        self._is_disc = case.footprint == "disc"
        north, east = (
            low + (np.arange(count) + 0.5) * cell
            for low, count in zip(field.low_m, self._shape, strict=True)
        )
        centres = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1).reshape(-1, 2)
        boxes = np.array(field.boxes_m, dtype=np.float64).reshape(-1, 4)
        blocked: Bools = _overlaps(centres, boxes, 0.0).any(axis=1).reshape(self._shape)
        self._free: Bools = np.logical_not(blocked)
        self._trials = trials
        self._clear()

    def _clear(self) -> None:
        """Begin with untouched ground; the places of each step wait for the next count."""
        rows, columns = self._shape
        self._waiting: list[Floats] = []
        self._covered = np.zeros((self._trials, rows, columns), dtype=np.bool_)

    def mark(self, position_m: Floats) -> None:
        """Put a body at (trials * robots, 2)."""
        self._waiting.append(position_m)

    def share(self) -> Floats:
        """Count the covered share of the free cells, (trials,)."""
        places = np.stack(self._waiting).reshape(len(self._waiting), self._trials, -1, 2)
        self._waiting = []
        for trial in range(self._trials):
            self._covered[trial] |= self._under(places[:, trial].reshape(-1, 2))
        counted: Counts = np.count_nonzero(self._covered & self._free, axis=(1, 2))
        return counted / np.count_nonzero(self._free)

    def _under(self, place_m: Floats) -> Bools:
        """Tell which cells are under bodies at (m, 2): +1 where a run begins, -1 behind its end."""
        rows, columns = self._shape
        cell, half = self._cell_m, self._half_m
        north, east = (place_m - self._origin_m).T[:, :, None]
        last = np.floor((north + half) / cell - 0.5)
        row = np.ceil((north - half) / cell - 0.5) + np.arange(math.ceil(2.0 * half / cell) + 1)
        row = np.clip(np.minimum(row, last), 0, rows - 1)
        if self._is_disc:
            half = np.sqrt(np.maximum(half * half - ((row + 0.5) * cell - north) ** 2, 0.0))
        begin = np.maximum(np.ceil((east - half) / cell - 0.5), 0.0)
        end = np.minimum(np.floor((east + half) / cell - 0.5) + 1.0, columns)
        first = row * (columns + 1)
        edges, size = np.zeros(rows * (columns + 1), dtype=np.intp), rows * (columns + 1)
        edges += np.bincount((first + begin).astype(np.intp).ravel(), minlength=size)
        edges -= np.bincount(
            (first + np.maximum(begin, end)).astype(np.intp).ravel(), minlength=size
        )
        return edges.reshape(rows, columns + 1).cumsum(axis=1)[:, :-1] > 0


class _CompiledGround(_Ground):
    """The same cells, a bit each, marked at once."""

    def _clear(self) -> None:
        rows, columns = self._shape
        words = -(-columns // 64)
        bits = np.zeros((rows, 64 * words), dtype=np.bool_)
        bits[:, :columns] = self._free
        packed = np.packbits(bits, axis=1, bitorder="little").view("<u8")
        self._free_bits = packed.astype(np.uint64)
        self._bits = np.zeros((self._trials, rows, words), dtype=np.uint64)

    def mark(self, position_m: Floats) -> None:
        """Put a body at (trials * robots, 2)."""
        _jit(_mark)(
            position_m.reshape(self._trials, -1, 2),
            self._origin_m,
            self._cell_m,
            self._half_m,
            self._is_disc,
            self._shape[1],
            self._bits,
        )

    def share(self) -> Floats:
        """Count the covered share of the free cells, (trials,)."""
        counted: Counts = _jit(_count)(self._bits, self._free_bits)
        return counted / np.count_nonzero(self._free)


def _interpreted() -> _Tools:
    return _Tools(_cast_all, _meet_all, _Ground)


def _compiled() -> _Tools:
    return _Tools(_jit(_cast), _jit(_meet), _CompiledGround)


@cache
def _jit(kernel: Callable[..., Any]) -> Callable[..., Any]:
    import numba  # noqa: PLC0415 - an extra, and slow to import

    compiled: Callable[..., Any] = numba.njit(kernel, cache=True, error_model="numpy")
    return compiled


def _cast_all(
    place_m: Floats,
    cos: Floats,
    sin: Floats,
    low: tuple[float, float],
    high: tuple[float, float],
    boxes: Floats,
) -> Floats:
    """Measure from places (n, 2) ahead, to the left and to the right, (n, 3), m."""
    north, east = np.stack([cos, sin, -sin], axis=1), np.stack([sin, -cos, cos], axis=1)
    north = np.where(np.abs(north) < _TINY, _TINY, north)
    east = np.where(np.abs(east) < _TINY, _TINY, east)
    x, y = place_m[:, :1], place_m[:, 1:]
    ranges_m: Floats = np.minimum(
        (np.where(north > 0.0, high[0], low[0]) - x) / north,
        (np.where(east > 0.0, high[1], low[1]) - y) / east,
    )
    for box in boxes:
        a, b = (box[0] - x) / north, (box[2] - x) / north
        c, d = (box[1] - y) / east, (box[3] - y) / east
        enters = np.maximum(np.minimum(a, b), np.minimum(c, d))
        leaves = np.minimum(np.maximum(a, b), np.maximum(c, d))
        hit = (enters <= leaves) & (leaves >= 0.0)
        ranges_m = np.where(hit, np.minimum(ranges_m, np.maximum(enters, 0.0)), ranges_m)
    return ranges_m


def _meet_all(
    place_m: Floats, radio_m2: float, body_m2: float, peers_m: Floats, touching: Bools,
    collisions: Counts,
) -> None:  # fmt: skip
    """Fill in the offsets to all others that a chain of radio links connects; count contacts."""
    robots = place_m.shape[1]
    north = place_m[:, None, :, 0] - place_m[:, :, None, 0]
    east = place_m[:, None, :, 1] - place_m[:, :, None, 1]
    apart_m2 = north * north + east * east
    apart_m2[:, range(robots), range(robots)] = np.inf
    over = apart_m2 < body_m2
    collisions += (over & ~touching).sum(axis=(1, 2)) // 2
    touching[:] = over
    if peers_m.shape[2]:
        linked = apart_m2 <= radio_m2
        for via in range(robots):
            linked |= linked[:, :, via, None] & linked[:, None, via, :]
        linked[:, range(robots), range(robots)] = False
        peers_m[..., 0] = np.where(linked, north, np.nan)
        peers_m[..., 1] = np.where(linked, east, np.nan)


# From here on: the three of above as loops for numba, which cannot see the rest of the module.


def _cast(
    place_m: Floats,
    cos: Floats,
    sin: Floats,
    low: tuple[float, float],
    high: tuple[float, float],
    boxes: Floats,
) -> Floats:
    tiny = 1e-12
    ranges_m = np.empty((len(place_m), 3))
    for i in range(len(place_m)):
        x, y = place_m[i, 0], place_m[i, 1]
        for beam in range(3):
            north, east = cos[i], sin[i]
            if beam == 1:
                north, east = sin[i], -cos[i]
            elif beam == 2:
                north, east = -sin[i], cos[i]
            north = tiny if abs(north) < tiny else north
            east = tiny if abs(east) < tiny else east
            nearest = min(
                ((high[0] if north > 0.0 else low[0]) - x) / north,
                ((high[1] if east > 0.0 else low[1]) - y) / east,
            )
            for k in range(len(boxes)):
                a, b = (boxes[k, 0] - x) / north, (boxes[k, 2] - x) / north
                c, d = (boxes[k, 1] - y) / east, (boxes[k, 3] - y) / east
                enters, leaves = max(min(a, b), min(c, d)), min(max(a, b), max(c, d))
                if enters <= leaves and leaves >= 0.0:
                    nearest = min(nearest, max(enters, 0.0))
            ranges_m[i, beam] = nearest
    return ranges_m


def _meet(  # noqa: C901, PLR0912 - a kernel: calls would cost more than they tell
    place_m: Floats, radio_m2: float, body_m2: float, peers_m: Floats, touching: Bools,
    collisions: Counts,
) -> None:  # fmt: skip
    trials, robots = place_m.shape[:2]
    cluster = np.empty(robots, dtype=np.int64)
    for trial in range(trials):
        for i in range(robots):
            cluster[i] = i
        alone = True
        for i in range(robots):
            for j in range(i + 1, robots):
                north = place_m[trial, j, 0] - place_m[trial, i, 0]
                east = place_m[trial, j, 1] - place_m[trial, i, 1]
                apart_m2 = north * north + east * east
                over = apart_m2 < body_m2
                if over and not touching[trial, i, j]:
                    collisions[trial] += 1
                touching[trial, i, j] = over
                if apart_m2 <= radio_m2:
                    alone = False
                    if cluster[i] != cluster[j]:
                        into, gone = cluster[i], cluster[j]
                        for k in range(robots):
                            if cluster[k] == gone:
                                cluster[k] = into
        if peers_m.shape[2] == 0:
            continue
        if alone:
            peers_m[trial] = np.nan
            continue
        for i in range(robots):
            for j in range(robots):
                if i != j and cluster[i] == cluster[j]:
                    peers_m[trial, i, j, 0] = place_m[trial, j, 0] - place_m[trial, i, 0]
                    peers_m[trial, i, j, 1] = place_m[trial, j, 1] - place_m[trial, i, 1]
                else:
                    peers_m[trial, i, j, 0] = np.nan
                    peers_m[trial, i, j, 1] = np.nan


def _mark(
    place_m: Floats,
    origin_m: tuple[float, float],
    cell: float,
    half: float,
    is_disc: bool,
    columns: int,
    bits: NDArray[np.uint64],
) -> None:
    trials, robots = place_m.shape[:2]
    every = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
    for trial in range(trials):
        for i in range(robots):
            north = place_m[trial, i, 0] - origin_m[0]
            east = place_m[trial, i, 1] - origin_m[1]
            first = max(math.ceil((north - half) / cell - 0.5), 0)
            last = min(math.floor((north + half) / cell - 0.5), bits.shape[1] - 1)
            begin = max(math.ceil((east - half) / cell - 0.5), 0)
            end = min(math.floor((east + half) / cell - 0.5) + 1, columns)
            for row in range(first, last + 1):
                if is_disc:
                    beside = (row + 0.5) * cell - north
                    reach = math.sqrt(max(half * half - beside * beside, 0.0))
                    begin = max(math.ceil((east - reach) / cell - 0.5), 0)
                    end = min(math.floor((east + reach) / cell - 0.5) + 1, columns)
                if begin >= end:
                    continue
                for word in range(begin >> 6, ((end - 1) >> 6) + 1):
                    low, high = max(begin - (word << 6), 0), min(end - (word << 6), 64)
                    run = (every >> np.uint64(64 - high + low)) << np.uint64(low)
                    bits[trial, row, word] |= run


def _count(bits: NDArray[np.uint64], free: NDArray[np.uint64]) -> Counts:
    counted = np.zeros(len(bits), dtype=np.int64)
    for trial in range(len(bits)):
        for row in range(free.shape[0]):
            for word in range(free.shape[1]):
                left = bits[trial, row, word] & free[row, word]
                left -= (left >> np.uint64(1)) & np.uint64(0x5555555555555555)
                twos = np.uint64(0x3333333333333333)
                left = (left & twos) + ((left >> np.uint64(2)) & twos)
                left = (left + (left >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
                counted[trial] += np.int64((left * np.uint64(0x0101010101010101)) >> np.uint64(56))
    return counted
