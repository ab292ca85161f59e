"""One page about a run: `summary.json`, and the same as a table for the terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from swarm_ctl.record.contacts import CONTACT_FIGURES
from swarm_ctl.record.spread import SPREAD_FIGURES, Contacts
from swarm_ctl.record.truth import Truth, read_truth

Outcome = Literal["flown", "interrupted", "failed"]

_TOTALS = (
    "victims_found",
    "victims_total",
    "collisions",
    "min_separation_m",
    "path_length_m",
    "energy_kwh",
    "setpoint_jitter_p99_ms",
    "mock_late_fraction",
    "mock_dropped",
    "redundant_fraction",
    "vehicles_per_cell",
)


@dataclass(frozen=True, slots=True)
class VehicleResult:
    """How one vehicle's flight ended, as its controller saw it."""

    sysid: int
    phase: str
    """Its last phase."""
    reason: str
    """Why it ended there, in a few words; empty when all went well."""
    messages_sent: int = 0
    messages_received: int = 0
    messages_lost: int = 0
    victims: list[Any] = field(default_factory=list)
    """What it saw itself; JSON values only."""
    explored_from_s: float | None = None
    """Mission time at which it began to explore."""
    explored_to_s: float | None = None
    """Mission time at which it ceased to explore."""
    autopilot: str = ""
    """What its heartbeat said; empty when none came."""
    path_length_m: float = 0.0
    """By its own estimate."""
    ticks_due: int = 0
    """Of its controller in real time."""
    ticks_late: int = 0
    """Those that began late, or not at all."""
    unsent: int = 0
    """Datagrams of its controller that did not leave."""
    unheard: int = 0
    """Datagrams for its controller that were dropped."""


def summarise(
    run: Path,
    *,
    mission: Mapping[str, Any],
    mode: str,
    outcome: Outcome,
    time_s: float,
    wall_s: float,
    results: Sequence[VehicleResult],
    run_sha256: str,
    notes: Sequence[str] = (),
    contacts: Contacts | None = None,
) -> dict[str, Any]:
    """Join what the controllers report with what the referee wrote to `truth/`; JSON values.

    `coverage_fraction` counts when the mission's exploration time is over, from the first
    vehicle that explored; `coverage_final_fraction` at the very end. Unknown is None; real
    vehicles have no referee, so there only what they know themselves is told.
    """
    truth = _known(results) if mode == "fly" else read_truth(run)
    starts = [one.explored_from_s for one in results if one.explored_from_s is not None]
    ends = [one.explored_to_s for one in results if one.explored_to_s is not None]
    until_s = min(starts) + float(mission["duration_s"]) if starts else math.inf
    final = truth.numbers.get("coverage_fraction")
    summary = {
        "mission": mission["name"],
        "outcome": outcome,
        "world": mission["world"],
        "seed": mission["seed"],
        "planner": mission["planner"]["kind"],
        "autopilot": mission["autopilot"],
        "vehicles": mission["vehicles"],
        "mode": mode,
        "duration_s": round(time_s, 3),
        "exploration_s": round(max(ends) - min(starts), 3) if starts and ends else None,
        "wall_s": round(wall_s, 3),
        "coverage_fraction": _coverage_at(truth, until_s, otherwise=final),
        "coverage_final_fraction": _coverage_at(truth, math.inf, otherwise=final),
        **{key: truth.numbers.get(key) for key in _TOTALS},
        "setpoint_late_fraction": _share_of(
            sum(one.ticks_late for one in results), sum(one.ticks_due for one in results)
        ),
        **(contacts.figures if contacts else dict.fromkeys((*CONTACT_FIGURES, *SPREAD_FIGURES))),
        "messages_sent": sum(one.messages_sent for one in results),
        "messages_received": sum(one.messages_received for one in results),
        "messages_lost": sum(one.messages_lost for one in results),
        "datagrams_unsent": sum(one.unsent for one in results),
        "datagrams_unheard": sum(one.unheard for one in results),
        "run_sha256": run_sha256,
        "notes": [
            *notes,
            *truth.notes,
            *_went_wrong(
                results, float(mission["duration_s"]), is_cut_short=outcome == "interrupted"
            ),
        ],
        "per_vehicle": [_entry(one) for one in results],
    }
    plain: dict[str, Any] = _plain(summary)
    return plain


def _share_of(part: int, whole: int) -> float | None:
    """Give a share, None of nothing."""
    return round(part / whole, 5) if whole else None


def _known(results: Sequence[VehicleResult]) -> Truth:
    """Give what the vehicles know themselves, in the place of a referee's truth."""
    victims = {victim for one in results for victim in one.victims}
    length_m = sum(one.path_length_m for one in results)
    return Truth(numbers={"victims_found": len(victims), "path_length_m": round(length_m, 2)})


def write_summary(run: Path, summary: Mapping[str, Any]) -> None:
    """Write `summary.json` in one go."""
    draft = run / "summary.tmp"
    text = json.dumps(_plain(dict(summary)), indent=2, allow_nan=False)
    draft.write_text(text + "\n", encoding="utf-8")
    draft.replace(run / "summary.json")


