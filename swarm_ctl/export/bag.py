"""A run as MCAP with Foxglove's schemas; opens in Foxglove and Lichtblick."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from swarm_ctl.errors import SwarmError
from swarm_ctl.export import scene
from swarm_ctl.export.geojson import collection
from swarm_ctl.export.globe import position
from swarm_ctl.export.scene import WORLD, Message, frame_of, stamp, update
from swarm_ctl.export.schemas import SCHEMAS
from swarm_ctl.model import Vec3
from swarm_ctl.record.reader import Run
from swarm_ctl.record.sightings import sightings

if TYPE_CHECKING:
    from mcap.writer import Writer

COVERAGE_S, LINKS_S, FIX_S = 5.0, 1.0, 1.0
"""Mission time between two grids, two pictures of the links, two places on the globe."""
DEBUG, INFO, WARNING, ERROR = 1, 2, 3, 4
"""foxglove.LogLevel."""
LEVELS = {
    "ContactsChanged": DEBUG, "CommandProgress": DEBUG, "LinkLost": ERROR, "FenceLeft": ERROR,
    "PeerTooClose": WARNING, "PeerElsewhere": WARNING, "PlannerFailed": ERROR,
    "CommandRefused": WARNING, "OrderRefused": WARNING, "ControllerRestarted": WARNING,
    "JournalUnusable": WARNING, "StatusText": WARNING,
}  # fmt: skip
"""What is not here is INFO."""
COVARIANCE_UNKNOWN = 0

Timed = tuple[str, str, float, Message]
"""Topic, schema, mission time, message."""


def write_mcap(run: Run, out: Path) -> None:
    """Write all that a run's record tells, in the order of time.

    Raises SwarmError when the extra `export` is missing.
    """
    try:
        from mcap.writer import Writer  # noqa: PLC0415 - an extra
    except ImportError:
        raise SwarmError("MCAP needs the extra: pip install 'swarm-ctl[export]'") from None
    with out.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="swarm-ctl")
        channels: dict[str, int] = {}
        schemas: dict[str, int] = {}
        for topic, schema, time_s, message in sorted(messages(run), key=lambda one: one[2]):
            if schema not in schemas:
                text = json.dumps(SCHEMAS[schema]).encode()
                schemas[schema] = writer.register_schema(schema, "jsonschema", text)
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", schemas[schema])
            at_ns = round((run.epoch_s + time_s) * 1e9)
            data = json.dumps(message, separators=(",", ":")).encode()
            writer.add_message(channels[topic], at_ns, data, at_ns)
        _attach(writer, run)
        writer.finish()  # type: ignore[no-untyped-call]


def messages(run: Run) -> Iterator[Timed]:
    """Give everything that is written, topic by topic."""
    yield from _still(run)
    yield from _transforms(run)
    yield from _coverage(run)
    yield from _victims(run)
    yield from _links(run)
    yield from _log(run)
    yield from _fixes(run)
    yield from _curves(run)


def _still(run: Run) -> Iterator[Timed]:
    """Give what does not change: walls, vehicles in their own frames, whole paths."""
    colours = scene.palette(len(run.tracks))
    now = run.epoch_s
    if run.truth.world.get("polygons"):
        yield "/world", "foxglove.SceneUpdate", 0.0, update([scene.walls(run, now)])
    drawn = [scene.vehicle(now, t.sysid, c) for t, c in zip(run.tracks, colours, strict=True)]
    paths = [scene.path(now, run, t, c) for t, c in zip(run.tracks, colours, strict=True)]
    yield "/vehicles", "foxglove.SceneUpdate", 0.0, update(drawn)
    yield "/paths", "foxglove.SceneUpdate", 0.0, update(paths)
    if run.origin is not None and run.starts_ned_m:
        text = json.dumps(collection(run))
        yield "/map", "foxglove.GeoJSON", 0.0, {"geojson": text}


def _transforms(run: Run) -> Iterator[Timed]:
    """Give where all vehicles are at each time of any track."""
    at: dict[float, list[Message]] = {}
    for track in run.tracks:
        frame, child = frame_of(run, track.sysid), f"vehicle_{track.sysid}"
        rows = zip(
            track.time_s.tolist(), track.ned_m.tolist(), scene.headings_rad(track), strict=True
        )
        for time_s, place, yaw_rad in rows:
            moved = scene.transform(run.epoch_s + time_s, frame, child, place, float(yaw_rad))
            at.setdefault(time_s, []).append(moved)
    for time_s, transforms in at.items():
        yield "/tf", "foxglove.FrameTransforms", time_s, {"transforms": transforms}


def _coverage(run: Run) -> Iterator[Timed]:
    arrays = run.truth.arrays
    if not {"seen_s", "free", "origin_ne_m", "cell_m", "coverage_time_s"} <= arrays.keys():
        return
    until_s = float(arrays["coverage_time_s"][-1]) if len(arrays["coverage_time_s"]) else 0.0
    for now in [*np.arange(0.0, until_s, COVERAGE_S).tolist(), until_s]:
        yield "/coverage", "foxglove.Grid", now, scene.coverage(run, run.epoch_s + now, now)


def _victims(run: Run) -> Iterator[Timed]:
    """Give all victims known whenever one is found: who jumps into the file sees them all."""
    if not run.starts_ned_m:
        return
    known: list[Message] = []
    for one in sightings(run):
        time_s = one.found.time_s
        known = [*known, scene.victim(run.epoch_s + time_s, one)]
        yield "/victims", "foxglove.SceneUpdate", time_s, update(known)


def _links(run: Run) -> Iterator[Timed]:
    if run.contacts is None or not run.starts_ned_m:
        return
    graph, tracks = run.contacts.graph, {track.sysid: track for track in run.tracks}
    due_s = -np.inf
    for at, time_s in enumerate(graph.times_s.tolist()):
        if time_s < due_s:
            continue
        due_s = time_s + LINKS_S - 1e-6
        pairs = [
            tuple(_at(tracks[graph.sysids[row]], time_s) for row in pair)
            for pair in np.argwhere(np.triu(graph.linked[at], 1)).tolist()
            if all(graph.sysids[row] in tracks for row in pair)
        ]
        drawn = scene.links(run.epoch_s + time_s, [(a, b) for a, b in pairs])
        yield "/links", "foxglove.SceneUpdate", time_s, update([drawn])


def _at(track: Any, time_s: float) -> list[float]:
    row = min(int(np.searchsorted(track.time_s, time_s)), len(track.time_s) - 1)
    place: list[float] = track.ned_m[row].tolist()
    return place


def _log(run: Run) -> Iterator[Timed]:
    for entry in run.entries:
        time_s = float(entry.get("time_s", 0.0))
        data = entry.get("data") or {}
        words = ", ".join(f"{key} {value}" for key, value in data.items())
        sysid = entry.get("sysid")
        message = {
            "timestamp": stamp(run.epoch_s + time_s),
            "level": LEVELS.get(entry.get("event", ""), INFO),
            "message": f"{entry.get('event')}: {words}" if words else str(entry.get("event")),
            "name": "swarm" if sysid is None else f"vehicle_{sysid}",
            "file": "events.jsonl",
            "line": 0,
        }
        yield "/log", "foxglove.Log", time_s, message


def _fixes(run: Run) -> Iterator[Timed]:
    if run.origin is None or not run.starts_ned_m:
        return
    for track in run.tracks:
        due_s = -np.inf
        for time_s, place in zip(track.time_s.tolist(), track.ned_m.tolist(), strict=True):
            if time_s < due_s:
                continue
            due_s = time_s + FIX_S - 1e-6
            longitude, latitude, altitude_m = position(Vec3(*place), run.origin)
            message = {
                "timestamp": stamp(run.epoch_s + time_s),
                "frame_id": f"vehicle_{track.sysid}",
                "latitude": latitude,
                "longitude": longitude,
                "altitude": altitude_m,
                "position_covariance": [0.0] * 9,
                "position_covariance_type": COVARIANCE_UNKNOWN,
            }
            yield f"/vehicle_{track.sysid}/fix", "foxglove.LocationFix", time_s, message


def _curves(run: Run) -> Iterator[Timed]:
    """Give what is for plots: the swarm once a second, each battery."""
    arrays, found_s = run.truth.arrays, [one.found.time_s for one in sightings(run)]
    graph = run.contacts.graph if run.contacts else None
    times_s = arrays.get("coverage_time_s", graph.times_s if graph else np.empty(0)).tolist()
    for at, time_s in enumerate(times_s):
        message: Message = {"timestamp": stamp(run.epoch_s + time_s)}
        if "coverage_fraction" in arrays:
            message["explored_fraction"] = round(float(arrays["coverage_fraction"][at]), 6)
        message["victims_found"] = sum(one_s <= time_s for one_s in found_s)
        if graph is not None and at < len(graph.times_s):
            message["pairs_in_contact"] = int(graph.link_counts[at])
            message["groups"] = int(graph.group_counts[at])
        yield "/swarm", "swarm_ctl.Swarm", time_s, message
    for sysid in run.sysids:
        one = run.battery(sysid)
        for time_s, left, power_w in zip(one.time_s, one.left_fraction, one.power_w, strict=True):
            message = {"timestamp": stamp(run.epoch_s + float(time_s))}
            told = {"left_fraction": float(left), "power_w": round(float(power_w), 2)}
            message |= {key: value for key, value in told.items() if np.isfinite(value)}
            yield f"/vehicle_{sysid}/battery", "swarm_ctl.Battery", max(float(time_s), 0.0), message


def _attach(writer: Writer, run: Run) -> None:
    """Put the mission and the summary into the file."""
    at_ns = round(run.epoch_s * 1e9)
    for name in ("mission.json", "summary.json"):
        file = run.path / name
        if file.is_file():
            writer.add_attachment(at_ns, at_ns, name, "application/json", file.read_bytes())
    facts = {"mission": run.name, "seed": run.started.get("seed"), "frame": WORLD}
    writer.add_metadata("run", {key: str(value) for key, value in facts.items()})
