"""Experiment files: what is compared, in which world, and what the paper says came of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, Field, ValidationError, model_validator

from swarm_ctl.errors import MissionError
from swarm_ctl.experiment.cell import Cell, Energy, Paper, case_of
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.sections import (
    Section,
    cross_check,
    first_mistake,
    in_words,
    read_yaml,
    shown,
    unknown_key,
)


class Experiment(Section):
    """Cells, and how often each is tried."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=60)
    """Short name; the file's own if left out."""
    description: str = ""
    """What the experiment shows, above its table."""
    trials: int = Field(default=20, ge=1, le=1_000_000)
    """Trials of each cell. "We conducted 20 trial simulations"."""
    seed: int = Field(default=1, ge=0, lt=2**63)
    """Seed of every draw; trial t has the same starts in all cells."""
    sample_s: float = Field(default=60.0, gt=0.0)
    """Time between two counts of the coverage, s."""
    pictures: bool = True
    """Whether to draw the paths of a typical trial of each cell."""
    cells: Annotated[tuple[Cell, ...], Field(strict=False, min_length=1)]
    """The configurations, in the order of the table."""
    tune: Any = None
    """What `swarm-ctl tune` searches, and checks (`space.py`)."""

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        names = [cell.name for cell in self.cells]
        for index, name in enumerate(names):
            if name in names[:index]:
                raise cross_check(f"cells.{index}.name", f"{name!r} is the name of an earlier cell")
        return self


def load_experiment(
    path: Path, *, trials: int | None = None, seed: int | None = None
) -> Experiment:
    """Read and check an experiment file; what is not None replaces the file's own value.

    Keys under `defaults` hold for every cell that does not set them, also key by key within
    `planner` and the other blocks. MissionError names file, key and reason in one sentence.
    """
    raw = read_yaml(path, "an experiment is a block of lines like `trials: 20`")
    raw.setdefault("name", path.stem)
    raw.update({k: v for k, v in {"trials": trials, "seed": seed}.items() if v is not None})
    defaults = raw.pop("defaults", None) or {}
    if not isinstance(defaults, Mapping):
        raise MissionError(path, "defaults", f"must be a block of keys, not {shown(defaults)}")
    own = raw.get("cells")
    if isinstance(own, list):
        raw["cells"] = [_placed(_merged(defaults, cell), path) for cell in own]
    try:
        experiment = Experiment.model_validate(raw)
    except ValidationError as error:
        raise _mission_error(path, error, own) from None
    for index, cell in enumerate(experiment.cells):
        case_of(cell, experiment.sample_s, path, f"cells.{index}")
    return experiment


def _merged(defaults: Mapping[str, Any], cell: Any) -> Any:
    """Lay a cell over the defaults, block by block."""
    if not isinstance(cell, Mapping):
        return cell
    blocks = {
        key: _merged(value, cell[key])
        for key, value in defaults.items()
        if isinstance(value, Mapping) and isinstance(cell.get(key), Mapping)
    }
    return {**defaults, **cell, **blocks}


def _placed(cell: Any, path: Path) -> Any:
    """Make the path of a cell's world relative to the experiment file."""
    if isinstance(cell, dict) and isinstance(cell.get("world"), str):
        return {**cell, "world": (path.parent / cell["world"]).resolve()}
    return cell


def _mission_error(path: Path, error: ValidationError, own: Any) -> MissionError:
    """Pick the first mistake, an unknown key before its consequences, and say it plainly.

    `own` are the cells before the defaults were laid under them.
    """
    detail = first_mistake(error)
    loc = [str(part) for part in detail["loc"]]
    if (key := str(detail.get("ctx", {}).get("key", ""))).startswith("cells."):
        return MissionError(path, key, in_words(detail, _unknown_key))
    loc += key.split(".") if key else []
    cell, inside = detail["loc"][1:2], loc[2:]
    if detail["type"] != "missing" and inside and not _holds(own[cell[0]], inside):
        loc = ["defaults", *inside]
    return MissionError(path, ".".join(loc), in_words(detail, _unknown_key))


def _holds(block: Any, keys: Sequence[str]) -> bool:
    """Tell whether a block says something of its own under the keys, or where they lead."""
    for key in keys:
        if not isinstance(block, Mapping):
            break
        if key not in block:
            return False
        block = block[key]
    return True


_BLOCKS: dict[str, type[BaseModel]] = {"planner": PlannerParams, "energy": Energy, "paper": Paper}


def _unknown_key(loc: Sequence[int | str]) -> str:
    """Name the nearest key: of the same block first, then of any other."""
    *block, last = (str(part) for part in loc)
    here: type[BaseModel] = _BLOCKS.get(block[-1], Cell) if block else Experiment
    places = [
        {name: f"{prefix}{name}" for name in model.model_fields}
        for prefix, model in (("", here), *_places())
    ]
    return unknown_key(last, places, here.model_fields)


def _places() -> Iterator[tuple[str, type[BaseModel]]]:
    yield "defaults.", Cell
    for name, model in _BLOCKS.items():
        yield f"defaults.{name}.", model
    yield "", Experiment
