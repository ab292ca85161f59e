"""What went over the wire: frames of controllers and vehicles, and what the radio did."""

from __future__ import annotations

import contextlib
import json
from collections import Counter
from collections.abc import Mapping
from typing import Any

from swarm_ctl import wire
from swarm_ctl.record.reader import Run
from swarm_ctl.record.report.markup import Markup, join, table, tag
from swarm_ctl.record.tlog import count_frames

COMPONENTS = {1: "autopilot", 68: "radio", 191: "companion"}
"""MAV_COMPONENT, of those that a controller hears."""


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


def _json(run: Run, name: str) -> dict[str, Any]:
    try:
        value = json.loads((run.path / name).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return value if isinstance(value, dict) else {}
