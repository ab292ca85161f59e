"""The operator's live view of a run: a table in a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Any, Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from swarm_ctl.mission import Mission
from swarm_ctl.model import Snapshot

REFRESH_S = 0.25
"""Wall time between two drawings: four a second are enough for an eye."""
LINE_S = 10.0
"""Wall time between two plain lines where nobody can draw."""
FULL_TABLE = 20
"""More vehicles than this are counted per phase; only those with something to say get a row."""
HEADER_LINES = 7
"""Lines of the view that are no vehicle's."""
BAR = 14
"""Characters of the bar of what is explored: the line behind it fits into 80 columns."""

STYLES = {
    "connecting": "bright_black",
    "ready": "white",
    "arming": "cyan",
    "takeoff": "cyan",
    "exploring": "green",
    "avoiding": "bright_green",
    "holding": "yellow",
    "lost": "bold yellow",
    "returning": "blue",
    "landing": "blue",
    "yielded": "magenta",
    "done": "bright_black",
    "failed": "bold red",
}
URGENCY = {"failed": 0, "lost": 1, "yielded": 2, "holding": 3, "landing": 4, "returning": 5}
"""Phases an operator wants to see first when not all fit."""
LOW_BATTERY = 0.25
SILENT_S = 1.0
"""A link that is silent for less is in order."""


