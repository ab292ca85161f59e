"""How the fleet went: who was in contact with whom, phases, batteries."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from swarm_ctl.record.contacts import ContactGraph, contact_details
from swarm_ctl.record.looks import colours
from swarm_ctl.record.reader import Battery, Run
from swarm_ctl.record.report.markup import Markup, hexadecimal, join, picture, table, tag
from swarm_ctl.record.report.plot import Plot, ticks, x_axis

ALONE, IN_GROUP = (240, 160, 60), (37, 120, 200)
PAIRS_UP_TO = 40
"""Vehicles of which every pair has a square of its own."""
PHASE_HUES = {
    "exploring": (37, 120, 200, 200),
    "avoiding": (37, 120, 200, 130),
    "holding": (234, 150, 30, 255),
    "returning": (90, 170, 130, 220),
    "landing": (90, 170, 130, 120),
    "takeoff": (90, 170, 130, 120),
    "yielded": (160, 90, 200, 255),
    "lost": (214, 40, 57, 255),
    "failed": (214, 40, 57, 255),
}
"""What is not here stands on the ground."""


def contacts_section(run: Run) -> Markup | None:
    """Draw a lane per vehicle: alone, or in a group the darker the larger it is."""
    contacts = run.contacts
    if contacts is None or not contacts.graph.is_swarm.any():
        return None
    graph = contacts.graph
    details = contact_details(graph)
    titles = {
        one["sysid"]: f"vehicle {one['sysid']}: alone for {one['alone_s']:.0f} s of "
        f"{one['flown_s']:.0f} s in flight"
        for one in details["vehicles"]
    }
    marks = [
        _news_mark(graph, int(sysid), victim["found_s"] + after_s, victim["victim"], after_s)
        for victim in contacts.news
        for sysid, after_s in victim["knew_after_s"].items()
    ]
    keys = [("sq alone", "", "alone"), ("sq group", "", "in a group; darker: more vehicles")]
    if contacts.news:
        keys += [("mark found", "★", "finds a victim"), ("mark told", "", "learns of one")]
    lanes = _lanes(graph.sysids, _until_s(graph), _group_rows(graph), titles, marks, keys)
    return join(lanes, _groups(graph), _pairs(graph, details["pairs"]))


def _until_s(graph: ContactGraph) -> float:
    return max(1.0, float(graph.times_s[-1]))


def _group_rows(graph: ContactGraph) -> np.ndarray[Any, Any]:
    """Paint (n, s, 4): in a group of how many each vehicle was."""
    n = len(graph.sysids)
    counts = [np.bincount(groups[groups >= 0], minlength=n) for groups in graph.groups]
    sizes = np.take_along_axis(np.array(counts), np.maximum(graph.groups, 0), axis=1).T
    rgba = np.zeros((n, len(graph.times_s), 4), dtype=np.uint8)
    rgba[..., :3] = IN_GROUP
    rgba[..., 3] = (70 + 185 * sizes / n).astype(np.uint8)
    rgba[graph.alone.T] = (*ALONE, 255)
    rgba[~graph.flying.T] = 0
    return rgba


def _news_mark(
    graph: ContactGraph, sysid: int, time_s: float, victim: int, after_s: float
) -> Markup:
    row = graph.sysids.index(sysid)
    where = (
        f"left:{100.0 * time_s / _until_s(graph):.2f}%;"
        f"top:{100.0 * (row + 0.5) / len(graph.sysids):.2f}%"
    )
    if not after_s:
        words = f"vehicle {sysid} finds victim {victim} at {time_s:.0f} s"
        return tag("b", "★", cls="mark found", style=where, title=words)
    words = f"vehicle {sysid} learns of victim {victim} after {after_s:.0f} s"
    return tag("b", cls="mark told", style=where, title=words)


def _lanes(
    sysids: Sequence[int],
    until_s: float,
    rgba: np.ndarray[Any, Any],
    titles: Mapping[int, str],
    marks: Iterable[Markup] = (),
    keys: Iterable[tuple[str, str, str]] = (),
) -> Markup:
    """Draw a lane per vehicle over time; a gap of a third is left between two lanes."""
    banded = np.repeat(rgba, 4, axis=0)
    banded[3::4] = 0
    names = [tag("span", str(sysid), title=titles.get(sysid)) for sysid in sysids]
    legend = [tag("span", tag("b", sign, cls=cls), words) for cls, sign, words in keys]
    body = tag("div", picture(banded, "a lane per vehicle"), *marks, cls="lane")
    return tag(
        "div",
        tag("div", tag("div", *names, cls="names"), body, cls="lanes", style=f"--n:{len(sysids)}"),
        x_axis(ticks(until_s, 6), until_s),
        tag("div", "mission time, s", cls="xlabel"),
        tag("div", *legend, cls="keys"),
        cls="chart",
    )


def _groups(graph: ContactGraph) -> Markup:
    counts = np.where(graph.flying.any(axis=1), graph.group_counts, 0).astype(float)
    links = graph.link_counts.astype(float)
    groups = Plot(_until_s(graph), float(counts.max()) * 1.08, "groups (1: all together)")
    groups.line(graph.times_s, counts, "curve", is_filled=True)
    pairs = Plot(_until_s(graph), max(1.0, float(links.max()) * 1.08), "pairs in contact")
    pairs.line(graph.times_s, links, "curve", is_filled=True)
    return tag("div", groups.html(), pairs.html(), cls="two")


def _pairs(graph: ContactGraph, pairs: Sequence[Mapping[str, Any]]) -> Markup:
    """Draw a square for each pair, the darker the longer they were in contact."""
    n, index = len(graph.sysids), {sysid: at for at, sysid in enumerate(graph.sysids)}
    if n > PAIRS_UP_TO or not pairs:
        return Markup()
    longest_s = max(one["together_s"] for one in pairs)
    squares = []
    for one in pairs:
        a, b = one["sysids"]
        words = f"{a} and {b}: {one['together_s']:.0f} s together, met {one['encounters']} times"
        for x, y in ((index[a], index[b]), (index[b], index[a])):
            shade = f"{0.12 + 0.88 * one['together_s'] / longest_s:.2f}"
            square = {"x": x, "y": y, "width": 0.92, "height": 0.92, "fill_opacity": shade}
            squares.append(tag("rect", tag("title", words), **square))
    letters = [
        tag("text", str(sysid), x=at + 0.46, y=-0.25, text_anchor="middle")
        + tag("text", str(sysid), x=-0.25, y=at + 0.68, text_anchor="end")
        for sysid, at in index.items()
    ]
    drawing = tag(
        "svg", *map(Markup, letters), *squares, viewBox=f"-1.6 -1.3 {n + 1.7} {n + 1.4}", cls="net"
    )
    words = f"Who was in contact with whom: darkest is {longest_s:.0f} s together"
    return tag("details", tag("summary", words), drawing)


def phases_section(run: Run) -> Markup | None:
    """Draw what each vehicle was doing when, and how each one ended."""
    changes = run.events("PhaseChanged")
    if not changes:
        return None
    until_s = max(1.0, *(entry["time_s"] for entry in changes))
    columns = min(1000, max(2, round(until_s * 2)))
    rgba = np.zeros((len(run.sysids), columns, 4), dtype=np.uint8)
    for entry in changes:
        at = min(round(entry["time_s"] / until_s * columns), columns - 1)
        hue = PHASE_HUES.get(entry["data"]["after"], (0, 0, 0, 0))
        rgba[run.sysids.index(entry["sysid"]), at:] = hue
    seen = {entry["data"]["after"] for entry in changes}
    keys = [(f"sq ph-{name}", "", name) for name in PHASE_HUES if name in seen]
    return _lanes(run.sysids, until_s, rgba, _stories(changes), keys=keys)


def _stories(changes: Iterable[Mapping[str, Any]]) -> dict[int, str]:
    stories: dict[int, list[str]] = {}
    for entry in changes:
        words = f"{entry['time_s']:.0f} s {entry['data']['after']}"
        stories.setdefault(entry["sysid"], []).append(words)
    return {sysid: f"vehicle {sysid}: " + ", ".join(story) for sysid, story in stories.items()}


def energy_section(run: Run) -> Markup | None:
    """Draw how the batteries went down, and tell of each vehicle what it used."""
    batteries = {sysid: run.battery(sysid) for sysid in run.sysids}
    told = {sysid: one for sysid, one in batteries.items() if len(one.time_s) > 1}
    results = {one["sysid"]: one for one in run.summary.get("per_vehicle", ())}
    if not told and not results:
        return None
    parts: list[str] = []
    if told:
        plot = Plot(max(float(one.time_s[-1]) for one in told.values()), 100.0, "battery left, %")
        hues = dict(zip(run.sysids, map(hexadecimal, colours(len(run.sysids))), strict=True))
        for sysid, one in told.items():
            left = 100.0 * one.left_fraction
            plot.line(one.time_s, left, "thin", title=f"vehicle {sysid}", colour=hues[sysid])
        reserve = 100.0 * float(run.mission.get("limits", {}).get("battery_reserve", 0.0))
        if reserve:
            ends = np.array([0.0, plot.x_max])
            plot.line(ends, np.full(2, reserve), "bound", key="reserve: who is below flies home")
        parts.append(plot.html())
    heads = ["vehicle", "ended", "flown", "battery left", "energy", "mean power"]
    rows = [_spent(sysid, results.get(sysid, {}), batteries[sysid]) for sysid in run.sysids]
    return join(*parts, table(heads, rows))


def _spent(sysid: int, result: Mapping[str, Any], battery: Battery) -> list[str]:
    left, energy, power = "unknown", "unknown", "unknown"
    if len(battery.time_s) > 1:
        last = float(battery.left_fraction[-1])
        left = f"{last:.0%}" if math.isfinite(last) else left
        watts = battery.power_w[np.isfinite(battery.power_w)]
        if len(watts) == len(battery.time_s):
            used_wh = float(np.trapezoid(watts, battery.time_s)) / 3600.0
            energy, power = f"{used_wh:.1f} Wh", f"{float(watts.mean()):.0f} W"
    reason = f" ({result['reason']})" if result.get("reason") else ""
    length_m = result.get("path_length_m")
    return [
        str(sysid),
        f"{result.get('phase', 'unknown')}{reason}",
        "unknown" if length_m is None else f"{length_m:.0f} m",
        left,
        energy,
        power,
    ]
