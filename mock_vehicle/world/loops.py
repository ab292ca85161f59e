"""Looking around as loops that numba compiles: the same as `World` does with numpy, bit for bit.

Import it only where numba is installed. Angles and products of matrices come from numpy, which
rounds them in its own way; all else is written in numpy's order. `Solids` says what arrays hold.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from typing import Any, TypeVar

Call = TypeVar("Call", bound=Callable[..., Any])

NO_SLOPE = 1e-18
"""In place of 0, by which nothing can be divided."""
BESIDE_M = 1e-6
"""How far beside the corners of a box a ray surely misses it, whatever was rounded."""

compiled: Callable[[Call], Call] = importlib.import_module("numba").njit(
    cache=True, error_model="numpy"
)


@compiled
def _meet_room(origin: Any, north: Any, east: Any, low: Any, high: Any, ranges: Any) -> None:
    """Stop rays at the four walls around everything."""
    for ray in range(len(ranges)):
        inverse = 1.0 / north[ray]
        along = max((high[0] - origin[0]) * inverse, inverse * (low[0] - origin[0]))
        inverse = 1.0 / east[ray]
        aside = max((high[1] - origin[1]) * inverse, inverse * (low[1] - origin[1]))
        ranges[ray] = max(min(along, aside), 0.0)


@compiled
def _meet_box(
    x: float, y: float, half_x: float, half_y: float, axes: Any, north: Any, east: Any, ranges: Any
) -> None:
    """Stop rays at a box: `x` and `y` are its origin's place along the axes of the box, (4,)."""
    corner_m = math.sqrt(half_x * half_x + half_y * half_y) + BESIDE_M
    for ray in range(len(ranges)):
        slope_x = north[ray] * axes[0] + east[ray] * axes[1]
        slope_y = north[ray] * axes[2] + east[ray] * axes[3]
        if abs(slope_x * y - slope_y * x) > corner_m:
            continue
        inverse = 1.0 / (slope_x if slope_x != 0.0 else NO_SLOPE)
        crossing, reach = x * -inverse, abs(inverse) * half_x
        near, far = crossing - reach, crossing + reach
        inverse = 1.0 / (slope_y if slope_y != 0.0 else NO_SLOPE)
        crossing, reach = y * -inverse, abs(inverse) * half_y
        near, far = max(near, crossing - reach), min(far, crossing + reach)
        if near < far and far > 0.0:
            ranges[ray] = min(ranges[ray], max(near, 0.0))


@compiled
def _meet_disc(
    to_north: float, to_east: float, radius: float, north: Any, east: Any, ranges: Any
) -> None:
    """Stop rays at a disc whose middle is so far away."""
    is_outside = math.sqrt(to_north * to_north + to_east * to_east) > radius
    for ray in range(len(ranges)):
        along = north[ray] * to_north + east[ray] * to_east
        aside = north[ray] * to_east - east[ray] * to_north
        square = radius * radius - aside * aside
        if square <= 0.0 or (is_outside and along < 0.0):
            continue
        root = math.sqrt(square)
        if along + root > 0.0:
            ranges[ray] = min(ranges[ray], max(along - root, 0.0))


@compiled
def _stand_off(away_m: float, height_m: float, half_height_m: float, upright: Any) -> None:
    """Stop the beams up and down, (2,), at a solid: `height_m` is how far below its middle."""
    gap = max(abs(height_m) - half_height_m, 0.0)
    if away_m >= 0.0:
        return
    if height_m > 0.0 or gap == 0.0:
        upright[0] = min(upright[0], gap)
    if height_m <= 0.0 or gap == 0.0:
        upright[1] = min(upright[1], gap)


@compiled
def _limit(ranges: Any, range_max_m: float) -> None:
    for index in range(len(ranges)):
        if ranges[index] > range_max_m:
            ranges[index] = math.inf


