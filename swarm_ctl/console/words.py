"""Events of a run folder in a few words, as an operator reads them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

QUIET = frozenset({"ContactsChanged", "VictimHeard", "RunStarted", "RunResumed", "CommandProgress"})
"""Events that are drawn or counted, and would flood a log."""

_WORDS: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "PhaseChanged": lambda data: ": ".join(filter(None, (data["after"], data["reason"]))),
    "Connected": lambda data: f"connected, {data['autopilot']}",
    "VictimFound": lambda data: f"found victim {data['victim']}",
    "CommandRefused": lambda data: f"command {data['command']} refused: {data['reason']}",
    "StatusText": lambda data: str(data["text"]),
    "OperatorOrder": lambda data: f"ordered to {data['order']}",
    "OrderRefused": lambda data: f"order to {data['order']} refused",
    "PlannerFailed": lambda data: f"planner failed: {data['error']}",
}


def in_words(name: str, data: Mapping[str, Any]) -> str:
    """Say what happened; an event without words of its own is its name and its values."""
    try:
        return _WORDS[name](data)
    except (KeyError, TypeError):
        told = ", ".join(f"{key} {value}" for key, value in data.items())
        return f"{_spaced(name)}: {told}" if told else _spaced(name)


def _spaced(name: str) -> str:
    """Write `LinkLost` as `link lost`."""
    return "".join(f" {c.lower()}" if c.isupper() else c for c in name).strip()
