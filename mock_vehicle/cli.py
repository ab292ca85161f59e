"""The command `mock-vehicle`: a fleet of mock autopilots on UDP ports."""

from __future__ import annotations

import asyncio
import gc
import itertools
import json
import logging
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from mock_vehicle.errors import MockVehicleError
from mock_vehicle.faults import parse_fault
from mock_vehicle.fleet import Fleet
from mock_vehicle.ports import plan_gcs_ports, plan_ports
from mock_vehicle.server import Port, PortError, Server
from mock_vehicle.vehicle import personalities
from mock_vehicle.world import WorldSpec, load_world

SYSID_MAX = 255


class Autopilot(StrEnum):
    """Which autopilots the fleet pretends to be."""

    PX4 = "px4"
    ARDUPILOT = "ardupilot"
    MIXED = "mixed"


class Telemetry(StrEnum):
    """How often telemetry is sent."""

    FULL = "full"
    LEAN = "lean"


class Boot(StrEnum):
    """How long a vehicle takes from power-on until it is ready."""

    FAST = "fast"
    REAL = "real"


READY_S = 1.0
"""A fast boot."""
TRUTH_EVERY = 5
"""Reports, one a second, between two writings of the truth; one takes about 4 ms."""


def _print_schema(wanted: bool) -> None:
    if wanted:
        typer.echo(json.dumps(WorldSpec.model_json_schema(), indent=2))
        raise typer.Exit


def run(
    world: Annotated[Path, typer.Argument(help="World file (YAML).", metavar="WORLD")],
    vehicles: Annotated[int, typer.Option(help="How many vehicles.", min=1, max=SYSID_MAX)] = 1,
    autopilot: Annotated[Autopilot, typer.Option(help="What they pretend to be.")] = Autopilot.PX4,
    speed: Annotated[
        float, typer.Option(help="Mission seconds per second.", min=0.01, max=1000.0)
    ] = 1.0,
    seed: Annotated[int, typer.Option(help="Seed of starts, noise, wind and losses.", min=0)] = 1,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[
        int | None,
        typer.Option(
            help="First port to listen on; 0 takes free ones and calls nobody unasked. "
            "(default: 14580 + i for px4, 14650 + i for ardupilot)",
            min=0,
            max=65535,
        ),
    ] = None,
    remote: Annotated[
        str | None,
        typer.Option(
            help="Whom every vehicle calls. (default: 14540 + i for px4, 14550 for ardupilot)",
            metavar="HOST:PORT",
        ),
    ] = None,
    first_sysid: Annotated[int, typer.Option(help="sysid of the first.", min=1, max=255)] = 1,
    rates: Annotated[
        Telemetry,
        typer.Option(help="Telemetry as the real ones send it, or 10 Hz at most for swarms."),
    ] = Telemetry.FULL,
    boot: Annotated[
        Boot, typer.Option(help="Ready to arm within a second, or as late as the real ones.")
    ] = Boot.FAST,
    fault: Annotated[
        list[str] | None,
        typer.Option(help="What goes wrong; repeatable.", metavar="KIND:SYSID@SECONDS"),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the truth.")] = None,
    duration: Annotated[
        float | None, typer.Option(help="Stop after so many mission seconds.", min=0.02)
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Report JSON lines; stop when stdin closes.")
    ] = False,
    schema: Annotated[  # noqa: ARG001 - its callback has done all there is to do
        bool,
        typer.Option(
            "--schema",
            help="Print the JSON Schema of world files and exit.",
            callback=_print_schema,
            is_eager=True,
        ),
    ] = False,
) -> None:
    """Fly a fleet of mock MAVLink vehicles until stopped."""
    logging.basicConfig(format="mock-vehicle: %(message)s", stream=sys.stderr)
    kinds = personalities(autopilot.value, vehicles)
    try:
        ports = plan_ports(kinds, host=host, base=port, remote=remote)
        if rates is Telemetry.FULL:
            ports += plan_gcs_ports(kinds, host=host, base=port)
        check_sysids(first_sysid, vehicles)
        fleet = Fleet(
            load_world(world),
            kinds,
            seed=seed,
            first_sysid=first_sysid,
            boot_s=None if boot is Boot.REAL else READY_S,
            rates=rates.value,
            faults=[parse_fault(text) for text in fault or ()],
        )
    except (MockVehicleError, ValueError, OSError) as error:
        typer.echo(f"mock-vehicle: {error}", err=True)
        raise typer.Exit(2) from None
    show = _show_json if as_json else _show_human
    try:
        asyncio.run(_serve(fleet, ports, show, speed=speed, duration_s=duration, out=out))
    except PortError as error:
        typer.echo(f"mock-vehicle: {error}", err=True)
        raise typer.Exit(2) from None


def check_sysids(first: int, vehicles: int) -> None:
    """Raise ValueError for a fleet whose last sysid is none."""
    last = first + vehicles - 1
    if last > SYSID_MAX:
        raise ValueError(f"--first-sysid {first}: sysids would end at {last}, not 255")


async def _serve(
    fleet: Fleet,
    ports: list[Port],
    show: Callable[[Fleet, Server], AbstractContextManager[Callable[[], None]]],
    *,
    speed: float,
    duration_s: float | None,
    out: Path | None,
) -> None:
    """Fly; write the truth at the end, and every few seconds in case the end never comes."""
    server = Server(fleet, ports, speed=speed)
    watch_stdin = show is _show_json
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, server.stop)
    gc.collect()
    gc.freeze()
    reports = itertools.count(1)
    with show(fleet, server) as report:

        def keep() -> None:
            report()
            if out is not None and next(reports) % TRUTH_EVERY == 0:
                fleet.referee.write(out)

        await server.run(duration_s=duration_s, report=keep, watch_stdin=watch_stdin)
        if out is not None:
            fleet.referee.write(out)


