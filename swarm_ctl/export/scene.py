"""What a run looks like in three dimensions: messages of Foxglove, x east, y north, z up."""

from __future__ import annotations

import base64
import colorsys
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from swarm_ctl.record.reader import Run, Track
from swarm_ctl.record.sightings import Sighting

Message = dict[str, Any]

WORLD = "world"
"""Frame of the launch frame, turned: x east, y north, z up."""
LINE_STRIP, LINE_LIST = 0, 2
UINT8 = 1
NOTHING = {"sec": 0, "nsec": 0}
WALL, LOW = (0.45, 0.48, 0.52, 1.0), (0.6, 0.62, 0.66, 0.5)
FOUND, LINKED = (0.09, 0.64, 0.29, 1.0), (0.12, 0.45, 0.75, 0.35)
SEEN, MISSED = (37, 120, 200, 120), (234, 150, 30, 140)
_KINDS = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


def stamp(seconds: float) -> Message:
    """Write a time as seconds and nanoseconds."""
    nanoseconds = round(seconds * 1e9)
    return {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}


def frame_of(run: Run, sysid: int) -> str:
    """Name the frame that a vehicle's track counts in: its own start's if nobody knows better."""
    return WORLD if run.starts_ned_m else f"start_{sysid}"


def update(entities: Iterable[Message]) -> Message:
    """Write foxglove.SceneUpdate."""
    return {"deletions": [], "entities": list(entities)}


def entity(
    time_s: float, frame: str, name: str, *, is_locked: bool = False, **parts: Sequence[Message]
) -> Message:
    """Write foxglove.SceneEntity; it stays until one of the same name comes."""
    return {
        "timestamp": stamp(time_s),
        "frame_id": frame,
        "id": name,
        "lifetime": NOTHING,
        "frame_locked": is_locked,
        "metadata": [],
        **{kind: list(parts.get(kind, ())) for kind in _KINDS},
    }


def vehicle(time_s: float, sysid: int, colour: Sequence[float]) -> Message:
    """Draw a vehicle in its own frame: a flat box, an arrow ahead, its number above."""
    arrow = {
        "pose": pose(0.0, 0.0, 0.05),
        "shaft_length": 0.25,
        "shaft_diameter": 0.06,
        "head_length": 0.15,
        "head_diameter": 0.14,
        "color": rgba(colour),
    }
    box = {"pose": pose(), "size": vector(0.45, 0.45, 0.12), "color": rgba(colour)}
    number = text(str(sysid), 0.0, 0.0, 0.35, colour)
    return entity(
        time_s, f"vehicle_{sysid}", f"vehicle {sysid}",
        is_locked=True, arrows=[arrow], cubes=[box], texts=[number],
    )  # fmt: skip


def walls(run: Run, time_s: float) -> Message:
    """Draw the outlines of the world as prisms; a map without outlines as a box for each run."""
    ceiling_m = float(run.truth.world.get("ceiling_m") or 3.0)
    prisms = [_prism(polygon, ceiling_m) for polygon in run.truth.world.get("polygons") or ()]
    return entity(time_s, WORLD, "walls", triangles=prisms)


def path(time_s: float, run: Run, track: Track, colour: Sequence[float]) -> Message:
    """Draw a vehicle's whole path."""
    points = [vector(e, n, -d) for n, e, d in track.ned_m.tolist()]
    line = lines(LINE_STRIP, points, (*colour[:3], 0.5))
    return entity(time_s, frame_of(run, track.sysid), f"path {track.sysid}", lines=[line])


def victim(time_s: float, one: Sighting) -> Message:
    """Draw a victim, and around it the ball in which it lies."""
    if one.ned_m is None:
        return entity(time_s, WORLD, f"victim {one.number}")
    north, east, down = one.ned_m
    ball = {"pose": pose(east, north, -down), "size": vector(0.4, 0.4, 0.4), "color": rgba(FOUND)}
    around = 2.0 * (one.uncertainty_m or 0.0)
    halo = {**ball, "size": vector(around, around, around), "color": rgba((*FOUND[:3], 0.25))}
    words = text(one.name or f"victim {one.number}", east, north, 0.6 - down, FOUND)
    return entity(time_s, WORLD, f"victim {one.number}", spheres=[ball, halo], texts=[words])


def links(time_s: float, pairs: Iterable[tuple[Sequence[float], Sequence[float]]]) -> Message:
    """Draw a line between each two places, north, east, down."""
    ends = [vector(e, n, -d) for pair in pairs for n, e, d in pair]
    return entity(time_s, WORLD, "links", lines=[lines(LINE_LIST, ends, LINKED)])


