"""Read parameter files, as Mission Planner, MAVProxy and QGroundControl write them."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from mock_vehicle.errors import MockVehicleError

INT8, INT16, INT32, REAL32 = 2, 4, 6, 9
"""MAV_PARAM_TYPE, as far as autopilots use it."""
INT_BITS: Mapping[int, int] = {INT8: 8, INT16: 16, INT32: 32}
_REAL32_MAX = 3.4e38
_PLAIN_FIELDS, _QGC_FIELDS = 2, 5


class ParameterError(MockVehicleError):
    """A parameter that the vehicle does not have, or cannot have."""

    def __init__(self, place: str, reason: str) -> None:
        self.place = place
        """File and line, or the name."""
        self.reason = reason
        super().__init__(f"{place}: {reason}")


class Line(NamedTuple):
    """One parameter of a file."""

    place: str
    """File and line."""
    name: str
    value: float
    kind: int | None
    """MAV_PARAM_TYPE, which only QGroundControl writes."""


def read(path: Path) -> Iterator[Line]:
    """Read `NAME,VALUE`, `NAME VALUE`, or `SYSID COMPID NAME VALUE TYPE`; # starts a comment."""
    text = path.read_text(encoding="utf-8", errors="replace")
    for number, line in enumerate(text.splitlines(), 1):
        fields = line.partition("#")[0].replace(",", " ").split()
        if fields:
            yield _line(f"{path}:{number}", fields)


def _line(place: str, fields: list[str]) -> Line:
    if len(fields) not in {_PLAIN_FIELDS, _QGC_FIELDS}:
        raise ParameterError(place, f"{' '.join(fields)!r} is not NAME VALUE")
    name, value = fields[:2] if len(fields) == _PLAIN_FIELDS else fields[2:4]
    try:
        kind = int(fields[4]) if len(fields) == _QGC_FIELDS else None
        return Line(place, name, float(value), kind)
    except ValueError:
        raise ParameterError(place, f"{name} cannot be {value!r}, it takes a number") from None


def check(place: str, name: str, value: float, kind: int) -> None:
    """Raise ParameterError for a value that a parameter of this type cannot have."""
    if not abs(value) < _REAL32_MAX:
        raise ParameterError(place, f"{name} cannot be {value}")
    bits = INT_BITS.get(kind)
    if bits is None:
        return
    if not value.is_integer():
        raise ParameterError(place, f"{name} cannot be {value:g}, it takes a whole number")
    if not -(2 ** (bits - 1)) <= value < 2 ** (bits - 1):
        raise ParameterError(place, f"{name} cannot be {value:g}, it has {bits} bits")


def unknown(place: str, name: str, known: Collection[str]) -> ParameterError:
    """Say that nobody has this parameter, and which one may be meant."""
    near = difflib.get_close_matches(name.upper(), known, n=1, cutoff=0.7)
    hint = f", perhaps {near[0]}?" if near else ""
    return ParameterError(place, f"there is no parameter {name}{hint}")
