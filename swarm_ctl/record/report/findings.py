"""What the swarm found, and how fast it searched: victims, coverage."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.frames import ned_to_geodetic
from swarm_ctl.record.reader import Run
from swarm_ctl.record.report.markup import Markup, join, table, tag
from swarm_ctl.record.report.plot import Plot
from swarm_ctl.record.sightings import Sighting, missed, sightings

UNKNOWN = "unknown"
SHARES = (0.5, 0.75, 0.9, 0.95, 0.99)


def victims_section(run: Run) -> Markup | None:
    """Tell of each victim when and where it was found, how sure that is, and who knew."""
    found = sightings(run)
    lost = missed(run, found)
    if not found and not lost:
        return None
    news = run.contacts.news if run.contacts else []
    known = {one["victim"]: one["all_s"] for one in news}
    rows = [_victim(run, one, known.get(one.number)) for one in found]
    heads = [
        head for head in (rows[0] if rows else {}) if any(row[head] != UNKNOWN for row in rows)
    ]
    words = (
        "Places are what the vehicles that saw a victim reported, in metres from "
        f"{'the corner of the world' if run.truth.arrays else 'the origin of the launch frame'}. "
        "“Sure to” is the radius in which it lies 95 times of 100, by what its finder knew of its "
        "own place and by what all vehicles say of it"
        + (", “off truth” the distance to where it lies." if run.truth.world else ".")
    )
    if not run.starts_ned_m:
        words = "Places count from the start of the vehicle that found it, in metres."
    parts: list[str] = [tag("p", words)] if found else []
    parts += [table(heads, [[row[head] for head in heads] for row in rows])] if found else []
    for name, place in lost:
        where = f"north {place.x:.1f} m, east {place.y:.1f} m"
        parts.append(tag("p", f"Not found: {name or 'a victim'} at {where}.", cls="bad"))
    return join(*parts)


def _victim(run: Run, one: Sighting, all_s: float | None) -> dict[str, str]:
    """Give what is told of a victim, by the head of its column; columns of nothing are left out."""
    place = one.ned_m or one.found.own_ned_m
    globe = UNKNOWN
    if run.is_real and run.origin and one.ned_m:  # a mock's world lies on a meadow by default
        at = ned_to_geodetic(one.ned_m, run.origin)
        globe = f"{at.latitude_deg:.7f}, {at.longitude_deg:.7f}"
    return {
        "victim": one.name or f"number {one.number}",
        "found at": f"{one.found.time_s:.1f} s",
        "by vehicle": f"{one.found.sysid}",
        "north": f"{place.x:.2f}",
        "east": f"{place.y:.2f}",
        "height": f"{-place.z:.2f}",
        "sure to": _metres(one.uncertainty_m),
        "off truth": _metres(one.error_m),
        "latitude, longitude": globe,
        "all knew after": _all_knew(run, all_s),
    }


def _all_knew(run: Run, all_s: float | None) -> str:
    if len(run.sysids) < 2:
        return UNKNOWN
    return "never" if all_s is None else f"{all_s:.1f} s"


def _metres(value: float | None) -> str:
    return UNKNOWN if value is None else f"{value:.2f} m"


def coverage_section(run: Run) -> Markup | None:
    """Draw the explored share over time beside what could have been swept at best."""
    arrays = run.truth.arrays
    if not {"coverage_time_s", "coverage_fraction"} <= arrays.keys():
        return None
    times_s, share = arrays["coverage_time_s"].astype(float), arrays["coverage_fraction"]
    if len(times_s) < 2:
        return None
    plot = Plot(float(times_s[-1]), 100.0, "explored, %")
    bound = swept_share(run, times_s)
    if bound is not None:
        until = min(int(np.searchsorted(bound, 1.0)) + 1, len(times_s))
        plot.line(times_s[:until], 100.0 * bound[:until], "bound", key="swept-area bound")
    plot.line(times_s, 100.0 * share, "curve", key="explored", is_filled=True)
    for one in sightings(run):
        at = float(np.interp(one.found.time_s, times_s, share))
        words = f"{one.name or f'victim {one.number}'} found at {one.found.time_s:.0f} s"
        plot.mark(one.found.time_s, 100.0 * at, words, "found")
    if run.events("VictimFound"):
        plot.key("a victim found", "found")
    return join(plot.html(), *_reached(run, times_s, share, bound))


def swept_share(run: Run, times_s: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Give the share that n vehicles sweep at full speed which never see a place twice.

    n (pi r^2 + 2 r v t) of the ground, n (4/3 pi r^3 + pi r^2 v t) of the air: no planner can be
    faster. None when nobody knows how much there is to see.
    """
    numbers, arrays = run.truth.numbers, run.truth.arrays
    since_s = _taken_off_s(run)
    way_m = run.mission["flight"]["speed_m_s"] * np.maximum(times_s - since_s, 0.0)
    radius_m, ball_m = numbers.get("sight_radius_m"), numbers.get("ball_radius_m")
    if ball_m is not None:
        whole = float(numbers["searchable_m3"])
        each = math.pi * ball_m**2 * (4.0 / 3.0 * ball_m + way_m)
    elif radius_m is not None and "free" in arrays:
        whole = float(arrays["free"].sum()) * float(arrays["cell_m"]) ** 2
        each = radius_m * (math.pi * radius_m + 2.0 * way_m)
    else:
        return None
    share = np.minimum(1.0, len(run.sysids) * each / whole)
    return np.where(times_s < since_s, 0.0, share)


def _reached(
    run: Run, times_s: NDArray[Any], share: NDArray[Any], bound: NDArray[Any] | None
) -> list[Markup]:
    """Say when parts of the whole were explored, and when they could have been at best."""
    since_s = _taken_off_s(run)
    rows = []
    for wanted in SHARES:
        took_s = _first(times_s, share, wanted) - since_s
        at_best_s = _first(times_s, bound, wanted) - since_s if bound is not None else math.nan
        if math.isfinite(took_s):
            times = f"{took_s / at_best_s:.1f} times" if at_best_s > 0.0 else ""
            best = f"{at_best_s:.0f} s" if math.isfinite(at_best_s) else "unknown"
            rows.append([f"{wanted:.0%}", f"{took_s:.0f} s", best, times])
    if not rows:
        return []
    heads = ["explored", "after", "at best", "as long"]
    rows, heads = (rows, heads) if bound is not None else ([row[:2] for row in rows], heads[:2])
    return [table(heads, rows), tag("p", "Times count from the first take-off.")]


def _first(times_s: NDArray[Any], share: NDArray[Any], wanted: float) -> float:
    reached = np.flatnonzero(share >= wanted)
    return float(times_s[reached[0]]) if len(reached) else math.nan


def _taken_off_s(run: Run) -> float:
    """Tell when the first vehicle took off: from then on the swarm sees the ground."""
    changes = run.events("PhaseChanged")
    return min((e["time_s"] for e in changes if e["data"]["after"] == "takeoff"), default=0.0)
