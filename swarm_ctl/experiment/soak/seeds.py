"""Many seeds on several processes, a line of a file for each, so that a run can go on later."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any

from swarm_ctl.errors import SwarmError, plain
from swarm_ctl.experiment.pool import processes
from swarm_ctl.experiment.soak.draw import draw
from swarm_ctl.experiment.soak.flight import Outcome, Violation, fly
from swarm_ctl.experiment.source import code_hash

CHUNK = 8
"""Seeds in a job: half a minute's work at most, which Ctrl-C waits for."""
SLOWEST = 3


def soak(
    seeds: range,
    *,
    workers: int | None = None,
    out: Path | None = None,
    hashed: bool = False,
    progress: Callable[[int, int, int], None] = lambda *_: None,
) -> tuple[list[Outcome], bool]:
    """Fly seeds; give what came of them, in order, and whether Ctrl-C ended it early.

    Seeds that `out` tells to have kept every promise are not flown again by the same code, which
    its lines name. `progress` is called
    with seeds done, seeds in all, and how many of them failed.
    """
    known = _read(out, seeds, hashed=hashed) if out else {}
    jobs = _chunks([seed for seed in seeds if seed not in known])
    count = min(workers or os.cpu_count() or 1, max(1, len(jobs)))
    run = partial(fly_seeds, hashed=hashed)
    is_interrupted = False
    with processes(count, run) as compute, _appended(out) as file:
        try:
            for _, outcomes in compute(jobs):
                for outcome in outcomes:
                    known[outcome.seed] = outcome
                    if file is not None:
                        file.write(json.dumps(outcome.keys()) + "\n")
                        file.flush()
                failed = sum(one.violation is not None for one in known.values())
                progress(len(known), len(seeds), failed)
        except KeyboardInterrupt:
            is_interrupted = True
    return [known[seed] for seed in sorted(known)], is_interrupted


def fly_seeds(seeds: Sequence[int], *, hashed: bool) -> list[Outcome]:
    """Fly a few seeds one after another."""
    return [fly(draw(seed), hashed=hashed) for seed in seeds]


def summary_lines(outcomes: Sequence[Outcome]) -> list[str]:
    """Sum up: seeds, broken promises, robot-hours, the closest approach, the slowest seeds."""
    hours = sum(one.vehicles * one.time_s for one in outcomes) / 3600.0
    failed = sum(one.violation is not None for one in outcomes)
    met = [(one.closest_m, one.seed) for one in outcomes if one.closest_m is not None]
    slowest = sorted(outcomes, key=lambda one: -one.cpu_s)[:SLOWEST]
    lines = [
        f"{len(outcomes)} seeds, {failed} with a broken promise",
        f"{hours:.1f} robot-hours in {sum(one.cpu_s for one in outcomes) / 60.0:.1f} CPU-minutes",
    ]
    if met:
        closest_m, seed = min(met)
        lines.append(f"closest approach {closest_m:.2f} m (seed {seed})")
    if slowest:
        told = ", ".join(f"{one.seed} ({one.cpu_s:.1f} s)" for one in slowest)
        lines.append(f"slowest seeds {told}")
    return lines


def _chunks(seeds: Sequence[int]) -> list[Sequence[int]]:
    return [seeds[at : at + CHUNK] for at in range(0, len(seeds), CHUNK)]


def _appended(out: Path | None) -> Any:
    if out is None:
        return nullcontext()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        return out.open("a", encoding="utf-8")
    except OSError as error:
        raise SwarmError(f"--out {out}: cannot be written: {plain(error)}") from None


def _read(out: Path, seeds: range, *, hashed: bool) -> dict[int, Outcome]:
    """Read the seeds that need not be flown again; a line torn by a kill is left out."""
    if not out.exists():
        return {}
    found = (_outcome(line) for line in _lines(out))
    return {
        one.seed: one
        for one in found
        if one is not None
        and one.seed in seeds
        and one.violation is None
        and one.code == code_hash()
        and bool(one.run_sha256) >= hashed
    }


def _lines(out: Path) -> Iterable[str]:
    try:
        return out.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        raise SwarmError(f"--out {out}: is no file of results that could be gone on with") from None


def _outcome(line: str) -> Outcome | None:
    try:
        keys = json.loads(line)
        violation = keys.pop("violation")
        return Outcome(**keys, violation=Violation(**violation) if violation else None)
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
