"""YAML files read into models, and what is wrong with one said in a sentence."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from swarm_ctl.errors import MissionError, plain


class Section(BaseModel):
    """A block of a file: every key known, every value of its own type and finite."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        strict=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
    )


def read_yaml(path: Path, what: str) -> dict[str, Any]:
    """Read a file of keys; MissionError says what is wrong, or `what` the file should have been."""
    try:
        raw = yaml.load(path.read_text(encoding="utf-8"), _Loader)  # noqa: S506 - a SafeLoader
    except FileNotFoundError:
        raise MissionError(path, "", "there is no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = plain(error) if isinstance(error, OSError) else "it is not UTF-8 text"
        raise MissionError(path, "", f"cannot be read: {reason}") from None
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise MissionError(path, "", f"{line}{_without_jargon(error.problem or '')}") from None
    except yaml.YAMLError as error:
        first = str(error).splitlines()[0]
        raise MissionError(path, "", f"this is not YAML: {first}") from None
    if not isinstance(raw, dict):
        raise MissionError(path, "", what)
    return raw


def _without_jargon(problem: str) -> str:
    """Say what YAML's own words mean, where people have asked."""
    words = (words for part, words in _YAML.items() if part in problem)
    return next(words, problem or "this is not YAML")


def cross_check(key: str, reason: str) -> PydanticCustomError:
    """Make the error of a key that does not fit another one."""
    return PydanticCustomError("cross_check", "{reason}", {"key": key, "reason": reason})


def first_mistake(error: ValidationError) -> ErrorDetails:
    """Pick the mistake to name: an unknown key before its consequences."""
    return min(error.errors(), key=lambda detail: detail["type"] != "extra_forbidden")


def in_words(detail: ErrorDetails, unknown_key: Callable[[Sequence[int | str]], str]) -> str:
    """Say in plain words what pydantic found; `unknown_key` knows the keys of the file."""
    kind, given, context = detail["type"], shown(detail["input"]), detail.get("ctx", {})
    if kind in _SENTENCES:
        return _SENTENCES[kind].format(given=given, **context)
    if kind == "extra_forbidden":
        return unknown_key(detail["loc"])
    words = next((words for name, words in _TYPES.items() if kind.startswith(name)), None)
    return f"must be {words}, not {given}" if words else f"{detail['msg']}, not {given}"


def shown(value: object) -> str:
    """Show a value as its author wrote it, or what kind of thing it is."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "a block of keys"
    if isinstance(value, list | tuple):
        return "a list"
    if value is None:
        return "nothing"
    return repr(value) if isinstance(value, str) else str(value)


class _Loader(yaml.SafeLoader):
    """YAML that refuses a key given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            name = str(key_node.value)
            if name in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"{name} is given twice", problem_mark=key_node.start_mark
                )
            seen.add(name)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(  # YAML 1.1 takes 1e-3 for text
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


_YAML = {
    "mapping values are not allowed": "a colon too many, or an indent unlike its neighbours'",
    r"character '\t'": "a tab; indent with spaces",
    "constructor for the tag": "a tag (!...) is not taken here; write a plain value",
    "got '<stream end>'": "a bracket or quote is not closed",
    "expected <block end>": "an indent unlike that of its neighbours",
}
_SENTENCES = {
    "missing": "is missing",
    "invalid_key": "unknown key; keys are words",
    "cross_check": "{reason}",
    "value_error": "{error}",
    "literal_error": "must be {expected}, not {given}",
    "greater_than_equal": "must be at least {ge:g}, not {given}",
    "greater_than": "must be more than {gt:g}, not {given}",
    "less_than_equal": "must be at most {le:g}, not {given}",
    "less_than": "must be less than {lt:g}, not {given}",
    "string_pattern_mismatch": "may hold only letters, digits, - and _, not {given}",
    "string_too_short": "may not be empty",
    "string_too_long": "may have {max_length} characters at most",
    "too_short": "must hold at least one",
    "too_long": "must hold at most {max_length}",
}
_TYPES = {
    "int": "a whole number",
    "float": "a number",
    "finite_number": "a finite number",
    "bool": "true or false",
    "string": "text",
    "model": "a block of keys",
    "dict": "a block of keys",
    "tuple": "a list",
    "is_instance_of": "the path of a file",
    "path": "the path of a file",
}


def unknown_key(name: str, places: Sequence[Mapping[str, str]], here: Iterable[str]) -> str:
    """Say which key was meant: places, the nearest first, tell how to say the names they know.

    `here` are the names to list when nothing is like it.
    """
    for cutoff in (1.0, 0.6):  # the very name elsewhere before one like it here
        for place in places:
            close = difflib.get_close_matches(name, place, n=1, cutoff=cutoff)
            if close:
                return f"unknown key; did you mean {place[close[0]]}?"
    return f"unknown key; known here are {', '.join(here)}"
