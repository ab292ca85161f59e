"""The command that examines vehicles before they fly: `doctor`."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from swarm_ctl.cli_options import Connect, PipeConsole, SigningKey, read_key
from swarm_ctl.doctor.diagnosis import diagnose
from swarm_ctl.doctor.examination import Question
from swarm_ctl.doctor.report import as_json, silences, tables, verdict
from swarm_ctl.doctor.rows import Severity
from swarm_ctl.doctor.shell import run
from swarm_ctl.errors import SwarmError
from swarm_ctl.mission import load_mission
from swarm_ctl.run.places import pair_up
from swarm_ctl.signing import timestamp_of

WOULD_BITE, NOBODY_HEARD = 1, 2


def doctor(
    connect: Connect,
    sysid: Annotated[
        list[int] | None,
        typer.Option(
            help="Whom to examine, as for `fly`; again for more. Default: everybody heard.",
            metavar="N",
        ),
    ] = None,
    mission: Annotated[
        Path | None, typer.Option(help="Hold the vehicles against this mission's limits.")
    ] = None,
    open_air: Annotated[
        bool, typer.Option("--open-air", help="Nothing is in the way: no rangefinders needed.")
    ] = False,
    fix: Annotated[
        bool, typer.Option("--fix", help="Set the parameters that are safe to set, and say which.")
    ] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Let warnings fail, too.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Report as JSON.")] = False,
    speed: Annotated[
        float,
        typer.Option(help="Times real time, of a simulator.", min=0.1, max=100.0),
    ] = 1.0,
    timeout: Annotated[
        float,
        typer.Option(help="How long to wait for who is silent, seconds.", min=1.0, max=600.0),
    ] = 10.0,
    signing_key: SigningKey = None,
) -> None:
    """Examine vehicles on the ground: what would bite in the air, and what to do about it.

    Exit status: 0 fit to fly, 1 something would bite, 2 bad input or nobody heard. Nothing is
    changed without --fix, and nothing at all on an armed vehicle.
    """
    chosen = load_mission(mission, is_simulated=False) if mission else None
    question = Question(
        urls=list(dict.fromkeys(connect)),
        wanted=frozenset(pair_up(connect, sysid)) if sysid else frozenset(),
        mission=chosen,
        is_open_air=open_air,
        speed=speed,
        key=read_key(signing_key),
        timestamp=timestamp_of(datetime.now(UTC)),
        patience_s=timeout * speed,
    )
    columns = (TextColumn("{task.description}"), BarColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=json) as bar:
        task = bar.add_task("examining", total=1.0)
        examination = run(question, lambda done: bar.update(task, completed=done), is_fixing=fix)
    diagnosis = diagnose(examination)
    worst = {finding.severity for findings in diagnosis.values() for finding in findings}
    bites = Severity.ERROR in worst or (strict and bool(worst)) or bool(silences(examination))
    if json:
        typer.echo(as_json(examination, diagnosis, is_fit=bool(diagnosis) and not bites))
    elif diagnosis:
        PipeConsole(highlight=False).print(tables(examination, diagnosis, is_fixing=fix))
    else:
        raise SwarmError(". ".join(silences(examination)) or verdict(examination, diagnosis))
    raise typer.Exit(NOBODY_HEARD if not diagnosis else WOULD_BITE if bites else 0)
