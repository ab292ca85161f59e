"""A picture of the contacts over time: who was in which company, and who knew of victims when."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm_ctl.record.looks import CURVE, INK, quiet, title

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from swarm_ctl.record.contacts import ContactGraph
    from swarm_ctl.record.spread import Contacts
    from swarm_ctl.record.truth import Truth

ALONE, AWAY = "#e66100", "#f3f1ec"
"""Orange beside blues is told apart by everybody."""
_BLUES = (0.22, 0.98)
"""Part of matplotlib's colour map that is taken: a pair is pale, all together dark."""
_FEW = 20
"""Of so many vehicles each lane is labelled, and big enough for numbers."""
_LANE_INCH = (0.3, 0.1)
"""Height of a lane among few vehicles, and among many."""
_ROOM_PER_LETTER = 0.0062
"""Part of the width."""


def contacts_figure(contacts: Contacts, summary: Mapping[str, Any], truth: Truth) -> Figure:
    """Draw a lane per vehicle, coloured by the size of its group, with the news of victims.

    Beneath it are the number of groups, and what was explored meanwhile if anybody knows.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra

    graph = contacts.graph
    lanes = float(np.clip(len(graph.sysids) * _LANE_INCH[0], 1.2, 3.0))
    lanes = max(lanes, len(graph.sysids) * _LANE_INCH[1])
    has_coverage = "coverage_fraction" in truth.arrays
    below = 1.1 * (1 + has_coverage)
    figure = Figure(figsize=(9.0, lanes + below + 2.0), layout="constrained")
    heights = [lanes, *[1.1] * (1 + has_coverage)]
    panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)
    first, second, *rest = panels[:, 0]
    _lanes(first, graph)
    if len(graph.sysids) <= _FEW:
        _companions(first, graph)
    _news(first, contacts)
    _groups(second, graph)
    for axes in rest:
        _coverage(axes, truth)
    panels[-1, 0].set_xlabel("mission time, s")
    first.set_xlim(*_span(graph))
    for axes in panels[:, 0]:
        quiet(axes)
    figure.align_ylabels()
    together = summary.get("together_fraction")
    words = "Who was in contact"
    if together is not None:
        words += f": all together {together:.0%} of the time"
    title(first, words, summary)
    return figure


def _span(graph: ContactGraph) -> tuple[float, float]:
    """Give the time between the first take-off and the end of the last mission."""
    times_s = graph.times_s[graph.flying.any(axis=1)]
    return float(times_s[0]), float(times_s[-1]) + 1.0


def _lanes(axes: Axes, graph: ContactGraph) -> None:
    from matplotlib import colormaps  # noqa: PLC0415 - an extra
    from matplotlib.colors import BoundaryNorm, ListedColormap  # noqa: PLC0415 - an extra

    vehicles = len(graph.sysids)
    blues = colormaps["Blues"](np.linspace(*_BLUES, vehicles - 1))
    shades = ListedColormap([ALONE, *blues])
    norm = BoundaryNorm(np.arange(0.5, vehicles + 1.0), vehicles)
    axes.set_facecolor(AWAY)
    image = axes.pcolormesh(
        np.append(graph.times_s, graph.times_s[-1] + 1.0),
        np.arange(vehicles + 1) - 0.5,
        np.ma.masked_less(company(graph), 1).T,
        cmap=shades,
        norm=norm,
    )
    axes.set(ylim=(vehicles - 0.5, -0.5), ylabel="vehicle")
    step = 1 if vehicles <= _FEW else 5
    shown = [at for at, sysid in enumerate(graph.sysids) if at == 0 or sysid % step == 0]
    axes.set_yticks(shown, [str(graph.sysids[at]) for at in shown])
    if vehicles <= _FEW:
        axes.hlines(np.arange(vehicles - 1) + 0.5, *_span(graph), color="white", lw=1.5)
    bar = axes.figure.colorbar(image, ax=axes, pad=0.015, fraction=0.04, aspect=18)
    bar.set_label("vehicles in its group", color=INK)
    ticks = np.unique(np.linspace(1, vehicles, min(vehicles, 6)).round().astype(int))
    bar.set_ticks(ticks.tolist(), labels=["alone", *map(str, ticks[1:])], minor=False)
    bar.ax.minorticks_off()
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0, colors=INK, labelsize=9)


def _companions(axes: Axes, graph: ContactGraph) -> None:
    """Write into each lane with whom its vehicle is, where there is room for that."""
    begin_s, end_s = _span(graph)
    sizes = company(graph)
    for lane, groups in enumerate(graph.groups.T):
        others = (graph.groups == groups[:, None]) & graph.flying
        ends = np.flatnonzero((others[1:] != others[:-1]).any(axis=1)) + 1
        for begin, end in itertools.pairwise([0, *ends.tolist(), len(groups)]):
            with_whom = [
                sysid for sysid, is_one in zip(graph.sysids, others[begin], strict=True) if is_one
            ]
            words = " ".join(str(sysid) for sysid in with_whom if sysid != graph.sysids[lane])
            room = (graph.times_s[end - 1] - graph.times_s[begin]) / (end_s - begin_s)
            if sizes[begin, lane] > 1 and room > _ROOM_PER_LETTER * (len(words) + 1):
                is_dark = sizes[begin, lane] > 0.5 * len(graph.sysids)
                axes.annotate(
                    words, (graph.times_s[begin : end].mean() + 0.5, lane - 0.22), ha="center",
                    va="center_baseline", fontsize=6.5, color="white" if is_dark else INK,
                )  # fmt: skip


def company(graph: ContactGraph) -> NDArray[np.intp]:
    """Count the vehicles in each one's group, itself included, (s, n); 0 is not flying."""
    same = graph.groups[:, :, None] == graph.groups[:, None, :]
    return np.asarray(same.sum(axis=2) * graph.flying)


