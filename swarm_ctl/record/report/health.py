"""What went wrong or nearly so, what the wire carried, and how to fly the same again."""

from __future__ import annotations

import contextlib
import json
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from swarm_ctl import wire
from swarm_ctl.record.reader import Run
from swarm_ctl.record.report.markup import Markup, join, table, tag
from swarm_ctl.record.tlog import count_frames

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
COMPONENTS = {1: "autopilot", 68: "radio", 191: "companion"}
"""MAV_COMPONENT, of those that a controller hears."""


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


def wire_section(run: Run) -> Markup | None:
    """Tell what the controllers sent and heard, what was lost, and what the radio did."""
    results = run.summary.get("per_vehicle", ())
    parts: list[str] = []
    jitter_ms = run.summary.get("setpoint_jitter_p99_ms") or 0.0
    if jitter_ms >= 0.05:
        words = f"Setpoints were at most {jitter_ms:.1f} ms off their beat, 99 times of 100."
        parts.append(tag("p", words))
    if radio := _json(run, "truth/radio.json"):
        parts += _radio(radio)
    if results:
        heads = ["vehicle", "autopilot", "sent", "received", "lost", "lost share"]
        parts.append(table(heads, [_wire(one) for one in results]))
    parts += _kinds(run)
    return join(*parts) if parts else None


def _kinds(run: Run) -> list[str]:
    """Count by kind what went over the first vehicle's link: all links carry the same kinds."""
    if not run.sysids:
        return []
    sysid, until_s = run.sysids[0], run.summary.get("duration_s") or 0.0
    counts = count_frames(run.tlog(sysid))
    if not counts or not until_s:
        return []
    rows = [
        [
            _name(number),
            "own" if source == sysid else "peers'",
            COMPONENTS.get(compid, f"component {compid}"),
            f"{count:,}",
            f"{count / until_s:.1f}",
        ]
        for (source, compid, number), count in _of_peers_together(counts, sysid).most_common()
    ]
    heads = ["message", "vehicle", "from", "frames", "a second"]
    words = f"what went over the link of vehicle {sysid}, by kind"
    return [tag("details", tag("summary", words), table(heads, rows))]


def _name(number: int) -> str:
    with contextlib.suppress(ValueError):
        return wire.message(number).name
    return f"number {number}"


def _of_peers_together(
    counts: Counter[tuple[int, int, int]], sysid: int
) -> Counter[tuple[int, int, int]]:
    together: Counter[tuple[int, int, int]] = Counter()
    for (source, compid, number), count in counts.items():
        together[source if source == sysid else 0, compid, number] += count
    return together


def _wire(one: Mapping[str, Any]) -> list[str]:
    received, lost = one["messages_received"], one["messages_lost"]
    share = lost / (received + lost) if received + lost else 0.0
    counts = [f"{one['messages_sent']:,}", f"{received:,}", f"{lost:,}"]
    return [str(one["sysid"]), one["autopilot"], *counts, f"{share:.2%}"]


def _radio(radio: Mapping[str, Any]) -> list[str]:
    links = radio.get("links", ())
    lost: Counter[str] = Counter()
    for link in links:
        lost.update(link["lost"])
    sent = sum(link["sent"] for link in links)
    delivered = sum(link["delivered"] for link in links)
    if not sent:
        return []
    slowest_s = max(link["delay_max_s"] for link in links)
    size = sum(link["bytes"] for link in links)
    words = (
        f"Over the radio vehicles broadcast {sum(v['sent'] for v in radio['vehicles']):,} frames; "
        f"{delivered:,} were heard ({size / 1e6:.1f} MB), the slowest after {slowest_s:.2f} s. "
        "What vehicles that ever came in reach did not hear was lost to"
    )
    rows = [[cause, f"{n:,}", f"{n / sent:.1%}"] for cause, n in lost.most_common()]
    return [tag("p", words), table(["cause", "frames", "of all sent"], rows)]


def repeat_section(run: Run) -> Markup:
    """Say how to fly the same again, and with which versions it was flown."""
    mode = run.started.get("mode")
    seed, folder = run.started.get("seed"), run.path.name
    file = shlex.quote(f"{folder}/mission.json")
    faults = "".join(f" --fault {shlex.quote(fault)}" for fault in run.started.get("faults", ()))
    commands = {
        "virtual": f"swarm-ctl run {file} --virtual{faults}",
        "udp": f"swarm-ctl run {file}{faults}",
        "fly": f"swarm-ctl fly {file} --connect URL",
    }
    promise = {
        "virtual": "In virtual time the same versions fly the same, frame by frame: run_sha256 "
        f"is then {run.summary.get('run_sha256', 'unknown')}.",
        "udp": "Over UDP the seed repeats every random draw, but not the clock's.",
        "fly": "Real vehicles never fly the same twice; the seed repeats the planners' draws.",
    }
    versions = ", ".join(f"{name} {what}" for name, what in run.started["versions"].items())
    flown = f"Flown {run.started_utc:%Y-%m-%d %H:%M:%S} UTC with seed {seed}; {versions}."
    return join(
        tag("pre", commands.get(str(mode), "")),
        tag("p", promise.get(str(mode), "")),
        tag("p", flown),
        tag(
            "details",
            tag("summary", "the mission, with every value"),
            tag("pre", json.dumps(run.mission, indent=2)),
        ),
    )


def _spaced(name: str) -> str:
    """Write `LinkLost` as two words."""
    return "".join(f" {c.lower()}" if c.isupper() else c for c in name).strip()


def _metres(value: float | None) -> str | None:
    return None if value is None else f"{value:.2f} m"


def _json(run: Run, name: str) -> dict[str, Any]:
    try:
        value = json.loads((run.path / name).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return value if isinstance(value, dict) else {}
