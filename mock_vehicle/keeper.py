"""Writes the truth into a folder while the fleet flies, what takes long beside the flight."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path

from mock_vehicle.fleet import Fleet
from mock_vehicle.referee import write_files
from mock_vehicle.server import Server

EVERY, PART = 5, 20
"""Looks, one a second, between two writings: so many, or such a part of all so far, since all that
was written before is written again."""


class Keeper:
    """The folder of a served fleet, written every few seconds in case the end never comes."""

    def __init__(self, fleet: Fleet, server: Server, folder: Path) -> None:
        """Write what stays as it is; who waits for `ready` finds it."""
        self._fleet, self._server, self._folder = fleet, server, folder
        self._looks, self._due = 0, EVERY
        self._writing: asyncio.Future[None] | None = None
        fleet.referee.write_world(folder)

    def look(self) -> None:
        """Write the truth so far when its time has come; OSError if the last time failed."""
        self._looks += 1
        if self._looks < self._due or (self._writing and not self._writing.done()):
            return
        self._due = self._looks + max(EVERY, self._looks // PART)
        if self._writing:
            self._writing.result()
        files = self._fleet.files(so_far=True, pace=self._server.pace())
        loop = asyncio.get_running_loop()
        write = partial(write_files, self._folder, files, small=False)
        self._writing = loop.run_in_executor(None, write)

    async def close(self) -> None:
        """Write the whole truth."""
        if self._writing:
            await self._writing
        write_files(self._folder, self._fleet.files(pace=self._server.pace()))