def _news(axes: Axes, contacts: Contacts) -> None:
    few = len(contacts.graph.sysids) <= _FEW
    lower = 0.18 if few else 0.0  # beneath the numbers
    lane = {sysid: at + lower for at, sysid in enumerate(contacts.graph.sysids)}
    found = [(one["found_s"], lane[one["found_by"]]) for one in contacts.news]
    told = [
        (one["found_s"] + after_s, lane[sysid])
        for one in contacts.news
        for sysid, after_s in one["knew_after_s"].items()
        if sysid != one["found_by"]
    ]
    for places, marker, size, label in (
        (told, "o", 4.5 if few else 2.5, "learns of a victim"),
        (found, "*", 12.0 if few else 10.0, "finds a victim"),
    ):
        if places:
            axes.plot(
                *zip(*places, strict=True), marker, ms=size, label=label, ls="none",
                mfc="white", mec=INK, mew=0.9 if few else 0.6,
            )  # fmt: skip
    _legend(axes, "in a group (numbers: with whom)" if few else "in a group")


def _legend(axes: Axes, in_a_group: str) -> None:
    from matplotlib.patches import Patch  # noqa: PLC0415 - an extra

    marks, _ = axes.get_legend_handles_labels()
    patches = [
        Patch(fc=ALONE, label="alone"),
        Patch(fc="#6aaed6", label=in_a_group),
        Patch(fc=AWAY, ec="#c9c6bd", label="not flying"),
    ]
    axes.figure.legend(
        handles=[*patches, *marks[::-1]], loc="outside lower center", ncols=5, frameon=False,
        labelcolor=INK, fontsize=9, handletextpad=0.5, columnspacing=1.6,
    )  # fmt: skip


def _groups(axes: Axes, graph: ContactGraph) -> None:
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415 - an extra

    counts = np.where(graph.flying.any(axis=1), graph.group_counts, np.nan)
    axes.step(graph.times_s, counts, where="post", color=INK, lw=1.4)
    axes.fill_between(graph.times_s, 1.0, counts, step="post", color=ALONE, alpha=0.25, lw=0)
    axes.set(ylabel="groups\n(1: together)", ylim=(0.0, 1.08 * max(2.0, float(np.nanmax(counts)))))
    axes.axhline(1.0, color=CURVE, lw=1.0, ls=(0, (4, 3)))
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))
    axes.grid(axis="x", color="#e4e4e4", lw=0.8)


def _coverage(axes: Axes, truth: Truth) -> None:
    times_s, share = truth.arrays["coverage_time_s"], 100.0 * truth.arrays["coverage_fraction"]
    axes.fill_between(times_s, share, color=CURVE, alpha=0.12, lw=0)
    axes.plot(times_s, share, color=CURVE, lw=2.0)
    axes.set(ylabel="explored, %", ylim=(0.0, 104.0), yticks=[0, 50, 100])
    axes.grid(axis="x", color="#e4e4e4", lw=0.8)
