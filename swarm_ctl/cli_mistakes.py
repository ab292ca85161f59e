"""Mistakes in what was typed, in one sentence each."""

from __future__ import annotations

import difflib
from typing import Any

import typer
from pydantic import ValidationError

from swarm_ctl.sections import in_words

UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""What a command line that cannot be understood raises, wherever typer keeps it."""


def in_a_sentence(error: Any) -> str:
    """Say what is wrong with a command line, what was expected, and where to look."""
    command = error.ctx.command_path if error.ctx is not None else "swarm-ctl"
    return f"{command}: {_wrong(error)} (see {command} --help)"


def _wrong(error: Any) -> str:
    parameter, cause = getattr(error, "param", None), error.__cause__
    if parameter is not None and isinstance(cause, ValidationError):
        name = next((word for word in parameter.opts if word.startswith("-")), parameter.name)
        return f"{name}: {in_words(cause.errors()[0], str)}".rstrip(".")
    option = getattr(error, "option_name", "")
    if option and hasattr(error, "possibilities"):
        near = difflib.get_close_matches(option, error.possibilities or (), n=1)
        return f"there is no option {option}" + (f"; did you mean {near[0]}?" if near else "")
    said = " ".join(str(error.format_message()).split()).rstrip(".")
    return "; ".join(part[:1].lower() + part[1:] for part in said.split(". "))
