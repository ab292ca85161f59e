"""The command that flies real vehicles: `fly`."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl import event_loop
from swarm_ctl.cli_options import (
    EXIT_CODES,
    Connect,
    Duration,
    MissionFile,
    Mqtt,
    Out,
    Peers,
    PipeConsole,
    PlannerKind,
    SigningKey,
    Wait,
    interrupts,
    open_broker,
    open_mesh,
    read_key,
)
from swarm_ctl.errors import SwarmError
from swarm_ctl.flight import finish
from swarm_ctl.link import open_link
from swarm_ctl.link.shared import SharedLink
from swarm_ctl.mission import Mission, check_starts, load_mission
from swarm_ctl.progress import ProgressView
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.record.resume import JOURNALS, find_unfinished, last_written
from swarm_ctl.record.summary import report_lines
from swarm_ctl.run.places import only_autopilot, pair_up
from swarm_ctl.run.real import RealRun

Sysids = Annotated[
    list[int] | None,
    typer.Option(
        "--sysid",
        help="The vehicle's sysid. One for several --connect counts up; several for one --connect "
        "are all behind it; else they pair up. Default: that of the one autopilot heard.",
        metavar="N",
    ),
]


def fly(
    mission: MissionFile,
    connect: Connect,
    sysid: Sysids = None,
    peers: Peers = None,
    planner: PlannerKind = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of every random draw.", metavar="N")
    ] = None,
    duration: Duration = None,
    open_air: Annotated[
        bool,
        typer.Option(
            "--open-air", help="Fly without rangefinders: nothing is in the way but peers."
        ),
    ] = False,
    speed: Annotated[
        float,
        typer.Option(
            help="Times real time, of a simulator that runs faster.",
            metavar="K",
            min=0.1,
            max=100.0,
        ),
    ] = 1.0,
    out: Out = None,
    new: Annotated[
        bool,
        typer.Option("--new", help="Begin a new run, also where a killed one could be taken up."),
    ] = False,
    signing_key: SigningKey = None,
    mqtt: Mqtt = None,
    wait: Wait = False,
) -> None:
    """Fly a mission with real autopilots, PX4 or ArduPilot, and write its record.

    As many vehicles fly as are connected, whatever the mission says; its
    world is not used. One that is armed already is left alone. Let
    `swarm-ctl doctor` look at the vehicles first.

    Type the same command again when this one was killed: it takes its
    vehicles over in the air, in the same run folder (the one named by --out,
    else the newest, up to 10 minutes later).

    Exit status: 0 flown, 1 not flown, 2 bad input, 130 interrupted. Ctrl-C
    or SIGTERM lands everybody; a second one ends at once, and the
    autopilots' own failsafes take over.
    """
    chosen = load_mission(
        mission,
        planner=planner,
        peers=peers,
        seed=seed,
        duration_s=duration,
        open_air=open_air or None,
        is_simulated=False,
    )
    key = read_key(signing_key)
    if not sysid and len(connect) > 1:
        raise SwarmError("several --connect want --sysid: the first vehicle's, or each one's")
    pair_up(connect, sysid or [1])  # a mistake is told before a port is opened
    console = PipeConsole(highlight=False)
    flight = _fly(
        mission,
        chosen,
        connect,
        sysid,
        console,
        speed=speed,
        out=out,
        is_new=new,
        key=key,
        mqtt=mqtt,
        waits=wait,
    )
    outcome = event_loop.run(flight)
    raise typer.Exit(EXIT_CODES[outcome])


async def _fly(
    file: Path,
    mission: Mission,
    urls: Sequence[str],
    sysids: Sequence[int] | None,
    console: PipeConsole,
    *,
    speed: float,
    out: Path | None,
    is_new: bool,
    key: bytes | None,
    mqtt: str | None,
    waits: bool,
) -> str:
    """Fly from the first heartbeat to the last line of the record; give the outcome."""
    with contextlib.ExitStack() as opened:
        broker = opened.enter_context(open_broker(mqtt))
        shared: dict[str, SharedLink] = {}
        for url in dict.fromkeys(urls):
            shared[url] = SharedLink(open_link(url))
            opened.callback(shared[url].close)
        mesh = opened.enter_context(open_mesh(mission))
        if not sysids:
            sysids = [await only_autopilot(shared[urls[0]], speed)]
            console.print(f"heard sysid {sysids[0]} at {urls[0]}: flying this one", markup=False)
        links = [shared[url].member(sysid) for url, sysid in pair_up(urls, sysids)]
        check_starts(file, mission, [link.sysid for link in links])
        mission = mission.model_copy(update={"vehicles": len(links)})
        flown = [link.sysid for link in links]
        folder = _open_folder(mission, flown, console, speed=speed, out=out, is_new=is_new)
        flight = RealRun(mission, folder, links, speed=speed, key=key)
        flight.broker, flight.mesh = broker, mesh
        if waits:
            flight.wait_for_start()
        with interrupts():
            return await _record(flight, mission, console)


def _open_folder(
    mission: Mission,
    sysids: Sequence[int],
    console: PipeConsole,
    *,
    speed: float,
    out: Path | None,
    is_new: bool,
) -> RunFolder:
    """Take up the run that was killed, or else begin one."""
    resolved, utc = mission.dump(), datetime.now(UTC)
    earlier = None if is_new else out or find_unfinished(Path("runs"), resolved, sysids, utc)
    if earlier is None or not (earlier / JOURNALS).is_dir():
        return RunFolder.create(
            out, mission.name, resolved, seed=mission.seed, mode="fly", journaled=sysids
        )
    ago_s = utc.timestamp() - last_written(earlier)
    folder = RunFolder.reopen(earlier, resolved, sysids, speed=speed)
    words = f"taking up {earlier}, last written {ago_s:.0f} s ago (--new begins a new run)"
    console.print(words, markup=False, soft_wrap=True)
    return folder


async def _record(flight: RealRun, mission: Mission, console: PipeConsole) -> str:
    """Fly in sight of the operator and sum up; give the outcome."""
    with ProgressView(mission, console, is_real=True) as view:

        def show() -> None:
            while flight.found:
                console.print(flight.found.pop(0), markup=False, soft_wrap=True)
            if view.is_due:
                view.update(flight.now, [one.agent.snapshot() for one in flight.controllers])

        await flight.fly(show)
    with console.status("writing the record"):
        summary = finish(
            mission,
            flight.folder,
            flight.controllers,
            mode="fly",
            time_s=flight.now,
            wall_s=(datetime.now(UTC) - flight.folder.started_utc).total_seconds(),
            interrupted=flight.interrupted,
            notes=flight.notes,
        )
    console.print(report_lines(summary, flight.folder.path))
    outcome: str = summary["outcome"]
    return outcome
