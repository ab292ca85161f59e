"""World files as JSON Schema, for editors."""

from __future__ import annotations

import ast
import inspect
import itertools
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from mock_vehicle.world import radio, spec


def world_schema() -> dict[str, Any]:
    """Describe world files, each key by the docstring below it.

    pydantic would read these docstrings whenever the models are imported, which takes a quarter
    of the time in which a mock vehicle starts; so they are read here.
    """
    schema = spec.WorldSpec.model_json_schema()
    for name, model in {"WorldSpec": schema, **schema["$defs"]}.items():
        words = dict(_docstrings(vars(spec).get(name) or getattr(radio, name)))
        for key, described in model["properties"].items():
            described["description"] = words[key]
    return schema


def _docstrings(model: type[BaseModel]) -> Iterator[tuple[str, str]]:
    """Pair the fields of a model, also those it inherits, with the strings that follow them."""
    for kind in model.__mro__[: model.__mro__.index(BaseModel)]:
        (definition,) = ast.parse(inspect.getsource(kind)).body
        body = definition.body if isinstance(definition, ast.ClassDef) else []
        for field, text in itertools.pairwise(body):
            match field, text:
                case ast.AnnAssign(target=ast.Name(id=key)), ast.Expr(ast.Constant(str(words))):
                    yield key, inspect.cleandoc(words)
