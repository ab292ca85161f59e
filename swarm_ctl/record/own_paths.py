"""Paths of real vehicles: a panel for each, because nobody knows where one started from another."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

from swarm_ctl.record.contacts_plot import contacts_figure
from swarm_ctl.record.looks import (
    FOUND,
    FREE,
    INK,
    NO_MATPLOTLIB,
    PALETTE,
    WALL,
    is_drawable,
    save_pictures,
)
from swarm_ctl.record.spread import Contacts
from swarm_ctl.record.truth import Truth

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from swarm_ctl.model import Vec3

Places = list[tuple[float, float]]
"""East and north of a vehicle's own start, in metres."""


def draw_own_paths(
    run: Path,
    summary: Mapping[str, Any],
    victims: Mapping[int, Mapping[int, Vec3]],
    contacts: Contacts | None = None,
) -> list[str]:
    """Draw `paths.png` from `paths.json`, and `contacts.png`; give a note for each left out.

    `victims` are the places where each sysid saw them, in its own frame.
    """
    if not is_drawable():
        return [NO_MATPLOTLIB]
    flown = read_flown(run)
    if not any(flown.values()):
        return ["no pictures: nothing was flown"]
    seen = {
        sysid: [(place.y, place.x) for place in found.values()] for sysid, found in victims.items()
    }
    pictures = {"paths.png": lambda: own_paths_figure(flown, seen, summary)}
    if contacts is not None and contacts.graph.is_swarm.any():
        pictures["contacts.png"] = lambda: contacts_figure(contacts, summary, Truth())
    return save_pictures(run, pictures)


def read_flown(run: Path) -> dict[int, Places]:
    """Read where each sysid flew from `paths.json`."""
    vehicles = json.loads((run / "paths.json").read_text(encoding="utf-8"))["vehicles"]
    return {
        vehicle["sysid"]: [
            (east, north)
            for waypoint in vehicle["waypoints"]
            if waypoint["kind"] == "flown"
            for north, east, _ in (waypoint["position_m"],)
        ]
        for vehicle in vehicles
    }


def own_paths_figure(
    flown: Mapping[int, Places], seen: Mapping[int, Places], summary: Mapping[str, Any]
) -> Figure:
    """Draw a panel per vehicle, all to one scale, north up, its start in the middle."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra

    columns = math.ceil(math.sqrt(len(flown)))
    rows = math.ceil(len(flown) / columns)
    panel = 5.0 if len(flown) == 1 else 3.2
    figure = Figure(figsize=(panel * columns, panel * rows + 0.8), layout="constrained")
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    everything = [place for places in (*flown.values(), *seen.values()) for place in places]
    reach_m = 1.1 * max([1.0, *(abs(metres) for place in everything for metres in place)])
    for index, (axes, (sysid, places)) in enumerate(zip(grid, flown.items(), strict=False)):
        _panel(axes, sysid, places, PALETTE[index % len(PALETTE)], reach_m)
        if seen.get(sysid):
            axes.scatter(
                *zip(*seen[sysid], strict=True),
                marker="*",
                s=130,
                color=FOUND,
                ec="white",
                zorder=5,
            )
    for axes in grid[len(flown) :]:
        axes.set_axis_off()
    count = summary["vehicles"]
    facts = (
        str(summary["mission"]), "1 vehicle" if count == 1 else f"{count} vehicles",
        str(summary["planner"]), f"{summary['duration_s'] or 0.0:.0f} s",
    )  # fmt: skip
    figure.suptitle("Paths, each from its own start\n" + " · ".join(facts), color=INK, fontsize=11)
    return figure


def _panel(axes: Axes, sysid: int, places: Places, colour: str, reach_m: float) -> None:
    axes.set(xlim=(-reach_m, reach_m), ylim=(-reach_m, reach_m), facecolor=FREE)
    axes.set_aspect("equal")
    axes.set_title(f"vehicle {sysid}", fontsize=9, color=INK, loc="left")
    axes.set_xlabel("east, m", fontsize=8)
    axes.set_ylabel("north, m", fontsize=8)
    axes.grid(color="#e9e7e1", lw=0.7)
    axes.tick_params(length=0, colors=INK, labelsize=7)
    for spine in axes.spines.values():
        spine.set(color=WALL, linewidth=0.8)
    if not places:
        axes.text(0.5, 0.5, "did not fly", transform=axes.transAxes, ha="center", color=INK)
        return
    east, north = zip(*places, strict=True)
    axes.plot(east, north, color=colour, lw=1.5, solid_joinstyle="round", zorder=3)
    axes.scatter(east[0], north[0], s=34, facecolor="white", edgecolor=colour, lw=1.6, zorder=4)
    axes.scatter(east[-1], north[-1], s=60, marker="s", color=colour, edgecolor="white", zorder=4)
