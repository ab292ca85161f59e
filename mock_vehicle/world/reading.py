"""World files read: YAML into models, and errors that name the key in one sentence."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel
from pydantic import ValidationError as PydanticError
from pydantic_core import ErrorDetails

from mock_vehicle.errors import WorldError
from mock_vehicle.faults import Fault
from mock_vehicle.world.spec import FaultsSpec, WorldSpec

Spec = TypeVar("Spec", bound=BaseModel)

_IN_OUR_WORDS = {
    "missing": "is required",
    "tuple_type": "should be a list",
    "model_type": "should hold keys",
    "float_type": "should be a number",
}


class _TwiceError(yaml.YAMLError):
    """A key that a mapping gives twice."""

    def __init__(self, key: str, first: int, second: int) -> None:
        self.key = key
        self.lines = f"{first} and {second}"
        super().__init__(key)


class _Loader(yaml.SafeLoader):
    """Reads YAML as `safe_load` does, but keeps no last one of two equal keys."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Refuse a key that was there before."""
        lines: dict[tuple[str, str], int] = {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                name, line = (key.tag, key.value), key.start_mark.line + 1
                if name in lines:
                    raise _TwiceError(key.value, lines[name], line)
                lines[name] = line
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(  # YAML 1.1 takes 1e-3 for text
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


def read_spec(path: Path) -> WorldSpec:
    """Read and validate a world file; WorldError when it cannot be read or says something wrong."""
    data = _read_yaml(path)
    if not isinstance(data, dict):
        raise WorldError(path, "", "should hold keys like name: and size_m:")
    return _validated(path, WorldSpec, data)


def read_faults(path: Path) -> tuple[Fault, ...]:
    """Read a file of faults: a list as in a world file, or the key `faults` above it."""
    data = _read_yaml(path)
    return _validated(path, FaultsSpec, {"faults": data} if isinstance(data, list) else data).faults


def _validated(path: Path, model: type[Spec], data: object) -> Spec:
    try:
        return model.model_validate(data)
    except PydanticError as error:
        detail = error.errors(include_url=False)[0]
        raise WorldError(path, _key(detail), _reason(detail)) from error


def _read_yaml(path: Path) -> object:
    try:
        # a safe loader: it builds nothing but plain values
        data: object = yaml.load(path.read_text(encoding="utf-8"), _Loader)  # noqa: S506
    except OSError as error:
        raise WorldError(path, "", f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise WorldError(path, "", "is not UTF-8 text") from error
    except _TwiceError as error:
        raise WorldError(path, error.key, f"is given twice, in lines {error.lines}") from None
    except yaml.YAMLError as error:
        raise WorldError(path, "", "is not YAML: " + " ".join(str(error).split())) from error
    return data


def _key(detail: ErrorDetails) -> str:
    """Write pydantic's location as people do: `walls[0].doors[1].width_m`."""
    parts = list(detail["loc"])
    if parts[:1] == ["starts"]:
        del parts[1:2]  # the tag of the union is no key of the file
    parts += [detail["ctx"]["key"]] if detail["type"] in {"unknown_key", "fault"} else []
    return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in parts if p != "").lstrip(
        "."
    )


def _reason(detail: ErrorDetails) -> str:
    """Say what is wrong in the words of the file, with the value if it is short."""
    message = _IN_OUR_WORDS.get(detail["type"], detail["msg"])
    message = message.removeprefix("Input ").removeprefix("Tuple ").replace(" after validation", "")
    silent = detail["type"] in {"missing", "unknown_key", "starts", "fault"}
    value = detail["input"]
    return message if silent or isinstance(value, dict | list) else f"{message}, not {value!r}"
