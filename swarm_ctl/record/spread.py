"""How the news of victims spread: who knew of each when, beside who could have known."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from swarm_ctl.errors import SwarmError
from swarm_ctl.record.contacts import (
    FLOATS,
    LABELS,
    ContactGraph,
    Entry,
    contact_details,
    contact_figures,
    contact_graph,
    groups_of,
)
from swarm_ctl.record.journal import read_journal
from swarm_ctl.record.truth import read_truth

SPREAD_FIGURES = (
    "victim_told_median_s", "victim_told_max_s", "victim_lag_median_s", "victim_lag_max_s",
    "victim_all_max_s", "victim_untold",
)  # fmt: skip
"""Keys of the summary that `spread_figures` gives."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """Who could talk to whom in a run, and what became of it."""

    graph: ContactGraph
    news: list[dict[str, Any]] = field(default_factory=list)
    """Each victim, as `spread` tells."""

    @property
    def figures(self) -> dict[str, Any]:
        """Give what the summary takes up."""
        return contact_figures(self.graph) | spread_figures(self.news)

    def write(self, path: Path) -> None:
        """Write `contacts.json` in one go."""
        draft = path.with_suffix(".tmp")
        details = {**contact_details(self.graph), "victims": self.news}
        draft.write_text(json.dumps(details) + "\n", encoding="utf-8")
        draft.replace(path)


def read_contacts(run: Path) -> Contacts | None:
    """Join a run folder's events with its truth, if there is any; None when nothing is known."""
    try:
        entries = read_journal(run / "events.jsonl")
    except (OSError, SwarmError):
        return None
    graph = contact_graph(entries, read_truth(run))
    return None if graph is None else Contacts(graph, spread(graph, entries))


def spread(graph: ContactGraph, entries: Sequence[Entry]) -> list[dict[str, Any]]:
    """Tell for every victim who found it first and how its news went round; JSON values.

    `connected` are the vehicles in the finder's group when it was found, and `connected_s` the
    time until the last of them knew, None if one never did or there are none. `reachable` are all
    to whom a chain of contacts led, then or later, and `lags_s` how much later than the last of
    these contacts each one knew. `all_s` is the time until everybody who flew knew. Contacts
    that lasted for one sample only count for nothing.
    """
    lasting = graph.linked.copy()
    lasting[:-1] &= graph.linked[1:]
    groups = groups_of(lasting, graph.flying)
    knew_s: dict[int, dict[int, float]] = {}
    finders: dict[int, tuple[float, int]] = {}
    for entry in entries:
        if entry.get("event") in {"VictimFound", "VictimHeard"} and entry["sysid"] in graph.sysids:
            victim, at = entry["data"]["victim"], (entry["time_s"], entry["sysid"])
            knew_s.setdefault(victim, {}).setdefault(at[1], at[0])
            if entry["event"] == "VictimFound":
                finders[victim] = min(finders.get(victim, at), at)
    return [
        _news(graph, groups, victim, found_s, finder, knew_s[victim])
        for victim, (found_s, finder) in sorted(finders.items())
    ]


def spread_figures(news: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Give the figures of a summary; None where no victim was found in company, or at all."""
    told_s = [one["connected_s"] for one in news if one["connected_s"] is not None]
    lags_s = [lag_s for one in news for lag_s in one["lags_s"].values()]
    all_s = [one["all_s"] for one in news]
    values = (
        *((median(told_s), max(told_s)) if told_s else (None, None)),
        *((median(lags_s), max(lags_s)) if lags_s else (None, None)),
        max(all_s) if all_s and None not in all_s else None,
        sum(len(one["reachable"]) - len(one["lags_s"]) for one in news) if news else None,
    )
    rounded = (value if value is None else round(value, 3) for value in values)
    return dict(zip(SPREAD_FIGURES, rounded, strict=True))


def _news(
    graph: ContactGraph,
    groups: LABELS,
    victim: int,
    found_s: float,
    finder: int,
    knew_s: dict[int, float],
) -> dict[str, Any]:
    sysids = np.array(graph.sysids)
    at = max(int(np.searchsorted(graph.times_s, found_s, side="right")) - 1, 0)
    source = graph.sysids.index(finder)
    others = np.arange(len(sysids)) != source
    together = (groups[at] == groups[at, source]) & graph.flying[at]
    connected = sysids[together & others].tolist()
    reached_s = np.maximum(_reached_s(graph.times_s[at:], groups[at:], source), found_s)
    reachable = sysids[np.isfinite(reached_s) & others].tolist()
    flew = sysids[graph.flying.any(axis=0)].tolist()
    after_s = {sysid: round(max(0.0, time_s - found_s), 3) for sysid, time_s in knew_s.items()}
    return {
        "victim": victim,
        "found_by": finder,
        "found_s": round(found_s, 3),
        "connected": connected,
        "connected_s": _until_all(after_s, connected),
        "reachable": reachable,
        "lags_s": {
            sysid: round(max(0.0, knew_s[sysid] - float(reached)), 3)
            for sysid, reached in zip(graph.sysids, reached_s, strict=True)
            if sysid in reachable and sysid in knew_s
        },
        "all_s": _until_all(after_s, flew),
        "knew_after_s": after_s,
    }


def _until_all(after_s: dict[int, float], sysids: Sequence[int]) -> float | None:
    """Give the time until the last of them knew; None if one never did, or there are none."""
    if not sysids or not after_s.keys() >= set(sysids):
        return None
    return max(after_s[sysid] for sysid in sysids)


def _reached_s(times_s: FLOATS, groups: LABELS, source: int) -> FLOATS:
    """Tell when news could have come to each, over contacts one after the other; inf is never."""
    reached_s = np.where(np.arange(groups.shape[1]) == source, -math.inf, math.inf)
    for time_s, group in zip(times_s, groups, strict=True):
        is_told = np.isin(group, group[(reached_s < math.inf) & (group >= 0)])
        reached_s[is_told & (reached_s == math.inf)] = time_s
    return reached_s