def report_lines(summary: Mapping[str, Any], folder: Path | None = None) -> RenderableType:
    """Lay a summary out as a compact table with plain words."""
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", justify="right")
    table.add_column()
    for label, value in _rows(summary):
        table.add_row(label, value)
    if folder is not None:
        here = Path.cwd()
        shown = folder.relative_to(here) if folder.is_relative_to(here) else folder
        table.add_row("record", Text(str(shown), style="cyan", overflow="fold"))
    parts: list[RenderableType] = [_headline(summary), Padding(table, (0, 0, 0, 1))]
    parts += [Text(f" • {note}", style="yellow") for note in summary["notes"]]
    return Group(*parts)


def _coverage_at(truth: Truth, time_s: float, *, otherwise: float | None) -> float | None:
    """Give the last value of the coverage curve at or before a time."""
    times, values = truth.arrays.get("coverage_time_s"), truth.arrays.get("coverage_fraction")
    if times is None or values is None or not len(times):
        return otherwise
    index = int(np.searchsorted(times, time_s + 1e-6, side="right")) - 1
    return round(float(values[max(index, 0)]), 6)


def _went_wrong(
    results: Sequence[VehicleResult], duration_s: float, *, is_cut_short: bool
) -> list[str]:
    """Give a sentence for every way in which vehicles did not explore their time and come down.

    Who explored less than its time because the operator ended the run gets none.
    """
    who: dict[str, list[int]] = {}
    for one in results:
        explored_s = _explored_s(one)
        if one.phase != "done":
            reason = one.reason or f"the flight ended while {one.phase}"
            reason = reason.removeprefix(f"vehicle {one.sysid}: ")
        elif explored_s < duration_s - 2.0 and not is_cut_short:
            reason = f"explored {explored_s:.0f} s instead of {duration_s:.0f} s"
            reason += f" ({one.reason})" if one.reason else ""
        elif one.reason and not is_cut_short:
            reason = one.reason
        else:
            continue
        who.setdefault(reason, []).append(one.sysid)
    sentences = [f"{_names(sysids)}: {reason}" for reason, sysids in who.items()]
    if results and all(one.explored_from_s is None for one in results):
        sentences.append("no vehicle came to explore")
    return sentences


def _names(sysids: Sequence[int]) -> str:
    """Name vehicles as a sentence does; of many only the first."""
    if len(sysids) == 1:
        return f"vehicle {sysids[0]}"
    if len(sysids) > 8:
        first = ", ".join(str(sysid) for sysid in sysids[:6])
        return f"vehicles {first} and {len(sysids) - 6} more"
    return f"vehicles {', '.join(map(str, sysids[:-1]))} and {sysids[-1]}"


def _explored_s(one: VehicleResult) -> float:
    if one.explored_from_s is None:
        return 0.0
    return math.inf if one.explored_to_s is None else one.explored_to_s - one.explored_from_s


def _entry(one: VehicleResult) -> dict[str, Any]:
    return {
        "sysid": one.sysid,
        "autopilot": one.autopilot,
        "phase": one.phase,
        "reason": one.reason,
        "messages_sent": one.messages_sent,
        "messages_received": one.messages_received,
        "messages_lost": one.messages_lost,
        "victims": one.victims,
        "explored_from_s": one.explored_from_s,
        "explored_to_s": one.explored_to_s,
        "path_length_m": round(one.path_length_m, 2),
    }


