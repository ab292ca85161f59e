"""The page: its head, its sections in their order, its looks."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from importlib.resources import files

from swarm_ctl.record.reader import Run
from swarm_ctl.record.report.findings import coverage_section, victims_section
from swarm_ctl.record.report.fleet import contacts_section, energy_section, phases_section
from swarm_ctl.record.report.ground import map_section
from swarm_ctl.record.report.markup import Markup, join, tag
from swarm_ctl.record.report.safety import safety_section
from swarm_ctl.record.report.traffic import wire_section


def page(run: Run) -> str:
    """Write the whole page; sections of which nothing is known are left out."""
    title = f"{run.name}, {run.started_utc:%Y-%m-%d %H:%M} UTC"
    style = files("swarm_ctl.record.report").joinpath("style.css").read_text(encoding="utf-8")
    drawn = [(words, section(run)) for words, section in SECTIONS]
    sections = [tag("section", tag("h2", words), html) for words, html in drawn if html]
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Markup(style)),
    )
    body = tag("body", tag("main", _head(run), *sections))
    return f"<!doctype html>\n{tag('html', head, body, lang='en')}\n"


def _head(run: Run) -> Markup:
    mission, summary = run.mission, run.summary
    outcome = summary.get("outcome", "not finished")
    count = len(run.sysids)
    flown = {"fly": "real vehicles", "udp": "mock vehicles", "virtual": "mock, virtual time"}
    facts = [
        "1 vehicle" if count == 1 else f"{count} vehicles",
        f"{shards} shards" if (shards := run.started.get("shards")) else "",
        str(summary.get("autopilot") or mission.get("autopilot")),
        f"planner {mission['planner']['kind']}",
        f"seed {run.started.get('seed')}",
        flown.get(str(run.started.get("mode")), ""),
        f"{run.started_utc:%Y-%m-%d %H:%M} UTC",
    ]
    notes = [tag("li", str(note)) for note in summary.get("notes", ())]
    if not summary:
        notes = [tag("li", "The run left no summary: it was killed, or it is still being flown.")]
    return tag(
        "header",
        tag("h1", run.name, " ", tag("span", str(outcome), cls=f"outcome {outcome}")),
        tag("p", " · ".join(fact for fact in facts if fact), cls="facts"),
        tag("div", *_tiles(run), cls="tiles"),
        tag("ul", *notes, cls="notes") if notes else Markup(),
    )


def _tiles(run: Run) -> list[Markup]:
    """Write the figures that one asks for first; unknown ones are left out."""
    s = run.summary.get
    found, total, share = s("victims_found"), s("victims_total"), s("coverage_fraction")
    nearest, length, energy = s("min_separation_m"), s("path_length_m"), s("energy_kwh")
    lost, hits = s("messages_lost"), s("collisions")
    tiles = [
        ("explored", None if share is None else f"{share:.1%}", ""),
        ("victims found", _of(found, total), ""),
        ("collisions", None if hits is None else f"{hits}", "bad" if hits else ""),
        ("nearest two came", None if nearest is None else f"{nearest:.2f} m", ""),
        ("explored for", _seconds(s("exploration_s")), ""),
        ("in all", _seconds(s("duration_s")), ""),
        ("flown", None if length is None else f"{length:,.0f} m", ""),
        ("energy", None if energy is None else f"{1000.0 * energy:,.0f} Wh", ""),
        ("messages lost", None if lost is None else f"{lost:,}", ""),
    ]
    return [
        tag("div", tag("b", value), tag("span", words), cls=f"tile {cls}".strip())
        for words, value, cls in tiles
        if value is not None
    ]


def _of(found: int | None, total: int | None) -> str | None:
    if found is None or total == 0:
        return None
    return f"{found}" if total is None else f"{found} of {total}"


def _seconds(value: float | None) -> str | None:
    return None if value is None else f"{value:,.0f} s"


def repeat_section(run: Run) -> Markup:
    """Say how to fly the same again, and with which versions it was flown."""
    mode = run.started.get("mode")
    seed, folder = run.started.get("seed"), run.path.name
    file = shlex.quote(f"{folder}/mission.json")
    faults = "".join(f" --fault {shlex.quote(fault)}" for fault in run.started.get("faults", ()))
    shards = f" --shards {run.started['shards']}" if "shards" in run.started else ""
    commands = {
        "virtual": f"swarm-ctl run {file} --virtual{faults}",
        "udp": f"swarm-ctl run {file}{faults}{shards}",
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


SECTIONS: tuple[tuple[str, Callable[[Run], Markup | None]], ...] = (
    ("Map", map_section),
    ("Victims", victims_section),
    ("Coverage over time", coverage_section),
    ("Safety", safety_section),
    ("What each vehicle did", phases_section),
    ("Contacts over time", contacts_section),
    ("Battery and energy", energy_section),
    ("Wire", wire_section),
    ("Mission, and how to repeat it", repeat_section),
)
