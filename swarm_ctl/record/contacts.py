"""The contact graph of a run: who could talk to whom, when the swarm fell apart and rejoined."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.record.truth import Truth

FLOATS = NDArray[np.float64]
BOOLS = NDArray[np.bool_]
LABELS = NDArray[np.int16]

SAMPLE_S = 1.0
_AT_ONCE = 64
"""Samples whose groups are found together, which bounds the memory: (64, n, n)."""
_AWAY = frozenset({"connecting", "ready", "arming", "done", "failed"})
"""In these phases a vehicle is not with the swarm: on the ground, or without a controller."""

Entry = Mapping[str, Any]
"""A line of `events.jsonl`."""


@dataclass(frozen=True, slots=True)
class ContactGraph:
    """Who was in contact with whom, once a second, of the vehicles that flew."""

    sysids: list[int]
    times_s: FLOATS
    """(s,), mission time."""
    linked: BOOLS
    """(s, n, n): both fly and hear each other."""
    flying: BOOLS
    """(s, n): between take-off and the end of its mission."""
    groups: LABELS
    """(s, n): the lowest index of all whom a vehicle reaches over any number of links; -1 is
    not flying."""

    @property
    def is_swarm(self) -> BOOLS:
        """(s,): whether at least two fly."""
        return np.asarray(self.flying.sum(axis=1) > 1)

    @property
    def group_counts(self) -> NDArray[np.intp]:
        """(s,): into how many groups those that fly have fallen."""
        return np.asarray((self.groups == np.arange(len(self.sysids))).sum(axis=1))

    @property
    def link_counts(self) -> NDArray[np.intp]:
        """(s,): pairs in contact."""
        return np.asarray(self.linked.sum(axis=(1, 2)) // 2)

    @property
    def alone(self) -> BOOLS:
        """(s, n): flying, and in contact with nobody."""
        return np.asarray(self.flying & ~self.linked.any(axis=2))


@dataclass(frozen=True, slots=True)
class Change:
    """A group that fell apart, or groups that became one."""

    time_s: float
    is_split: bool
    parts: tuple[tuple[int, ...], ...]
    """sysids of the parts: after a split, before a rejoining."""


def contact_graph(entries: Sequence[Entry], truth: Truth) -> ContactGraph | None:
    """Join who flew, from events, with who heard whom; None when nobody knows.

    The truth knows who heard whom; where there is none, what the vehicles have noted themselves.
    """
    sysids = sorted({e["sysid"] for e in entries if e.get("event") == "PhaseChanged"})
    sampled = _from_truth(truth)
    if sampled is None and "track_ned_m" not in truth.arrays:
        sampled = _from_events(entries, sysids)
    if sampled is None or not sysids:
        return None
    sysids, times_s, heard = sampled
    flying = _flying(entries, sysids, times_s)
    linked = heard & heard.transpose(0, 2, 1) & flying[:, :, None] & flying[:, None, :]
    return ContactGraph(sysids, times_s, linked, flying, groups_of(linked, flying))


def changes(graph: ContactGraph) -> list[Change]:
    """Tell when groups fell apart and became one, of the vehicles that fly before and after."""
    found = []
    differs = np.flatnonzero((graph.groups[1:] != graph.groups[:-1]).any(axis=1))
    for at in differs.tolist():
        stays = graph.flying[at] & graph.flying[at + 1]
        sysids = np.array(graph.sysids)[stays]
        before, after = graph.groups[at][stays], graph.groups[at + 1][stays]
        time_s = float(graph.times_s[at + 1])
        found += [Change(time_s, True, parts) for parts in _parts(before, after, sysids)]
        found += [Change(time_s, False, parts) for parts in _parts(after, before, sysids)]
    return found


def encounters(graph: ContactGraph) -> NDArray[np.intp]:
    """Count how often each pair came into contact, (n, n)."""
    begins = graph.linked & ~np.concatenate([np.zeros_like(graph.linked[:1]), graph.linked[:-1]])
    return np.asarray(begins.sum(axis=0))


def contact_figures(graph: ContactGraph) -> dict[str, Any]:
    """Give the figures of a summary: means over the time in which at least two fly; JSON values."""
    swarm, happened = graph.is_swarm, changes(graph)
    if not swarm.any():
        return dict.fromkeys(CONTACT_FIGURES)
    counts, links = graph.group_counts[swarm], graph.link_counts[swarm]
    sizes = graph.groups[swarm][:, :, None] == np.arange(len(graph.sysids))
    largest = sizes.sum(axis=1).max(axis=1) / graph.flying[swarm].sum(axis=1)
    alone_s = graph.alone[swarm].sum(axis=0) * SAMPLE_S
    values = (
        round(float(links.mean()), 3),
        int(encounters(graph).sum()) // 2,
        round(float(counts.mean()), 3),
        round(float(largest.mean()), 4),
        round(float((counts == 1).mean()), 4),
        sum(change.is_split for change in happened),
        sum(not change.is_split for change in happened),
        float(alone_s.max()),
    )
    return dict(zip(CONTACT_FIGURES, values, strict=True))


CONTACT_FIGURES = (
    "links_mean", "encounters", "groups_mean", "largest_group_fraction", "together_fraction",
    "splits", "rejoins", "alone_longest_s",
)  # fmt: skip
"""Keys of the summary that `contact_figures` gives."""


def contact_details(graph: ContactGraph) -> dict[str, Any]:
    """Give what `contacts.json` holds: curves, splits and rejoinings, pairs, vehicles."""
    counts, together_s = encounters(graph), graph.linked.sum(axis=0) * SAMPLE_S
    first, second = np.nonzero(np.triu(counts, 1))
    return {
        "times_s": graph.times_s.round(3).tolist(),
        "links": graph.link_counts.tolist(),
        "groups": graph.group_counts.tolist(),
        "changes": [
            {
                "time_s": round(change.time_s, 3),
                "kind": "split" if change.is_split else "rejoin",
                "parts": change.parts,
            }
            for change in changes(graph)
        ],
        "pairs": [
            {
                "sysids": [graph.sysids[a], graph.sysids[b]],
                "encounters": int(counts[a, b]),
                "together_s": float(together_s[a, b]),
            }
            for a, b in zip(first.tolist(), second.tolist(), strict=True)
        ],
        "vehicles": [
            {"sysid": sysid, "flown_s": float(flown), "alone_s": float(alone)}
            for sysid, flown, alone in zip(
                graph.sysids,
                graph.flying.sum(axis=0) * SAMPLE_S,
                graph.alone.sum(axis=0) * SAMPLE_S,
                strict=True,
            )
        ],
    }


def _from_truth(truth: Truth) -> tuple[list[int], FLOATS, BOOLS] | None:
    """Unpack the referee's samples: sysids, times and who heard whom both ways."""
    arrays = truth.arrays
    if not {"links", "coverage_time_s", "sysids"} <= arrays.keys():
        return None
    sysids, times_s = arrays["sysids"].tolist(), arrays["coverage_time_s"].astype(float)
    first, second = np.triu_indices(len(sysids), 1)
    heard = np.zeros((len(times_s), len(sysids), len(sysids)), dtype=bool)
    links = arrays["links"].reshape(len(times_s), -(len(first) // -8))  # of no samples, too
    heard[:, first, second] = np.unpackbits(links, axis=1, count=len(first))
    return sysids, times_s, heard | heard.transpose(0, 2, 1)


def _from_events(
    entries: Iterable[Entry], sysids: Sequence[int]
) -> tuple[list[int], FLOATS, BOOLS]:
    """Follow what each vehicle has noted of whom it hears."""
    entries = [entry for entry in entries if "time_s" in entry]
    until_s = max((entry["time_s"] for entry in entries), default=0.0)
    times_s = np.arange(0.0, until_s + SAMPLE_S, SAMPLE_S)
    heard = np.zeros((len(times_s), len(sysids), len(sysids)), dtype=bool)
    index = {sysid: at for at, sysid in enumerate(sysids)}
    for entry in entries:
        if entry["event"] != "ContactsChanged":
            continue
        since, hearer = int(np.searchsorted(times_s, entry["time_s"])), index[entry["sysid"]]
        for key, is_heard in (("gained", True), ("lost", False)):
            peers = [index[peer] for peer in entry["data"][key] if peer in index]
            heard[since:, peers, hearer] = is_heard
    return list(sysids), times_s, heard


def _flying(entries: Iterable[Entry], sysids: Sequence[int], times_s: FLOATS) -> BOOLS:
    """Follow the phases: (s, n)."""
    index = {sysid: at for at, sysid in enumerate(sysids)}
    flying = np.zeros((len(times_s), len(sysids)), dtype=bool)
    for entry in entries:
        if entry.get("event") == "PhaseChanged" and entry["sysid"] in index:
            since = int(np.searchsorted(times_s, entry["time_s"]))
            flying[since:, index[entry["sysid"]]] = entry["data"]["after"] not in _AWAY
    return flying


def groups_of(linked: BOOLS, flying: BOOLS) -> LABELS:
    """Give each vehicle the lowest index that it reaches, (s, n); -1 to who does not fly."""
    groups = np.empty(flying.shape, dtype=np.int16)
    for at in range(0, len(linked), _AT_ONCE):
        groups[at : at + _AT_ONCE] = _groups(linked[at : at + _AT_ONCE])
    groups[~flying] = -1
    return groups


def _groups(linked: BOOLS) -> LABELS:
    """Give each vehicle the lowest index that it reaches, (s, n)."""
    n = linked.shape[1]
    near = linked | np.eye(n, dtype=bool)
    labels = np.broadcast_to(np.arange(n, dtype=np.int16), linked.shape[:2])
    while True:
        lowest = np.where(near, labels[:, None, :], np.int16(n)).min(axis=2)
        lowest = np.take_along_axis(lowest, lowest.astype(np.intp), axis=1)
        if np.array_equal(lowest, labels):
            return lowest
        labels = lowest


def _parts(
    whole: LABELS, parts: LABELS, sysids: NDArray[Any]
) -> Iterator[tuple[tuple[int, ...], ...]]:
    """Give the parts of each whole that has several."""
    for label in np.unique(whole):
        inside = whole == label
        names = np.unique(parts[inside])
        if len(names) > 1:
            yield tuple(tuple(sysids[inside & (parts == name)].tolist()) for name in names)
