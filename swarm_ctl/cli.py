"""The command line: only here and in the modules `cli_...` is printed and ended."""

from __future__ import annotations

import json
import logging
import sys
import time
from importlib.machinery import ExtensionFileLoader
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console

import swarm_ctl
from swarm_ctl import event_loop, model
from swarm_ctl.cli_console import console
from swarm_ctl.cli_doctor import doctor
from swarm_ctl.cli_experiment import experiment, tune
from swarm_ctl.cli_fly import fly
from swarm_ctl.cli_mistakes import UsageError, in_a_sentence
from swarm_ctl.cli_options import (
    BAD_INPUT,
    EXIT_CODES,
    NOT_FLOWN,
    AutopilotKind,
    Duration,
    Interrupts,
    MissionFile,
    Mqtt,
    Out,
    Peers,
    PipeConsole,
    PlannerKind,
    Seed,
    SigningKey,
    Vehicles,
    Wait,
    World,
    interrupts,
    open_broker,
    open_mesh,
    read_key,
)
from swarm_ctl.cli_order import order
from swarm_ctl.cli_record import export, report
from swarm_ctl.cli_shards import ShardNumber, ShardOption, fly_shards, is_number, join
from swarm_ctl.cli_soak import soak
from swarm_ctl.errors import MockError, SwarmError, plain
from swarm_ctl.flight import Faults, Shard, discard, finish
from swarm_ctl.mission import Mission, load_mission, mission_schema
from swarm_ctl.progress import ProgressView
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.record.summary import report_lines
from swarm_ctl.run.mock import UdpRun

if TYPE_CHECKING:
    from swarm_ctl.experiment.arena import Arena
    from swarm_ctl.experiment.check import WorldFacts

REFRESH_S = 0.25

app = typer.Typer(
    name="swarm-ctl",
    help="Explore unknown space with a swarm of UAVs over MAVLink.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Run the command line; every foreseen mistake is one sentence and exit 2."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    try:
        sys.exit(app(standalone_mode=False))
    except UsageError as error:
        if str(error):  # else nothing was typed, and the help is shown
            _complain(in_a_sentence(error))
        sys.exit(BAD_INPUT)
    except SwarmError as error:
        _complain(str(error))
        sys.exit(BAD_INPUT)
    except OSError as error:
        _complain(": ".join(filter(None, (str(error.filename or ""), plain(error)))))
        sys.exit(NOT_FLOWN)


def _complain(sentence: str) -> None:
    Console(stderr=True, highlight=False, soft_wrap=True).print(sentence, markup=False)


def _version(wanted: bool) -> None:
    if wanted:
        kind = " (compiled)" if isinstance(model.__loader__, ExtensionFileLoader) else ""
        typer.echo(f"swarm-ctl {swarm_ctl.__version__}{kind}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Explore unknown space with a swarm of UAVs over MAVLink."""


@app.command()
def run(
    context: typer.Context,
    mission: MissionFile,
    world: World = None,
    vehicles: Vehicles = None,
    planner: PlannerKind = None,
    autopilot: AutopilotKind = None,
    peers: Peers = None,
    seed: Seed = None,
    duration: Duration = None,
    speed: Annotated[
        float, typer.Option(help="Times real time, over UDP.", min=0.1, max=100.0)
    ] = 1.0,
    virtual: Annotated[
        bool, typer.Option("--virtual", help="Fly in memory in virtual time, without sockets.")
    ] = False,
    out: Out = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            help="Break something: KIND:SYSID@SECONDS, as dead:3@60, controller:4@90 or fleet@120;"
            " may be given again.",
        ),
    ] = None,
    signing_key: SigningKey = None,
    mqtt: Mqtt = None,
    wait: Wait = False,
    show: Annotated[
        bool,
        typer.Option(
            "--show",
            help="Let ground stations (QGroundControl, UDP 14550) and viewers (Hawkeye, 19410 + i) "
            "see the fleet.",
        ),
    ] = False,
    shards: ShardOption = None,
    shard: ShardNumber = None,
) -> None:
    """Fly a mission against mock vehicles and write its record.

    Exit status: 0 flown, 1 not flown, 2 bad input, 130 interrupted (Ctrl-C or SIGTERM
    lands everybody, a second one ends at once).
    """
    chosen = load_mission(
        mission,
        world=world,
        vehicles=vehicles,
        planner=planner,
        autopilot=autopilot,
        peers=peers,
        seed=seed,
        duration_s=duration,
    )
    if is_number(shards) and shard is None:
        raise typer.Exit(fly_shards(context, chosen, int(shards or 1), out))
    part = _part_of(chosen, shards, shard)
    if part is not None and part.is_grouped:  # a network of its own, and a mission of its own
        chosen = chosen.model_copy(update={"name": f"{chosen.name}-group{part.group}"})
    _world_of(chosen)
    faults = Faults.parse(fault or [], chosen.vehicles, part.sysids.start if part else 1)
    key = read_key(signing_key)
    if virtual and part:
        raise SwarmError("--shards: a --virtual flight is one process; leave one of them out")
    if virtual and mqtt:
        raise SwarmError("--mqtt: there is no time for orders in --virtual; leave one of them out")
    if virtual and show:
        raise SwarmError("--show: nobody can watch a --virtual flight; leave one of them out")
    if virtual and wait:
        raise SwarmError("--wait: nobody can order `start` in --virtual; leave one of them out")
    if virtual and peers:
        raise SwarmError("--peers: in --virtual the mock's radio is all; leave one of them out")
    mode: Literal["udp", "virtual"] = "virtual" if virtual else "udp"
    is_ours = out is None or not out.exists()
    folder = RunFolder.create(
        out,
        chosen.name,
        chosen.dump(),
        seed=chosen.seed,
        mode=mode,
        faults=fault or (),
        shard=part and part.told(),
    )
    console = PipeConsole(highlight=False)
    began = time.monotonic()
    with interrupts() as stop:
        try:
            if virtual:
                facts = _fly_virtual(chosen, folder, faults, console, stop)
            else:
                flight = UdpRun(chosen, folder, speed=speed, faults=faults, key=key, shard=part)
                flight.is_shown = show
                facts = _fly_udp(flight, console, mqtt, waits=wait)
        except (SwarmError, KeyboardInterrupt):  # the mock would not, or may not, start
            discard(folder, is_ours=is_ours)
            raise
        wall_s = time.monotonic() - began
        with console.status("writing the record"):
            summary = finish(chosen, folder, mode=mode, wall_s=wall_s, **facts)
    console.print(report_lines(summary, folder.path))
    raise typer.Exit(EXIT_CODES[summary["outcome"]])


