"""The layers of a map, one above the other: ground, walls, paths, starts and ends, victims."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.record.reader import Run, Track
from swarm_ctl.record.report.markup import Markup, picture, tag
from swarm_ctl.record.sightings import Sighting, missed

MARGIN_M = 2.0
MOST_POINTS = 60_000
"""Of all paths together: some 300 kB."""
SEARCHED, UNSEARCHED, SOLID = (37, 120, 200), (234, 150, 30), (110, 116, 125)
"""Red, green and blue; they lie half transparent on a light page or a dark one."""


@dataclass(frozen=True, slots=True)
class Frame:
    """What part of the ground a map shows, in metres."""

    west: float
    east: float
    south: float
    north: float

    def where(self, place: Sequence[float]) -> str:
        """Give a place's share of the map's width and height, as a style."""
        left = (place[1] - self.west) / (self.east - self.west)
        bottom = (place[0] - self.south) / (self.north - self.south)
        return f"left:{100.0 * left:.2f}%;bottom:{100.0 * bottom:.2f}%"

    @property
    def view(self) -> str:
        """Give the view box of an SVG in centimetres, y down."""
        return (
            f"{100 * self.west:.0f} {-100 * self.north:.0f} "
            f"{100 * (self.east - self.west):.0f} {100 * (self.north - self.south):.0f}"
        )


def frame_of(run: Run, tracks: Sequence[Track]) -> Frame:
    """Give what a map has to show: the walls, or else the grid, or else the paths."""
    world = run.truth.world
    places = np.concatenate([track.ned_m[:, :2] for track in tracks])
    south, west = places.min(axis=0) - MARGIN_M
    north, east = places.max(axis=0) + MARGIN_M
    if world.get("low") and world.get("closed"):
        (south, west, _), (north, east, _) = world["low"], world["high"]
    elif "seen_s" in run.truth.arrays:
        box = _extent(run)
        west, east, south, north = box.west, box.east, box.south, box.north
    return Frame(float(west), float(east), float(south), float(north))


def searched_layer(run: Run, frame: Frame) -> Markup:
    """Lay under the map what was seen, what was not, and what is solid."""
    arrays = run.truth.arrays
    if not {"seen_s", "free", "seen_fraction", "origin_ne_m", "cell_m"} <= arrays.keys():
        return Markup()
    box = _extent(run)
    style = (
        f"{frame.where((box.south, box.west))};"
        f"width:{100 * (box.east - box.west) / (frame.east - frame.west):.2f}%;"
        f"height:{100 * (box.north - box.south) / (frame.north - frame.south):.2f}%"
    )
    rgba = _painted(arrays, has_walls=bool(run.truth.world.get("polygons")))
    return picture(rgba[::-1], "the area searched", cls="searched", style=style)


def wall_layer(run: Run) -> Iterable[Markup]:
    """Draw the outlines of what stands there: solid where it reaches the height of flight."""
    height_m = float(run.mission["flight"]["height_m"])
    for polygon in run.truth.world.get("polygons") or ():
        top_m, bottom_m = polygon.get("top_m", math.inf), polygon.get("bottom_m", 0.0)
        cuts = bottom_m <= height_m <= top_m
        points = " ".join(f"{100 * e:.0f},{-100 * n:.0f}" for n, e in polygon["points_ne_m"])
        yield tag("polygon", points=points, cls="wall" if cuts else "low")


def path_layer(tracks: Sequence[Track], hues: dict[int, str]) -> Iterable[Markup]:
    """Draw where everybody flew."""
    step = math.ceil(sum(len(track.time_s) for track in tracks) / MOST_POINTS)
    for track in tracks:
        north, east = (100.0 * track.ned_m[::step, :2].T).round().astype(int)
        moves = np.flatnonzero((np.diff(north) != 0) | (np.diff(east) != 0)) + 1
        steps = zip(
            np.diff(east[np.append(0, moves)]), -np.diff(north[np.append(0, moves)]), strict=True
        )
        d = f"M{east[0]},{-north[0]}l" + " ".join(f"{x},{y}" for x, y in steps)
        yield tag(
            "path",
            tag("title", f"vehicle {track.sysid}"),
            d=d if len(moves) else f"M{east[0]},{-north[0]}",
            cls=f"way v{track.sysid}",
            style=f"stroke:{hues[track.sysid]}",
        )


def end_layer(frame: Frame, tracks: Sequence[Track], hues: dict[int, str]) -> Iterable[Markup]:
    """Mark where everybody started, and with its number where it ended."""
    for track in tracks:
        hue, who = hues[track.sysid], f"vehicle {track.sysid}"
        for place, sign, cls, words in (
            (track.ned_m[0], "", "start", f"{who} started here at {track.time_s[0]:.0f} s"),
            (track.ned_m[-1], f"{track.sysid}", "end", f"{who} ended here"),
        ):
            style = f"{frame.where(place)};--hue:{hue}"
            yield tag("b", sign, cls=f"mark {cls} v{track.sysid}", style=style, title=words)


def victim_layer(frame: Frame, run: Run, found: Sequence[Sighting]) -> Iterable[Markup]:
    """Mark victims where the swarm says they lie; those that it missed where they do."""
    for one in found:
        if one.ned_m is not None:
            words = words_of(one)
            yield tag("b", "★", cls="mark found", style=frame.where(one.ned_m), title=words)
    for name, place in missed(run, found):
        words = f"{name or 'a victim'}: never found"
        yield tag("b", "✖", cls="mark missed", style=frame.where(place), title=words)


def scale(frame: Frame) -> Markup:
    """Draw a rule of a round length, and say where north is."""
    rough = (frame.east - frame.west) / 5.0
    power = 10.0 ** math.floor(math.log10(rough))
    length = next(power * m for m in (5.0, 2.0, 1.0) if power * m <= rough)
    share = 100.0 * length / (frame.east - frame.west)
    return tag(
        "div",
        tag("i", style=f"width:{share:.2f}%"),
        tag("span", f"{length:g} m, north is up"),
        cls="scale",
    )


def words_of(one: Sighting) -> str:
    """Say in a few words who found a victim, and when."""
    name = one.name or f"victim {one.number}"
    return f"{name}: found by vehicle {one.found.sysid} at {one.found.time_s:.0f} s"


def _extent(run: Run) -> Frame:
    """Give what the referee's grid covers."""
    arrays = run.truth.arrays
    rows, columns = arrays["seen_s"].shape
    south, west = map(float, arrays["origin_ne_m"])
    cell_m = float(arrays["cell_m"])
    return Frame(west, west + columns * cell_m, south, south + rows * cell_m)


def _painted(arrays: dict[str, NDArray[Any]], *, has_walls: bool) -> NDArray[np.uint8]:
    """Paint the ground the darker the earlier it was seen; of a volume the more of its air."""
    seen_s, free = arrays["seen_s"].astype(float), arrays["free"].astype(bool)
    share = np.clip(arrays["seen_fraction"].astype(float), 0.0, 1.0)
    seen = np.isfinite(seen_s) & free & (share > 0.0)
    last_s = max(float(seen_s[seen].max()), 1.0) if seen.any() else 1.0
    rgba = np.zeros((*seen_s.shape, 4), dtype=np.uint8)
    rgba[free & ~seen] = (*UNSEARCHED, 150)
    rgba[seen, :3] = SEARCHED
    is_flat = bool(np.all(share[seen] == 1.0))
    late = seen_s[seen] / last_s if is_flat else 1.0 - share[seen]
    rgba[seen, 3] = (150.0 - 110.0 * late).astype(np.uint8)
    if not has_walls:
        rgba[arrays["blocked"].astype(bool)] = (*SOLID, 255)
    return rgba
