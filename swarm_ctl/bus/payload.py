"""What all payloads of the bus have in common: JSON of one version, read back or refused."""

from __future__ import annotations

import json
import math
from types import NoneType, UnionType
from typing import Any, Self, get_args, get_origin, get_type_hints

VERSION = 1
"""Of every payload; it changes when a key changes its meaning."""
_KEYS: dict[type, dict[str, Any]] = {}


class Payload:
    """A frozen dataclass with slots whose fields are the keys of a JSON object.

    A number that is none, infinite or NaN, is written as null.
    """

    __slots__ = ()

    def dump(self) -> bytes:
        """Write it."""
        said = {"v": VERSION, **{name: getattr(self, name) for name in _keys(type(self))}}
        try:
            return json.dumps(said, allow_nan=False).encode()
        except ValueError:
            return json.dumps(_finite(said)).encode()

    @classmethod
    def load(cls, payload: bytes) -> Self | None:
        """Read it; None when it is of another version, lacks a key, or has one of another type.

        Keys that are not known are left out.
        """
        try:
            said = json.loads(payload)
        except (ValueError, RecursionError):
            return None
        keys = _keys(cls)
        if not isinstance(said, dict) or said.get("v") != VERSION or keys.keys() - said.keys():
            return None
        if not all(_fits(said[name], hint) for name, hint in keys.items()):
            return None
        return cls(**{name: said[name] for name in keys})


def _keys(kind: type[Payload]) -> dict[str, Any]:
    """Give the fields of a kind of payload and their types."""
    if kind not in _KEYS:
        _KEYS[kind] = get_type_hints(kind)
    return _KEYS[kind]


def _fits(value: Any, hint: Any) -> bool:
    """Whether a JSON value is of an annotated type; a whole number is a number, too."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is UnionType:
        return any(_fits(value, one) for one in inner)
    if origin is list:
        return isinstance(value, list) and all(_fits(one, inner[0]) for one in value)
    if hint in {None, NoneType}:
        return value is None
    if hint is float:
        return _fits(value, int) or (isinstance(value, float) and math.isfinite(value))
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return isinstance(value, origin or hint)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
