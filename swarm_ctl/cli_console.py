"""The command that opens the operator's page: `console`."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.errors import SwarmError

PORT = 8080


def console(
    run: Annotated[
        Path,
        typer.Argument(help="Run folder to play back.", metavar="RUN_FOLDER", show_default=False),
    ],
    host: Annotated[
        str, typer.Option(help="Address to serve on; 0.0.0.0 is every one of this computer.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to serve on; 0 takes a free one.")] = PORT,
) -> None:
    """Open a page in the browser that plays a run back.

    Exit status: 0 ended by Ctrl-C, 2 bad input.
    """
    try:
        from swarm_ctl.console import server  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise SwarmError(
            f"swarm-ctl console needs {error.name}, which the extra brings: "
            "pip install 'swarm-ctl[console]'"
        ) from None
    from swarm_ctl.console.player import Player  # noqa: PLC0415 - goes with the server
    from swarm_ctl.console.replay import Replay  # noqa: PLC0415 - goes with the server

    replay = Replay.read(run)
    sock, token = server.listen(host, port), server.new_token()
    typer.echo(f"open {server.address(sock, token)}\nCtrl-C ends the console")
    asyncio.run(server.serve(sock, token, lambda: Player(replay, time.monotonic)))
