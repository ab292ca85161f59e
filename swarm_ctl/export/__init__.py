"""A run in the words of others: Foxglove, rescuers' maps, ground stations, tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from swarm_ctl.errors import SwarmError
from swarm_ctl.export.bag import write_mcap
from swarm_ctl.export.geojson import write_geojson
from swarm_ctl.export.globe import parse_origin
from swarm_ctl.export.kml import write_kml
from swarm_ctl.export.plan import write_plan
from swarm_ctl.export.tables import write_tables
from swarm_ctl.record.reader import Run, telling_what_is_damaged

WRITERS: dict[str, Callable[[Run, Path], None]] = {
    "mcap": write_mcap,
    "geojson": write_geojson,
    "plan": write_plan,
    "kml": write_kml,
    "csv": write_tables,
}
"""By the name of their format, which is what their files end with; `csv` is a folder."""


def export_run(
    path: Path,
    kind: str,
    out: Path | None = None,
    *,
    origin: str | None = None,
    sysid: int | None = None,
) -> Path:
    """Write a run folder in another format; give where it lies, by default in the folder.

    `origin` tells where on the globe the launch frame begins, over what the run knows; with a
    sysid a plan has this vehicle's path. Raises SwarmError with what is missing.
    """
    if kind not in WRITERS:
        raise SwarmError(f"--format {kind}: expected one of {', '.join(WRITERS)}")
    if sysid is not None and kind != "plan":
        raise SwarmError(f"--vehicle: only a plan is of one vehicle, not {kind}; leave it out")
    with telling_what_is_damaged(path):
        run = Run.read(path)
        if origin is not None:
            run = dataclasses.replace(run, given_origin=parse_origin(origin))
        out = out or path / ("csv" if kind == "csv" else f"{run.name}.{kind}")
        _write(run, kind, out, sysid)
    return out


def _write(run: Run, kind: str, out: Path, sysid: int | None) -> None:
    try:
        if kind == "plan":
            write_plan(run, out, sysid)
        else:
            WRITERS[kind](run, out)
    except OSError as error:
        raise SwarmError(f"{out}: cannot be written: {error.strerror or error}") from None
