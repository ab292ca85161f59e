"""Where vehicles stand at the beginning: listed, in rows or by chance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mock_vehicle.errors import WorldError
from mock_vehicle.maps import CLEARANCE_CAP_M
from mock_vehicle.world.floor import headings, on_floor, rows
from mock_vehicle.world.spec import GridStarts

if TYPE_CHECKING:
    from mock_vehicle.world import World
    from mock_vehicle.world.spec import RandomSpec

Floats = NDArray[np.float64]

START_CLEARANCE_M = 0.3
"""Least distance from a start to anything solid, m."""
_START_HEIGHT_M = 0.15
"""Height at which a vehicle on the floor is wide, m."""
_FLIGHT_HEIGHT_M = 1.5
"""Height at which starts by chance must have a way to most of the world, m; lower where the world
is."""
_CELL_M = 0.25
"""Edge of the cells in which that way is looked for, m."""


def place(world: World, n: int, seed: int) -> tuple[Floats, Floats]:
    """Place n vehicles as the world's file says: (n, 3) NED, m, and (n,) headings, rad."""
    rule = world.spec.starts
    if isinstance(rule, tuple):
        points, yaw = np.array([s.position_m for s in rule]), [s.yaw_deg for s in rule]
        if len(rule) < n:
            raise WorldError(world.path, "starts", f"lists {len(rule)} places, not {n}")
        places, yaws_deg = on_floor(points.reshape(-1, 2)[:n, ::-1]), np.array(yaw[:n])
    elif isinstance(rule, GridStarts):
        places, yaws_deg = rows(rule.grid, n)
    else:
        return _by_chance(world, rule.random, n, seed)
    _check(world, places)
    return places, headings(np.asarray(yaws_deg, dtype=np.float64))


def _check(world: World, places_m: Floats) -> None:
    """Raise WorldError for the first place that is inside or too near to something solid."""
    clearance = world.clearance(places_m - [0.0, 0.0, _START_HEIGHT_M])
    for index in np.flatnonzero(clearance < START_CLEARANCE_M)[:1]:
        north, east, _ = places_m[index]
        listed = isinstance(world.spec.starts, tuple)
        key = f"starts[{index}].position_m" if listed else "starts.grid"
        which = "" if listed else f"vehicle {index + 1} at "
        gap = clearance[index]
        near = "is inside something" if gap <= 0.0 else f"is only {gap:.2f} m from something"
        raise WorldError(world.path, key, f"{which}({east:g}, {north:g}) {near} solid")


def _by_chance(world: World, rule: RandomSpec, n: int, seed: int) -> tuple[Floats, Floats]:
    """Throw darts at the floor of the largest area; keep those far from solids and each other."""
    darts, noses = (np.random.default_rng([seed, stream]) for stream in (0, 1))
    room = min(max(rule.margin_m, START_CLEARANCE_M), CLEARANCE_CAP_M)
    height = min(_FLIGHT_HEIGHT_M, -float(world.low_ned_m[2]) / 2.0)
    area = world.largest_area(_CELL_M, height)
    kept = np.empty((0, 3))
    for _ in range(64):
        batch = on_floor(darts.uniform(world.low_ned_m[:2], world.high_ned_m[:2], (512, 2)))
        fits = world.clearance(batch - [0.0, 0.0, _START_HEIGHT_M]) >= room
        for dart in batch[fits & area.is_free(batch)]:
            if len(kept) < n and (np.hypot(*(kept - dart).T[:2]) >= rule.spacing_m).all():
                kept = np.vstack([kept, dart])
        if len(kept) >= n:
            return kept, noses.uniform(-math.pi, math.pi, n)
    reason = f"there is room for {len(kept)} vehicles {rule.spacing_m:g} m apart, not for {n}"
    raise WorldError(world.path, "starts.random", reason)
