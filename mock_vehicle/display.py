"""What `mock-vehicle` writes while it flies: a line that lives, or lines of JSON."""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from mock_vehicle.fleet import Fleet
from mock_vehicle.ports import GCS_REMOTE, hint
from mock_vehicle.server import Server

INTRODUCED = 8
"""Vehicles that are told one by one where to be reached."""


@contextmanager
def show_json(fleet: Fleet, server: Server) -> Iterator[Callable[[], None]]:
    """Print one object per line: ready, progress every second, done."""

    def write(content: dict[str, Any]) -> None:
        try:
            sys.stdout.write(json.dumps(content, allow_nan=False) + "\n")
            sys.stdout.flush()
        except BrokenPipeError:  # nobody listens any more
            server.stop()

    def progress() -> dict[str, Any]:
        return {
            **fleet.referee.snapshot(),
            **server.pace(),
            "refused": fleet.refused,
            **({} if server.border is None else {"border": server.border.report()}),
        }

    write({"ready": server.ready()})
    yield lambda: write(progress())
    write({"done": progress()})


@contextmanager
def show_human(fleet: Fleet, server: Server) -> Iterator[Callable[[], None]]:
    """Print where to connect, then one line that lives."""
    from rich.console import Console  # noqa: PLC0415 - only people wait for it
    from rich.live import Live  # noqa: PLC0415

    console = Console(highlight=False)
    for line in introduction(fleet, server):
        console.print(line, soft_wrap=True)
    health = Health(fleet, server)
    with Live(console=console, auto_refresh=False) as live:
        yield lambda: live.update(health.line(), refresh=True)
        live.update(f"{health.line(whole=True)}\nstopped after {server.time_s:.1f} s")
    if not console.is_terminal:
        console.print()


def introduction(fleet: Fleet, server: Server) -> Iterator[str]:
    """Say who flies, and how clients reach whom, in their own words."""
    yield f"{fleet.world.name}: {fleet.n} {'vehicle' if fleet.n == 1 else 'vehicles'}; Ctrl-C ends"
    companions, ground = server.endpoints[: fleet.n], server.endpoints[fleet.n :]
    for endpoint in companions[:INTRODUCED]:
        sysid, kind = fleet.sysids[endpoint.vehicle], fleet.personalities[endpoint.vehicle]
        reached = hint(endpoint.bind, endpoint.remote)
        yield f"  sysid {sysid} {kind}, UDP {endpoint.bind[1]}: {reached}"
    if fleet.n > INTRODUCED:
        yield f"  and so on, to sysid {fleet.sysids[-1]} on UDP {server.ports[-1]}"
    called = {endpoint.remote for endpoint in [*companions, *ground]}
    if any(remote is not None and remote[1] == GCS_REMOTE for remote in called):
        yield f"  QGroundControl sees them by itself, on UDP {GCS_REMOTE}"


class Health:
    """The line that tells how it goes, with rates since it was last asked for."""

    def __init__(self, fleet: Fleet, server: Server) -> None:
        self._fleet, self._server = fleet, server
        self._first = self._last = self._now()

    def line(self, *, whole: bool = False) -> str:
        """Tell time, who is armed and airborne, modes, datagrams per second, and delay.

        Rates are those since the last line, or of the `whole` flight.
        """
        before, self._last = self._first if whole else self._last, self._now()
        passed, mission, arrived, sent = (
            now - then for now, then in zip(self._last, before, strict=True)
        )
        wall_s = max(passed, 1e-3)
        seen, fleet = self._fleet.referee.snapshot(), self._fleet
        modes = Counter(vehicle.mode_name for vehicle in fleet.vehicles if vehicle.alive)
        parts = [
            f"{self._server.time_s:6.1f} s",
            f"armed {sum(v.armed for v in fleet.vehicles)}/{fleet.n}",
            f"airborne {seen['airborne']}",
            " ".join(f"{mode} {count}" for mode, count in modes.most_common(3)),
            f"in {arrived / wall_s:.0f}/s out {sent / wall_s:.0f}/s",
            *self._search(seen),
            f"{mission / wall_s:.1f}x",
        ]
        if self._server.behind_s >= 0.1:
            parts.append(f"behind by {self._server.behind_s:.1f} s")
        if self._server.steps_late:
            parts.append(f"late {self._server.pace()['mock_late_fraction']:.2%}")
        if fleet.refused:
            parts.append(f"refused {fleet.refused}")
        return "  ".join(parts)

    def _search(self, seen: dict[str, Any]) -> list[str]:
        """Tell how the search goes, where there is something to find or to hit."""
        if not seen["victims_total"]:
            return [f"collisions {seen['collisions']}"] if seen["collisions"] else []
        return [
            f"coverage {seen['coverage_fraction']:.1%}",
            f"victims {seen['victims_found']}/{seen['victims_total']}",
            f"collisions {seen['collisions']}",
        ]

    def _now(self) -> tuple[float, float, int, int]:
        endpoints = self._server.endpoints
        arrived, sent = (sum(e.arrived for e in endpoints), sum(e.sent for e in endpoints))
        return time.monotonic(), self._server.time_s, arrived, sent
