"""What went wrong or nearly so."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from swarm_ctl.record.reader import Run
from swarm_ctl.record.report.markup import Markup, join, table, tag

ROUTINE = frozenset(
    {
        "RunStarted", "RunResumed", "Connected", "ContactsChanged", "VictimFound", "VictimHeard",
        "CommandProgress",
    }
)  # fmt: skip
"""Events of every good flight."""
CALM = frozenset({"connecting", "ready", "arming", "takeoff", "exploring", "landing", "done"})
"""Phases of every good flight; to avoid what is in the way is `avoiding`, too often to be told."""
MOST_LISTED = 300


def safety_section(run: Run) -> Markup:
    """Tell how near it came to a collision, and every event that a good flight has not."""
    summary, truth = run.summary, run.truth.numbers
    facts = [
        ("contacts with walls", truth.get("wall_collisions")),
        ("contacts between vehicles", truth.get("pair_collisions")),
        ("nearest two came", _metres(summary.get("min_separation_m"))),
    ]
    told = [(name, value) for name, value in facts if value is not None]
    words = "; ".join(f"{name}: {value}" for name, value in told)
    entries = [entry for entry in run.entries if _is_remarkable(entry)]
    parts: list[str] = [tag("p", f"{words}.")] if words else []
    if not entries:
        return join(*parts, tag("p", "No safety event: no link lost, no fence left, no failsafe."))
    return join(*parts, _folded(entries), _listed(entries))


def _is_remarkable(entry: Mapping[str, Any]) -> bool:
    if entry.get("event") == "PhaseChanged":
        after = entry["data"]["after"]
        return after not in {*CALM, "avoiding", "returning"} or bool(_alarm(entry))
    return entry.get("event") not in ROUTINE


def _alarm(entry: Mapping[str, Any]) -> str:
    """Give the reason of a change to land or return that the plan did not ask for."""
    data = entry["data"]
    is_planned = data["after"] not in {"returning", "landing", "done"} or data["reason"] in PLANNED
    return "" if is_planned else str(data["reason"])


PLANNED = frozenset({"", "exploration time is over", "home", "landed"})
"""Reasons why a good flight ends."""


def _what(entry: Mapping[str, Any]) -> str:
    data = entry.get("data", {})
    if entry["event"] == "PhaseChanged":
        return f"{data['after']}: {data['reason']}" if data["reason"] else str(data["after"])
    return _spaced(entry["event"])


def _folded(entries: Iterable[Mapping[str, Any]]) -> Markup:
    kinds: dict[str, list[Mapping[str, Any]]] = {}
    for entry in entries:
        kinds.setdefault(_what(entry), []).append(entry)
    rows = []
    for what, same in kinds.items():
        who = sorted({entry["sysid"] for entry in same if "sysid" in entry})
        named = ", ".join(map(str, who[:8])) + (f" and {len(who) - 8} more" if who[8:] else "")
        times = [entry.get("time_s", 0.0) for entry in same]
        rows.append([what, f"{len(same)}", named, f"{min(times):.1f} s", f"{max(times):.1f} s"])
    return table(["event", "times", "vehicles", "first", "last"], rows)


def _listed(entries: list[dict[str, Any]]) -> Markup:
    rows = [
        [
            f"{entry.get('time_s', 0.0):.1f} s",
            str(entry.get("sysid", "")),
            _what(entry),
            ", ".join(f"{key} {value}" for key, value in entry.get("data", {}).items()),
        ]
        for entry in entries[:MOST_LISTED]
    ]
    more = len(entries) - len(rows)
    words = f"all of them in order{f', but for the last {more}' if more else ''}"
    return tag(
        "details", tag("summary", words), table(["time", "vehicle", "event", "details"], rows)
    )


def _spaced(name: str) -> str:
    """Write `LinkLost` as two words."""
    return "".join(f" {c.lower()}" if c.isupper() else c for c in name).strip()


def _metres(value: float | None) -> str | None:
    return None if value is None else f"{value:.2f} m"
