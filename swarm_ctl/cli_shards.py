"""`run --shards`: one world, flown by several processes here; `join` adds up their records."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.cli_options import EXIT_CODES, PipeConsole
from swarm_ctl.errors import SwarmError
from swarm_ctl.mission import Mission
from swarm_ctl.record.folder import make_folder
from swarm_ctl.record.shards import join_records, join_shards
from swarm_ctl.record.summary import report_lines
from swarm_ctl.run.shards import Shards, free_addresses

ShardOption = Annotated[
    str | None,
    typer.Option(
        "--shards",
        help="Fly several shards in one world, each with --vehicles of its own: how many here, "
        "each in processes of its own; or where all shards hear one another, as "
        "10.0.0.1:14700,10.0.0.2:14700, and --shard.",
        metavar="N|IP:PORT,...",
        show_default=False,
    ),
]
ShardNumber = Annotated[
    int | None,
    typer.Option("--shard", help="Which of the --shards is flown here, from 1 on.", metavar="K"),
]
ALONE = {
    "virtual": "a flight in virtual time is one process",
    "show": "shards have vehicles of one sysid, which a ground station would take for one",
    "fault": "every shard would break its own; run the shards by --shard, and name it to one",
}
"""Options of `run` that several shards cannot have, and why."""


def is_number(shards: str | None) -> bool:
    """Tell whether shards are to be flown here, however many."""
    return shards is not None and shards.strip().isdecimal()


def fly_shards(context: typer.Context, mission: Mission, shards: int, out: Path | None) -> int:
    """Fly all shards to their ends, join their records and tell of them; give the exit status."""
    from swarm_ctl.experiment.check import (  # noqa: PLC0415 - needs the mock's world
        check_shards,
        check_world,
    )

    if not 2 <= shards <= 99:
        raise SwarmError(f"--shards {shards}: expected 2 to 99")
    for name, reason in ALONE.items():
        if context.params[name]:
            raise SwarmError(f"--{name}: {reason}; leave out this or --shards")
    if str(context.params["mqtt"] or "").startswith("embedded"):
        raise SwarmError("--mqtt embedded: shards are several processes; name a broker")
    check_shards(mission, shards)
    check_world(mission, shards)
    is_ours = out is None or not out.exists()
    folder = make_folder(out, mission.name, datetime.now(UTC))
    addresses, words = free_addresses(shards), list(_typed(context))
    parts = [folder / f"shard{number}" for number in range(1, shards + 1)]
    commands = [
        [*words, "--shards", addresses, "--shard", str(number), "--out", str(part)]
        for number, part in enumerate(parts, start=1)
    ]
    console = PipeConsole(highlight=False)
    flight = Shards(commands, lambda line: console.print(line, markup=False, soft_wrap=True))
    codes = asyncio.run(flight.fly())
    if not any((part / "summary.json").exists() for part in parts):
        if is_ours:
            shutil.rmtree(folder)
        return max(codes)  # nothing flew, and why has been said
    summary = join_shards(folder, mission.name, parts)
    console.print(report_lines(summary, folder))
    return EXIT_CODES[summary["outcome"]]


def join(
    folder: Annotated[
        Path,
        typer.Argument(help="Where the run folders of all shards lie, under any names."),
    ],
) -> None:
    """Join the records of shards into one: of several hosts, or of a killed run.

    Copy the run folder of each shard into one folder first. It becomes a run
    folder itself, as that of run --shards N: summary, pictures, report. The
    shards' own folders stay as they are.
    """
    console = PipeConsole(highlight=False)
    with console.status("joining the records"):
        summary = join_records(folder)
    console.print(report_lines(summary, folder))


def _typed(context: typer.Context) -> Iterator[str]:
    """Give again what was typed behind `run`, but for what each shard is told anew."""
    for parameter in context.command.params:
        name = str(parameter.name)
        source = context.get_parameter_source(name)
        if source is None or source.name != "COMMANDLINE" or name in {"shards", "out"}:
            continue
        if parameter.param_type_name == "option":
            yield parameter.opts[0]
        if not getattr(parameter, "is_flag", False):
            yield str(context.params[name])
