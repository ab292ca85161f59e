"""Obstacle avoidance by range sensors (Table I, extended to 3-D) and the way out of a stall."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from swarm_ctl.explore.chance import Bools, Chance, Floats, Rows

RANGE_ORDER = ("front", "back", "left", "right", "up", "down")


class Policy(NamedTuple):
    """What to do when exactly these sensors (1 = triggered) see something."""

    front: int
    left: int
    right: int
    up: int
    down: int
    turn: Literal["planner", "left", "right", "either", "about", "straight"]
    """Quarter turns, except "either": an eighth to a side that chance picks; "planner": Eq. 6."""
    vertical: Literal["planner", "level", "climb", "descend"]


TABLE = (
    Policy(0, 0, 0, 0, 0, "planner", "planner"),
    Policy(0, 0, 0, 0, 1, "planner", "climb"),
    Policy(0, 0, 0, 1, 0, "planner", "descend"),
    Policy(0, 0, 0, 1, 1, "planner", "level"),
    Policy(0, 0, 1, 0, 0, "left", "level"),
    Policy(0, 0, 1, 0, 1, "left", "climb"),
    Policy(0, 0, 1, 1, 0, "left", "descend"),
    Policy(0, 0, 1, 1, 1, "left", "level"),
    Policy(0, 1, 0, 0, 0, "right", "level"),
    Policy(0, 1, 0, 0, 1, "right", "climb"),
    Policy(0, 1, 0, 1, 0, "right", "descend"),
    Policy(0, 1, 0, 1, 1, "right", "level"),
    Policy(0, 1, 1, 0, 0, "straight", "planner"),
    Policy(0, 1, 1, 0, 1, "straight", "climb"),
    Policy(0, 1, 1, 1, 0, "straight", "descend"),
    Policy(0, 1, 1, 1, 1, "straight", "level"),
    Policy(1, 0, 0, 0, 0, "either", "level"),
    Policy(1, 0, 0, 0, 1, "either", "climb"),
    Policy(1, 0, 0, 1, 0, "either", "descend"),
    Policy(1, 0, 0, 1, 1, "either", "level"),
    Policy(1, 0, 1, 0, 0, "left", "level"),
    Policy(1, 0, 1, 0, 1, "left", "climb"),
    Policy(1, 0, 1, 1, 0, "left", "descend"),
    Policy(1, 0, 1, 1, 1, "left", "level"),
    Policy(1, 1, 0, 0, 0, "right", "level"),
    Policy(1, 1, 0, 0, 1, "right", "climb"),
    Policy(1, 1, 0, 1, 0, "right", "descend"),
    Policy(1, 1, 0, 1, 1, "right", "level"),
    Policy(1, 1, 1, 0, 0, "about", "climb"),
    Policy(1, 1, 1, 0, 1, "about", "climb"),
    Policy(1, 1, 1, 1, 0, "about", "descend"),
    Policy(1, 1, 1, 1, 1, "about", "level"),
)
"""Table I with the sensors up and down added; row number = F*16 + L*8 + R*4 + U*2 + D."""

# Headings grow clockwise, so a turn to the left is negative. Down is positive, a climb negative.
_TURN_RAD = {
    "planner": 0.0,
    "straight": 0.0,
    "left": -math.pi / 2,
    "right": math.pi / 2,
    "either": math.pi / 4,
    "about": math.pi,
}
_DOWN = {"planner": 0.0, "level": 0.0, "climb": -1.0, "descend": 1.0}

TURN_RAD: Floats = np.array([_TURN_RAD[policy.turn] for policy in TABLE])
IS_COIN: Bools = np.array([policy.turn == "either" for policy in TABLE])
TURNS: Bools = np.array([policy.turn != "planner" for policy in TABLE])
DOWN: Floats = np.array([_DOWN[policy.vertical] for policy in TABLE])
HOLDS_HEIGHT: Bools = np.array([policy.vertical != "planner" for policy in TABLE])

_WEIGHTS = {2: np.array([16.0, 0, 8, 4, 0, 0]), 3: np.array([16.0, 0, 8, 4, 2, 1])}
_TURNED = math.cos(math.radians(20.0))
"""A vehicle has made its turn when its heading is this close (cosine) to the commanded one."""
_NOBODY: Rows = np.zeros(0, dtype=np.intp)


def table_row(ranges_m: Floats, distance_m: float, dimensions: int) -> Rows:
    """Find the row of TABLE (n,) for ranges (n, 6) in RANGE_ORDER.

    A sensor triggers below the distance, an `inf` or a NaN never. In 2-D up and down do not count.
    """
    row: Rows = ((ranges_m < distance_m) @ _WEIGHTS[dimensions]).astype(np.intp)
    return row


def consult(
    ranges_m: Floats, distance_m: float, dimensions: int, last: Rows, turns: Bools
) -> tuple[Rows, Rows, Rows]:
    """Find the row of TABLE (n,) for each, who turns by it, and who comes free of a turn.

    `last` is the row (n,) of the step before; `turns` is TURNS.
    """
    if not ((ranges_m < distance_m).any() or last.any()):
        return last, _NOBODY, _NOBODY
    row = table_row(ranges_m, distance_m, dimensions)
    is_turning = turns[row]
    return row, is_turning.nonzero()[0], (turns[last] & ~is_turning).nonzero()[0]


class Avoidance:
    """The commanded heading of each vehicle in front of an obstacle.

    "Activates as soon as at least one sensor is triggered, and it remains active until the robot
    safely clears the obstacle." A turn is relative to the heading at the moment when its sensors
    trigger. As long as the same ones (front, left, right) stay triggered the commanded heading
    stands until the vehicle has turned there; only then is the table asked again. For a vehicle
    that turns at once this is the table at every step.
    """

    def __init__(
        self,
        vehicles: int,
        distance_m: float,
        dimensions: int,
        consult: Callable[..., tuple[Rows, Rows, Rows]] = consult,
    ) -> None:
        self._consult = consult
        self._distance_m = distance_m
        self._dimensions = dimensions
        self._row = np.zeros(vehicles, dtype=np.intp)
        self.heading_rad: Floats = np.zeros(vehicles)
        """Commanded heading (n,), valid where `suspends` says so."""

    @property
    def is_active(self) -> Bools:
        """Tell whom a sensor keeps from flying freely (n,)."""
        active: Bools = self._row != 0
        return active

    @property
    def suspends(self) -> Bools:
        """Tell for whom Eq. 6 is suspended along the ground (n,)."""
        suspended: Bools = TURNS[self._row]
        return suspended

    @property
    def vertical(self) -> tuple[Bools, Floats]:
        """Tell whose height the table rules (n,) and where to: -1 up, 0 level, 1 down (n,)."""
        return HOLDS_HEIGHT[self._row], DOWN[self._row]

    def update(self, heading_rad: Floats, ranges_m: Floats, chance: Chance) -> Rows:
        """Read the sensors at the present headings (n,); the rows that came free of a turn."""
        last = self._row
        row, turning, free = self._consult(
            ranges_m, self._distance_m, self._dimensions, last, TURNS
        )
        self._row = row
        if turning.size:
            held = np.cos(heading_rad[turning] - self.heading_rad[turning]) < _TURNED
            held &= row[turning] >> 2 == last[turning] >> 2
            fresh = turning[~held]
            if fresh.size:
                self.heading_rad[fresh] = heading_rad[fresh] + self._turn(fresh, chance)
        return free

    def reset(self, rows: Rows) -> None:
        """Ask the table anew for `rows` at the next update, whatever heading they hold."""
        self._row[rows] = 0

    def _turn(self, rows: Rows, chance: Chance) -> Floats:
        row = self._row[rows]
        turn_rad = TURN_RAD[row]
        coin = IS_COIN[row].nonzero()[0]
        if coin.size:
            left = chance.uniform(rows[coin], 1)[:, 0] < 0.5
            turn_rad[coin[left]] *= -1.0
        return turn_rad


class OneAvoidance:
    """Does what `Avoidance` does for one vehicle, in plain numbers."""

    def __init__(self, distance_m: float, dimensions: int) -> None:
        self._distance_m = distance_m
        self._is_flat = dimensions == 2
        self._row = 0
        self.heading_rad = 0.0
        """Commanded heading, valid where `suspends` says so."""

    @property
    def is_active(self) -> bool:
        """Whether a sensor keeps it from flying freely."""
        return self._row != 0

    @property
    def suspends(self) -> bool:
        """Whether Eq. 6 is suspended along the ground."""
        return TABLE[self._row].turn != "planner"

    @property
    def vertical(self) -> float | None:
        """Where to the table sends it: -1 up, 0 level, 1 down; None when it leaves its height."""
        policy = TABLE[self._row]
        return None if policy.vertical == "planner" else _DOWN[policy.vertical]

    def update(self, heading_rad: float, ranges_m: Sequence[float], chance: Chance) -> bool:
        """Read the six sensors at the present heading; whether it came free of a turn."""
        near_m, did_turn, last = self._distance_m, self.suspends, self._row
        front, _, left, right, up, down = ranges_m
        self._row = (front < near_m) << 4 | (left < near_m) << 3 | (right < near_m) << 2
        if not self._is_flat:
            self._row |= (up < near_m) << 1 | (down < near_m)
        if not self.suspends:
            return did_turn
        is_same = self._row >> 2 == last >> 2
        if not (is_same and math.cos(heading_rad - self.heading_rad) < _TURNED):
            self.heading_rad = heading_rad + self._turn(chance)
        return False

    def _turn(self, chance: Chance) -> float:
        turn = TABLE[self._row].turn
        to_left = turn == "either" and chance.draw(0, 1)[0] < 0.5
        return -_TURN_RAD[turn] if to_left else _TURN_RAD[turn]


class OneStallWatch:
    """Notice what `StallWatch` notices of one vehicle, in plain numbers."""

    def __init__(self, steps: int, distance_m: float) -> None:
        self._steps = steps
        self._distance_m = distance_m
        self._count = 0
        self._moved_m = self._commanded_m = 0.0

    def update(self, moved_m: float, commanded_m: float) -> bool:
        """Count the paths of the last step; whether it is stalled, at the end of a window."""
        self._count += 1
        self._moved_m += moved_m
        self._commanded_m += commanded_m
        if self._count < self._steps:
            return False
        is_far = self._commanded_m > 2.0 * self._distance_m
        is_stalled = is_far and self._moved_m < self._distance_m
        self._count = 0
        self._moved_m = self._commanded_m = 0.0
        return is_stalled


class StallWatch:
    """Notice vehicles that are commanded to move and do not, once in every `steps` steps.

    Stalled is who moved less than `distance_m` while more than twice that was commanded.
    """

    def __init__(self, vehicles: int, steps: int, distance_m: float) -> None:
        self._steps = steps
        self._distance_m = distance_m
        self._count = 0
        self._moved_m: Floats = np.zeros(vehicles)
        self._commanded_m: Floats = np.zeros(vehicles)

    def update(self, moved_m: Floats, commanded_m: Floats) -> Rows:
        """Count the paths (n,) of the last step; the stalled rows, at the end of a window."""
        self._count += 1
        self._moved_m += moved_m
        self._commanded_m += commanded_m
        if self._count < self._steps:
            return _NOBODY
        far = self._commanded_m > 2.0 * self._distance_m
        stalled = (far & (self._moved_m < self._distance_m)).nonzero()[0]
        self._count = 0
        self._moved_m[:] = 0.0
        self._commanded_m[:] = 0.0
        return stalled
