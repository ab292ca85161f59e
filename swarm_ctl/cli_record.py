"""The commands that read a run folder: `report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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
