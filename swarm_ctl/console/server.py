"""The console's web server: on the loopback unless told otherwise, behind a token."""

from __future__ import annotations

import asyncio
import secrets
import socket
from collections.abc import Callable, Coroutine
from typing import Any

import uvicorn
from fastapi import FastAPI
from nicegui import ui

from swarm_ctl.console.door import Door
from swarm_ctl.console.page import Source, build
from swarm_ctl.errors import SwarmError

TOKEN_BYTES = 16


def listen(host: str, port: int) -> socket.socket:
    """Take a port; SwarmError says what is wrong with it."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    sock = socket.socket(family, socket.SOCK_STREAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((host, port))
        sock.listen()
    except OSError as error:
        sock.close()
        wrong = f"--host {host} --port {port}: {error.strerror}"
        raise SwarmError(f"{wrong}; choose another --port, 0 for a free one") from None
    return sock


def address(sock: socket.socket, token: str) -> str:
    """Give the address that opens the page, with the token."""
    host, port = sock.getsockname()[:2]
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/?token={token}"


def new_token() -> str:
    """Draw a token that cannot be guessed."""
    return secrets.token_urlsafe(TOKEN_BYTES)


async def serve(
    sock: socket.socket,
    token: str,
    open_source: Callable[[], Source],
    watch: Callable[[], Coroutine[Any, Any, None]] | None = None,
) -> None:
    """Serve the page until Ctrl-C, and watch meanwhile; each browser gets a source of its own."""
    async with asyncio.TaskGroup() as tasks:
        watching = tasks.create_task(watch(), name="console watch") if watch else None
        await uvicorn.Server(_site(sock, token, open_source)).serve(sockets=[sock])
        if watching is not None:
            watching.cancel()


def _site(sock: socket.socket, token: str, open_source: Callable[[], Source]) -> uvicorn.Config:
    site = FastAPI(openapi_url=None)

    @ui.page("/", title="swarm-ctl console")
    def page() -> None:
        build(open_source())

    ui.run_with(site, dark=True, tailwind=False, show_welcome_message=False)
    return uvicorn.Config(
        Door(site, token, sock.getsockname()[1]),
        log_level="warning",
        access_log=False,
        timeout_graceful_shutdown=1,
        server_header=False,
    )
