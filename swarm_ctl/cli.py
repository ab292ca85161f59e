"""The command line: only here and in `cli_experiment.py` is printed and ended."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console

import swarm_ctl
from swarm_ctl.cli_doctor import doctor
from swarm_ctl.cli_experiment import INTERRUPTED, PipeConsole, experiment, tune
from swarm_ctl.errors import MockError, SwarmError
from swarm_ctl.flight import Faults, discard, finish
from swarm_ctl.mission import Mission, load_mission, mission_schema
from swarm_ctl.model import Operator
from swarm_ctl.progress import ProgressView
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.record.summary import report_lines
from swarm_ctl.run.fleet import STOP_SIGNALS, TWICE
from swarm_ctl.run.mock import UdpRun
from swarm_ctl.signing import KEY_VARIABLE, find_key

if TYPE_CHECKING:
    from swarm_ctl.experiment.arena import Arena

REFRESH_S = 0.25
BAD_INPUT, NOT_FLOWN = 2, 1

app = typer.Typer(
    name="swarm-ctl",
    help="Explore unknown space with a swarm of UAVs over MAVLink.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

MissionFile = Annotated[Path, typer.Argument(help="Mission file (YAML).", show_default=False)]
World = Annotated[
    Path | None, typer.Option(help="Fly in this world file instead of the mission's own.")
]
Vehicles = Annotated[int | None, typer.Option(help="Number of vehicles, 1 to 250.")]
PlannerKind = Annotated[str | None, typer.Option(help="Planner: explore, lf-pso, levy or pso.")]
AutopilotKind = Annotated[
    str | None, typer.Option(help="What the mock vehicles behave like: px4, ardupilot or mixed.")
]
Seed = Annotated[
    int | None, typer.Option(help="Seed of every random draw; repeats a --virtual run exactly.")
]
Duration = Annotated[float | None, typer.Option(help="Exploration time of each vehicle, seconds.")]


def main() -> None:
    """Run the command line; every foreseen mistake is one sentence and exit 2."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    try:
        app()
    except (SwarmError, OSError) as error:
        Console(stderr=True, highlight=False, soft_wrap=True).print(str(error), markup=False)
        sys.exit(BAD_INPUT if isinstance(error, SwarmError) else NOT_FLOWN)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"swarm-ctl {swarm_ctl.__version__}")
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
    mission: MissionFile,
    world: World = None,
    vehicles: Vehicles = None,
    planner: PlannerKind = None,
    autopilot: AutopilotKind = None,
    seed: Seed = None,
    duration: Duration = None,
    speed: Annotated[
        float, typer.Option(help="Times real time, over UDP.", min=0.1, max=100.0)
    ] = 1.0,
    virtual: Annotated[
        bool, typer.Option("--virtual", help="Fly in memory in virtual time, without sockets.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="Run folder; default runs/<mission>-<utc>.")
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            help="Break something: KIND:SYSID@SECONDS, as dead:3@60, controller:4@90 or fleet@120;"
            " may be given again.",
        ),
    ] = None,
    signing_key: Annotated[
        Path | None,
        typer.Option(
            help="Sign all over UDP with the key in this file: a passphrase or 64 hexadecimal "
            f"digits; default: the key in {KEY_VARIABLE}, if any.",
            metavar="FILE",
        ),
    ] = None,
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
        seed=seed,
        duration_s=duration,
    )
    faults = Faults.parse(fault or [], chosen.vehicles)
    key = _key(signing_key)
    mode: Literal["udp", "virtual"] = "virtual" if virtual else "udp"
    is_ours = out is None or not out.exists()
    folder = RunFolder.create(out, chosen.name, chosen.dump(), seed=chosen.seed, mode=mode)
    console = PipeConsole(highlight=False)
    began = time.monotonic()
    with _interrupts() as interrupts:
        try:
            if virtual:
                facts = _fly_virtual(chosen, folder, faults, console, interrupts)
            else:
                facts = _fly_udp(chosen, folder, faults, console, speed, key)
        except (SwarmError, KeyboardInterrupt):  # the mock would not, or may not, start
            discard(folder, is_ours=is_ours)
            raise
        wall_s = time.monotonic() - began
        with console.status("writing the record"):
            summary = finish(chosen, folder, mode=mode, wall_s=wall_s, **facts)
    console.print(report_lines(summary, folder.path))
    codes = {"flown": 0, "interrupted": INTERRUPTED}
    raise typer.Exit(codes.get(summary["outcome"], NOT_FLOWN))


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
    from swarm_ctl.experiment.check import check_world  # noqa: PLC0415 - needs the mock's world

    facts = check_world(chosen)
    victims = f"{facts.victims} victim{'' if facts.victims == 1 else 's'}"
    vehicles_explore = (
        "1 vehicle explores" if chosen.vehicles == 1 else f"{chosen.vehicles} vehicles explore"
    )
    typer.echo(
        f"{mission}: {chosen.name} is fine: {vehicles_explore} {facts.name} "
        f"({facts.size}) for {chosen.duration_s:g} s with {chosen.planner.kind} "
        f"in {chosen.planner.dimensions} dimensions; {victims} to find"
    )


app.command()(doctor)
app.command()(experiment)
app.command()(tune)


@app.command()
def schema() -> None:
    """Print the JSON Schema of mission files, for editors."""
    typer.echo(json.dumps(mission_schema(), indent=2))


def _key(file: Path | None) -> bytes | None:
    try:
        return find_key(file, os.environ)
    except ValueError as error:
        raise SwarmError(str(error)) from None


def _fly_udp(
    mission: Mission,
    folder: RunFolder,
    faults: Faults,
    console: Console,
    speed: float,
    key: bytes | None,
) -> dict[str, Any]:
    flight = UdpRun(mission, folder, speed=speed, faults=faults, key=key)
    with ProgressView(mission, console) as view:

        def show(flight: UdpRun) -> None:
            snapshots = [controller.agent.snapshot() for controller in flight.controllers]
            view.update(flight.now, snapshots, flight.referee)

        try:
            asyncio.run(flight.fly(show))
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
    mission: Mission, folder: RunFolder, faults: Faults, console: Console, interrupts: _Interrupts
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
    arena.write_truth()
    return {
        "controllers": arena.controllers,
        "time_s": arena.now,
        "interrupted": interrupts.count > 0,
        "notes": arena.notes,
    }


class _Interrupts:
    """Ctrl-C and SIGTERM as an order to land; the second ends at once, a third even the record."""

    def __init__(self) -> None:
        self.count = 0
        self._obeyed = 0

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        self.count += 1
        if self.count > 2:
            raise KeyboardInterrupt

    def obey(self, arena: Arena) -> None:
        """Pass on to a flight what was asked for since the last call."""
        if self.count > self._obeyed and not self._obeyed:
            arena.order(Operator.LAND)
        if self.count > 1 and self._obeyed < 2 and not arena.is_over:
            arena.notes.append(TWICE)
            for controller in arena.controllers:
                controller.kill(TWICE, arena.now)
        self._obeyed = self.count


@contextmanager
def _interrupts() -> Iterator[_Interrupts]:
    interrupts = _Interrupts()
    before = {number: signal.signal(number, interrupts) for number in STOP_SIGNALS}
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


if __name__ == "__main__":
    main()
