"""What one batch of trials is about: the field, the robots, and where they begin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore.chance import Bools, Floats
from swarm_ctl.explore.planner import PlannerParams

Counts = NDArray[np.int64]

TINY = 1e-12
"""Least component of a ray, so that nothing is divided by zero."""
BEAM_M = 1.0
"""Reach of the beams of `explore` unless said; "beam hit (front/left/right, 1-2 m)" (ALGORITHM
2.6)."""
FAILS = (0.1, 0.75)
"""When robots fail: evenly between these shares of the duration (ALGORITHM 2.3)."""


@dataclass(frozen=True, slots=True)
class Field:
    """A closed rectangle with boxes along its axes, and victims; north, east, in 3-D down, m."""

    low_m: tuple[float, ...]
    high_m: tuple[float, ...]
    boxes_m: tuple[tuple[float, ...], ...] = ()
    """Low corner and high corner of each: low north, low east, high north, high east."""
    victims_m: tuple[tuple[float, ...], ...] = ()
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
    climb_m_s: float | None = None
    """Greatest climb and descent in 3-D; none: `speed_m_s`."""
    start_m: tuple[float, float] | None = None
    """Where all robots start; none: anywhere, each for itself."""
    start_spacing_m: float = 0.0
    """Distance between neighbours in a row eastwards with `start_m` in its middle; 0: no row."""
    start_height_m: float | None = None
    """Height above the floor of all starts in 3-D; none: any, each its own."""
    jitter_m: float = 0.01
    """Standard deviation of the starts around `start_m`."""
    radio_m: float = 2.0
    body_m: float = 0.6
    """Edge of a robot. "The area covered by a robot based on its size was treated as explored"."""
    footprint: Literal["square", "disc"] = "square"
    """In 3-D always a sphere."""
    footprint_m: float | None = None
    """Half the width of what is explored; none: half of `body_m`."""
    failures: int = 0
    """Robots that stop for ever, each at a time within FAILS of the duration."""
    message_loss: float = 0.0
    """Share of beacons and payloads that a receiver in range misses (`explore`)."""
    odometry_drift: float = 0.0
    """Error of the odometry as a share of the distance (`explore`), see `odometry.py`."""
    position_noise_m: float = 0.0
    """Standard deviation of where a peer is seen, along each axis (`explore`)."""
    beam_m: float | None = None
    """How far the beams see (`explore`); none: 1 m, or farther if Table I needs it."""

    @property
    def dimensions(self) -> int:
        """Tell whether height is anybody's business."""
        return self.planner.dimensions

    @property
    def reach_m(self) -> float:
        """Give half the width of what is explored."""
        return self.body_m / 2.0 if self.footprint_m is None else self.footprint_m

    @property
    def sight_m(self) -> float:
        """Give how far the beams must see: Table I needs its distance, a memory more."""
        needed_m = self.planner.avoid_distance_m
        if self.planner.kind != "explore":
            return needed_m
        return max(needed_m, BEAM_M) if self.beam_m is None else self.beam_m

    @property
    def boxes(self) -> Floats:
        """Give the boxes as an array (b, 2 d)."""
        return np.array(self.field.boxes_m, dtype=np.float64).reshape(-1, 2 * self.dimensions)


def overlaps(place_m: Floats, boxes: Floats, half_m: float) -> Bools:
    """Tell which boxes (b, 2 d) the bodies of (n, d) places overlap, (n, b)."""
    d = place_m.shape[1]
    over: Bools = np.ones((len(place_m), len(boxes)), dtype=np.bool_)
    for axis in range(d):
        along = place_m[:, axis, None]
        over &= (along > boxes[:, axis] - half_m) & (along < boxes[:, axis + d] + half_m)
    return over
