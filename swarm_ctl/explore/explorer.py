"""LF-PSO-M: the hybrid with a memory that it shares, for one vehicle (ALGORITHM 2.6 and 3.3)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from swarm_ctl.explore import kernels
from swarm_ctl.explore.avoidance import OneAvoidance, OneStallWatch
from swarm_ctl.explore.chance import Chance, Floats, Rows, Seed
from swarm_ctl.explore.company import Company
from swarm_ctl.explore.frontier import find_way, find_way_to
from swarm_ctl.explore.logbook import Logbook
from swarm_ctl.explore.memory import VisitedMap, three
from swarm_ctl.explore.pieces import LINE, WALL_X, points
from swarm_ctl.explore.planner import SLOW, OnePlan, Plan, PlannerParams
from swarm_ctl.explore.pso import fly_one
from swarm_ctl.explore.repulsion import repel
from swarm_ctl.explore.swath import Swath
from swarm_ctl.explore.trails import News, Trails

JUMP_M = 3.0
"""A position farther than this from the last one is a new beginning, not a way flown."""
_ROW: Rows = np.zeros(1, dtype=np.intp)


class WrittenOff(NamedTuple):
    """A place that a vehicle does without, after an attempt."""

    kind: str
    """`block`, `wall` or `give up`."""
    point_m: list[float]
    axis: int
    """Across which a wall lies, 0 to 2."""


class Explorer:
    """Plan one vehicle's way over ground that nobody it has met has seen.

    `step` is called once per period as with `Planner` (n = 1); the other calls come as things are
    seen and heard. All positions are metres in the vehicle's own frame unless the name says so.
    """

    def __init__(
        self,
        params: PlannerParams,
        *,
        speed_m_s: float,
        climb_m_s: float,
        seed: Seed,
        sysid: int = 0,
        birth: int = 0,
    ) -> None:
        if params.kind != "explore":
            raise ValueError(f"a planner of kind {params.kind} has no memory")
        if speed_m_s <= 0.0 or (params.dimensions == 3 and climb_m_s <= 0.0):
            raise ValueError("speed and, in 3-D, climb must be positive")
        self.params = params
        d = self._d = params.dimensions
        self._level_m = speed_m_s * params.period_s
        self._climb_m = climb_m_s * params.period_s
        self._chance = Chance([seed])
        self.memory = VisitedMap(
            d,
            params.cell_m,
            params.footprint_m,
            is_square=params.footprint_shape == "square",
            dilation=params.wall_dilation_cells,
        )
        self.trails = Trails(sysid, d, birth)
        self._logbook = Logbook(self.trails)
        self.company = Company(params)
        self._avoidance = OneAvoidance(params.avoid_distance_m, d)
        window = math.ceil(params.stall_time_s / params.period_s - 1e-9)
        self._stall = OneStallWatch(window, params.stall_distance_m)
        self._swath = Swath(params)
        self._gap_cells = max(0, int(2.0 * params.clearance_m / params.cell_m + 1e-9) - 1)
        self._now = 0.0
        self._place: list[float] = []
        self._motion = [0.0, 0.0, 0.0]
        self._commanded_m = 0.0
        self._facing_rad = 0.0
        self._target: list[float] | None = None
        self._corners: deque[list[float]] = deque()
        self._goal: list[float] | None = None
        self._length_m = 0.0
        self._travelled_m = 0.0
        self._steps = 0
        self._is_new = False
        self.written_off: list[WrittenOff] = []
        """Ground that this vehicle could not pass or reach, in the order of its attempts."""
        self.searches = 0
        """Frontier searches so far."""

    # -- what is seen and heard ----------------------------------------------------------------

    def observe_hits(self, points_m: Floats) -> None:
        """Take wall points (h, d) that beams have hit; the cell behind each is a wall."""
        self.observe_points(points_m.tolist())

    def observe_points(self, points_m: Iterable[Sequence[float]]) -> None:
        """Take the same in plain numbers."""
        if not self._place:
            return
        (own_x, own_y, own_z), half = three(self._place), 0.5 * self.params.cell_m
        for point in points_m:
            x, y, z = three(point)
            dx, dy, dz = x - own_x, y - own_y, z - own_z
            far = math.hypot(dx, dy, dz)
            if 1e-6 < far < math.inf:
                behind = [x + half * dx / far, y + half * dy / far, z + half * dz / far]
                axis = 2 if abs(dz) > max(abs(dx), abs(dy)) else int(abs(dy) > abs(dx))
                self._add_wall(behind, axis)

    def hear_peer(
        self,
        sysid: int,
        now: float,
        offset_m: Sequence[float],
        peer_position_m: Sequence[float],
        target_m: Sequence[float] | None = None,
        *,
        own_position_m: Sequence[float] | None = None,
    ) -> None:
        """Note a contact: a peer is at `offset_m` from here, and says where that is in its frame.

        `peer_position_m` and `target_m` are in the peer's frame. With axes along north in both
        frames that gives the shift between them. `own_position_m` is where this vehicle was when
        the offset was measured; without it the position of the last step counts.
        """
        own = own_position_m if own_position_m is not None else self._place
        values = [*offset_m, *peer_position_m, *(target_m or ())]
        if len(own) == 0 or not all(map(math.isfinite, values)):
            return
        self._now = max(self._now, now)
        place = [float(p) + float(o) for p, o in zip(own, offset_m, strict=True)]
        shift = tuple(p - float(q) for p, q in zip(place, peer_position_m, strict=True))
        self.trails.meet(sysid, self._now, shift)
        target = None
        if target_m is not None:
            target = [float(t) + s for t, s in zip(target_m, shift, strict=True)]
        self.company.meet(sysid, self._now, place, target)

    def summary(self) -> bytes:
        """Give the version vector for the next beacon: origins and lengths of their logs."""
        return self.trails.summary()

    def hear_summary(self, sysid: int, data: bytes) -> None:
        """Take a peer's version vector."""
        self.trails.hear_summary(sysid, data)

    def outbox(self, most_payloads: int) -> list[bytes]:
        """Give what peers in contact lack, in payloads for everybody in range."""
        payloads = self.trails.outbox(most_payloads, self._now)
        self._logbook.write_out(self.params.footprint_m)
        return payloads

    def hear_chunk(self, sysid: int, data: bytes) -> None:
        """Take a payload of a peer's outbox: any number of times, in any order."""
        for news in self.trails.hear_chunk(sysid, data, self._now):
            self._paint(news)

    def _paint(self, news: News) -> None:
        shift, last_cm = news.shift_m, news.before_cm
        last = last_cm and [cm / 100.0 + s for cm, s in zip(last_cm, shift, strict=True)]
        for kind, point_cm in zip(news.kinds, points(news.numbers_cm, self._d), strict=True):
            point = [cm / 100.0 + s for cm, s in zip(point_cm, shift, strict=True)]
            if kind >= WALL_X:
                self.memory.wall(point, kind - WALL_X)
            else:
                self.memory.sweep(last if kind == LINE and last else point, point)
                last = point

    def way_to(self, position_m: Sequence[float], goal_m: Sequence[float]) -> list[list[float]]:
        """Give the corners of the shortest way over ground that anybody it met has seen."""
        return find_way_to(self.memory, position_m, goal_m)

    # -- going on after a restart --------------------------------------------------------------

    @property
    def head_m(self) -> list[float]:
        """Where the way over new ground ends whose last line is not in the log; empty without."""
        return self._place if self._logbook.is_new else []

    def resume(
        self,
        payloads: Iterable[bytes],
        written_off: Iterable[WrittenOff],
        head_m: list[float],
        now: float,
    ) -> None:
        """Know again what an earlier process knew: `trails.beyond`, `written_off` and `head_m`."""
        self._now = now
        for data in payloads:
            for news in self.trails.read_back(data):
                self._paint(news)
        for place in written_off:
            self.write_off(*place)
        vertex = self.trails.last_m(self.trails.own)
        if head_m and vertex:
            self.memory.sweep(vertex, head_m)
            self._place = head_m
            self._logbook.resume(vertex, head_m)

    # -- the step ------------------------------------------------------------------------------

    @property
    def target_m(self) -> list[float] | None:
        """Where this vehicle is heading to, to be told to its peers."""
        return self._goal or self._target

    def step(
        self, position_m: Floats, heading_rad: Floats, ranges_m: Floats, peers_m: Floats
    ) -> Plan:
        """Plan once per period from (1, d), (1,), (1, 6) and (1, k, d); ValueError for others."""
        d = self._d
        if position_m.shape != (1, d) or ranges_m.shape != (1, 6) or peers_m.shape[::2] != (1, d):
            raise ValueError(f"expected arrays for one vehicle in {d}-D")
        step = self.step_one(
            position_m[0].tolist(),
            float(heading_rad[0]),
            ranges_m[0].tolist(),
            peers_m[0].tolist(),
        )
        return Plan(*(np.array([value]) for value in step))

    def step_one(
        self,
        place_m: list[float],
        heading_rad: float,
        ranges_m: Sequence[float],
        peers_m: Sequence[Sequence[float]],
    ) -> OnePlan:
        """Plan once per period from d numbers, a heading, 6 ranges and d numbers per peer."""
        is_stalled = self._account(place_m, heading_rad)
        self._now += self.params.period_s
        has_turned = self._consult(heading_rad, ranges_m)
        suspended = self._avoidance.suspends
        if is_stalled:
            self._mark_stall(place_m)
        if not suspended and (is_stalled or has_turned or self._is_due(place_m)):
            self._decide(place_m)
        self._fly(place_m, peers_m)
        if self._avoidance.is_active:
            self._avoid()
        if self._commanded_m > SLOW * self._level_m:
            self._facing_rad = math.atan2(self._motion[1], self._motion[0])
        is_new, self._is_new = self._is_new, False
        period_s = self.params.period_s
        return OnePlan(
            [part / period_s for part in self._motion[: self._d]],
            self._facing_rad,
            self._avoidance.is_active,
            self._target or place_m,
            is_new,
        )

    def _account(self, place: list[float], heading_rad: float) -> bool:
        """Remember the way since the last step; tell whether the vehicle is stalled."""
        last, self._place = self._place, place
        moved_m = math.dist(last, place) if last else math.inf
        if moved_m > JUMP_M + 3.0 * self._level_m:
            self._facing_rad = heading_rad
            self.memory.sweep(place, place, is_own=True)
            self._logbook.begin(place)
            self._target = None
            return False
        self._travelled_m += moved_m
        if moved_m > 0.0:
            self._logbook.mark(place, is_new=self.memory.sweep(last, place, is_own=True))
        return self._stall.update(moved_m, self._commanded_m)

    def _add_wall(self, point: list[float], axis: int) -> None:
        if self.memory.wall(point, axis):
            self.trails.append(WALL_X + axis, point[: self._d])

    def _mark_stall(self, place: list[float]) -> None:
        """Take what a vehicle cannot pass for a wall, unless a peer is in its way."""
        size = math.hypot(*self._motion)
        if size <= 0.0:
            return
        unit = [part / size for part in self._motion]
        if self.company.is_ahead(self._now, place, unit):
            return
        cell_m, ahead_m = self.params.cell_m, self.params.clearance_m
        self.write_off("block", [p + cell_m * u for p, u in zip(place, unit, strict=False)])
        reach = (ahead_m + cell_m) / cell_m
        # In 3-D the few beams leave gaps: there a stall is always worth a patch of wall.
        is_seen = self._d == 2 and kernels.wall_within(
            self.memory.grid, self.memory.cells(place), reach
        )
        if not is_seen:
            axis = max(range(self._d), key=lambda index: abs(unit[index]))
            ahead_m += 0.5 * cell_m
            wall = [p + ahead_m * u for p, u in zip(place, unit, strict=False)]
            self.write_off("wall", wall, axis)
        if self._goal is not None:
            self.write_off("give up", self._goal)

    def write_off(self, kind: str, point_m: list[float], axis: int = 0) -> None:
        """Take a place for one to `block` ways at, for a `wall` across an axis, or `give up`."""
        self.written_off.append(WrittenOff(kind, point_m, axis))
        match kind:
            case "block":
                self.memory.block(point_m)
            case "wall":
                self.memory.wall(point_m, axis)
            case _:
                self.memory.give_up(point_m, self.params.cell_m)

    def _consult(self, heading_rad: float, ranges_m: Sequence[float]) -> bool:
        """Ask Table I where a sensor is triggered, or was; tell whether it ends a turn.

        Without the front one those at the sides do not count, see `_reflex`.
        """
        near_m = self.params.avoid_distance_m
        front, _, _, _, up, down = ranges_m
        is_near = front < near_m or (self._d == 3 and (up < near_m or down < near_m))
        if not is_near and not self._avoidance.is_active:
            return False
        return self._avoidance.update(heading_rad, self._reflex(ranges_m), self._chance)

    def _reflex(self, ranges_m: Sequence[float]) -> Sequence[float]:
        """Leave to Table I only what the memory cannot explain.

        Where the map shows the wall that the front beam sees, the way past it was chosen with
        that wall in mind: the table would turn the vehicle away from every door.
        """
        front_m = ranges_m[0]
        if front_m < self.params.avoid_distance_m:
            reach = (front_m + 2.0 * self.params.cell_m) / self.params.cell_m
            if not kernels.wall_within(self.memory.grid, self.memory.cells(self._place), reach):
                return ranges_m
        return [math.inf] * 4 + list(ranges_m[4:])

    def decide(self) -> None:
        """Choose a new local best now."""
        self._decide(self._place)

    # -- deciding ------------------------------------------------------------------------------

    def _is_due(self, place: list[float]) -> bool:
        """Tell whether it is time for a new target."""
        target = self._target
        if target is None:
            return True
        self._steps += 1
        reach_m = max(0.75 * self.params.cell_m, 0.6 * self._level_m)
        if math.dist(place, target) <= reach_m:
            if not self._corners:
                return True
            self._target = self._corners.popleft()
            self._length_m += math.dist(place, self._target)
            self._is_new = True
            return False
        if self._travelled_m >= 1.3 * self._length_m + reach_m:
            return True
        if self._goal is not None:
            return self._steps % 4 == 0 and not self._is_goal_open()
        new, free_m = self._swath.ahead(self.memory, place, target)
        return free_m < self.params.cell_m or (self._steps >= 3 and new < self.params.abort_below)

    def _is_goal_open(self) -> bool:
        i, j, k = (math.floor(value) for value in self.memory.cells(self._goal or []))
        return kernels.unknown_within(self.memory.grid, i, j, k, 1) > 0

    def _decide(self, place: list[float]) -> None:
        """Choose the next local best: the best candidate step, or the way to a frontier."""
        params, swath = self.params, self._swath
        directions, sides, lengths_m = swath.candidates(self._chance)
        with self.memory.supposed(self.company.claims(self._now)):
            rated = swath.rate(self.memory, place, directions, sides, lengths_m)
        best = int(np.argmax(self._scores(place, directions, rated)))
        new, _, last, free = rated[best]
        full = swath.inner * last / swath.pitch
        self._corners.clear()
        self._goal = None
        self._travelled_m, self._steps, self._is_new = 0.0, 0, True
        if new < params.frontier_below * full or new < 6.0:
            if self._pull(place):
                return
            if new == 0.0:
                self._roam(place, directions, rated)
                return
        self._head_for(place, directions[best], last * params.cell_m, free * params.cell_m)

    def _scores(self, place: list[float], directions: Floats, rated: Floats) -> Floats:
        params, swath = self.params, self._swath
        last = rated[:, 2] / swath.pitch
        scores: Floats = (rated[:, 0] + params.adjacency * rated[:, 1]) / (
            swath.inner * (np.maximum(last, 1.0) + swath.overhead)
        )
        if self.company:
            ends = np.array(three(place)) + directions * (rated[:, 2] * params.cell_m)[:, None]
            crowding = self.company.crowding(self._now, place, ends, swath.width_m)
            scores -= params.peer_weight * crowding
        return scores

    def _head_for(
        self, place: list[float], direction: Floats, last_m: float, free_m: float
    ) -> None:
        length = max(min(last_m, free_m - self.params.standoff_m), self.params.cell_m)
        self._length_m = length
        self._target = [p + length * u for p, u in zip(place, direction.tolist(), strict=False)]

    def _pull(self, place: list[float]) -> bool:
        """Follow the shortest known way to the best frontier; False when there is none."""
        self.searches += 1
        corners = find_way(self.memory, place, self.company.others(self._now), self._gap_cells)
        if not corners:
            return False
        self._goal = corners[-1]
        self._corners.extend(corners)
        self._target = self._corners.popleft()
        self._length_m = math.dist(place, self._target)
        return True

    def _roam(self, place: list[float], directions: Floats, rated: Floats) -> None:
        """Go on anywhere when all ground is known: others may know of more."""
        pick = int(np.argmax(rated[:, 3] * self._chance.uniform(_ROW, len(rated))[0]))
        free_m = float(rated[pick, 3]) * self.params.cell_m
        self._head_for(place, directions[pick], free_m, free_m)

    # -- moving --------------------------------------------------------------------------------

    def _fly(self, place: list[float], peers_m: Sequence[Sequence[float]]) -> None:
        """Move by Eq. 6, one random number per term, and keep the speed limits."""
        params, target = self.params, self._target or place
        away_m, social = [0.0] * self._d, 0.0
        if params.social and peers_m:
            away_m = repel(peers_m, params.repulsion_vertical, params.repulsion_max)
            social = params.social
        motion_m = fly_one(
            self._motion[: self._d],
            [t - p for t, p in zip(target, place, strict=True)],
            away_m,
            self._chance.draw(0, 2),
            (params.inertia, params.cognitive, social),
            self._level_m,
            self._climb_m,
        )
        self._motion = three(motion_m)
        self._commanded_m = math.hypot(*self._motion)

    def _avoid(self) -> None:
        """Put Table I in the place of Eq. 6 where sensors are triggered."""
        if self._avoidance.suspends:
            heading = self._avoidance.heading_rad
            level_m = self._level_m * self.params.avoid_speed_fraction
            self._motion[0] = level_m * math.cos(heading)
            self._motion[1] = level_m * math.sin(heading)
            self._commanded_m = level_m
        down = self._avoidance.vertical
        if self._d == 3 and down is not None:
            climb_m = self._climb_m * self.params.avoid_climb_fraction
            self._motion[2] = down * climb_m
            if self._target is not None and (self._target[2] - self._place[2]) * down < 0.0:
                self._target[2] = self._place[2]
