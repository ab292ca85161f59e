"""A scenario that breaks a promise made as small as it can be and still break it."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

from pydantic import ValidationError

from swarm_ctl.errors import SwarmError
from swarm_ctl.experiment.soak.flight import Outcome, fly
from swarm_ctl.experiment.soak.scenario import Scenario

MOST_FLIGHTS = 150
"""After which the smallest one so far is good enough."""
SHORTEST_S = 2.0
_LISTS = (
    ("", "faults"),
    ("", "orders"),
    ("", "takeovers"),
    ("world", "walls"),
    ("world", "boxes"),
    ("world", "cylinders"),
)
"""What has entries that may not be needed."""
_CALM: tuple[tuple[str, str, Any], ...] = (
    ("world", "sensors", {}),
    ("world", "wind", {}),
    ("world", "victims", []),
    ("mission", "frame", {}),
    ("mission", "autopilot", "px4"),
)
"""What a quiet day has."""

Keys = dict[str, Any]


def shrink(
    scenario: Scenario, invariant: str, told: Callable[[int], None] = lambda _: None
) -> tuple[Scenario, Outcome]:
    """Take away what is not needed to break the same promise; `told` hears of every flight.

    Greedy: a change that keeps the promise broken stays, and all are tried again after it.
    """
    outcome, flights = fly(scenario), 1
    is_smaller = True
    while is_smaller and flights < MOST_FLIGHTS:
        is_smaller = False
        for keys in edits(scenario.keys()):
            if flights >= MOST_FLIGHTS or (smaller := _scenario(keys)) is None:
                continue
            tried, flights = fly(smaller), flights + 1
            told(flights)
            if tried.violation is not None and tried.violation.invariant == invariant:
                scenario, outcome, is_smaller = smaller, tried, True
                break
    return scenario, outcome


def edits(keys: Keys) -> Iterator[Keys]:
    """Give smaller scenarios, the boldest first; some may be none that can be flown."""
    vehicles, duration_s = keys["mission"]["vehicles"], keys["mission"]["duration_s"]
    if vehicles > 1:
        yield from (_without(keys, sysid) for sysid in range(vehicles, 0, -1))
    for block, name in _LISTS:
        for index in range(len(_in(keys, block).get(name, ()))):
            new = copy.deepcopy(keys)
            _in(new, block)[name].pop(index)
            yield new
    for block, name, value in _CALM:
        if _in(keys, block).get(name, value) != value:
            yield _set(keys, block, name, value)
    radio = keys["world"].get("radio", {})
    if len(radio) > 1:
        yield _set(keys, "world", "radio", {k: v for k, v in radio.items() if k == "radius_m"})
    if duration_s > SHORTEST_S:
        yield _set(keys, "mission", "duration_s", round(duration_s / 2.0, 1))


def _scenario(keys: Keys) -> Scenario | None:
    try:
        scenario = Scenario.model_validate(keys)
    except (ValidationError, SwarmError):
        return None
    return scenario


def _in(keys: Keys, block: str) -> Keys:
    return keys[block] if block else keys


def _set(keys: Keys, block: str, name: str, value: Any) -> Keys:
    return {**keys, block: {**keys[block], name: value}}


def _without(keys: Keys, gone: int) -> Keys:
    """Take a vehicle out, with all that is about it; those behind it move up."""
    new = copy.deepcopy(keys)
    new["mission"]["vehicles"] -= 1
    starts = new["world"].get("starts")
    if isinstance(starts, list):
        starts.pop(gone - 1)
    places = new["mission"].get("frame", {}).get("starts_m")
    if places:
        kept = [place for sysid, place in sorted(places.items(), key=_number) if int(sysid) != gone]
        new["mission"]["frame"]["starts_m"] = dict(enumerate(kept, start=1))
    faults = [_renumbered(text, gone) for text in new.get("faults", ())]
    new["faults"] = [text for text in faults if text]
    for name in ("orders", "takeovers"):
        acts = [act for act in new.get(name, ()) if act.get("sysid") != gone]
        for act in acts:
            if (act.get("sysid") or 0) > gone:
                act["sysid"] -= 1
        new[name] = acts
    return new


def _number(item: tuple[Any, Any]) -> int:
    return int(item[0])


def _renumbered(text: str, gone: int) -> str:
    """Let a fault strike the same vehicle by its new number; empty when that one is gone."""
    head, at, rest = text.partition("@")
    kind, colon, sysid = head.partition(":")
    if not colon or int(sysid) < gone:
        return text
    return "" if int(sysid) == gone else f"{kind}:{int(sysid) - 1}{at}{rest}"
