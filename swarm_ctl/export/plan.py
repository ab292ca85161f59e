"""A plan for QGroundControl: the victims one after the other, or the path of one vehicle."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.errors import SwarmError
from swarm_ctl.export.globe import origin_of, position
from swarm_ctl.frames import Geodetic
from swarm_ctl.model import Vec3
from swarm_ctl.record.reader import Run
from swarm_ctl.record.sightings import sightings

NAV_WAYPOINT, NAV_RETURN_TO_LAUNCH, NAV_TAKEOFF = 16, 20, 22
"""MAV_CMD."""
RELATIVE_ALTITUDE = 3
"""MAV_FRAME_GLOBAL_RELATIVE_ALT."""
FIRMWARE = {"px4": 12, "ardupilot": 3}
"""MAV_AUTOPILOT; QGroundControl takes it for the autopilot that the plan is for."""
QUADROTOR = 2
STRAY_M = 0.3
"""How far a plan may leave the path that it stands for."""
HOLD_S = 5.0
"""At each victim."""


def write_plan(run: Run, out: Path, sysid: int | None = None) -> None:
    """Write a `.plan`: all victims in the order of their discovery, or a vehicle's path.

    A plan leads straight from one waypoint to the next and knows no walls. Raises SwarmError when
    there is nothing to fly to, or no place on the globe.
    """
    origin = origin_of(run)
    places, hold_s = _victims(run) if sysid is None else (_path(run, sysid), 0.0)
    home = run.starts_ned_m[sysid if sysid in run.starts_ned_m else min(run.starts_ned_m)]
    text = json.dumps(plan(run, origin, home, places, hold_s), indent=4)
    out.write_text(text + "\n", encoding="utf-8")


def plan(
    run: Run, origin: Geodetic, home: Vec3, places: Sequence[Vec3], hold_s: float
) -> dict[str, Any]:
    """Take off at home, visit the places, come back; heights count from home."""
    height_m = float(run.mission["flight"]["height_m"])
    speed_m_s = float(run.mission["flight"]["speed_m_s"])
    longitude, latitude, altitude_m = position(home, origin)
    items = [_item(NAV_TAKEOFF, (0.0, 0.0, 0.0), latitude, longitude, height_m)]
    for place in places:
        at = position(place, origin)
        up_m = max(home.z - place.z, height_m)
        items.append(_item(NAV_WAYPOINT, (hold_s, 0.0, 0.0), at[1], at[0], up_m))
    items.append(_item(NAV_RETURN_TO_LAUNCH, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0))
    for number, item in enumerate(items, start=1):
        item["doJumpId"] = number
    pilot = FIRMWARE.get(str(run.summary.get("autopilot", run.mission["autopilot"])), 12)
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": {
            "version": 2,
            "firmwareType": pilot,
            "vehicleType": QUADROTOR,
            "cruiseSpeed": speed_m_s,
            "hoverSpeed": speed_m_s,
            "globalPlanAltitudeMode": 1,
            "plannedHomePosition": [latitude, longitude, altitude_m],
            "items": items,
        },
        "geoFence": {"version": 2, "circles": [], "polygons": []},
        "rallyPoints": {"version": 2, "points": []},
    }


def simplified(path: NDArray[np.float64], stray_m: float) -> NDArray[np.float64]:
    """Leave out what lies within `stray_m` of the straight way (Douglas and Peucker, 1973)."""
    keep = np.zeros(len(path), dtype=bool)
    keep[[0, -1]] = True
    spans = [(0, len(path) - 1)]
    while spans:
        first, last = spans.pop()
        inner = path[first + 1 : last]
        if not len(inner):
            continue
        off_m = _off_m(inner, path[first], path[last])
        worst = int(np.argmax(off_m))
        if off_m[worst] > stray_m:
            middle = first + 1 + worst
            keep[middle] = True
            spans += [(first, middle), (middle, last)]
    return path[keep]


def _off_m(
    points: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Give the distance of points (p, 3) from the straight line between two others."""
    way, to = end - start, points - start
    along = np.clip(to @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(to - along[:, None] * way, axis=1))


def _victims(run: Run) -> tuple[list[Vec3], float]:
    places = [one.ned_m for one in sightings(run) if one.ned_m is not None]
    if not places:
        raise SwarmError(f"{run.path}: no victim was found; --vehicle N gives a vehicle's path")
    return places, HOLD_S


def _path(run: Run, sysid: int) -> list[Vec3]:
    for track in run.tracks:
        if track.sysid == sysid and len(track.time_s) > 1:
            flown = simplified(track.ned_m, STRAY_M)
            return [Vec3(*place) for place in flown.tolist()]
    flew = ", ".join(str(track.sysid) for track in run.tracks if len(track.time_s) > 1)
    raise SwarmError(f"--vehicle {sysid}: did not fly in {run.path}; who flew: {flew or 'nobody'}")


def _item(
    command: int,
    first: tuple[float, float, float],
    latitude: float,
    longitude: float,
    height_m: float,
) -> dict[str, Any]:
    is_place = command != NAV_RETURN_TO_LAUNCH
    yaw = [None if command == NAV_WAYPOINT else 0.0]  # null keeps the heading as it is
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": command,
        "frame": RELATIVE_ALTITUDE if is_place else 2,  # MAV_FRAME_MISSION: no place
        "params": [*first, *yaw, latitude, longitude, round(height_m, 2)],
        **(
            {"Altitude": round(height_m, 2), "AltitudeMode": 1, "AMSLAltAboveTerrain": None}
            if is_place
            else {}
        ),
    }
