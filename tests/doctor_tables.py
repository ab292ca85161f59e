"""Tables of what the doctor examines; `python tests/doctor_tables.py` writes them.

They are made of the tables that it works by, into docs/doctor.md.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from swarm_ctl.doctor import ardupilot, px4
from swarm_ctl.doctor.checks import CHECKS
from swarm_ctl.doctor.diagnosis import SWARM_CHECKS
from swarm_ctl.doctor.rows import Parameter, When

PAGE = Path(__file__).parents[1] / "docs" / "doctor.md"
BEGIN, END = "<!-- tables -->\n", "<!-- end of tables -->\n"


def tables() -> str:
    """Write all tables."""
    return "\n".join(
        [
            "## What is checked",
            "",
            "Written by `python tests/doctor_tables.py` from the tables that the doctor works by.",
            "",
            *_table(["what", "severity", "counts", "advised", "why"], _checks()),
            "",
            "## Parameters of PX4",
            "",
            *_table(_PARAMETER_TITLES, _parameters(px4.PARAMETERS)),
            "",
            "## Parameters of ArduPilot",
            "",
            *_table(_PARAMETER_TITLES, _parameters(ardupilot.PARAMETERS)),
            "",
        ]
    )


_PARAMETER_TITLES = ["parameter", "good", "else", "counts", "`--fix`", "why"]


def _table(titles: list[str], rows: Iterable[list[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (titles, ["---"] * len(titles), *rows)]


def _checks() -> Iterator[list[str]]:
    for check in CHECKS:
        yield [check.name, check.severity, _counts(check.when), check.advised, check.why]
    for swarm in SWARM_CHECKS:
        yield [swarm.name, "error", "always", swarm.advised, swarm.why]


def _parameters(rows: Iterable[Parameter]) -> Iterator[list[str]]:
    for row in rows:
        names = ", ".join(f"`{name}`" for name in row.names)
        yield [names, _good(row), row.severity, _counts(row.when), _fix(row), row.why]


def _good(row: Parameter) -> str:
    def meant(found: re.Match[str]) -> str:
        meaning = row.meanings.get(int(found[0]))
        return f"{found[0]} ({meaning})" if meaning else found[0]

    words = re.sub(r"(?<![\w.-])\d+(?![\w.])", meant, row.good.words)
    return f"{words} {row.unit}" if row.unit and words[-1].isdigit() else words


def _fix(row: Parameter) -> str:
    return f"{'sets it' if row.is_safe_to_set else '-'}{'; restart' * row.needs_reboot}"


def _counts(whens: Iterable[When]) -> str:
    return ", ".join(when.words for when in whens) or "always"


def page() -> str:
    """Put the tables into the page."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    return before + BEGIN + tables() + END + after


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