@compiled
def look(
    range_max_m: float,
    range_max_m2: float,
    origins: Any,
    low: Any,
    high: Any,
    boxes: Any,
    box_sizes: Any,
    box_axes: Any,
    discs: Any,
    discs_away: Any,
    disc_sizes: Any,
    disc_middles: Any,
    north: Any,
    east: Any,
    ring: Any,
    upright: Any,
) -> None:
    """Stop the level rays of all origins, (n, 72), and their beams up and down, (n, 2)."""
    for i in range(len(origins)):
        ranges, beams, origin = ring[i], upright[i], origins[i]
        if math.isfinite(low[0]):
            _meet_room(origin, north[i], east[i], low, high, ranges)
        beams[0], beams[1] = max(origin[2] - low[2], 0.0), max(high[2] - origin[2], 0.0)
        for k in range(box_sizes.shape[1]):
            x, y, down = boxes[i, 0, k], boxes[i, 1, k], boxes[i, 2, k]
            half_x, half_y, half_height = box_sizes[0, k], box_sizes[1, k], box_sizes[2, k]
            beyond_x, beyond_y = abs(x) - half_x, abs(y) - half_y
            _stand_off(max(beyond_x, beyond_y), down, half_height, beams)
            beyond_x, beyond_y = max(beyond_x, 0.0), max(beyond_y, 0.0)
            away = beyond_x * beyond_x + beyond_y * beyond_y
            if abs(down) - half_height < 0.0 and away <= range_max_m2:
                _meet_box(x, y, half_x, half_y, box_axes[k], north[i], east[i], ranges)
        for k in range(disc_sizes.shape[1]):
            radius, half_height = disc_sizes[1, k], disc_sizes[2, k]
            down, away = discs[i, 2, k], discs_away[i, k] - radius
            _stand_off(away, down, half_height, beams)
            if abs(down) - half_height < 0.0 and away <= range_max_m:
                to_north = disc_middles[0, k] - origin[0]
                to_east = disc_middles[1, k] - origin[1]
                _meet_disc(to_north, to_east, disc_sizes[0, k], north[i], east[i], ranges)
        _limit(ranges, range_max_m)
        _limit(beams, range_max_m)


@compiled
def see_bodies(
    radius_m2: float,
    origins: Any,
    bodies: Any,
    seers: Any,
    seen: Any,
    north: Any,
    east: Any,
    ring: Any,
    upright: Any,
) -> None:
    """Stop rays and beams of the seers at the spheres of the bodies that they see."""
    for pair in range(len(seers)):
        i, j = seers[pair], seen[pair]
        to_north, to_east = bodies[j, 0] - origins[i, 0], bodies[j, 1] - origins[i, 1]
        down = bodies[j, 2] - origins[i, 2]
        square = radius_m2 - down * down
        if square > 0.0:
            _meet_disc(to_north, to_east, math.sqrt(square), north[i], east[i], ring[i])
        square = radius_m2 - (to_north * to_north + to_east * to_east)
        if square > 0.0:
            beam = 1 if down > 0.0 else 0
            upright[i, beam] = min(upright[i, beam], max(abs(down) - math.sqrt(square), 0.0))


@compiled
def _slab(offset: float, slope: float, half: float) -> tuple[float, float]:
    """Bound a ray to between two parallel faces, `offset` from their middle."""
    inverse = 1.0 / (1e-12 if abs(slope) < 1e-12 else slope)
    middle, reach = offset * inverse, abs(inverse) * half
    return -middle - reach, reach - middle


@compiled
def _leave_room(origin: Any, direction: Any, low: Any, high: Any) -> float:
    """Measure along a ray to the first plane around everything."""
    nearest = math.inf
    for axis in range(3):
        slope = direction[axis]
        if not abs(slope) < 1e-12:
            bound = low[axis] if slope < 0.0 else high[axis]
            nearest = min(nearest, (bound - origin[axis]) / slope)
    return max(nearest, 0.0)


