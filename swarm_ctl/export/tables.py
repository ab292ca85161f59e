"""The record as tables: a tidy CSV file per kind, a row per observation."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarm_ctl.errors import SwarmError
from swarm_ctl.frames import ned_to_geodetic
from swarm_ctl.record.reader import Run
from swarm_ctl.record.sightings import sightings

Rows = Iterable[Sequence[Any]]


def write_tables(run: Run, out: Path) -> None:
    """Write a folder of tables; what is not known is an empty cell, a table of nothing no file.

    Places are metres north, east, down of the launch frame where the run has one, else of each
    vehicle's own start. Raises SwarmError when the folder cannot be made.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SwarmError(f"{out}: cannot be the folder of the tables: {error.strerror}") from None
    tables: dict[str, tuple[str, Rows]] = {
        "vehicles": (_VEHICLES, _vehicles(run)),
        "paths": ("sysid,time_s,north_m,east_m,down_m", _paths(run)),
        "victims": (_VICTIMS, _victims(run)),
        "reports": ("victim,time_s,sysid,seen,north_m,east_m,down_m", _reports(run)),
        "events": ("time_s,sysid,event,data", _events(run)),
        "coverage": ("time_s,explored_fraction", _coverage(run)),
        "contacts": ("time_s,sysid,peer", _contacts(run)),
        "battery": ("sysid,time_s,left_fraction,power_w", _battery(run)),
    }
    for name, (heads, rows) in tables.items():
        written = list(rows)
        if written:
            with (out / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file)
                writer.writerow(heads.split(","))
                writer.writerows(written)


_VEHICLES = (
    "sysid,autopilot,phase,reason,explored_from_s,explored_to_s,path_length_m,"
    "messages_sent,messages_received,messages_lost"
)
_VICTIMS = (
    "victim,name,found_s,found_by,north_m,east_m,down_m,latitude_deg,longitude_deg,"
    "uncertainty_m,error_m,all_knew_after_s"
)


def _vehicles(run: Run) -> Rows:
    for one in run.summary.get("per_vehicle", ()):
        yield [one.get(key) for key in _VEHICLES.split(",")]


def _paths(run: Run) -> Rows:
    for track in run.tracks:
        for time_s, place in zip(track.time_s.tolist(), track.ned_m.tolist(), strict=True):
            yield [track.sysid, round(time_s, 3), *(round(metres, 3) for metres in place)]


def _victims(run: Run) -> Rows:
    news = run.contacts.news if run.contacts else []
    all_s = {one["victim"]: one["all_s"] for one in news}
    for one in sightings(run):
        place = one.ned_m or (None, None, None)
        globe: tuple[float | None, float | None] = (None, None)
        if run.origin is not None and one.ned_m is not None:
            at = ned_to_geodetic(one.ned_m, run.origin)
            globe = round(at.latitude_deg, 7), round(at.longitude_deg, 7)
        sure = [one.uncertainty_m, one.error_m, all_s.get(one.number)]
        found = [one.found.time_s, one.found.sysid]
        rounded = (None if value is None else round(value, 3) for value in sure)
        yield [one.number, one.name, *found, *place, *globe, *rounded]


def _reports(run: Run) -> Rows:
    for one in sightings(run):
        for report in one.reports:
            place = report.ned_m or report.own_ned_m
            yield [one.number, report.time_s, report.sysid, int(report.is_seen), *place]


def _events(run: Run) -> Rows:
    for entry in run.entries:
        data = entry.get("data")
        text = json.dumps(data) if data else None
        yield [entry.get("time_s"), entry.get("sysid"), entry.get("event"), text]


def _coverage(run: Run) -> Rows:
    arrays = run.truth.arrays
    if {"coverage_time_s", "coverage_fraction"} <= arrays.keys():
        yield from zip(
            arrays["coverage_time_s"].round(3).tolist(),
            arrays["coverage_fraction"].round(6).tolist(),
            strict=True,
        )


def _contacts(run: Run) -> Rows:
    """Give a row for each pair in contact at each sample, the lower sysid first."""
    if run.contacts is None:
        return
    graph = run.contacts.graph
    for at, a, b in np.argwhere(np.triu(graph.linked, 1)).tolist():
        yield round(float(graph.times_s[at]), 3), graph.sysids[a], graph.sysids[b]


def _battery(run: Run) -> Rows:
    for sysid in run.sysids:
        one = run.battery(sysid)
        columns = (one.time_s, one.left_fraction, one.power_w)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            yield [sysid, *(round(value, 3) if math.isfinite(value) else None for value in row)]
