"""What one batch of trials is about: the field, the robots, and where they begin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.explore.chance import Floats
from swarm_ctl.explore.planner import PlannerParams

Bools = NDArray[np.bool_]
Counts = NDArray[np.int64]

TINY = 1e-12
"""Least component of a ray, so that nothing is divided by zero."""


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


def overlaps(place_m: Floats, boxes: Floats, half_m: float) -> Bools:
    """Tell which boxes the bodies of (n, 2) places overlap, (n, b)."""
    north, east = place_m[:, :1], place_m[:, 1:]
    over: Bools = (north > boxes[:, 0] - half_m) & (north < boxes[:, 2] + half_m)
    over &= (east > boxes[:, 1] - half_m) & (east < boxes[:, 3] + half_m)
    return over