def _plain(value: Any) -> Any:
    """Make numpy numbers plain, and None of what JSON cannot say (no second vehicle: inf m)."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value


_MARKS: dict[Outcome, tuple[str, str]] = {
    "flown": ("✔", "green"),
    "interrupted": ("■", "yellow"),
    "failed": ("✘", "red"),
}


def _headline(summary: Mapping[str, Any]) -> Text:
    mark, colour = _MARKS[summary["outcome"]]
    line = Text.from_markup(
        f"[bold {colour}]{mark} {escape(summary['mission'])} {summary['outcome']}[/]"
    )
    line.append(
        f"  {_count(summary['vehicles'], 'vehicle')}, {summary['autopilot']}, "
        f"planner {summary['planner']}, seed {summary['seed']}",
        style="dim",
    )
    return line


def _rows(summary: Mapping[str, Any]) -> list[tuple[str, RenderableType]]:
    rows: list[tuple[str, RenderableType | None]] = [
        ("explored", _explored(summary)),
        ("victims", _victims(summary)),
        ("contacts", _contacts(summary)),
        ("radio", _radio(summary)),
        ("news", _news(summary)),
        ("overlap", _overlap(summary)),
        ("flown", _flown(summary)),
        ("messages", _messages(summary)),
        ("pace", _pace(summary)),
        ("time", _time(summary)),
    ]
    is_real = summary["mode"] == "fly"
    return [(name, row) for name, row in rows if row and not (is_real and name in _REFEREES)]


_REFEREES = {"explored", "contacts"}
"""Rows that only a referee can fill."""


def _explored(summary: Mapping[str, Any]) -> Text:
    share, final = summary["coverage_fraction"], summary["coverage_final_fraction"]
    if share is None:
        return Text("unknown")
    text = Text(f"{share:.1%}", style="bold")
    text.append("  ")
    text.append("━" * round(24 * share), style="green")
    text.append("━" * (24 - round(24 * share)), style="bright_black")
    if final is not None and final - share >= 0.0005:
        text.append(f"  {final:.1%} with the way home", style="dim")
    return text


def _victims(summary: Mapping[str, Any]) -> Text:
    found, total = summary["victims_found"], summary["victims_total"]
    if found is not None and total is None:
        return Text(f"{found} seen" if found else "none seen", style="bold" if found else "dim")
    if found is None or total is None:
        return Text("unknown")
    if not total:
        return Text("none to find", style="dim")
    return Text(f"{found} of {total} found", style="bold green" if found == total else "bold")


def _contacts(summary: Mapping[str, Any]) -> Text:
    contacts, nearest = summary["collisions"], summary["min_separation_m"]
    if contacts is None:
        return Text("unknown")
    text = Text("none", style="green") if not contacts else Text(str(contacts), style="bold red")
    if nearest is not None:
        text.append(f"; two vehicles never closer than {nearest:.2f} m", style="default")
    return text


def _radio(summary: Mapping[str, Any]) -> Text | None:
    """Say how well the swarm held together; a vehicle alone has nobody to talk to."""
    together, splits = summary["together_fraction"], summary["splits"]
    if together is None:
        return None
    if together == 1.0:
        return Text("all in contact all the time", style="green")
    text = Text(f"all in contact {together:.0%} of the time")
    text.append(f"; fell apart {_times(splits)}, rejoined {_times(summary['rejoins'])}")
    if alone_s := summary["alone_longest_s"]:
        text.append(f"; one vehicle was alone for {alone_s:.0f} s in all", style="dim")
    return text


def _news(summary: Mapping[str, Any]) -> Text | None:
    """Say how fast those in contact, then or later, came to know of victims."""
    lag_s, all_s = summary["victim_lag_max_s"], summary["victim_all_max_s"]
    untold = summary["victim_untold"]
    if lag_s is None and not untold:
        return None
    text = Text("victims told to peers")
    if lag_s is not None:
        text.append(f" at most {lag_s:.1f} s after contact")
    if all_s is not None:
        text.append(f"; all knew of each within {all_s:.0f} s")
    if untold:
        text.append(f"; {untold} times one in contact never heard", style="yellow")
    return text


def _overlap(summary: Mapping[str, Any]) -> Text | None:
    """Say how much was seen by more vehicles than it takes."""
    share = summary["redundant_fraction"]
    if share is None or summary["vehicles"] < 2:
        return None
    return Text(
        f"{share:.0%} of what was seen was seen by several; "
        f"{summary['vehicles_per_cell']:.1f} vehicles a place on average"
    )


def _flown(summary: Mapping[str, Any]) -> Text:
    length, energy = summary["path_length_m"], summary["energy_kwh"]
    parts = [f"{length:,.0f} m in all"] if length is not None else []
    parts += [f"{energy:.3g} kWh"] if energy is not None else []
    return Text(", ".join(parts) or "unknown")


def _messages(summary: Mapping[str, Any]) -> Text:
    text = Text(f"{summary['messages_sent']:,} sent, {summary['messages_lost']:,} lost")
    jitter = summary["setpoint_jitter_p99_ms"]
    if jitter is not None:
        text.append(f"; setpoints {jitter:.1f} ms off their beat at most, 99 times of 100")
    return text


def _pace(summary: Mapping[str, Any]) -> Text | None:
    """Say what came late or not at all because the machine was too slow."""
    parts = [
        words.format(summary[key])
        for key, words in (
            ("setpoint_late_fraction", "{:.2%} of the setpoints late"),
            ("mock_late_fraction", "{:.2%} of the mock's steps late"),
            ("datagrams_unsent", "{:,} datagrams did not leave"),
            ("datagrams_unheard", "{:,} datagrams were dropped unread"),
            ("mock_dropped", "the mock dropped {:,} frames"),
        )
        if summary[key]
    ]
    return Text("; ".join(parts)) if parts else None


def _time(summary: Mapping[str, Any]) -> Text:
    mission_s, wall_s = summary["duration_s"], summary["wall_s"]
    text = Text(f"{mission_s:,.0f} s of mission in {wall_s:,.0f} s")
    if wall_s > 0.0:
        text.append(f" ({mission_s / wall_s:.1f} times real time)", style="dim")
    return text


def _times(number: int) -> str:
    return {0: "never", 1: "once", 2: "twice"}.get(number, f"{number} times")


def _count(number: int, word: str) -> str:
    return f"{number} {word}" if number == 1 else f"{number} {word}s"
