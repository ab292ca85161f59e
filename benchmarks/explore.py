"""Measure the planner `explore`: `python benchmarks/explore.py --help`.

A kinematic world for tuning (no dynamics, no collisions between vehicles): the paper's field in
2-D at 1 s steps, or a hall in 3-D. Prints coverage means with 95 % confidence intervals.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore.explorer import Explorer
from swarm_ctl.explore.planner import PlannerParams

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
GRID_M = 0.1
MOST_PAYLOADS = 12
"""TUNNEL payloads a vehicle sends per second."""


@dataclass(frozen=True)
class Case:
    """One experiment."""

    start: str = "r"
    """r: anywhere; c: all at (10, 2)."""
    world: str = "open"
    """open, boxesN, office."""
    vehicles: int = 10
    time_s: int = 600
    speed_m_s: float = 0.2
    period_s: float = 1.0
    footprint_m: float = 0.3
    shape: str = "square"
    body_m: float = 0.3
    radio_m: float = 2.0
    beam_m: float = 1.0
    loss: float = 0.0
    drift: float = 0.0
    noise_m: float = 0.0
    failures: int = 0
    side_m: float = 20.0
    height_m: float = 0.0
    """Above 0: 3-D."""
    params: dict[str, Any] = field(default_factory=dict)


def rectangles(world: str, chance: np.random.Generator, side: float) -> Floats:
    """Build the obstacles (n, 4): low x, low y, high x, high y."""
    if world == "office":
        t, d = 0.1, 0.5
        walls: list[list[float]] = []
        for y, doors in ((8.4, (3.3, 10.0, 16.7)), (11.6, (5.0, 15.0))):
            edges = [0.0, *(e for door in doors for e in (door - d, door + d)), side]
            walls += [[a, y - t, b, y + t] for a, b in zip(edges[::2], edges[1::2], strict=True)]
        walls += [[x - t, 0.0, x + t, 8.4] for x in (6.65, 13.35)]
        walls += [[10.0 - t, 11.6, 10.0 + t, side]]
        return np.array(walls)
    boxes: list[list[float]] = []
    count = int(world.removeprefix("boxes") or 0) if world.startswith("boxes") else 0
    while len(boxes) < count:
        low, size = chance.uniform(0.0, side, 2), chance.uniform(1.0, 3.0, 2)
        high = np.minimum(low + size, side)
        if not (np.all(low - 1.0 < (10.0, 2.0)) and np.all(high + 1.0 > (10.0, 2.0))):
            boxes.append([*low, *high])
    return np.array(boxes).reshape(-1, 4)


class World:
    """A square field with rectangles that bodies of a half width keep out of."""

    def __init__(self, case: Case, chance: np.random.Generator) -> None:
        self.case = case
        self.boxes = rectangles(case.world, chance, case.side_m)
        n = round(case.side_m / GRID_M)
        self.middles = (np.arange(n) + 0.5) * GRID_M
        self.reachable = self._reachable(n)

    def is_free(self, place: Floats) -> bool:
        """Tell whether a body may be at a place."""
        b, side = self.case.body_m, self.case.side_m
        x, y = place[0], place[1]
        if not (b <= x <= side - b and b <= y <= side - b):
            return False
        boxes = self.boxes
        return not bool(
            (
                (x > boxes[:, 0] - b)
                & (x < boxes[:, 2] + b)
                & (y > boxes[:, 1] - b)
                & (y < boxes[:, 3] + b)
            ).any()
        )

    def move(self, place: Floats, step: Floats) -> Floats:
        """Go as far as walls let: all of the step, or its part along one axis, or nothing."""
        b, side = self.case.body_m, self.case.side_m
        goal = place + step
        goal[:2] = np.clip(goal[:2], b, side - b)
        if len(goal) == 3:
            goal[2] = np.clip(goal[2], -(self.case.height_m - b), -b)
        if not len(self.boxes) or self.is_free(goal):
            return goal
        for axis in (0, 1):
            slid = goal.copy()
            slid[axis] = place[axis]
            if self.is_free(slid):
                return slid
        return place

    def beams(self, place: Floats, heading: float, most_m: float) -> Floats:
        """Range along heading, right and left (3,), inf beyond `most_m`."""
        angles = heading + np.array([0.0, math.pi / 2, -math.pi / 2])
        ux, uy = np.cos(angles), np.sin(angles)
        ux[np.abs(ux) < 1e-9], uy[np.abs(uy) < 1e-9] = 1e-9, 1e-9
        side = self.case.side_m
        tx = np.where(ux > 0.0, side - place[0], -place[0]) / ux
        ty = np.where(uy > 0.0, side - place[1], -place[1]) / uy
        ranges = np.minimum(tx, ty)
        if len(self.boxes):
            b = self.boxes[:, :, None]
            x0, x1 = (b[:, 0] - place[0]) / ux, (b[:, 2] - place[0]) / ux
            y0, y1 = (b[:, 1] - place[1]) / uy, (b[:, 3] - place[1]) / uy
            near = np.maximum(np.minimum(x0, x1), np.minimum(y0, y1))
            far = np.minimum(np.maximum(x0, x1), np.maximum(y0, y1))
            hit = np.where((near <= far) & (near > 0.0), near, np.inf)
            ranges = np.minimum(ranges, hit.min(axis=0))
        return np.where(ranges <= most_m, ranges, np.inf)

    def random_place(self, chance: np.random.Generator) -> Floats:
        """Draw a free place."""
        while True:
            place = chance.uniform(self.case.body_m, self.case.side_m - self.case.body_m, 2)
            if self.is_free(place):
                return place

    def _reachable(self, n: int) -> Bools:
        """Cells that a footprint can cover from (10, 2)."""
        free = np.zeros((n, n), dtype=np.bool_)
        if not len(self.boxes):
            return np.ones((n, n), dtype=np.bool_)
        for i, x in enumerate(self.middles):
            for j, y in enumerate(self.middles):
                free[i, j] = self.is_free(np.array([x, y]))
        seen = np.zeros_like(free)
        i, j = int(10.0 / GRID_M), int(2.0 / GRID_M)
        seen[i, j] = True
        while True:
            grown = seen.copy()
            grown[1:] |= seen[:-1]
            grown[:-1] |= seen[1:]
            grown[:, 1:] |= seen[:, :-1]
            grown[:, :-1] |= seen[:, 1:]
            grown &= free
            if (grown == seen).all():
                break
            seen = grown
        reach = round(self.case.footprint_m / GRID_M)
        covered = seen.copy()
        for _ in range(reach):
            grown = covered.copy()
            grown[1:] |= covered[:-1]
            grown[:-1] |= covered[1:]
            covered = grown.copy()
            covered[:, 1:] |= grown[:, :-1]
            covered[:, :-1] |= grown[:, 1:]
        for x0, y0, x1, y1 in self.boxes:
            inside_x = (self.middles > x0) & (self.middles < x1)
            inside_y = (self.middles > y0) & (self.middles < y1)
            covered[np.ix_(inside_x, inside_y)] = False
        return covered


class Odometry:
    """Own frame: true displacements with a slowly turning bias and a heading that walks."""

    def __init__(self, chance: np.random.Generator, drift: float, dimensions: int) -> None:
        self._chance = chance
        self._drift = drift
        self._bias = chance.uniform(0.0, 2.0 * math.pi)
        self._turn = 0.0
        self.position_m = np.zeros(dimensions)

    def move(self, step: Floats) -> None:
        """Add a true displacement as the vehicle believes it."""
        far = math.hypot(step[0], step[1])
        if self._drift and far:
            self._bias += self._chance.normal(0.0, 0.1 * math.sqrt(far))
            sigma = math.radians(1.0) * self._drift * 100.0 * math.sqrt(far / 10.0)
            self._turn += self._chance.normal(0.0, sigma)
            c, s = math.cos(self._turn), math.sin(self._turn)
            step = step.copy()
            step[:2] = [c * step[0] - s * step[1], s * step[0] + c * step[1]]
            step[0] += self._drift * far * math.cos(self._bias)
            step[1] += self._drift * far * math.sin(self._bias)
        self.position_m = self.position_m + step


class Truth:
    """Ground covered so far."""

    def __init__(self, case: Case, world: World) -> None:
        self.case, self.world = case, world
        n = len(world.middles)
        if case.height_m:
            n = round(case.side_m / 0.25)
            deep = round(case.height_m / 0.25)
            self.seen: Bools = np.zeros((n, n, deep), dtype=np.bool_)
            reach = round(case.footprint_m / 0.25) + 1
            axis = np.arange(-reach, reach + 1)
            self._ball = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
        else:
            self.seen = np.zeros((n, n), dtype=np.bool_)

    def mark(self, place: Floats) -> None:
        """Cover what the footprint sees from a place."""
        half = self.case.footprint_m
        if self.case.height_m:
            at = np.array([place[0], place[1], -place[2]])
            cells = np.floor(at / 0.25).astype(int) + self._ball
            far = ((cells + 0.5) * 0.25 - at) ** 2
            inside = (far.sum(axis=1) <= half * half) & (cells >= 0).all(axis=1)
            inside &= (cells < self.seen.shape).all(axis=1)
            self.seen[tuple(cells[inside].T)] = True
            return
        edges = [
            slice(
                max(0, math.ceil((p - half) / GRID_M - 0.5 - 1e-9)),
                math.floor((p + half) / GRID_M - 0.5 + 1e-9) + 1,
            )
            for p in place
        ]
        if self.case.shape == "square":
            self.seen[edges[0], edges[1]] = True
            return
        dx = self.world.middles[edges[0], None] - place[0]
        dy = self.world.middles[None, edges[1]] - place[1]
        self.seen[edges[0], edges[1]] |= dx * dx + dy * dy <= half * half

    def coverage(self) -> float:
        """Give the covered share of what can be covered, %."""
        if self.case.height_m:
            return 100.0 * float(self.seen.mean())
        reachable = self.world.reachable
        return 100.0 * float((self.seen & reachable).sum() / reachable.sum())


class Swarm:
    """A trial."""

    def __init__(self, case: Case, seed: int) -> None:
        self.case = case
        self.chance = np.random.default_rng([seed, 1])
        self.world = World(case, np.random.default_rng([seed, 2]))
        self.truth = Truth(case, self.world)
        n, d = case.vehicles, 3 if case.height_m else 2
        places = []
        for index in range(n):
            if case.start == "r":
                place = self.world.random_place(self.chance)
            elif d == 3:
                place = np.array([10.0 + 1.5 * (index - n / 2 + 0.5), 1.2])
            else:
                place = np.array([10.0, 2.0]) + self.chance.normal(0.0, 0.01, 2)
            if d == 3:
                height = self.chance.uniform(0.5, case.height_m - 0.5) if case.start == "r" else 1.0
                place = np.array([*place, -height])
            places.append(place)
        self.place = np.array(places)
        self.heading = np.zeros(n)
        self.odometry = [
            Odometry(np.random.default_rng([seed, 3, i]), case.drift, d) for i in range(n)
        ]
        stall_m = 0.25 * case.speed_m_s * case.period_s if d == 2 else 0.2
        params = PlannerParams(
            **{
                "kind": "explore",
                "dimensions": d,
                "period_s": case.period_s,
                "footprint_m": case.footprint_m,
                "footprint_shape": case.shape,
                "avoid_distance_m": case.body_m + 0.05,
                "avoid_speed_fraction": 1.0,
                "stall_distance_m": stall_m,
                **case.params,
            }
        )
        self.explorers = [
            Explorer(
                params,
                speed_m_s=case.speed_m_s,
                climb_m_s=case.speed_m_s,
                seed=[seed, i],
                sysid=i + 1,
            )
            for i in range(n)
        ]
        self.fails_s = np.full(n, math.inf)
        doomed = self.chance.permutation(n)[: case.failures]
        self.fails_s[doomed] = self.chance.uniform(0.1, 0.75, len(doomed)) * case.time_s
        self.payloads = 0
        self.path_m = 0.0

    def run(self) -> dict[str, float]:
        """Fly to the end."""
        case = self.case
        reached: dict[str, float] = {}
        for place in self.place:
            self.truth.mark(place)
        steps = round(case.time_s / case.period_s)
        talk = max(1, round(1.0 / case.period_s))
        half = 0.0
        for step in range(steps):
            now = step * case.period_s
            alive = (self.fails_s > now).nonzero()[0]
            near = self._near(alive)
            for i in alive:
                self._step(int(i), near)
            if step % talk == 0:
                self._talk(now, alive, near)
            if step % 10 == 9:
                coverage = self.truth.coverage()
                for mark in (50, 75, 90, 95, 99):
                    if coverage >= mark:
                        reached.setdefault(f"t{mark}", now + case.period_s)
            if step == steps // 2:
                half = self.truth.coverage()
        sent = sum(explorer.searches for explorer in self.explorers)
        logged = statistics.mean(e.trails.length(e.trails.sysid) for e in self.explorers)
        return {
            "coverage": self.truth.coverage(),
            "half": half,
            "path": self.path_m,
            "bfs": sent,
            "payloads": self.payloads,
            "log": logged,
            **reached,
        }

    def _near(self, alive: NDArray[np.intp]) -> Bools:
        offsets = self.place[None] - self.place[:, None]
        near: Bools = (offsets**2).sum(axis=2) <= self.case.radio_m**2
        present = np.zeros(len(self.place), dtype=np.bool_)
        present[alive] = True
        near &= present[None] & present[:, None]
        np.fill_diagonal(near, False)
        return near

    def _step(self, i: int, near: Bools) -> None:
        case, explorer, odometry = self.case, self.explorers[i], self.odometry[i]
        d = self.place.shape[1]
        peers = self.place[near[i]] - self.place[i]
        ranges = np.full((1, 6), np.inf)
        beams = self.world.beams(self.place[i], self.heading[i], case.beam_m)
        ranges[0, [0, 3, 2]] = beams
        if d == 3:
            ranges[0, 4:] = [case.height_m + self.place[i, 2], -self.place[i, 2]]
            ranges[0, 4:][ranges[0, 4:] > case.beam_m] = np.inf
        own = odometry.position_m
        plan = explorer.step(own[None], self.heading[i : i + 1], ranges, peers[None])
        hits = []
        for beam, turn in zip(beams, (0.0, math.pi / 2, -math.pi / 2), strict=True):
            if beam < np.inf:
                angle = self.heading[i] + turn
                level = [own[0] + beam * math.cos(angle), own[1] + beam * math.sin(angle)]
                hits.append([*level, *own[2:]])
        for beam, up in zip(ranges[0, 4:], (-1.0, 1.0), strict=True):
            if beam < np.inf:
                hits.append([own[0], own[1], own[2] + up * beam])
        if hits:
            explorer.observe_hits(np.array(hits))
        before = self.place[i].copy()
        self.place[i] = after = self.world.move(before, plan.velocity_m_s[0] * case.period_s)
        odometry.move(after - before)
        self.path_m += math.dist(before, after)
        self.heading[i] = plan.heading_rad[0]
        self.truth.mark(after)

    def _talk(self, now: float, alive: NDArray[np.intp], near: Bools) -> None:
        chance, loss = self.chance, self.case.loss
        beacons = {i: self.explorers[i].summary() for i in alive}
        for i in alive:
            for j in near[i].nonzero()[0]:
                if chance.random() < loss:
                    continue
                offset = self.place[j] - self.place[i]
                if self.case.noise_m:
                    offset = offset + chance.normal(0.0, self.case.noise_m, len(offset))
                self.explorers[i].hear_peer(
                    j + 1,
                    now,
                    offset.tolist(),
                    self.odometry[j].position_m.tolist(),
                    self.explorers[j].target_m,
                    own_position_m=self.odometry[i].position_m.tolist(),
                )
                self.explorers[i].hear_summary(j + 1, beacons[j])
        for i in alive:
            for payload in self.explorers[i].outbox(MOST_PAYLOADS):
                self.payloads += 1
                for j in near[i].nonzero()[0]:
                    if chance.random() >= loss:
                        self.explorers[j].hear_chunk(i + 1, payload)


def trial(seed: int, case: Case) -> dict[str, float]:
    """Run one seed."""
    began = time.perf_counter()
    result = Swarm(case, seed).run()
    result["cpu"] = time.perf_counter() - began
    return result


def measure(case: Case, seeds: range, workers: int) -> dict[str, Any]:
    """Run all seeds; means, the 95 % interval of the coverage and medians of the times."""
    if workers > 1:
        with ProcessPoolExecutor(workers) as pool:
            rows = list(pool.map(partial(trial, case=case), seeds))
    else:
        rows = [trial(seed, case) for seed in seeds]
    coverage = [row["coverage"] for row in rows]
    spread = statistics.stdev(coverage) if len(rows) > 1 else 0.0
    result: dict[str, Any] = {
        "coverage": round(statistics.mean(coverage), 2),
        "ci": round(1.96 * spread / math.sqrt(len(rows)), 2),
        "min": round(min(coverage), 1),
    }
    for name in ("half", "path", "bfs", "payloads", "log", "cpu"):
        result[name] = round(statistics.mean(row[name] for row in rows), 1)
    for mark in (50, 75, 90, 95, 99):
        times = [row[f"t{mark}"] for row in rows if f"t{mark}" in row]
        if len(times) * 2 >= len(rows):
            result[f"t{mark}"] = round(statistics.median(times))
    return result


CASES: dict[str, dict[str, Any]] = {
    "open": {},
    "loss30": {"loss": 0.3},
    "drift1": {"drift": 0.01},
    "drift2": {"drift": 0.02},
    "fail3": {"failures": 3},
    "noise5": {"noise_m": 0.05},
    "boxes20": {"world": "boxes20"},
    "office": {
        "world": "office",
        "beam_m": 3.0,
        "params": {"social": 0.1, "target_exclusion_m": 4.0, "frontier_below": 0.3},
    },
    "hall": {
        "height_m": 6.0,
        "time_s": 300,
        "speed_m_s": 1.0,
        "period_s": 0.3,
        "footprint_m": 1.0,
        "shape": "disc",
        "beam_m": 3.0,
    },
}


def main() -> None:
    """Read the command line, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", default="open")
    parser.add_argument("--starts", default="rc")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=7000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--set", default="{}", help="JSON of planner parameters")
    parser.add_argument("--case", default="{}", help="JSON of case fields")
    args = parser.parse_args()
    seeds = range(args.first, args.first + args.seeds)
    for name in args.cases.split(","):
        for start in args.starts:
            fields = {**CASES[name], **json.loads(args.case)}
            params = {**CASES[name].get("params", {}), **json.loads(args.set)}
            case = Case(**{**fields, "start": start, "params": params})
            print(f"{name:8} {start}", json.dumps(measure(case, seeds, args.workers)), flush=True)


if __name__ == "__main__":
    main()