@app.command()
def check(
    mission: MissionFile,
    world: World = None,
    vehicles: Vehicles = None,
    planner: PlannerKind = None,
    autopilot: AutopilotKind = None,
    duration: Duration = None,
) -> None:
    """Validate a mission and its world without flying."""
    chosen = load_mission(
        mission,
        world=world,
        vehicles=vehicles,
        planner=planner,
        autopilot=autopilot,
        duration_s=duration,
    )
    facts = _world_of(chosen)
    victims = f"{facts.victims} victim{'' if facts.victims == 1 else 's'}"
    vehicles_explore = (
        "1 vehicle explores" if chosen.vehicles == 1 else f"{chosen.vehicles} vehicles explore"
    )
    typer.echo(
        f"{mission}: {chosen.name} is fine: {vehicles_explore} {facts.name} "
        f"({facts.size}) for {chosen.duration_s:g} s with {chosen.planner.kind} "
        f"in {chosen.planner.dimensions} dimensions; {victims} to find"
    )


def _part_of(mission: Mission, shards: str | None, number: int | None) -> Shard | None:
    """Give the part of a world's vehicles that is flown here; None stands for all."""
    if shards is None:
        if number is not None:
            raise SwarmError(f"--shard {number}: of which? --shards names their addresses")
        return None
    from swarm_ctl.experiment.check import take_shard  # noqa: PLC0415 - needs the mock

    return take_shard(mission, shards, number)


def _world_of(mission: Mission) -> WorldFacts:
    """Look whether the mission can be flown in its world."""
    from swarm_ctl.experiment.check import check_world  # noqa: PLC0415 - needs the mock's world

    return check_world(mission)


app.command()(fly)
app.command()(doctor)
app.command()(experiment)
app.command()(tune)
app.command()(soak)
app.command()(order)
app.command()(console)
app.command()(report)
app.command()(export)
app.command()(join)


@app.command()
def schema() -> None:
    """Print the JSON Schema of mission files, for editors."""
    typer.echo(json.dumps(mission_schema(), indent=2))


def _fly_udp(flight: UdpRun, console: Console, mqtt: str | None, *, waits: bool) -> dict[str, Any]:
    if waits:
        flight.wait_for_start()
    with (
        open_broker(mqtt) as flight.broker,
        open_mesh(flight.mission) as flight.mesh,
        ProgressView(flight.mission, console) as view,
    ):

        def show(flight: UdpRun) -> None:
            if view.is_due:
                snapshots = [controller.agent.snapshot() for controller in flight.controllers]
                view.update(flight.now, snapshots, flight.referee)

        try:
            event_loop.run(flight.fly(show))
        except MockError:
            if flight.interrupted:
                raise KeyboardInterrupt from None
            raise
    return {
        "controllers": flight.controllers,
        "time_s": flight.now,
        "interrupted": flight.interrupted,
        "notes": flight.notes,
    }


def _fly_virtual(
    mission: Mission, folder: RunFolder, faults: Faults, console: Console, interrupts: Interrupts
) -> dict[str, Any]:
    from swarm_ctl.experiment.arena import Arena  # noqa: PLC0415 - the one door to the mock

    arena = Arena(mission, folder, faults)
    with ProgressView(mission, console) as view:
        next_s = 0.0

        def show(arena: Arena) -> None:
            nonlocal next_s
            interrupts.obey(arena)
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + REFRESH_S
                snapshots = [controller.agent.snapshot() for controller in arena.controllers]
                view.update(arena.now, snapshots, arena.fleet.referee.snapshot())

        arena.fly(show)
    arena.write_truth(folder.path)
    return {
        "controllers": arena.controllers,
        "time_s": arena.now,
        "interrupted": interrupts.count > 0,
        "notes": arena.notes,
    }


if __name__ == "__main__":
    main()
