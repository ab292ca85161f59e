"""The map: all vehicles in one frame, or each in its own; what is shown can be chosen."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from swarm_ctl.record.looks import colours
from swarm_ctl.record.reader import Run, Track
from swarm_ctl.record.report.layers import (
    MARGIN_M,
    Frame,
    end_layer,
    frame_of,
    path_layer,
    scale,
    searched_layer,
    victim_layer,
    wall_layer,
    words_of,
)
from swarm_ctl.record.report.markup import Markup, hexadecimal, join, tag
from swarm_ctl.record.sightings import missed, sightings

LAYERS = {"searched": "area searched", "paths": "paths", "victims": "victims"}


def map_section(run: Run) -> Markup | None:
    """Draw the launch frame; of vehicles whose frames nobody can join, each one's own."""
    tracks = [track for track in run.tracks if len(track.time_s)]
    if not tracks:
        return None
    hues = dict(zip(run.sysids, map(hexadecimal, colours(len(run.sysids))), strict=True))
    if run.starts_ned_m:
        return _whole(run, tracks, hues)
    words = "Nobody knows where one start lies from another: each path counts from its own."
    reach_m = max(float(np.abs(track.ned_m[:, :2]).max()) for track in tracks) + MARGIN_M
    frame = Frame(-reach_m, reach_m, -reach_m, reach_m)
    panels = [_own(run, frame, track, hues[track.sysid]) for track in tracks]
    return join(tag("p", words), tag("div", *panels, cls="panels"))


def _whole(run: Run, tracks: Sequence[Track], hues: dict[int, str]) -> Markup:
    frame = frame_of(run, tracks)
    keys = _keys(run) if "seen_s" in run.truth.arrays else Markup()
    drawn = _drawing(run, frame, tracks, hues)
    return tag("div", _choices(tracks, hues), drawn, scale(frame), keys, cls="ground")


def _choices(tracks: Sequence[Track], hues: dict[int, str]) -> Markup:
    """Let a reader choose the layers, and one vehicle; the style sheet does what is chosen."""
    boxes = [
        join(
            tag("input", type="checkbox", id=f"l-{name}", checked=True),
            tag("label", words, for_=f"l-{name}"),
        )
        for name, words in LAYERS.items()
    ]
    sysids = [track.sysid for track in tracks]
    radios = [
        join(
            tag("input", type="radio", name="who", id=f"w-{sysid}", checked=not sysid),
            tag(
                "label",
                str(sysid or "all"),
                for_=f"w-{sysid}",
                style=f"--hue:{hues[sysid]}" if sysid else None,
                title=f"vehicle {sysid} alone" if sysid else "all vehicles",
            ),
        )
        for sysid in (0, *sysids)
    ]
    return join(_alone(sysids), *boxes, tag("br"), *radios)


def _alone(sysids: Iterable[int]) -> Markup:
    """Write the rules by which a chosen vehicle is shown alone."""
    rules = "".join(
        f"#w-{sysid}:checked~.map .paths>:not(.v{sysid}){{display:none}}" for sysid in sysids
    )
    return Markup(f"<style>{rules}</style>")


def _drawing(run: Run, frame: Frame, tracks: Sequence[Track], hues: dict[int, str]) -> Markup:
    wide, high = frame.east - frame.west, frame.north - frame.south
    paths = tag("g", *path_layer(tracks, hues), cls="paths")
    return tag(
        "div",
        searched_layer(run, frame),
        tag("svg", *wall_layer(run), paths, viewBox=frame.view),
        tag("div", *end_layer(frame, tracks, hues), cls="paths"),
        tag("div", *victim_layer(frame, run, sightings(run)), cls="victims"),
        cls="map",
        style=f"aspect-ratio:{wide:.3f}/{high:.3f};--wide:{wide / high:.3f}",
    )


def _keys(run: Run) -> Markup:
    """Say what the colours of the ground mean."""
    is_volume = run.mission["planner"]["dimensions"] == 3
    seen = "searched; darker: more of its air" if is_volume else "searched; darker: earlier"
    keys = [("sq group", "", seen), ("sq missing", "", "never seen")]
    found = sightings(run)
    if found:
        keys.append(("mark found", "★", "victim, where the swarm says it lies"))
    if missed(run, found):
        keys.append(("mark missed", "✖", "victim, never found"))
    return tag(
        "div",
        *(tag("span", tag("b", sign, cls=cls), words) for cls, sign, words in keys),
        cls="keys",
    )


def _own(run: Run, frame: Frame, track: Track, hue: str) -> Markup:
    stars = [
        tag("b", "★", cls="mark found", style=frame.where(report.own_ned_m), title=words_of(one))
        for one in sightings(run)
        for report in one.reports
        if report.sysid == track.sysid
    ]
    drawing = tag("svg", *path_layer([track], {track.sysid: hue}), viewBox=frame.view)
    ends = end_layer(frame, [track], {track.sysid: hue})
    return tag(
        "div",
        tag("h3", f"vehicle {track.sysid}"),
        tag("div", drawing, *ends, *stars, cls="map", style="aspect-ratio:1"),
        scale(frame),
    )
