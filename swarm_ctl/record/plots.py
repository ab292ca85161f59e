"""Pictures of a run: those of the ground, the contacts, and coverage over time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm_ctl.record.contacts_plot import contacts_figure
from swarm_ctl.record.ground import map_figure, paths_figure
from swarm_ctl.record.looks import (
    CURVE,
    FOUND,
    INK,
    NO_MATPLOTLIB,
    explored,
    is_drawable,
    quiet,
    save_pictures,
    title,
)
from swarm_ctl.record.spread import Contacts
from swarm_ctl.record.truth import Truth, read_truth

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray


def draw_pictures(
    run: Path,
    summary: Mapping[str, Any],
    *,
    speed_m_s: float | None = None,
    contacts: Contacts | None = None,
) -> list[str]:
    """Draw `paths.png`, `coverage.png` and `coverage_map.png`; give a note per picture left out.

    With the speed of a vehicle the coverage picture shows the swept-area bound; with contacts of
    several vehicles there is `contacts.png`.
    """
    if not is_drawable():
        return [NO_MATPLOTLIB]
    truth = read_truth(run)
    if not truth.arrays:
        return ["no pictures: the referee's tracks are missing"]
    pictures: dict[str, Callable[[], Figure]] = {
        "paths.png": lambda: paths_figure(truth, summary),
        "coverage.png": lambda: coverage_figure(
            truth,
            summary,
            sight_radius_m=truth.numbers.get("sight_radius_m"),
            speed_m_s=speed_m_s,
        ),
        "coverage_map.png": lambda: map_figure(truth, summary),
    }
    if contacts is not None and contacts.graph.is_swarm.any():
        pictures["contacts.png"] = lambda: contacts_figure(contacts, summary, truth)
    return save_pictures(run, pictures)


def coverage_figure(
    truth: Truth,
    summary: Mapping[str, Any],
    *,
    sight_radius_m: float | None = None,
    speed_m_s: float | None = None,
) -> Figure:
    """Draw the explored share over time, when victims were found, and the swept-area bound."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra

    times, share = truth.arrays["coverage_time_s"], 100.0 * truth.arrays["coverage_fraction"]
    figure = Figure(figsize=(8.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    axes.fill_between(times, share, color=CURVE, alpha=0.12, lw=0)
    axes.plot(times, share, color=CURVE, lw=2.2, label="explored", solid_capstyle="round")
    start_s = _explored_from(summary)
    if sight_radius_m is not None and speed_m_s is not None:
        bound = _swept_share(truth, times - start_s, sight_radius_m, speed_m_s)
        # from where the exploration begins to where the bound reaches the top
        shown = slice(int(np.searchsorted(times, start_s)), int(np.searchsorted(bound, 100.0)) + 1)
        axes.plot(
            times[shown], bound[shown], color=INK, lw=1.3, ls=(0, (5, 3)),
            label="at best: fresh ground all the way",
        )  # fmt: skip
    found_s = np.sort(truth.arrays.get("victim_found_s", np.empty(0)).astype(float))
    found_s = found_s[np.isfinite(found_s) & (found_s >= 0.0)]
    axes.vlines(found_s, 0.0, 104.0, color=FOUND, lw=1.1, alpha=0.55, zorder=1)
    axes.plot(
        found_s, np.interp(found_s, times, share) if len(times) else found_s, "*", ms=14,
        color=FOUND, mec="white", mew=1.0, zorder=5,
        label="a victim found" if len(found_s) else None,
    )  # fmt: skip
    if len(times):
        _end_label(axes, times, share, summary)
    axes.set(
        xlim=(0.0, max(1.0, float(times[-1]) if len(times) else 1.0)), ylim=(0.0, 104.0),
        xlabel="mission time, s", ylabel="explored, %",
    )  # fmt: skip
    axes.grid(color="#e4e4e4", lw=0.8)
    axes.set_axisbelow(True)
    axes.legend(loc="lower right", frameon=True, framealpha=0.92, edgecolor="none")
    quiet(axes)
    title(axes, explored("Coverage over time", summary), summary)
    return figure


def _end_label(
    axes: Axes, times: NDArray[Any], share: NDArray[Any], summary: Mapping[str, Any]
) -> None:
    """Mark the coverage that counts: where the exploration time is over."""
    value = summary.get("coverage_fraction")
    if value is None:
        return
    reached = int(np.searchsorted(share, 100.0 * value - 1e-3))
    until = min(reached, len(times) - 1)
    axes.plot(times[until], 100.0 * value, "o", ms=7, color=CURVE, mec="white", mew=1.5, zorder=6)
    is_late = until > 0.85 * len(times)
    axes.annotate(
        f"{value:.1%}", (times[until], 100.0 * value), xytext=(10, -17), textcoords="offset points",
        ha="right" if is_late else "left", color=CURVE, fontweight="bold", fontsize=12,
    )  # fmt: skip


def _swept_share(
    truth: Truth, since_s: NDArray[Any], radius_m: float, speed_m_s: float
) -> NDArray[Any]:
    """Give the percentage that n discs of a radius can sweep, had none ever crossed old ground."""
    vehicles = truth.arrays["track_ned_m"].shape[1]
    area_m2 = float(truth.arrays["free"].sum()) * float(truth.arrays["cell_m"]) ** 2
    flown_s = np.maximum(since_s, 0.0)
    swept = vehicles * (math.pi * radius_m**2 + 2.0 * radius_m * speed_m_s * flown_s)
    share: NDArray[Any] = np.minimum(100.0, 100.0 * swept / area_m2)
    return share


def _explored_from(summary: Mapping[str, Any]) -> float:
    starts = [one["explored_from_s"] for one in summary.get("per_vehicle", ())]
    return min((start for start in starts if start is not None), default=0.0)
