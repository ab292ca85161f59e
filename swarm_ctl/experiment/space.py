"""The block `tune` of an experiment file: which planner parameters are searched, and where."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations_with_replacement, product
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from swarm_ctl.errors import MissionError
from swarm_ctl.experiment.cell import Cell
from swarm_ctl.experiment.specs import Experiment
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.sections import Section, cross_check, first_mistake, in_words, shown, unknown_key


class Span(Section):
    """Where one parameter is searched: between two numbers, or among choices."""

    low: float | None = None
    """Least value."""
    high: float | None = None
    """Greatest value."""
    log: bool = False
    """Whether its logarithm is searched: as many trials from 0.01 to 0.1 as from 0.1 to 1."""
    choices: Annotated[tuple[Any, ...] | None, Field(strict=False, min_length=1)] = None
    """All values that it may take; for words, and for true and false."""

    @model_validator(mode="after")
    def _is_one_of_both(self) -> Self:
        if self.choices is not None:
            given = [k for k in ("low", "high", "log") if k in self.model_fields_set]
            if given:
                raise cross_check(given[0], "does not go with choices")
            return self
        for key in ("low", "high"):
            if getattr(self, key) is None:
                raise cross_check(key, "is missing; a parameter has low and high, or choices")
        low, high = self.ends()
        if low >= high:
            raise cross_check("low", f"must be less than high ({high:g}), not {low:g}")
        if self.log and low <= 0.0:
            raise cross_check("low", f"must be more than 0 where log is true, not {low:g}")
        return self

    def ends(self) -> tuple[Any, ...]:
        """Give the values that fit if all fit."""
        return (self.low, self.high) if self.choices is None else self.choices


class Tune(Section):
    """What `swarm-ctl tune` searches."""

    objective: Literal["mean", "worst"] = "mean"
    """What is made large: the coverage on average over the cells, or of the least covered cell."""
    parameters: Annotated[dict[str, Span], Field(min_length=1)]
    """By their names in `planner`."""


def load_tune(path: Path, experiment: Experiment) -> Tune:
    """Check the block `tune` of an experiment read from `path`; MissionError in one sentence."""
    block = experiment.tune
    if block is None:
        reason = "is missing; it names what to tune, as `parameters: {inertia: {low: 0.3, ...}}`"
        raise MissionError(path, "tune", reason)
    if not isinstance(block, Mapping):
        raise MissionError(path, "tune", f"must be a block of keys, not {shown(block)}")
    try:
        tune = Tune.model_validate(block)
    except ValidationError as error:
        raise _mission_error(path, first_mistake(error)) from None
    for name, span in tune.parameters.items():
        _check_values(path, name, span)
    for values in _corners(tune):
        with_planner(path, experiment, values)
    return tune


def whole(name: str) -> bool:
    """Tell whether a parameter is a whole number."""
    return int in _kinds(name)


def with_planner(path: Path, experiment: Experiment, values: Mapping[str, Any]) -> Experiment:
    """Put values into the planner of every cell; MissionError if they do not go together."""
    cells = []
    for cell in experiment.cells:
        own = cell.planner.model_dump(exclude_unset=True)
        given = {key: value for key, value in cell if key in cell.model_fields_set}
        try:
            changed = Cell.model_validate({**given, "planner": {**own, **values}})
        except ValidationError as error:
            detail = first_mistake(error)
            key = str(detail.get("ctx", {}).get("key", ""))
            said = f"{key} {in_words(detail, _unknown)}".strip()
            such = ", ".join(f"{name} {shown(value)}" for name, value in values.items())
            reason = f"{said}; this would be so in cell {cell.name!r} with {such}"
            raise MissionError(path, "tune.parameters", reason) from None
        cells.append(changed)
    return experiment.model_copy(update={"cells": tuple(cells)})


def _check_values(path: Path, name: str, span: Span) -> None:
    """Refuse an unknown parameter, and values that it cannot take."""
    key = f"tune.parameters.{name}"
    if name not in PlannerParams.model_fields:
        raise MissionError(path, key, _nearest(name, PlannerParams))
    if span.choices is None and not _kinds(name):
        raise MissionError(path, f"{key}.low", f"{name} is no number; name its choices")
    keys = ("low", "high") if span.choices is None else ("choices",) * len(span.choices)
    for where, value in zip(keys, span.ends(), strict=True):
        try:
            PlannerParams.model_validate({name: value})
        except ValidationError as error:
            own = [detail for detail in error.errors() if detail["loc"][:1] == (name,)]
            if own:  # else it is about another one: the corners tell
                reason = in_words(own[0], _unknown)
                raise MissionError(path, f"{key}.{where}", reason) from None


def _kinds(name: str) -> set[type]:
    """Tell which numbers a parameter may be; none for words, and for true and false."""
    annotation = PlannerParams.model_fields[name].annotation
    return {int, float} & {annotation, *get_args(annotation)}


def _corners(tune: Tune) -> Iterator[dict[str, Any]]:
    """Give for every two parameters all pairs of their ends, with the others at their first.

    What goes together here does so inside: no rule of a planner is about more than two.
    """
    ends = {name: span.ends() for name, span in tune.parameters.items()}
    first = {name: values[0] for name, values in ends.items()}
    for one, other in combinations_with_replacement(ends, 2):
        for pair in product(ends[one], ends[other]):
            yield first | dict(zip((one, other), pair, strict=True))


def _mission_error(path: Path, detail: ErrorDetails) -> MissionError:
    key = str(detail.get("ctx", {}).get("key", ""))
    loc = ["tune", *map(str, detail["loc"]), *([key] if key else [])]
    return MissionError(path, ".".join(loc), in_words(detail, _unknown))


def _unknown(loc: Sequence[int | str]) -> str:
    return _nearest(str(loc[-1]), Tune if len(loc) == 1 else Span)


def _nearest(name: str, model: type[Section | PlannerParams]) -> str:
    fields = model.model_fields
    return unknown_key(name, [{field: field for field in fields}], fields)
