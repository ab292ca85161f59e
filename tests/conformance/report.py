"""Replay every recording with the mock: report.py [--accept] [SUITE ...].

Prints how many answers are equal, and every difference. `--accept` writes docs/conformance.md and
the list of differences that wait.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path

from compare import Comparison, compare
from differences import NOT_YET, reason, unexplained
from rates import compare_rates
from replay import replay
from transcript import RATES, scripts

PAGE = Path(__file__).parents[2] / "docs" / "conformance.md"
PERSONALITIES = ("ardupilot", "px4")
SUITES = (*(s.name for s in scripts()), *(f"{p}/{RATES}" for p in PERSONALITIES))

HEAD = """# Conformance

What clients and two real autopilots, ArduCopter 4.7 and PX4 1.17 in their simulators, said to each
other was recorded (`tests/conformance/*/*.json`). `tests/conformance` sends the recorded requests
to the mock at their recorded times, in virtual time, and compares its answers with the recorded
ones, field by field; `rules.py` there says which fields are noise. This page is written by
`python tests/conformance/report.py --accept`.

| suite | requests | answers compared | equal |
|---|---:|---:|---:|
"""


@cache
def compared(suite: str) -> Comparison:
    """Replay one suite, once."""
    personality, _, name = suite.partition("/")
    if name == RATES:
        return compare_rates(personality)
    script = next(script for script in scripts() if script.name == suite)
    return compare(script, replay(script))


def page(comparisons: Sequence[Comparison]) -> str:
    """Write docs/conformance.md."""
    rows = [f"| {c.suite} | {c.requests} | {c.answers} | {c.equal} |" for c in comparisons]
    sums = [sum(getattr(c, n) for c in comparisons) for n in ("requests", "answers", "equal")]
    rows.append("| **all** | " + " | ".join(f"**{n}**" for n in sums) + " |")
    stays = list(_by_reason(comparisons))
    waits = [
        f"- {c.suite}: {', '.join(f'`{kind}`' for kind in sorted(unexplained(c)))}"
        for c in comparisons
        if unexplained(c)
    ]
    parts = [HEAD + "\n".join(rows)]
    parts += ["## Differences that stay\n\n" + "\n".join(stays)] if stays else []
    parts += ["## Differences that wait for a service\n\n" + "\n".join(waits)] if waits else []
    return "\n\n".join(parts) + "\n"


def _by_reason(comparisons: Iterable[Comparison]) -> Iterable[str]:
    """Give a line per reason, with how often, where and what."""
    found: dict[str, list[tuple[str, str]]] = {}
    for c in comparisons:
        for difference in c.differences:
            why = reason(c.suite, difference.kind)
            if why is not None:
                found.setdefault(why, []).append((c.suite, difference.kind))
    for why, places in sorted(found.items()):
        suites = ", ".join(sorted({suite for suite, _ in places}))
        kinds = sorted({kind for _, kind in places})
        named = ", ".join(f"`{kind}`" for kind in kinds[:3])
        more = f" and {len(kinds) - 3} more" if len(kinds) > 3 else ""
        yield f"- {why} ({len(places)} in {suites}: {named}{more})"


def listing(comparison: Comparison) -> str:
    """Tell the differences of one suite, equal ones counted."""
    c = comparison
    lines = [f"## {c.suite}: {c.requests} requests, {c.answers} answers, {c.equal} equal"]
    for kind, n in sorted(Counter(d.kind for d in c.differences).items()):
        first = next(d for d in c.differences if d.kind == kind)
        why = reason(c.suite, kind)
        stays = f" -- stays: {why}" if why else ""
        lines.append(f"{n:5} x {kind}  [{first.at_s:.2f} s, after {first.request}]{stays}")
    return "\n".join(lines)


def by_kind(comparisons: Iterable[Comparison]) -> str:
    """Count the differences that wait, of all suites together."""
    waits: Counter[str] = Counter()
    for c in comparisons:
        waits.update(unexplained(c))
    return "\n".join(f"{n:5} x {kind}" for kind, n in sorted(waits.items()))


def main(arguments: Sequence[str]) -> None:
    """Print the comparison of the suites named, or of all."""
    wanted = [argument for argument in arguments if not argument.startswith("--")]
    comparisons = [
        compared(suite) for suite in SUITES if not wanted or any(w in suite for w in wanted)
    ]
    for comparison in comparisons:
        print(listing(comparison))  # noqa: T201 - a command
    print(f"## all suites, by kind\n{by_kind(comparisons)}")  # noqa: T201 - a command
    answers, equal = (sum(getattr(c, n) for c in comparisons) for n in ("answers", "equal"))
    print(f"{answers} answers compared, {equal} equal")  # noqa: T201 - a command
    if "--accept" in arguments and not wanted:
        lists = {c.suite: sorted(unexplained(c)) for c in comparisons if unexplained(c)}
        NOT_YET.write_text(json.dumps(lists, indent=1) + "\n", "utf-8")
        PAGE.write_text(page(comparisons), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
