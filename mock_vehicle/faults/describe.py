"""The kinds of faults told to people and to editors."""

from __future__ import annotations

import math
from typing import Any

from mock_vehicle.faults.kinds import KINDS, Kind, Parameter


def text() -> str:
    """Write all kinds for a terminal."""
    return "\n".join(line for name, kind in KINDS.items() for line in _lines(name, kind))


def _lines(name: str, kind: Kind) -> list[str]:
    lines = [f"{name}: {kind.says} ({_lasts(kind)})"]
    for key, one in kind.parameters.items():
        lines.append(f"    {key} ({_default(one)}): {one.says}; {one.range}")
    return lines


def _default(parameter: Parameter) -> str:
    value = parameter.default
    return "none" if value is None else value if isinstance(value, str) else f"{value:g}"


def _lasts(kind: Kind) -> str:
    if not kind.lasts:
        return "happens at once"
    return "for good" if kind.duration_s is None else f"{kind.duration_s:g} s"


def schema() -> dict[str, Any]:
    """Give the JSON Schema of one fault, a choice by its kind."""
    return {"oneOf": [_schema_of(name, kind) for name, kind in KINDS.items()]}


def _schema_of(name: str, kind: Kind) -> dict[str, Any]:
    properties: dict[str, Any] = {
        "kind": {"const": name},
        "time_s": {"type": "number", "minimum": 0, "description": "Mission time, s."},
    }
    if name != "fleet":
        who = "sysid of the vehicle; null: all of them."
        properties["vehicle"] = {"type": ["integer", "null"], "description": who}
    if kind.lasts:
        properties["duration_s"] = {
            "type": ["number", "null"],
            "exclusiveMinimum": 0,
            "default": kind.duration_s,
            "description": "How long it lasts, s; null: " + _lasts(kind) + ".",
        }
    properties |= {key: _schema_of_parameter(one) for key, one in kind.parameters.items()}
    return {
        "type": "object",
        "description": kind.says,
        "properties": properties,
        "required": ["kind", "time_s"],
        "additionalProperties": False,
    }


def _schema_of_parameter(parameter: Parameter) -> dict[str, Any]:
    about = {"description": parameter.says, "default": parameter.default}
    if parameter.choices:
        return {"enum": list(parameter.choices), **about}
    number = "integer" if parameter.is_whole else "number"
    bounds = {"minimum": parameter.low, "maximum": parameter.high}
    return {
        "type": [number, "null"] if parameter.default is None else number,
        **{key: value for key, value in bounds.items() if abs(value) < math.inf},
        **about,
    }
