"""Fenced blocks of the pages in docs/ and of README.md, and the commands in them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")],
    key=lambda page: page.as_posix(),
)
NOT_RUN = re.compile(r"<!-- not run: (.+) -->")
"""Stands before a block that is not run here, with the reason."""


@dataclass(frozen=True)
class Block:
    """One fenced block."""

    language: str
    title: str
    """Name of the file that it is; empty when it is none."""
    why_not: str
    """Why it is not run; empty when it is."""
    line: int
    text: str

    @property
    def commands(self) -> Iterator[list[str]]:
        """Split a shell block into the words of each command, without comments."""
        for line in self.text.replace("\\\n", " ").splitlines():
            for part in line.split(" && "):
                if words := shlex.split(part, comments=True):
                    yield words


def blocks(page: Path) -> Iterator[Block]:
    """Read the blocks of a page, in their order."""
    lines = page.read_text(encoding="utf-8").splitlines()
    fences = [number for number, line in enumerate(lines) if line.lstrip().startswith("```")]
    for begin, end in zip(fences[::2], fences[1::2], strict=True):
        language, _, rest = lines[begin].strip().removeprefix("```").partition(" ")
        title = re.search(r'title="(.+?)"', rest)
        before = next((line for line in reversed(lines[:begin]) if line.strip()), "")
        why_not = NOT_RUN.search(before)
        yield Block(
            language,
            title[1] if title else "",
            why_not[1] if why_not else "",
            begin + 1,
            "\n".join(lines[begin + 1 : end]) + "\n",
        )
