"""What the referee saw, as it lies in the run folder; it may be missing in part or at all."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Truth:
    """The referee's files; what could not be read is empty, and a note says so."""

    numbers: dict[str, Any] = field(default_factory=dict)
    """`truth.json`: coverage, victims, contacts, energy."""
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)
    """`truth.npz`: tracks, coverage over time, maps, victims."""
    world: dict[str, Any] = field(default_factory=dict)
    """`world.json`: bounds and the outlines of walls."""
    notes: tuple[str, ...] = ()


def read_truth(run: Path) -> Truth:
    """Read `truth/` of a run folder, as much as there is."""
    folder = run / "truth"
    numbers, arrays, world = (
        _json(folder / "truth.json"),
        _npz(folder / "truth.npz"),
        _json(folder / "world.json"),
    )
    notes = []
    if numbers is None and arrays is None:
        notes.append("the referee left no truth: coverage, victims and contacts are unknown")
    elif numbers is None:
        notes.append("the referee's totals (truth/truth.json) are missing or torn")
    elif arrays is None:
        notes.append("the referee's tracks (truth/truth.npz) are missing or torn")
    return Truth(numbers or {}, arrays or {}, world or {}, tuple(notes))


def _json(path: Path) -> dict[str, Any] | None:
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return value if isinstance(value, dict) else None


def _npz(path: Path) -> dict[str, NDArray[Any]] | None:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        return None
