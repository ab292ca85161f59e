"""The command `mock-vehicle`: a fleet of mock autopilots on UDP ports."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from datetime import UTC, datetime
from pathlib import Path
from typing import NoReturn

import typer

from mock_vehicle import options
from mock_vehicle.autopilot.parameters import read_values
from mock_vehicle.border import Border
from mock_vehicle.display import show_human, show_json
from mock_vehicle.errors import MockVehicleError
from mock_vehicle.faults import parse_fault
from mock_vehicle.fleet import Fleet
from mock_vehicle.keeper import Keeper
from mock_vehicle.options import SYSID_MAX, Autopilot, Boot, Telemetry
from mock_vehicle.ports import LOCALHOST, plan_further_ports, plan_ports, plan_shown_ports
from mock_vehicle.server import Port, Server
from mock_vehicle.shards import Address, Part, choose, parse_addresses, whole
from mock_vehicle.vehicle import PERSONALITIES, personalities
from mock_vehicle.world import load_world, read_faults
from mock_vehicle.world.field import open_field
from swarm_ctl import event_loop
from swarm_ctl.signing import find_key, timestamp_of

Show = Callable[[Fleet, Server], AbstractContextManager[Callable[[], None]]]

READY_S = 1.0
"""A fast boot."""
GARBAGE = 10_000
"""Objects made between two looks for garbage: there is hardly any."""


def run(
    world: options.World = None,
    vehicles: options.Vehicles = 1,
    autopilot: options.Pretended = Autopilot.PX4,
    sysid: options.Sysid = 1,
    rates: options.Rates = Telemetry.FULL,
    boot: options.BootTime = Boot.FAST,
    param: options.ParameterFiles = None,
    speed: options.Speed = 1.0,
    duration: options.Duration = None,
    host: options.Host = None,
    port: options.FirstPort = None,
    ports: options.Ports = None,
    remote: options.Remote = None,
    shards: options.Shards = None,
    shard: options.Shard = None,
    signing_key: options.SigningKey = None,
    seed: options.Seed = 1,
    fault: options.FaultList = None,
    faults: options.FaultFile = None,
    list_faults: options.ListFaults = False,  # noqa: ARG001 - its callback has done all, too
    out: options.Out = None,
    as_json: options.Json = False,
    schema: options.Schema = False,  # noqa: ARG001 - its callback has done all there is to do
) -> None:
    """Fly mock MAVLink vehicles until stopped."""
    logging.basicConfig(format="mock-vehicle: %(message)s", stream=sys.stderr)
    try:
        key = find_key(signing_key, os.environ)
        addresses = parse_addresses(shards) if shards is not None else []
        part = take_part(vehicles, addresses, shard)
        flown = whole(vehicles) if part is None else part
        check_sysids(sysid, len(flown.members))
        kinds = personalities(autopilot.value, vehicles)[flown.own.start : flown.own.stop]
        host = host or (addresses[flown.shard - 1][0] if addresses else LOCALHOST)
        listening = plan_ports(kinds, host=host, base=port, listed=ports, remote=remote)
        if rates is Telemetry.FULL:
            listening += plan_further_ports(kinds, host=host, usual=port is None and ports is None)
        if rates is Telemetry.SHOWN:
            listening += plan_shown_ports(len(kinds), host=host)
        fleet = Fleet(
            open_field() if world is None else load_world(world),
            kinds,
            seed=seed,
            first_sysid=sysid,
            boot_s=None if boot is Boot.REAL else READY_S,
            rates=rates.value,
            parameters=read_parameters(param or (), kinds),
            faults=[*(read_faults(faults) if faults else ()), *map(parse_fault, fault or ())],
            part=part,
        )
        if key is not None:
            fleet.sign_with(key, timestamp_of(datetime.now(UTC)))
    except (MockVehicleError, ValueError, OSError) as error:
        _give_up(error)
    show = show_json if as_json else show_human
    try:
        server = serve(fleet, listening, addresses, show, speed=speed, duration_s=duration, out=out)
        event_loop.run(server)
    except (MockVehicleError, OSError) as error:  # a port that is taken, a folder that is not ours
        _give_up(error)


def _give_up(error: Exception) -> NoReturn:
    words = str(error)
    if isinstance(error, OSError) and error.strerror:
        words = ": ".join(filter(None, (str(error.filename or ""), error.strerror)))
    typer.echo(f"mock-vehicle: {words}", err=True)
    raise typer.Exit(2) from None


def read_parameters(paths: Sequence[Path], kinds: Sequence[str]) -> dict[str, float]:
    """Read parameter files for a fleet of these personalities; the last file has the last word."""
    dialects = {PERSONALITIES[kind].dialect for kind in kinds}
    return {name: value for path in paths for name, value in read_values(path, dialects).items()}


def check_sysids(first: int, vehicles: int) -> None:
    """Raise ValueError for a fleet whose last sysid is none."""
    last = first + vehicles - 1
    if vehicles > SYSID_MAX:
        raise ValueError(
            f"--vehicles {vehicles}: a MAVLink network has {SYSID_MAX} sysids; more vehicles fly "
            "in groups, each a network of its own, by --shards (docs/scaling.md)"
        )
    if last > SYSID_MAX:
        raise ValueError(f"--sysid {first}: sysids would end at {last}, not {SYSID_MAX}")


def take_part(vehicles: int, addresses: Sequence[Address], shard: int | None) -> Part | None:
    """Give what one of the shards at these addresses flies; None where there are no shards."""
    if addresses:
        return choose(vehicles, addresses, shard)
    if shard is not None:
        raise ValueError(f"--shard {shard}: of which? --shards names their addresses")
    return None


async def serve(
    fleet: Fleet,
    ports: list[Port],
    shards: Sequence[Address],
    show: Show,
    *,
    speed: float,
    duration_s: float | None,
    out: Path | None,
) -> None:
    """Fly; write the truth at the end, and every few seconds in case the end never comes."""
    border = Border(fleet, shards) if shards else None
    server = Server(fleet, ports, speed=speed, border=border)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, server.stop)
    gc.collect()
    gc.freeze()
    gc.set_threshold(GARBAGE)
    keeper = None if out is None else Keeper(fleet, server, out)
    fleet.referee.keeps_tracks = keeper is not None
    with show(fleet, server) as report:

        def keep() -> None:
            report()
            if keeper is not None:
                keeper.look()

        await server.run(duration_s=duration_s, report=keep, watch_stdin=show is show_json)
        if keeper is not None:
            await keeper.close()


def main() -> None:
    """Run the command line."""
    typer.run(run)
