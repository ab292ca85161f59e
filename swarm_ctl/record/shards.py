"""The records of a world's shards as one: what all have seen together, summary and pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.errors import SwarmError
from swarm_ctl.record.contacts import CONTACT_FIGURES
from swarm_ctl.record.plots import draw_pictures
from swarm_ctl.record.reader import Run, telling_what_is_damaged
from swarm_ctl.record.report import REPORT, try_report
from swarm_ctl.record.spread import SPREAD_FIGURES
from swarm_ctl.record.summary import write_summary
from swarm_ctl.record.truth import Truth, read_truth

_ALIKE = ("world", "seed", "planner", "autopilot", "mode")
_SUMS = (
    "vehicles",
    "collisions",
    "path_length_m",
    "energy_kwh",
    "mock_dropped",
    "messages_sent",
    "messages_received",
    "messages_lost",
    "datagrams_unsent",
    "datagrams_unheard",
)
_WORST = (
    "duration_s",
    "exploration_s",
    "wall_s",
    "setpoint_jitter_p99_ms",
    "setpoint_late_fraction",
    "mock_late_fraction",
)
_UNKNOWN = ("redundant_fraction", "vehicles_per_cell", *CONTACT_FIGURES, *SPREAD_FIGURES)
"""What no shard can tell, for it knows of its own vehicles' ways alone."""
_SHOWN = ("vehicles", "outcome", "collisions", "min_separation_m", "setpoint_late_fraction")


def join_shards(folder: Path, name: str, shards: Sequence[Path]) -> dict[str, Any]:
    """Join the run folders of shards into one above them; give its summary.

    It becomes a run folder itself, of all vehicles, with pictures and a report; only telemetry logs
    stay where they are, and groups of vehicles, whose sysids repeat, are not told of one by one.
    A shard that left no summary is noted.
    """
    summaries: list[dict[str, Any]] = []
    told: list[dict[str, Any]] = []
    notes: list[str] = []
    for number, shard in enumerate(shards, start=1):
        try:
            summaries.append(json.loads((shard / "summary.json").read_text(encoding="utf-8")))
        except (OSError, ValueError):
            notes.append(f"shard {number} left no summary")
            continue
        notes += [f"shard {number}: {note}" for note in summaries[-1]["notes"]]
        told.append({"folder": shard.name, **{key: summaries[-1][key] for key in _SHOWN}})
    truth = _join_truths([read_truth(shard) for shard in shards])
    outcomes = {"failed"} if len(summaries) < len(shards) else {one["outcome"] for one in summaries}
    outcome = next(o for o in ("interrupted", "failed", "flown") if o in outcomes)
    summary = {
        "mission": name,
        "outcome": outcome,
        **{key: summaries[0][key] if summaries else None for key in _ALIKE},
        **{key: _over(summaries, key, sum) for key in _SUMS},
        **{key: _over(summaries, key, max) for key in _WORST},
        "min_separation_m": _over(summaries, "min_separation_m", min),
        "coverage_fraction": truth.numbers.get("coverage_fraction"),
        "coverage_final_fraction": truth.numbers.get("coverage_fraction"),
        "victims_found": truth.numbers.get("victims_found"),
        "victims_total": truth.numbers.get("victims_total"),
        **dict.fromkeys(_UNKNOWN),
        "notes": notes,
        "shards": told,
    }
    if truth.arrays:
        _write_truth(folder / "truth", truth)
        summary["notes"] += draw_pictures(folder, summary)
    summary["notes"] += _tell_of_each(folder, shards, summary, summaries)
    write_summary(folder, summary)
    return summary


def join_records(folder: Path) -> dict[str, Any]:
    """Join the run folders of shards that lie in a folder; give its summary.

    Raises SwarmError when there are none, or when they do not belong together.
    """
    found: dict[int, tuple[Path, dict[str, Any]]] = {}
    for path in sorted(folder.glob("*/mission.json")):
        try:
            started = json.loads(path.read_text(encoding="utf-8"))
            number = int(started["shard"]["number"])
        except (OSError, ValueError, LookupError, TypeError):
            continue
        if number in found:
            before = found[number][0].name
            raise SwarmError(f"{path.parent}: is shard {number}, and so is {before}")
        found[number] = path.parent, started
    if not found:
        raise SwarmError(
            f"{folder}: has no folder with the record of a shard; copy those of all shards into it"
        )
    with telling_what_is_damaged(folder):
        (first, of), *others = found.values()
        for path, started in others:
            if _world_of(started) != _world_of(of):
                raise SwarmError(f"{path}: is of another mission than {first.name}")
        name = str(of["mission"]["name"]).removesuffix(f"-group{of['shard']['group']}")
        paths = {number: path for number, (path, _) in found.items()}
        numbers = range(1, of["shard"]["of"] + 1)
        shards = [paths.get(number, folder / f"shard{number}") for number in numbers]
        return join_shards(folder, name, shards)


