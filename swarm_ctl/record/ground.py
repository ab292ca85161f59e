"""Pictures of the ground from above: paths as in the paper's Figs 3-8, a map of first sight."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm_ctl.record.looks import (
    FOUND,
    FREE,
    INK,
    MISSED,
    UNSEEN,
    WALL,
    colours,
    explored,
    one_colour,
    quiet,
    title,
)
from swarm_ctl.record.truth import Truth

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

_HALO = "white"


def paths_figure(truth: Truth, summary: Mapping[str, Any]) -> Figure:
    """Draw every vehicle's path from above, north up, with walls and victims."""
    tracks = truth.arrays["track_ned_m"]
    sysids = truth.arrays.get("sysids", np.arange(1, tracks.shape[1] + 1))
    figure, axes = _ground(truth)
    few = len(sysids) <= 12
    for sysid, colour, track in zip(
        sysids, colours(len(sysids)), tracks.transpose(1, 0, 2), strict=True
    ):
        known = track[np.isfinite(track).all(axis=1)]
        if not len(known):
            continue
        north, east = known[:, 0], known[:, 1]
        width = 1.5 if few else 1.0
        axes.plot(east, north, color=_HALO, lw=width + 1.4, alpha=0.7, zorder=3)
        axes.plot(
            east, north, color=colour, lw=width, zorder=3.1,
            solid_joinstyle="round", solid_capstyle="round",
        )  # fmt: skip
        size = 34 if few else 16
        axes.scatter(
            east[0], north[0], s=size, facecolor="white", edgecolor=colour, lw=1.6, zorder=5
        )
        axes.scatter(
            east[-1], north[-1], s=size * (3.2 if few else 1.3), marker="s", color=colour,
            edgecolor="white", lw=0.9, zorder=6,
        )  # fmt: skip
        if few:
            axes.annotate(
                str(sysid), (east[-1], north[-1]), ha="center", va="center_baseline",
                color="white", fontsize=7.5, fontweight="bold", zorder=6.1,
            )  # fmt: skip
    _victims(axes, truth)
    _legend(axes, truth, paths=True)
    title(axes, explored("Paths", summary), summary)
    return figure


def map_figure(truth: Truth, summary: Mapping[str, Any]) -> Figure:
    """Draw when each place was first seen; in three dimensions, how much of its air was seen."""
    arrays = truth.arrays
    figure, axes = _ground(truth, colour_bar=True)
    if is_volume := _is_volume(truth):
        values, label = 100.0 * arrays["seen_fraction"].astype(float), "seen of the air above, %"
    else:
        values, label = arrays["seen_s"].astype(float), "first seen, s"
    hidden = ~np.isfinite(values) | ~arrays["free"].astype(bool)
    if is_volume:
        hidden |= values <= 0.0
    image = axes.imshow(
        np.ma.masked_array(values, hidden),
        origin="lower",
        extent=_extent(arrays),
        cmap="viridis" if is_volume else "viridis_r",
        vmin=0.0,
        interpolation="nearest",
        zorder=1,
    )
    axes.set_facecolor(UNSEEN)
    bar = figure.colorbar(image, ax=axes, fraction=0.046, pad=0.03, aspect=32)
    bar.set_label(label, color=INK)
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0, colors=INK)
    _victims(axes, truth)
    _legend(axes, truth, paths=False)
    title(axes, explored("Coverage", summary), summary)
    return figure


