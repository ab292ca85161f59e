"""Replay every recording with the mock: report.py [--accept] [SUITE ...].

Prints how many answers are equal, and every difference. `--accept` writes docs/conformance.md.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from compare import Comparison, compare
from differences import KNOWN, known, topics, unexplained, unmet
from malformed import compare_malformed
from rates import compare_rates
from replay import replay
from transcript import MALFORMED, RATES, scripts

PAGE = Path(__file__).parents[2] / "docs" / "conformance.md"
PERSONALITIES = ("ardupilot", "px4")
OTHERS = {RATES: compare_rates, MALFORMED: compare_malformed}
SUITES = (*(s.name for s in scripts()), *(f"{p}/{name}" for name in OTHERS for p in PERSONALITIES))

HEAD = """# Conformance

What clients and two real autopilots, ArduCopter 4.7 and PX4 1.17 in their simulators, said to each
other was recorded (`tests/conformance/*/*.json`). `tests/conformance` sends the recorded requests
to the mock at their recorded times, in virtual time, and compares its answers with the recorded
ones, field by field; `rules.py` there says which fields are noise. Any difference that is not
listed here fails the tests, and so does a listed one that is gone. This page is written by
`python tests/conformance/report.py --accept`.

{equal} of {answers} answers are equal. The last column names the differences that stay and how
many there are (an answer may have several, and some are answers too many); the list below says
why.

| suite | requests | answers | equal | what differs |
|---|---:|---:|---:|---|
"""
TAIL = """

One recording is not replayed: NaN or infinity in some commands and setpoints kills the recorded
ArduPilot. The mock refuses such a command, stops at such a setpoint, and lives on.
"""


def compared(suite: str) -> Comparison:
    """Replay one suite."""
    personality, _, name = suite.partition("/")
    if name in OTHERS:
        return OTHERS[name](personality)
    script = next(script for script in scripts() if script.name == suite)
    return compare(script, replay(script))


def row(c: Comparison) -> str:
    """Write a suite's row of the table."""
    rest = ", ".join(f"{topic} {n}" for topic, n in sorted(topics(c).items()))
    return f"| {c.suite} | {c.requests} | {c.answers} | {c.equal} | {rest} |"


def rows_of(text: str) -> list[str]:
    """Find the rows of the suites in the page."""
    return [line for line in text.splitlines() if re.match(r"\| \w+/\w+ \|", line)]


def page(rows: Sequence[str]) -> str:
    """Write docs/conformance.md around the rows of its table."""
    numbers = [[int(cell) for cell in line.split(" | ")[1:4]] for line in rows]
    requests, answers, equal = (sum(column) for column in zip(*numbers, strict=True))
    total = f"| **all** | **{requests}** | **{answers}** | **{equal}** | |"
    reasons = "\n".join(f"- **{k.topic}** ({_count(rows, k.topic)}): {k.reason}" for k in KNOWN)
    head = HEAD.format(answers=answers, equal=equal)
    table = "\n".join([*rows, total])
    return f"{head}{table}\n\n## What differs, and why\n\n{reasons}{TAIL}"


def _count(rows: Iterable[str], topic: str) -> int:
    """Add a topic's numbers up over all rows."""
    found = (re.search(rf"[|,] {re.escape(topic)} (\d+)", line) for line in rows)
    return sum(int(match[1]) for match in found if match)


def listing(comparison: Comparison) -> str:
    """Tell the differences of one suite, equal ones counted."""
    c = comparison
    lines = [f"## {c.suite}: {c.requests} requests, {c.answers} answers, {c.equal} equal"]
    for kind, n in sorted(Counter(d.kind for d in c.differences).items()):
        first = next(d for d in c.differences if d.kind == kind)
        entry = known(c.suite, kind)
        why = entry.topic if entry else "NEW"
        lines.append(f"{n:5} x {kind}  [{first.at_s:.2f} s, after {first.request}]: {why}")
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> None:
    """Print the comparison of the suites named, or of all."""
    wanted = [argument for argument in arguments if not argument.startswith("--")]
    named = [suite for suite in SUITES if not wanted or any(w in suite for w in wanted)]
    comparisons = [compared(suite) for suite in named]
    for comparison in comparisons:
        print(listing(comparison))  # noqa: T201 - a command
    answers, equal = (sum(getattr(c, n) for c in comparisons) for n in ("answers", "equal"))
    print(f"{answers} answers compared, {equal} equal")  # noqa: T201 - a command
    new = sum(unexplained(c).total() for c in comparisons)
    gone = [] if wanted else unmet(comparisons)
    print(f"{new} differences without a reason; reasons without a difference: {gone}")  # noqa: T201
    if "--accept" in arguments and not (wanted or new or gone):
        PAGE.write_text(page([row(c) for c in comparisons]), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
