"""The command that opens the operator's page: `console`."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from swarm_ctl.bus.mqtt import Broker
from swarm_ctl.cli_options import MQTT, check_name
from swarm_ctl.errors import SwarmError

if TYPE_CHECKING:
    from swarm_ctl.console.page import Source

PORT = 8080
LOCAL_BROKER = "mqtt://127.0.0.1:1883"


def console(
    run: Annotated[
        Path | None,
        typer.Argument(
            help="Run folder to play back; without one, missions are shown as they are flown.",
            metavar="[RUN_FOLDER]",
            show_default=False,
        ),
    ] = None,
    mqtt: Annotated[str | None, MQTT] = None,
    mission: Annotated[
        str | None,
        typer.Option(
            help="Name of the mission to watch; default: whatever is flown.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to serve on; 0.0.0.0 is every one of this computer.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(help="Port to serve on; 0 takes a free one.", min=0, max=65535)
    ] = PORT,
) -> None:
    """Open a page in the browser: missions as they are flown, with orders, or a run played back.

    Exit status: 130 ended by Ctrl-C, 1 not served, 2 bad input.
    """
    try:
        from swarm_ctl.console import server  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise SwarmError(
            f"swarm-ctl console needs {error.name}, which the extra brings: "
            "pip install 'swarm-ctl[console]'"
        ) from None
    if run is not None and (mqtt or mission):
        raise SwarmError("--mqtt and --mission watch what is flown; leave them or the folder out")
    if mission is not None:
        check_name(mission)
    open_source, watch = _replay(run) if run else _live(mqtt or LOCAL_BROKER, mission)
    sock, token = server.listen(host, port), server.new_token()
    typer.echo(f"open {server.address(sock, token)}\nCtrl-C ends the console")
    asyncio.run(server.serve(sock, token, open_source, watch))


Opened = tuple[Callable[[], "Source"], Callable[[], Coroutine[Any, Any, None]] | None]
"""What gives each browser its source, and what has to run meanwhile."""


def _replay(run: Path) -> Opened:
    from swarm_ctl.console.player import Player  # noqa: PLC0415 - as above
    from swarm_ctl.console.replay import Replay  # noqa: PLC0415 - as above

    replay = Replay.read(run)
    return lambda: Player(replay, time.monotonic), None


def _live(url: str, mission: str | None) -> Opened:
    from swarm_ctl.console.live import Live, View  # noqa: PLC0415 - as above

    live = Live(Broker.parse(url, os.environ), mission, time.monotonic)
    return lambda: View(live), live.run