def _ground(truth: Truth, *, colour_bar: bool = False) -> tuple[Figure, Axes]:
    """Begin a picture of the world from above: equal axes, metres, walls."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra
    from matplotlib.patches import Polygon  # noqa: PLC0415 - an extra
    from matplotlib.ticker import MaxNLocator  # noqa: PLC0415 - an extra

    west, east, south, north = _extent(truth.arrays)
    wide, high = 7.4, 7.4 * (north - south) / (east - west)
    if high > 8.5:
        wide, high = wide * 8.5 / high, 8.5
    figure = Figure(
        figsize=(max(5.0, wide + 1.0 + colour_bar), max(3.2, high + 1.9)), layout="constrained"
    )
    axes = figure.add_subplot()
    axes.set_facecolor(FREE)
    polygons = truth.world.get("polygons") or []
    height_m = _flight_height_m(truth)
    for polygon in polygons:
        points = [(e, n) for n, e in polygon["points_ne_m"]]
        cuts = polygon.get("bottom_m", 0.0) <= height_m <= polygon.get("top_m", math.inf)
        axes.add_patch(
            Polygon(points, closed=True, fc=WALL, ec="none", zorder=2)
            if cuts
            else Polygon(points, closed=True, fc="#9aa0a82e", ec="#8b9099", lw=0.8, zorder=1.5)
        )
    if not polygons:
        blocked = truth.arrays["blocked"].astype(bool)
        cells = np.ma.masked_array(np.ones(blocked.shape), ~blocked)
        axes.imshow(
            cells, origin="lower", extent=(west, east, south, north), zorder=2,
            cmap=one_colour(WALL), interpolation="nearest",
        )  # fmt: skip
    axes.set(xlim=(west, east), ylim=(south, north), xlabel="east, m", ylabel="north, m")
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=8, integer=True, steps=[1, 2, 4, 5, 10]))
    axes.grid(color="#e9e7e1", lw=0.7, zorder=0)
    axes.set_axisbelow(True)
    quiet(axes)
    for spine in axes.spines.values():
        spine.set(visible=True, color=WALL, linewidth=1.6, zorder=4)
    return figure, axes


def _is_volume(truth: Truth) -> bool:
    """Tell whether coverage was counted in three dimensions: columns that were seen in part."""
    share = truth.arrays.get("seen_fraction", np.empty(0))
    return bool(np.any((share > 0.0) & (share < 1.0)))


def _flight_height_m(truth: Truth) -> float:
    down = truth.arrays.get("track_ned_m", np.zeros((0, 0, 3)))[..., 2]
    down = down[np.isfinite(down)]
    return -float(np.median(down)) if down.size else 1.5


def _extent(arrays: Mapping[str, NDArray[Any]]) -> tuple[float, float, float, float]:
    """Give west, east, south and north of the grid, in metres."""
    rows, columns = arrays["blocked"].shape
    south, west = (float(metres) for metres in arrays["origin_ne_m"])
    cell = float(arrays["cell_m"])
    return west, west + columns * cell, south, south + rows * cell


def _victims(axes: Axes, truth: Truth) -> None:
    for positions, marker, colour in zip(_by_found(truth), "*X", (FOUND, MISSED), strict=True):
        if len(positions):
            axes.scatter(
                positions[:, 1], positions[:, 0], marker=marker, color=colour, zorder=7,
                s=210 if marker == "*" else 95, edgecolor="white", lw=1.1,
            )  # fmt: skip


def _by_found(truth: Truth) -> tuple[NDArray[Any], NDArray[Any]]:
    """Part the victims: found, not found."""
    positions = truth.arrays.get("victims_ned_m", np.empty((0, 3))).reshape(-1, 3)
    found_s = truth.arrays.get("victim_found_s", np.full(len(positions), np.nan)).astype(float)
    found = np.isfinite(found_s) & (found_s >= 0.0)
    return positions[found], positions[~found]


def _legend(axes: Axes, truth: Truth, *, paths: bool) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415 - an extra
    from matplotlib.patches import Patch  # noqa: PLC0415 - an extra

    def mark(marker: str, label: str, size: float, **looks: Any) -> Line2D:
        return Line2D([], [], ls="none", marker=marker, ms=size, label=label, **looks)

    handles: list[Line2D | Patch] = []
    if paths:
        handles.append(mark("o", "start", 6, mfc="white", mec=INK, mew=1.5))
        handles.append(mark("s", "end", 7, mfc=INK, mec="white"))
    else:
        handles.append(Patch(fc=UNSEEN, ec="#c9c6bd", label="never seen"))
    found, missed = _by_found(truth)
    if len(found):
        handles.append(mark("*", f"victim found ({len(found)})", 13, mfc=FOUND, mec="white"))
    if len(missed):
        handles.append(mark("X", f"victim not found ({len(missed)})", 9, mfc=MISSED, mec="white"))
    if handles:
        axes.figure.legend(
            handles=handles, loc="outside lower center", ncols=len(handles), frameon=False,
            labelcolor=INK, handletextpad=0.4, columnspacing=1.8,
        )  # fmt: skip
