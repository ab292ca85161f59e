"""What models and commands say of themselves, written into these pages when the site is built."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import typer

import mock_vehicle.cli
from mock_vehicle.world.schema import world_schema
from swarm_ctl.cli import app
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.mission import mission_schema

Schema = Mapping[str, Any]

UNITS = {
    "_bit_s": "bit/s", "_m_s2": "m/s²", "_m_s": "m/s", "_slots": "slots", "_frames": "frames",
    "_cells": "cells", "_fraction": "0 to 1", "_deg": "degrees", "_db": "dB", "_m": "m", "_s": "s",
}  # fmt: skip
"""What the last words of a key's name mean, the longest first."""
EXPLORE_HEAD = """
## Defaults of `kind: explore`

Lengths of steps and cells grow with `footprint_m`; here with its default.

| key | others | `dimensions: 2` | `dimensions: 3` |
|---|---|---|---|"""
TABLE_HEAD = """
| key | type | unit | default | |
|---|---|---|---|---|"""
BOUNDS = {
    "exclusiveMinimum": "more than {:g}",
    "minimum": "{:g} or more",
    "exclusiveMaximum": "less than {:g}",
    "maximum": "at most {:g}",
}
NAMES = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
}


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put what is written in the place of its comment."""
    return COMMENT.sub(lambda found: WRITERS[found[1]](), markdown)


def missions() -> str:
    """Write every block and key of a mission file."""
    return _models(mission_schema()) + _defaults_of_explore()


def worlds() -> str:
    """Write every block and key of a world file."""
    return _models(world_schema())


def commands() -> str:
    """Write every command with its help, arguments and options."""
    swarm = typer.main.get_command(app)
    mock = typer.Typer(add_completion=False)
    mock.command()(mock_vehicle.cli.run)
    written = [
        _command(f"swarm-ctl {name}", command)
        for name, command in swarm.commands.items()  # type: ignore[attr-defined]
    ]
    return "\n".join([*written, _command("mock-vehicle", typer.main.get_command(mock))])


WRITERS = {"missions": missions, "worlds": worlds, "commands": commands}
COMMENT = re.compile("<!-- written: (.*) -->")


def _models(schema: Schema) -> str:
    """Write a table for the file itself, and one for each kind of block in it."""
    defs = schema["$defs"]
    of = {_referred(value): key for key, value in schema["properties"].items()}
    titles = {name: f"`{of[name]}`" if name in of else _title(name) for name in defs}
    order = sorted(defs, key=lambda name: list(of).index(name) if name in of else len(of))
    sections = [_table("Top level", schema, titles, defs)]
    sections += [_table(titles[name], defs[name], titles, defs) for name in order]
    return "\n".join(sections)


def _defaults_of_explore() -> str:
    """Write what `kind: explore` sets where a mission says nothing."""
    kinds = [PlannerParams.model_validate({"kind": "explore", "dimensions": n}) for n in (2, 3)]
    rows = []
    for key in PlannerParams.model_fields.keys() - {"kind", "dimensions"}:
        values = [getattr(one, key) for one in (PlannerParams(), *kinds)]
        if len(set(values)) > 1:
            rows.append(f"| `{key}` | {' | '.join(f'`{json.dumps(value)}`' for value in values)} |")
    return "\n".join([EXPLORE_HEAD, *sorted(rows), ""])


def _title(name: str) -> str:
    words = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name)
    return words.strip().removesuffix(" spec").capitalize()


def _referred(value: Schema) -> str:
    """Name the model that a property is made of, if it is made of one."""
    options = [value, value.get("items", {}), *value.get("anyOf", ())]
    return next((one["$ref"].rsplit("/", 1)[1] for one in options if "$ref" in one), "")


def _table(title: str, model: Schema, titles: Mapping[str, str], defs: Schema) -> str:
    required = set(model.get("required", ()))
    rows = [
        f"| `{key}` | {_kind(value, titles)} | {_unit(key)} | "
        f"{'**required**' if key in required else _default(value)} | {_words(value, defs)} |"
        for key, value in model["properties"].items()
    ]
    head = ["", f"## {title}", "", _words(model, defs), TABLE_HEAD]
    return "\n".join([*head, *rows, ""])


def _words(value: Schema, defs: Schema) -> str:
    """Give a description: its own, or that of the model that it is made of."""
    described = value if "description" in value else defs.get(_referred(value), {})
    return " ".join(str(described.get("description", "")).split()).replace("|", r"\|")


def _unit(key: str) -> str:
    return next((unit for ending, unit in UNITS.items() if key.endswith(ending)), "")


def _default(value: Schema) -> str:
    default = value.get("default", "")
    if default == "" or (isinstance(default, dict) and "$ref" in json.dumps(value)):
        return ""
    return "none" if default in (None, []) else f"`{json.dumps(default)}`"


def _kind(value: Schema, titles: Mapping[str, str]) -> str:
    """Say in words what a value may be."""
    choices = value.get("anyOf") or value.get("oneOf")
    if "$ref" in value:
        title = titles[value["$ref"].rsplit("/", 1)[1]]
        return f"[block](#{title.strip('`').lower().replace(' ', '-')})"
    if "enum" in value:
        return ", ".join(f"`{one}`" for one in value["enum"])
    if choices:
        return _choice(choices, titles)
    if value["type"] == "array":
        return _list(value, titles)
    if value["type"] == "object":
        return f"for each sysid: {_kind(value['additionalProperties'], titles)}"
    return _plain_kind(value)


def _plain_kind(value: Schema) -> str:
    name = "file" if value.get("format") == "path" else NAMES[value["type"]]
    bounds = [
        words.format(value[key]) for key, words in BOUNDS.items() if value.get(key, 2**60) < 2**60
    ]
    return ", ".join([name, *bounds])


def _choice(choices: Sequence[Schema], titles: Mapping[str, str]) -> str:
    if all("kind" in one.get("properties", {}) for one in choices):
        return "[fault](../faults.md)"
    kinds = [_kind(one, titles) for one in choices if one.get("type") != "null"]
    return " or ".join(dict.fromkeys(kinds))


def _list(value: Schema, titles: Mapping[str, str]) -> str:
    if "prefixItems" in value:
        inside = list(dict.fromkeys(_kind(one, titles) for one in value["prefixItems"]))
        return f"list of {len(value['prefixItems'])}: {'; '.join(inside)}"
    return f"list of {_kind(value['items'], titles)}"


def _command(name: str, command: Any) -> str:
    context = command.make_context(name, [], resilient_parsing=True)
    usage = " ".join([name, *command.collect_usage_pieces(context)])
    paragraphs = (" ".join(text.split()) for text in (command.help or "").split("\n\n"))
    rows = [
        f"| `{record[0]}` | {_plain(record[1])} |"
        for parameter in command.get_params(context)
        if (record := parameter.get_help_record(context)) and parameter.name != "help"
    ]
    head = ["", f"## {name}", "", f"`{usage}`", "", "\n\n".join(paragraphs), ""]
    return "\n".join([*head, "| option | meaning |", "|---|---|", *rows])


def _plain(words: str) -> str:
    """Keep a sentence from being read as markup."""
    return " ".join(words.split()).replace("|", r"\|").replace("<", "&lt;").replace("[", r"\[")