def coverage(run: Run, time_s: float, now: float) -> Message:
    """Write foxglove.Grid: what was seen by a mission time, and what could have been."""
    arrays = run.truth.arrays
    free = arrays["free"].astype(bool)
    seen = free & (np.nan_to_num(arrays["seen_s"].astype(float), nan=np.inf) <= now)
    cells = np.zeros((*free.shape, 4), dtype=np.uint8)
    cells[free] = MISSED
    cells[seen] = SEEN
    south, west = map(float, arrays["origin_ne_m"])
    cell_m = float(arrays["cell_m"])
    names = ("red", "green", "blue", "alpha")
    return {
        "timestamp": stamp(time_s),
        "frame_id": WORLD,
        "pose": pose(west, south, 0.01),
        "column_count": free.shape[1],
        "cell_size": {"x": cell_m, "y": cell_m},
        "row_stride": 4 * free.shape[1],
        "cell_stride": 4,
        "fields": [{"name": name, "offset": at, "type": UINT8} for at, name in enumerate(names)],
        "data": base64.b64encode(cells.tobytes()).decode(),
    }


def transform(
    time_s: float, parent: str, child: str, ned_m: Sequence[float], yaw_rad: float
) -> Message:
    """Write foxglove.FrameTransform of a vehicle that heads clockwise from north."""
    north, east, down = ned_m
    half = 0.5 * (0.5 * math.pi - yaw_rad)  # counter-clockwise from east, halved
    return {
        "timestamp": stamp(time_s),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": vector(east, north, -down),
        "rotation": {
            "x": 0.0,
            "y": 0.0,
            "z": round(math.sin(half), 6),
            "w": round(math.cos(half), 6),
        },
    }


def headings_rad(track: Track) -> np.ndarray[Any, Any]:
    """Take the way that a vehicle moves for its heading; who stands keeps the last one."""
    if len(track.time_s) < 2:
        return np.zeros(len(track.time_s))
    north, east = np.diff(track.ned_m[:, :2], axis=0, append=track.ned_m[-1:, :2]).T
    moves = np.hypot(north, east) > 0.05
    last = np.maximum.accumulate(np.where(moves, np.arange(len(moves)), 0))
    return np.asarray(np.arctan2(east, north)[last])


def palette(count: int) -> list[tuple[float, float, float, float]]:
    """Give colours a golden angle apart."""
    return [
        (*colorsys.hsv_to_rgb(index * 0.618034 % 1.0, 0.8, 0.85), 1.0) for index in range(count)
    ]


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Message:
    """Write a place without a turn."""
    return {"position": vector(x, y, z), "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}


def vector(x: float, y: float, z: float) -> Message:
    """Write three numbers, to the millimetre."""
    return {"x": round(x, 3), "y": round(y, 3), "z": round(z, 3)}


def rgba(colour: Sequence[float]) -> Message:
    """Write a colour."""
    return dict(zip("rgba", (round(part, 3) for part in colour), strict=True))


def text(words: str, x: float, y: float, z: float, colour: Sequence[float]) -> Message:
    """Write words that face who looks."""
    return {
        "pose": pose(x, y, z),
        "billboard": True,
        "font_size": 0.3,
        "scale_invariant": False,
        "color": rgba(colour),
        "text": words,
    }


def lines(kind: int, points: Sequence[Message], colour: Sequence[float]) -> Message:
    """Write a thin line of any length of view."""
    return {
        "type": kind,
        "pose": pose(),
        "thickness": 2.0,
        "scale_invariant": True,
        "points": list(points),
        "color": rgba(colour),
        "colors": [],
        "indices": [],
    }


def _prism(polygon: Mapping[str, Any], ceiling_m: float) -> Message:
    """Raise a convex outline from its bottom to its top: sides, and a lid."""
    corners = [(east, north) for north, east in polygon["points_ne_m"]]
    low = float(polygon.get("bottom_m") or 0.0)
    high = min(float(polygon.get("top_m") or ceiling_m), ceiling_m)
    points = [vector(x, y, z) for z in (low, high) for x, y in corners]
    n = len(corners)
    indices: list[int] = []
    for a in range(n):
        b = (a + 1) % n
        indices += [a, b, n + b, a, n + b, n + a]
    for a in range(1, n - 1):
        indices += [n, n + a, n + a + 1]
    colour = WALL if high >= 0.9 * ceiling_m else LOW
    return {
        "pose": pose(),
        "points": points,
        "color": rgba(colour),
        "colors": [],
        "indices": indices,
    }
