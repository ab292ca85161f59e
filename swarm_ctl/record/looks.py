"""What all pictures have in common: colours, titles, quiet axes, and what becomes of failures."""

from __future__ import annotations

import colorsys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, WALL, UNSEEN, FREE = "#2b2f36", "#4a4f57", "#e9e6df", "#fbfaf7"
FOUND, MISSED, CURVE = "#16a34a", "#dc2626", "#1d6fb8"
PALETTE = (
    "#1f77b4", "#e8710a", "#2a9d4a", "#d62839", "#7b5cc4",
    "#8c564b", "#d65db1", "#6c757d", "#a8a000", "#00a5b5",
)  # fmt: skip
DPI = 150


NO_MATPLOTLIB = "no pictures: matplotlib is missing (pip install 'swarm-ctl[plots]')"


def is_drawable() -> bool:
    """Whether matplotlib is here: an extra, and slow to import."""
    try:
        import matplotlib.figure  # noqa: F401, PLC0415 - an extra, and slow to import
    except ImportError:
        return False
    return True


def save_pictures(run: Path, pictures: Mapping[str, Callable[[], Figure]]) -> list[str]:
    """Draw pictures into a run folder, each under its name; give a note for each left out."""
    notes = []
    for name, draw in pictures.items():
        try:
            draw().savefig(run / name, dpi=DPI, facecolor="white")
        except KeyError as missing:
            notes.append(f"no {name}: the referee's tracks lack {missing.args[0]}")
        except OSError as error:
            notes.append(f"no {name}: {error.strerror or error}")
    return notes


def explored(what: str, summary: Mapping[str, Any]) -> str:
    """Give a title that says how much was explored, if anybody knows."""
    share = summary.get("coverage_fraction")
    return what if share is None else f"{what}: {share:.1%} explored"


def title(axes: Axes, words: str, summary: Mapping[str, Any]) -> None:
    """Write a title, and beneath it which run this is."""
    axes.set_title(words, loc="left", color=INK, fontsize=13, fontweight="bold", pad=26)
    facts = (
        str(summary.get("mission")), count_vehicles(summary), str(summary.get("planner")),
        f"seed {summary.get('seed')}", f"{summary.get('duration_s') or 0.0:.0f} s",
    )  # fmt: skip
    axes.annotate(
        " · ".join(facts), (0.0, 1.0), xycoords="axes fraction", xytext=(0, 8),
        textcoords="offset points", fontsize=9, color="#6b7280", va="bottom",
    )  # fmt: skip


def count_vehicles(summary: Mapping[str, Any]) -> str:
    """Say how many vehicles flew."""
    count = summary.get("vehicles")
    return "1 vehicle" if count == 1 else f"{count} vehicles"


def quiet(axes: Axes) -> None:
    """Take away what is no data."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#b6bac1")
    axes.tick_params(length=0, colors=INK, labelsize=9)
    axes.xaxis.label.set_color(INK)
    axes.yaxis.label.set_color(INK)


def one_colour(colour: str) -> Any:
    """Give a colour map that has one colour."""
    from matplotlib.colors import ListedColormap  # noqa: PLC0415 - an extra

    return ListedColormap([colour])


def colours(count: int) -> list[Any]:
    """Give one colour per robot: a chosen ten, or hues a golden angle apart."""
    if count <= len(PALETTE):
        return list(PALETTE[:count])
    return [
        colorsys.hsv_to_rgb(
            index * 0.618034 % 1.0, 0.85 - 0.25 * (index % 2), 0.62 + 0.1 * (index % 4)
        )
        for index in range(count)
    ]
