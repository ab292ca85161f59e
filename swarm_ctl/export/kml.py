"""Paths over time, victims and searched ground as KML, for Google Earth and its like."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from swarm_ctl.export.areas import Polygon, searched_ground
from swarm_ctl.export.geojson import utc_of
from swarm_ctl.export.globe import origin_of, position
from swarm_ctl.frames import Geodetic
from swarm_ctl.model import Vec3
from swarm_ctl.record.reader import Run, Track
from swarm_ctl.record.sightings import Sighting, sightings

KML, GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"


def write_kml(run: Run, out: Path) -> None:
    """Write tracks with a time at each place; SwarmError when the run has no place on the globe.

    Heights count from the ground beneath, as floors of buildings are not in anybody's terrain.
    """
    origin = origin_of(run)
    ET.register_namespace("", KML)
    ET.register_namespace("gx", GX)
    root = ET.Element(f"{{{KML}}}kml")
    document = _add(root, "Document")
    _add(document, "name", f"{run.name}, {run.started_utc:%Y-%m-%d %H:%M} UTC")
    _styles(document, run.sysids)
    victims = _folder(document, "victims")
    for one in sightings(run):
        if one.ned_m is not None:
            _victim(victims, run, one, position(one.ned_m, origin))
    tracks = _folder(document, "paths")
    for track in run.tracks:
        if len(track.time_s):
            _track(tracks, run, track, origin)
    _grounds(document, run, origin)
    ET.ElementTree(root).write(out, encoding="utf-8", xml_declaration=True)


def _styles(document: ET.Element, sysids: Sequence[int]) -> None:
    for index, sysid in enumerate(sysids):
        red, green, blue = colorsys.hsv_to_rgb(index * 0.618034 % 1.0, 0.8, 0.9)
        style = _add(document, "Style", id=f"v{sysid}")
        line = _add(style, "LineStyle")
        _add(line, "color", "ff" + "".join(f"{round(255 * c):02x}" for c in (blue, green, red)))
        _add(line, "width", "2")
    for name, colour in (("searched", "60c87825"), ("not_searched", "901e96ea")):  # aabbggrr
        style = _add(document, "Style", id=name)
        _add(_add(style, "LineStyle"), "width", "0")
        _add(_add(style, "PolyStyle"), "color", colour)


def _victim(folder: ET.Element, run: Run, one: Sighting, at: list[float]) -> None:
    mark = _add(folder, "Placemark")
    _add(mark, "name", one.name or f"victim {one.number}")
    sure = "" if one.uncertainty_m is None else f", sure to {one.uncertainty_m:.2f} m"
    words = f"found by vehicle {one.found.sysid} at {one.found.time_s:.0f} s{sure}"
    _add(mark, "description", words)
    _add(_add(mark, "TimeSpan"), "begin", utc_of(run, one.found.time_s))
    point = _add(mark, "Point")
    _add(point, "coordinates", f"{at[0]},{at[1]},0")


def _track(folder: ET.Element, run: Run, track: Track, origin: Geodetic) -> None:
    mark = _add(folder, "Placemark")
    _add(mark, "name", f"vehicle {track.sysid}")
    _add(mark, "styleUrl", f"#v{track.sysid}")
    line = _add(mark, "Track", space=GX)
    _add(line, "altitudeMode", "relativeToGround")
    for time_s in track.time_s.tolist():
        _add(line, "when", utc_of(run, time_s))
    for place in track.ned_m.tolist():
        longitude, latitude, _ = position(Vec3(*place), origin)
        _add(line, "coord", f"{longitude} {latitude} {max(-place[2], 0.0):.2f}", space=GX)


def _grounds(document: ET.Element, run: Run, origin: Geodetic) -> None:
    ground = searched_ground(run)
    if ground is None:
        return
    for name, cells in (("searched", ground.searched), ("not_searched", ground.missed)):
        if not cells.any():
            continue
        mark = _add(document, "Placemark")
        _add(mark, "name", f"{name.replace('_', ' ')}: {ground.area_m2(cells):.0f} m²")
        _add(mark, "description", f"by {ground.source}")
        _add(mark, "styleUrl", f"#{name}")
        shapes = _add(mark, "MultiGeometry")
        for polygon in ground.polygons(cells):
            _polygon(shapes, polygon, origin)


def _polygon(shapes: ET.Element, polygon: Polygon, origin: Geodetic) -> None:
    shape = _add(shapes, "Polygon")
    for index, ring in enumerate(polygon):
        edge = _add(_add(shape, "innerBoundaryIs" if index else "outerBoundaryIs"), "LinearRing")
        places = (position(Vec3(north, east, 0.0), origin) for north, east in ring)
        _add(edge, "coordinates", " ".join(f"{place[0]},{place[1]}" for place in places))


def _folder(document: ET.Element, name: str) -> ET.Element:
    folder = _add(document, "Folder")
    _add(folder, "name", name)
    return folder


def _add(
    parent: ET.Element, name: str, text: str | None = None, *, space: str = KML, **attributes: str
) -> ET.Element:
    element = ET.SubElement(parent, f"{{{space}}}{name}", attributes)
    element.text = text
    return element