def _world_of(started: Mapping[str, Any]) -> dict[str, Any]:
    """Give what is the same for all shards of a world."""
    mission = {key: value for key, value in started["mission"].items() if key != "name"}
    return {"mission": mission, "seed": started["seed"], "shards": started["shard"]["of"]}


def _tell_of_each(
    folder: Path,
    shards: Sequence[Path],
    summary: dict[str, Any],
    summaries: Sequence[Mapping[str, Any]],
) -> list[str]:
    """Write mission, events, paths and report of all vehicles; give a note if there is none."""
    try:
        runs = [Run.read(shard) for shard in shards if (shard / "mission.json").exists()]
    except SwarmError as error:
        return [f"no {REPORT}: {error}"]
    if not runs:
        return [f"no {REPORT}: no shard left its mission"]
    sysids = [sysid for run in runs for sysid in run.sysids]
    if len(set(sysids)) < len(sysids):
        return [f"no {REPORT}: vehicles of several groups share sysids; each shard has its own"]
    summary["per_vehicle"] = [vehicle for one in summaries for vehicle in one["per_vehicle"]]
    started = {**runs[0].started, "shards": len(shards)}
    started.pop("shard", None)
    (folder / "mission.json").write_text(json.dumps(started, indent=2) + "\n", encoding="utf-8")
    entries = [entry for run in runs for entry in run.entries if "sysid" in entry or run is runs[0]]
    entries.sort(key=lambda entry: entry.get("time_s", -math.inf))
    lines = "".join(json.dumps(entry) + "\n" for entry in entries)
    (folder / "events.jsonl").write_text(lines, encoding="utf-8")
    paths = {"vehicles": [path for run in runs for path in run.paths]}
    (folder / "paths.json").write_text(json.dumps(paths) + "\n", encoding="utf-8")
    return try_report(folder, summary)


def _over(
    summaries: Sequence[Mapping[str, Any]], key: str, join: Callable[[list[Any]], Any]
) -> Any:
    """Join what is known of a figure; None where nobody knows it."""
    known = [one[key] for one in summaries if one[key] is not None]
    return join(known) if known else None


def _join_truths(truths: Sequence[Truth]) -> Truth:
    """Add up what the referees of all shards saw; an empty Truth unless all left theirs."""
    if not truths or not all("volume_seen_s" in truth.arrays for truth in truths):
        return Truth()
    parts = [truth.arrays for truth in truths]
    seen_s = np.fmin.reduce([part["volume_seen_s"] for part in parts])
    free = np.logical_or.reduce([part["volume_free"] for part in parts])  # from anybody's start
    times_s = max((part["coverage_time_s"] for part in parts), key=len)
    share = np.searchsorted(np.sort(seen_s[free]), times_s, side="right") / max(free.sum(), 1)
    found_s = np.fmin.reduce([part["victim_found_s"] for part in parts])
    track_s = max((part["track_time_s"] for part in parts), key=len)
    seen_fraction = np.isfinite(seen_s).sum(axis=0) / np.maximum(free.sum(axis=0), 1)
    arrays = {
        **{key: parts[0][key] for key in ("blocked", "cell_m", "origin_ne_m", "victims_ned_m")},
        "free": free.any(axis=0),
        "track_time_s": track_s,
        "track_ned_m": np.concatenate([_track(part, track_s) for part in parts], axis=1),
        "sysids": np.concatenate([part["sysids"] for part in parts]),
        "starts_ned_m": np.concatenate([part["starts_ned_m"] for part in parts]),
        "coverage_time_s": times_s,
        "coverage_fraction": share,
        "seen_s": np.fmin.reduce(seen_s, axis=0),
        "seen_fraction": seen_fraction,
        "victim_found_s": found_s,
    }
    numbers = {
        "coverage_fraction": round(float(np.isfinite(seen_s[free]).mean()), 6),
        "victims_found": int(np.isfinite(found_s).sum()),
        "victims_total": len(found_s),
        "sight_radius_m": truths[0].numbers.get("sight_radius_m"),
    }
    return Truth(numbers, arrays, truths[0].world)


def _track(part: Mapping[str, NDArray[Any]], times_s: NDArray[Any]) -> NDArray[Any]:
    """Tell where a shard's vehicles were at times of another one's clock, (times, vehicles, 3)."""
    own_s, track = part["track_time_s"], part["track_ned_m"]
    if not len(own_s):
        return np.full((len(times_s), *track.shape[1:]), math.nan)
    rows = np.searchsorted(own_s, times_s + 1e-6, side="right") - 1
    where: NDArray[Any] = track[np.clip(rows, 0, len(own_s) - 1)]
    return where


def _write_truth(folder: Path, truth: Truth) -> None:
    folder.mkdir(exist_ok=True)
    np.savez_compressed(folder / "truth.npz", allow_pickle=False, **truth.arrays)
    for name, values in (("truth.json", truth.numbers), ("world.json", truth.world)):
        (folder / name).write_text(json.dumps(values) + "\n", encoding="utf-8")