class ProgressView:
    """Show how a run goes; use it as a context and call `update` as often as you like."""

    def __init__(
        self,
        mission: Mission,
        console: Console | None = None,
        *,
        is_real: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Show a mission on a console; a real one has no referee."""
        self._mission = mission
        self._is_real = is_real
        self._console = console or Console()
        self._clock = clock
        self._live: Live | None = None
        self._began: tuple[float, float] | None = None
        self._drawn_at = float("-inf")

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False, transient=True)
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None

    @property
    def is_due(self) -> bool:
        """Whether an update would be drawn: hundreds of snapshots are not made for nothing."""
        return self._clock() - self._drawn_at >= (LINE_S if self._live is None else REFRESH_S)

    def update(
        self,
        time_s: float,
        snapshots: Sequence[Snapshot],
        referee: Mapping[str, Any] | None = None,
    ) -> None:
        """Take the state at a mission time; draw it if the last drawing is old enough.

        `referee` is the mock's last line; None leaves what it alone knows blank.
        """
        wall_s = self._clock()
        self._began = self._began or (wall_s, time_s)
        if not self.is_due:
            return
        self._drawn_at = wall_s
        factor = self._factor(wall_s, time_s)
        if self._live is None:
            parts = [plain_line(time_s, snapshots, referee or {})]
            parts += known(snapshots) if self._is_real else []
            self._console.print("; ".join(parts), soft_wrap=True, highlight=False)
            return
        room = max(3, self._console.height - HEADER_LINES)
        told = Text("  ".join(known(snapshots)), no_wrap=True, overflow="ellipsis")
        counts = told if self._is_real else score(referee or {})
        view = Group(
            header(self._mission, time_s, factor, counts),
            table(snapshots, room, is_real=self._is_real),
        )
        self._live.update(view, refresh=True)

    def _factor(self, wall_s: float, time_s: float) -> float | None:
        """Give mission seconds per second since the first update; None before there are any."""
        wall_began, time_began = self._began or (wall_s, time_s)
        passed_s = wall_s - wall_began
        return (time_s - time_began) / passed_s if passed_s >= 0.5 else None


def header(
    mission: Mission, time_s: float, factor: float | None, counts: RenderableType
) -> RenderableType:
    """Give mission, time and what there is to count, in two lines."""
    first = Text(no_wrap=True, overflow="ellipsis")
    first.append(mission.name, style="bold")
    first.append(f"  {_clock_face(time_s)}", style="bold cyan")
    first.append(f" of {_clock_face(mission.duration_s)} and the way home", style="dim")
    if factor is not None:
        first.append(f"  {factor:.1f}x", style="dim")
    return Group(first, counts, Text())


def table(
    snapshots: Sequence[Snapshot], room: int = 1000, *, is_real: bool = False
) -> RenderableType:
    """Give a row per vehicle; of a large swarm only those with something to say, and counts.

    `room` is the number of lines there are for rows. Of real vehicles it is told how far they are
    from their start, and for how long their links have been silent.
    """
    shown = list(snapshots)
    is_part = len(shown) > min(FULL_TABLE, room)
    if is_part:
        room = min(FULL_TABLE, room - 1)
        telling = [one for one in shown if _is_telling(one)]
        shown = sorted(telling, key=_rank)[: max(1, room)]
    grid = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim", expand=True)
    grid.add_column("vehicle", justify="right", no_wrap=True)
    grid.add_column("phase", no_wrap=True, min_width=10)
    names = ["height", "battery", "hears", "victims", *(["away"] if is_real else [])]
    for name in names:
        grid.add_column(name, justify="right", no_wrap=True)
    grid.add_column("note", no_wrap=True, overflow="ellipsis", ratio=1)
    for one in shown:
        cells = (*_cells(one), _away(one)) if is_real else _cells(one)
        grid.add_row(*cells, _silence(one, is_real=is_real).append(one.note, style="dim"))
    if not is_part:
        return grid
    return Group(_counts(snapshots), grid) if shown else _counts(snapshots)


def plain_line(time_s: float, snapshots: Sequence[Snapshot], referee: Mapping[str, Any]) -> str:
    """Say how the run goes in one line for a log."""
    phases = Counter(one.phase for one in snapshots)
    parts = [", ".join(f"{count} {phase}" for phase, count in phases.most_common())]
    if (share := referee.get("coverage_fraction")) is not None:
        parts.append(f"explored {share:.1%}")
    if referee.get("victims_total"):
        parts.append(f"victims {referee.get('victims_found', 0)} of {referee['victims_total']}")
    if (contacts := referee.get("collisions")) is not None:
        parts.append(f"contacts {contacts}")
    return f"{time_s:7.1f} s  " + "; ".join(part for part in parts if part)


def known(snapshots: Sequence[Snapshot]) -> list[str]:
    """Say what the vehicles know themselves, where no referee is."""
    parts = [f"victims seen {sum(one.victims for one in snapshots)}"]
    parts.append(f"radio contacts {sum(len(one.peers) for one in snapshots) // 2}")
    told = [one.battery_fraction for one in snapshots if one.battery_fraction is not None]
    parts += [f"lowest battery {min(told):.0%}"] if told else []
    silent = [str(one.sysid) for one in snapshots if one.silent_s >= SILENT_S]
    return parts + ([f"silent: {', '.join(silent)}"] if silent else [])


def score(referee: Mapping[str, Any]) -> Text:
    """Say in one line what a referee counts."""
    line = Text(no_wrap=True, overflow="ellipsis")
    share = referee.get("coverage_fraction")
    if share is None:
        return line.append("the referee has not spoken yet", style="dim")
    full = round(BAR * min(1.0, max(0.0, share)))
    line.append("━" * full, style="green").append("━" * (BAR - full), style="bright_black")
    line.append(f" {share:.1%} explored", style="bold")
    if total := referee.get("victims_total"):
        found = referee.get("victims_found", 0)
        line.append("  victims ").append(f"{found}/{total}", style="bold green" if found else "")
    contacts = referee.get("collisions")
    if contacts is not None:
        line.append("  contacts ").append(str(contacts), style="bold red" if contacts else "green")
    nearest = referee.get("min_separation_m")
    if nearest is not None:
        line.append(f"  nearest pair {nearest:.2f} m")
    return line


def _counts(snapshots: Sequence[Snapshot]) -> Text:
    phases = Counter(one.phase for one in snapshots)
    line = Text(f"{len(snapshots)} vehicles: ")
    ordered = sorted(phases, key=lambda phase: (-phases[phase], phase))
    for index, phase in enumerate(ordered):
        line.append(", " if index else "")
        line.append(f"{phases[phase]} {phase}", style=STYLES.get(phase, ""))
    return line


def _is_telling(one: Snapshot) -> bool:
    return one.phase in URGENCY or one.victims > 0 or _is_low(one)


def _is_low(one: Snapshot) -> bool:
    return one.battery_fraction is not None and one.battery_fraction < LOW_BATTERY


def _rank(one: Snapshot) -> tuple[int, int, int]:
    return URGENCY.get(one.phase, 4 if _is_low(one) else 9), -one.victims, one.sysid


def _cells(one: Snapshot) -> tuple[Text, ...]:
    battery = one.battery_fraction
    return (
        Text(str(one.sysid), style="bold"),
        Text(one.phase, style=STYLES.get(one.phase, "")),
        Text(f"{0.0 - one.position_ned_m.z:.1f} m"),
        Text("?" if battery is None else f"{battery:.0%}", style="red" if _is_low(one) else ""),
        Text(str(len(one.peers)), style="" if one.peers else "dim"),
        Text(str(one.victims), style="bold green" if one.victims else "dim"),
    )


def _away(one: Snapshot) -> Text:
    return Text(f"{math.hypot(one.position_ned_m.x, one.position_ned_m.y):.1f} m")


def _silence(one: Snapshot, *, is_real: bool) -> Text:
    """Say that a link is silent; while it is not, there is nothing to say."""
    if not is_real or one.silent_s < SILENT_S:
        return Text()
    words = "never heard " if math.isinf(one.silent_s) else f"silent {one.silent_s:.0f} s "
    return Text(words, style="red")


def _clock_face(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes}:{rest:02d}"
