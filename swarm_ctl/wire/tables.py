"""The messages of the dialect, from pymavlink's tables, and what struct makes of their fields."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from struct import Struct
from struct import error as StructError  # noqa: N812 - a class deserves a class's name
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect


class _Table:
    """A message of MAVLink's common ones that pymavlink's dialects leave out."""

    def __init__(
        self, number: int, name: str, crc_extra: int, formats: str, declared: str, ordered: str
    ) -> None:
        """Take struct's formats, and the fields as declared and as sent, separated by spaces."""
        self.id, self.msgname, self.crc_extra = number, name, crc_extra
        self.fieldnames = declared.split()
        self.ordered_fieldnames = ordered.split()
        self.native_format = b"<" + "".join(f[-1] for f in formats.split()).encode()
        self.array_lengths = [int(f[:-1] or 0) for f in formats.split()]


_VERSIONS = "version min_version max_version spec_version_hash library_version_hash"
_LEFT_OUT = (
    _Table(300, "PROTOCOL_VERSION", 217, "H H H 8B 8B", _VERSIONS, _VERSIONS),
    _Table(
        410,
        "EVENT",
        160,
        "I I H B B B 40B",
        "destination_component destination_system id event_time_boot_ms sequence log_levels "
        "arguments",
        "id event_time_boot_ms sequence destination_component destination_system log_levels "
        "arguments",
    ),
    _Table(
        436,
        "CURRENT_MODE",
        193,
        "I I B",
        "standard_mode custom_mode intended_custom_mode",
        "custom_mode intended_custom_mode standard_mode",
    ),
)

TABLES: dict[int, Any] = {**dialect.mavlink_map, **{table.id: table for table in _LEFT_OUT}}
"""By id."""
CRC_EXTRAS = {number: bytes([table.crc_extra]) for number, table in TABLES.items()}
"""The byte by id that a CRC ends with, and that tells whether both ends mean the same fields."""
IDS = {table.msgname: number for number, table in TABLES.items()}
PACK_ERRORS = (StructError, TypeError, ValueError, OverflowError)
"""What struct raises of values that do not fit."""


class Field(NamedTuple):
    """One field of a message."""

    name: str
    code: str
    """struct's letter for one element; `c` is text."""
    length: int
    """Elements of an array, 0 for a single number."""

    @property
    def is_bytes(self) -> bool:
        """Whether struct sees the whole array as one string of bytes."""
        return self.length > 0 and self.code in "cB"

    @property
    def is_array(self) -> bool:
        """Whether struct sees one value per element."""
        return self.length > 0 and not self.is_bytes

    @property
    def format(self) -> str:
        """What struct calls this field."""
        if self.is_bytes:
            return f"{self.length}s"
        return f"{self.length or ''}{self.code}"

    @property
    def default(self) -> str:
        """Source of the value of an extension that the caller left out."""
        return '""' if self.code == "c" else "()" if self.length else "0"

    def preparing(self, value: str, index: int) -> str:
        """Source of the statements that make `value`, itself source, ready for struct."""
        if self.code == "c":
            return f'if isinstance({value}, str): {value} = {value}.encode("ascii", "replace")'
        if self.is_bytes:
            is_ready = f"{value}.__class__ is bytes and len({value}) <= {self.length}"
            return f"if not ({is_ready}): {value} = octets({value}, {self.length})"
        if self.is_array:
            pad = f"if len({value}) != {self.length}: {value} = padded({value}, {self.length})"
            return f"{pad}\n        {', '.join(self.slots(index))}, = {value}"
        return ""

    def slots(self, index: int) -> list[str]:
        """Names of the variables that take what struct unpacks for this field."""
        if self.is_array:
            return [f"w{index}_{element}" for element in range(self.length)]
        return [f"w{index}"]

    def unpacking(self, index: int) -> str:
        """Source of the field's value, made of its slots."""
        joined = ", ".join(self.slots(index))
        if self.code == "c":
            return f'{joined}.partition(b"\\0")[0].decode("ascii", "replace")'
        return f"({joined},)" if self.is_array else joined

    def check(self, value: Any) -> None:
        """Raise what packing this field alone raises."""
        arguments: Sequence[Any] = (value,)
        if self.code == "c":
            arguments = (value.encode("ascii", "replace") if isinstance(value, str) else value,)
        elif self.is_bytes:
            arguments = (octets(value, self.length),)
        elif self.length:
            arguments = padded(value, self.length)
        Struct("<" + self.format).pack(*arguments)


HEADER_FIELDS = [Field(name, "B", 0) for name in ("seq", "sysid", "compid")]


def padded(values: Sequence[Any], length: int) -> tuple[Any, ...]:
    """Fill an array with zeros up to its length."""
    if len(values) > length:
        raise ValueError(f"at most {length} elements fit, not {len(values)}")
    return (*values, *(0,) * (length - len(values)))


def octets(values: Iterable[int], length: int) -> bytes:
    """Give an array of bytes as struct wants it."""
    return bytes(padded(tuple(values), length))
