"""The commands that read a run folder: `report`, `export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.export import WRITERS, export_run
from swarm_ctl.record.report import write_report

RunPath = Annotated[
    Path, typer.Argument(help="Run folder, as runs/usar_office-20250304T120000Z.", metavar="RUN")
]


def report(run: RunPath) -> None:
    """Write report.html of a run: one page that needs nothing but a browser.

    Every run writes its own at the end; this one is for a run that was
    killed, or flown by an older version.
    """
    typer.echo(write_report(run))


def export(
    run: RunPath,
    kind: Annotated[
        str,
        typer.Option("--format", help=f"One of {', '.join(WRITERS)}.", show_default=False),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Where to write it; default: in the run folder. Of csv a folder."),
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            help="Where 0, 0, 0 of the launch frame lies, for a run that does not know.",
            metavar="LAT,LON,ALT",
        ),
    ] = None,
    vehicle: Annotated[
        int | None,
        typer.Option(help="Of plan: this vehicle's path, not the victims.", metavar="SYSID"),
    ] = None,
) -> None:
    """Write a run for others: viewers, rescuers' maps, ground stations, tables.

    mcap opens in Foxglove and Lichtblick, geojson and kml on maps, plan in
    QGroundControl; csv is a folder of tables.
    """
    typer.echo(export_run(run, kind, out, origin=origin, sysid=vehicle))
