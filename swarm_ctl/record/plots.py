"""Pictures of a run: paths as in the paper's Figs 3-8, coverage over time, a map of first sight."""

from __future__ import annotations

import colorsys
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm_ctl.record.truth import Truth, read_truth

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

INK, WALL, UNSEEN, FREE = "#2b2f36", "#4a4f57", "#e9e6df", "#fbfaf7"
FOUND, MISSED, CURVE = "#16a34a", "#dc2626", "#1d6fb8"
PALETTE = (
    "#1f77b4", "#e8710a", "#2a9d4a", "#d62839", "#7b5cc4",
    "#8c564b", "#d65db1", "#6c757d", "#a8a000", "#00a5b5",
)  # fmt: skip
DPI = 150
_HALO = "white"


def draw_pictures(
    run: Path,
    summary: Mapping[str, Any],
    *,
    speed_m_s: float | None = None,
) -> list[str]:
    """Draw `paths.png`, `coverage.png` and `coverage_map.png`; give a note per picture left out.

    With the speed of a vehicle the coverage picture shows the swept-area bound.
    """
    try:
        import matplotlib.figure  # noqa: F401, PLC0415 - an extra, and slow to import
    except ImportError:
        return ["no pictures: matplotlib is missing (pip install 'swarm-ctl[plots]')"]
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
    notes = []
    for name, draw in pictures.items():
        try:
            draw().savefig(run / name, dpi=DPI, facecolor="white")
        except KeyError as missing:
            notes.append(f"no {name}: the referee's tracks lack {missing.args[0]}")
        except OSError as error:
            notes.append(f"no {name}: {error.strerror or error}")
    return notes


def paths_figure(truth: Truth, summary: Mapping[str, Any]) -> Figure:
    """Draw every vehicle's path from above, north up, with walls and victims."""
    tracks = truth.arrays["track_ned_m"]
    sysids = truth.arrays.get("sysids", np.arange(1, tracks.shape[1] + 1))
    figure, axes = _ground(truth)
    few = len(sysids) <= 12
    for sysid, colour, track in zip(
        sysids, _colours(len(sysids)), tracks.transpose(1, 0, 2), strict=True
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
    _title(axes, "Paths", summary)
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
    _title(axes, "Coverage", summary)
    return figure


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
    _quiet(axes)
    _title(axes, "Coverage over time", summary)
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
        figsize=(max(5.0, wide + 1.0 + colour_bar), max(3.2, high + 1.6)), layout="constrained"
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
            cmap=_one_colour(WALL), interpolation="nearest",
        )  # fmt: skip
    axes.set(xlim=(west, east), ylim=(south, north), xlabel="east, m", ylabel="north, m")
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=8, integer=True, steps=[1, 2, 4, 5, 10]))
    axes.grid(color="#e9e7e1", lw=0.7, zorder=0)
    axes.set_axisbelow(True)
    _quiet(axes)
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


def _title(axes: Axes, what: str, summary: Mapping[str, Any]) -> None:
    share = summary.get("coverage_fraction")
    explored = "" if share is None else f": {share:.1%} explored"
    axes.set_title(
        f"{what}{explored}", loc="left", color=INK, fontsize=13, fontweight="bold", pad=26
    )
    facts = (
        str(summary.get("mission")), _vehicles(summary), str(summary.get("planner")),
        f"seed {summary.get('seed')}", f"{summary.get('duration_s') or 0.0:.0f} s",
    )  # fmt: skip
    axes.annotate(
        " · ".join(facts), (0.0, 1.0), xycoords="axes fraction", xytext=(0, 8),
        textcoords="offset points", fontsize=9, color="#6b7280", va="bottom",
    )  # fmt: skip


def _vehicles(summary: Mapping[str, Any]) -> str:
    count = summary.get("vehicles")
    return "1 vehicle" if count == 1 else f"{count} vehicles"


def _quiet(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#b6bac1")
    axes.tick_params(length=0, colors=INK, labelsize=9)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)


def _one_colour(colour: str) -> Any:
    from matplotlib.colors import ListedColormap  # noqa: PLC0415 - an extra

    return ListedColormap([colour])


def _colours(count: int) -> list[Any]:
    """Give one colour per robot: a chosen ten, or hues a golden angle apart."""
    if count <= len(PALETTE):
        return list(PALETTE[:count])
    return [
        colorsys.hsv_to_rgb(
            index * 0.618034 % 1.0, 0.85 - 0.25 * (index % 2), 0.62 + 0.1 * (index % 4)
        )
        for index in range(count)
    ]
