"""Victims, searched ground and paths as GeoJSON (RFC 7946), to be handed over."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from swarm_ctl.export.areas import Polygon, searched_ground
from swarm_ctl.export.globe import origin_of, position
from swarm_ctl.frames import Geodetic
from swarm_ctl.model import Vec3
from swarm_ctl.record.reader import Run
from swarm_ctl.record.sightings import Sighting, sightings

LEAST_M = 0.25
"""Radius of a circle on a map: coordinates are told to 1 cm, and no victim is a point."""
_CORNERS = 24
"""Of the circle around a victim."""


def write_geojson(run: Run, out: Path) -> None:
    """Write one FeatureCollection; SwarmError when the run has no place on the globe."""
    out.write_text(json.dumps(collection(run), allow_nan=False) + "\n", encoding="utf-8")


def collection(run: Run) -> dict[str, Any]:
    """Give victims with the circles in which they lie, ground searched and missed, and paths.

    Longitudes and latitudes are WGS 84; outer rings run counter-clockwise (RFC 7946, 3.1.6).
    """
    origin = origin_of(run)
    features = [*_victims(run, origin), *_grounds(run, origin), *_paths(run, origin)]
    return {"type": "FeatureCollection", "features": features}


def utc_of(run: Run, time_s: float) -> str:
    """Give a mission time as UTC, in the words of ISO 8601."""
    stamp = datetime.fromtimestamp(run.epoch_s + time_s, UTC)
    return stamp.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _victims(run: Run, origin: Geodetic) -> Iterable[dict[str, Any]]:
    for one in sightings(run):
        if one.ned_m is None:
            continue
        told = _told(run, one)
        yield _feature("Point", position(one.ned_m, origin), {"kind": "victim", **told})
        if one.uncertainty_m is not None:
            ring = [position(place, origin) for place in _circle(one.ned_m, one.uncertainty_m)]
            yield _feature("Polygon", [ring], {"kind": "victim_area", **told})


def _told(run: Run, one: Sighting) -> dict[str, Any]:
    return {
        "victim": one.number,
        "name": one.name,
        "found_s": one.found.time_s,
        "found_utc": utc_of(run, one.found.time_s),
        "found_by": one.found.sysid,
        "reported_by": len({report.sysid for report in one.reports}),
        "uncertainty_m": _rounded(one.uncertainty_m),
        "error_m": _rounded(one.error_m),
    }


def _grounds(run: Run, origin: Geodetic) -> Iterable[dict[str, Any]]:
    ground = searched_ground(run)
    if ground is None:
        return
    for kind, cells in (("searched", ground.searched), ("not_searched", ground.missed)):
        if cells.any():
            shapes = _on_globe(ground.polygons(cells), origin)
            facts = {"kind": kind, "area_m2": ground.area_m2(cells), "source": ground.source}
            yield _feature("MultiPolygon", shapes, facts)


def _on_globe(polygons: Iterable[Polygon], origin: Geodetic) -> list[list[list[list[float]]]]:
    return [
        [[position(Vec3(north, east, 0.0), origin)[:2] for north, east in ring] for ring in polygon]
        for polygon in polygons
    ]


def _paths(run: Run, origin: Geodetic) -> Iterable[dict[str, Any]]:
    for track in run.tracks:
        if len(track.time_s) < 2:
            continue
        line = [position(Vec3(*place), origin) for place in track.ned_m.tolist()]
        facts = {
            "kind": "path",
            "sysid": track.sysid,
            "begun_utc": utc_of(run, float(track.time_s[0])),
            "ended_utc": utc_of(run, float(track.time_s[-1])),
        }
        yield _feature("LineString", line, facts)


def _circle(middle: Vec3, radius_m: float) -> list[Vec3]:
    """Go counter-clockwise around a place, on its height, and come back to the first corner."""
    turns = [2.0 * math.pi * corner / _CORNERS for corner in (*range(_CORNERS), 0)]
    reach = max(radius_m, LEAST_M)
    return [
        Vec3(middle.x + reach * math.sin(turn), middle.y + reach * math.cos(turn), middle.z)
        for turn in turns
    ]


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _rounded(metres: float | None) -> float | None:
    return None if metres is None else round(metres, 3)
