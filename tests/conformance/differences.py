"""Where the mock is known to differ from the recordings, and why."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

from compare import Comparison

NOT_YET = Path(__file__).parent / "not_yet.json"
"""Differences that wait for a service of the mock: kinds by suite, written by report.py."""


class Known(NamedTuple):
    """Differences that stay."""

    suites: str
    """Pattern of personality/suite."""
    kinds: str
    """Pattern of the difference in words."""
    reason: str


KNOWN: tuple[Known, ...] = ()


def reason(suite: str, kind: str) -> str | None:
    """Say why a difference stays, or None."""
    for known in KNOWN:
        if fnmatchcase(suite, known.suites) and fnmatchcase(kind, known.kinds):
            return known.reason
    return None


def waiting() -> dict[str, list[str]]:
    """Read the differences that wait, by suite."""
    listed: dict[str, list[str]] = json.loads(NOT_YET.read_text("utf-8"))
    return listed


def unexplained(comparison: Comparison) -> Mapping[str, int]:
    """Count the kinds of differences that no reason explains."""
    kinds = Counter(difference.kind for difference in comparison.differences)
    return {kind: n for kind, n in kinds.items() if reason(comparison.suite, kind) is None}


def outdated(comparisons: list[Comparison]) -> list[Known]:
    """Find the known differences that did not occur."""
    met = [(c.suite, d.kind) for c in comparisons for d in c.differences]
    return [
        known
        for known in KNOWN
        if not any(fnmatchcase(s, known.suites) and fnmatchcase(k, known.kinds) for s, k in met)
    ]
