"""The options of `mock-vehicle`, in the panels of its help."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from mock_vehicle.faults import describe
from mock_vehicle.shards import VEHICLES_MAX
from swarm_ctl.signing import KEY_VARIABLE

SYSID_MAX = 255
VEHICLES, TIME, NETWORK, WORLD, OUTPUT = (
    "Vehicles",
    "Time",
    "Network",
    "World and faults",
    "Output",
)


class Autopilot(StrEnum):
    """Which autopilots the fleet pretends to be."""

    PX4 = "px4"
    ARDUPILOT = "ardupilot"
    MIXED = "mixed"


class Telemetry(StrEnum):
    """How often telemetry is sent."""

    FULL = "full"
    LEAN = "lean"
    SHOWN = "shown"


class Boot(StrEnum):
    """How long a vehicle takes from power-on until it is ready."""

    FAST = "fast"
    REAL = "real"


def _print_schema(wanted: bool) -> None:
    if wanted:
        from mock_vehicle.world.schema import world_schema  # noqa: PLC0415 - one run in a thousand

        typer.echo(json.dumps(world_schema(), indent=2))
        raise typer.Exit


def _print_faults(wanted: bool) -> None:
    if wanted:
        typer.echo(describe.text())
        raise typer.Exit


World = Annotated[
    Path | None,
    typer.Argument(help="World file (YAML); without one an open field of 200 m x 200 m."),
]

Vehicles = Annotated[
    int,
    typer.Option(
        help="How many, in all shards.", min=1, max=VEHICLES_MAX, rich_help_panel=VEHICLES
    ),
]
Pretended = Annotated[
    Autopilot, typer.Option(help="What they pretend to be.", rich_help_panel=VEHICLES)
]
Sysid = Annotated[
    int,
    typer.Option(
        "--sysid",
        "--first-sysid",
        help="sysid of the first; the others count up.",
        min=1,
        max=SYSID_MAX,
        rich_help_panel=VEHICLES,
    ),
]
Rates = Annotated[
    Telemetry,
    typer.Option(
        help="Telemetry as the real ones send it, or 10 Hz at most for swarms; shown: the same, "
        "and all call ground stations (14550) and viewers (19410 + i), too.",
        rich_help_panel=VEHICLES,
    ),
]
BootTime = Annotated[
    Boot,
    typer.Option(
        "--boot",
        help="Ready to arm within a second, or as late as the real ones.",
        rich_help_panel=VEHICLES,
    ),
]

Speed = Annotated[
    float,
    typer.Option(help="Mission seconds per second.", min=0.01, max=1000.0, rich_help_panel=TIME),
]
Duration = Annotated[
    float | None,
    typer.Option(help="Stop after so many mission seconds.", min=0.02, rich_help_panel=TIME),
]

Host = Annotated[
    str | None,
    typer.Option(
        help="Address to listen on. (default: 127.0.0.1, or the shard's own)",
        show_default=False,
        rich_help_panel=NETWORK,
    ),
]
Shards = Annotated[
    str | None,
    typer.Option(
        help="Fly one mission in several processes, which hear one another at these addresses: "
        "each flies its share of the vehicles.",
        metavar="IP:PORT,IP:PORT...",
        rich_help_panel=NETWORK,
    ),
]
Shard = Annotated[
    int | None,
    typer.Option(help="Which of the shards this one is, from 1 on.", rich_help_panel=NETWORK),
]
FirstPort = Annotated[
    int | None,
    typer.Option(
        help="First port to listen on; 0 takes free ones and calls nobody unasked. "
        "(default: 14580 + i for px4, 14650 + i for ardupilot)",
        min=0,
        max=65535,
        rich_help_panel=NETWORK,
    ),
]
Ports = Annotated[
    str | None,
    typer.Option(
        help="Ports to listen on, one per vehicle, as 14580,14590 or 14580-14589.",
        metavar="LIST",
        rich_help_panel=NETWORK,
    ),
]
Remote = Annotated[
    str | None,
    typer.Option(
        help="Whom every vehicle calls. (default: 14540 + i for px4, 14550 for ardupilot)",
        metavar="HOST:PORT",
        rich_help_panel=NETWORK,
    ),
]
SigningKey = Annotated[
    Path | None,
    typer.Option(
        help="Obey only who signs with the key in this file, a passphrase or 64 hexadecimal "
        f"digits. (default: the key in {KEY_VARIABLE}, if any)",
        metavar="FILE",
        rich_help_panel=NETWORK,
    ),
]

Seed = Annotated[
    int,
    typer.Option(help="Seed of starts, noise, wind and losses.", min=0, rich_help_panel=WORLD),
]
ParameterFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--param",
        help="Parameter file, of QGroundControl or NAME,VALUE lines; repeatable.",
        metavar="FILE",
        rich_help_panel=VEHICLES,
    ),
]
FaultList = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        help="What goes wrong, as dead:3@60 or link-delay:2@10+5,delay_s=0.3; repeatable.",
        metavar="KIND[:SYSID]@SECONDS[+DURATION][,NAME=VALUE...]",
        rich_help_panel=WORLD,
    ),
]
FaultFile = Annotated[
    Path | None,
    typer.Option(help="File of faults (YAML), a list as in a world file.", rich_help_panel=WORLD),
]
ListFaults = Annotated[
    bool,
    typer.Option(
        "--list-faults",
        help="Print what can go wrong and exit.",
        callback=_print_faults,
        is_eager=True,
        rich_help_panel=WORLD,
    ),
]
Schema = Annotated[
    bool,
    typer.Option(
        "--schema",
        help="Print the JSON Schema of world files and exit.",
        callback=_print_schema,
        is_eager=True,
        rich_help_panel=WORLD,
    ),
]

Out = Annotated[Path | None, typer.Option(help="Folder for the truth.", rich_help_panel=OUTPUT)]
Json = Annotated[
    bool,
    typer.Option(
        "--json",
        help="Report JSON lines; stop when stdin closes.",
        rich_help_panel=OUTPUT,
    ),
]
