"""Count what flows by itself, and compare with what the real vehicles send."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from collections.abc import Set as AbstractSet
from typing import Any

from compare import Comparison, Difference
from replay import Mock
from transcript import HERE, RATES, Said, once

TOLERANCE = 0.1
"""Relative; and one message more or less in the time of the recording."""
GROUND_STATION = ("HEARTBEAT", {"type": 6, "autopilot": 8, "mavlink_version": 3})
"""What a client says that asks for nothing."""


def compare_rates(personality: str) -> Comparison:
    """Repeat every measurement of rates with one mock per link."""
    cases = json.loads((HERE / personality / f"{RATES}.json").read_text("utf-8"))
    mocks: dict[int, Mock] = {}
    differences: list[Difference] = []
    for case in cases:
        mock = mocks.setdefault(case["link"], Mock(personality, case["link"]))
        for name in once(personality):
            case["hz"].pop(name, None)
        differences += _differences(case, _counted(mock, case, once(personality)))
    rates = sum(len(case["hz"]) for case in cases)
    asked = sum(case["start"] is not None for case in cases)
    wrong = sum("not recorded" not in difference.kind for difference in differences)
    return Comparison(f"{personality}/{RATES}", asked, rates, rates - wrong, differences)


def _counted(mock: Mock, case: dict[str, Any], left_out: AbstractSet[str]) -> dict[str, float]:
    """Listen to the mock as long as the recording took, and give messages per second."""
    from_s, span_s = case["from_s"], case["span_s"]
    mock.fly(from_s - 0.5)
    mock.send(Said(from_s - 0.5, *(case["start"] or GROUND_STATION)))
    mock.fly(from_s)
    heard = Counter(said.name for said in mock.fly(from_s + span_s))
    if case["stop"]:
        mock.send(Said(from_s + span_s, *case["stop"]))
    return {name: count / span_s for name, count in heard.items() if name not in left_out}


def _differences(case: dict[str, Any], heard: dict[str, float]) -> Iterator[Difference]:
    once_hz = 1.0 / case["span_s"]
    whole = case["start"] is None or case["stop"] is not None  # everything that flowed was noted
    for name in sorted({*case["hz"], *(heard if whole else ())}):
        theirs, ours = case["hz"].get(name, 0.0), heard.get(name, 0.0)
        if abs(theirs - ours) > TOLERANCE * theirs + once_hz + 1e-9:
            words = f"recorded {theirs:g} Hz, mock {ours:g} Hz" if theirs else "not recorded"
            yield Difference(case["from_s"], f"{name}: {words}", case["case"])