@compiled
def cast(
    range_max_m: float,
    origins: Any,
    directions: Any,
    low: Any,
    high: Any,
    box_at: Any,
    box_slopes: Any,
    box_sizes: Any,
    box_middles: Any,
    disc_at: Any,
    disc_slopes: Any,
    disc_sizes: Any,
    disc_middles: Any,
    distances: Any,
) -> None:
    """Measure (r,) distances along rays to the first surface.

    `at` and `slopes` are (2, r, m): where rays begin along the axes of every solid, how they run.
    """
    for ray in range(len(origins)):
        down, slope = origins[ray, 2], directions[ray, 2]
        nearest = _leave_room(origins[ray], directions[ray], low, high)
        for k in range(box_sizes.shape[1]):
            near, far = _slab(box_at[0, ray, k], box_slopes[0, ray, k], box_sizes[0, k])
            enter, leave = _slab(box_at[1, ray, k], box_slopes[1, ray, k], box_sizes[1, k])
            near, far = max(near, enter), min(far, leave)
            enter, leave = _slab(down - box_middles[k], slope, box_sizes[2, k])
            near, far = max(near, enter, 0.0), min(far, leave)
            if near < far:
                nearest = min(nearest, near)
        for k in range(disc_sizes.shape[1]):
            x, y = disc_at[0, ray, k], disc_at[1, ray, k]
            dx, dy = disc_slopes[0, ray, k], disc_slopes[1, ray, k]
            a, b = max(dx * dx + dy * dy, 1e-18), x * dx + y * dy
            square = b * b - a * (x * x + y * y - disc_sizes[0, k] * disc_sizes[0, k])
            if square < 0.0:
                continue
            root = math.sqrt(square)
            enter, leave = _slab(down - disc_middles[k], slope, disc_sizes[2, k])
            near, far = max((-b - root) / a, enter, 0.0), min((-b + root) / a, leave)
            if near < far:
                nearest = min(nearest, near)
        distances[ray] = math.inf if nearest > range_max_m else nearest


@compiled
def apart(origins: Any, bodies: Any, distances: Any) -> None:
    """Measure how far bodies, (3, n), are from origins, (k, 3): distances (k, n)."""
    for i in range(len(origins)):
        for j in range(bodies.shape[1]):
            north, east = bodies[0, j] - origins[i, 0], bodies[1, j] - origins[i, 1]
            down = bodies[2, j] - origins[i, 2]
            distances[i, j] = math.sqrt(north * north + down * down + east * east)


@compiled
def gaze(
    origins: Any, seers: Any, seen: Any, cosines: Any, sines: Any, ranges: Any, body: Any
) -> None:
    """Measure from seers (k,) to whom they see: ranges (k,) and unit vectors in body FRD, (k, 3).

    `cosines` and `sines` are of everybody's roll, pitch and yaw, (3, n).
    """
    for pair in range(len(seers)):
        i, j = seers[pair], seen[pair]
        north, east = origins[j, 0] - origins[i, 0], origins[j, 1] - origins[i, 1]
        down = origins[j, 2] - origins[i, 2]
        ranges[pair] = math.sqrt(north * north + down * down + east * east)
        scale = max(ranges[pair], 1e-9)
        north, east, down = north / scale, east / scale, down / scale
        cos, sin = cosines[2, i], sines[2, i]
        forward, right = cos * north + sin * east, cos * east - sin * north
        cos, sin = cosines[1, i], sines[1, i]
        body[pair, 0], down = cos * forward - sin * down, sin * forward + cos * down
        cos, sin = cosines[0, i], sines[0, i]
        body[pair, 1], body[pair, 2] = cos * right + sin * down, cos * down - sin * right


@compiled
def clear(
    cap_m: float,
    points: Any,
    low: Any,
    high: Any,
    boxes: Any,
    box_sizes: Any,
    discs: Any,
    discs_away: Any,
    disc_sizes: Any,
    clearance: Any,
) -> None:
    """Measure the distances (n,) from points to the nearest solid but the floor."""
    for i in range(len(points)):
        nearest = points[i, 2] - low[2]
        for axis in range(2):
            nearest = min(nearest, points[i, axis] - low[axis], high[axis] - points[i, axis])
        for k in range(box_sizes.shape[1]):
            x = abs(boxes[i, 0, k]) - box_sizes[0, k]
            y = abs(boxes[i, 1, k]) - box_sizes[1, k]
            z = abs(boxes[i, 2, k]) - box_sizes[2, k]
            inside = min(max(x, y, z), 0.0)
            x, y, z = max(x, 0.0), max(y, 0.0), max(z, 0.0)
            # einsum adds up along another axis where there is one box alone
            square = x * x + z * z + y * y if len(box_sizes[0]) == 1 else x * x + y * y + z * z
            nearest = min(nearest, inside + math.sqrt(square))
        for k in range(disc_sizes.shape[1]):
            aside = discs_away[i, k] - disc_sizes[1, k]
            above = abs(discs[i, 2, k]) - disc_sizes[2, k]
            inside = min(max(aside, above), 0.0)
            aside, above = max(aside, 0.0), max(above, 0.0)
            nearest = min(nearest, inside + math.sqrt(aside * aside + above * above))
        clearance[i] = min(nearest, cap_m)