@contextmanager
def _show_json(fleet: Fleet, server: Server) -> Iterator[Callable[[], None]]:
    """Print one object per line: ready, progress every second, done."""

    def write(content: dict[str, Any]) -> None:
        try:
            sys.stdout.write(json.dumps(content, allow_nan=False) + "\n")
            sys.stdout.flush()
        except BrokenPipeError:  # nobody listens any more
            server.stop()

    def progress() -> dict[str, Any]:
        return {**fleet.referee.snapshot(), "behind_s": round(server.behind_s, 3)}

    write({"ready": server.ready()})
    yield lambda: write(progress())
    write({"done": progress()})


@contextmanager
def _show_human(fleet: Fleet, server: Server) -> Iterator[Callable[[], None]]:
    """Print who listens where, then one line that lives."""
    from rich.console import Console  # noqa: PLC0415 - only people wait for it
    from rich.live import Live  # noqa: PLC0415

    console = Console(highlight=False)
    console.print(_introduction(fleet, server))
    started_s = last_s = time.monotonic()
    last_mission_s = 0.0

    with Live(console=console, auto_refresh=False) as live:

        def report() -> None:
            nonlocal last_s, last_mission_s
            now_s = time.monotonic()
            factor = (server.time_s - last_mission_s) / max(now_s - last_s, 1e-3)
            last_s, last_mission_s = now_s, server.time_s
            live.update(_status(fleet, factor), refresh=True)

        yield report
        live.update(_status(fleet, server.time_s / (time.monotonic() - started_s)), refresh=True)


def _introduction(fleet: Fleet, server: Server) -> str:
    vehicles = ", ".join(
        f"{sysid} {personality} udp {port}"
        for sysid, personality, port in zip(
            fleet.sysids, fleet.personalities, server.ports, strict=True
        )
    )
    return f"{fleet.world.name}: {vehicles}; Ctrl-C ends"


def _status(fleet: Fleet, factor: float) -> str:
    seen = fleet.referee.snapshot()
    return (
        f"{seen['time_s']:6.1f} s  {seen['airborne']}/{fleet.n} airborne  "
        f"coverage {seen['coverage_fraction']:.1%}  "
        f"victims {seen['victims_found']}/{seen['victims_total']}  "
        f"collisions {seen['collisions']}  {factor:.1f} x real time"
    )


def main() -> None:
    """Run the command line."""
    typer.run(run)
