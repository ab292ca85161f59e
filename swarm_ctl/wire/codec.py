"""Functions that pack and read one message each, generated from its table."""

from __future__ import annotations

import struct
from collections import namedtuple
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from struct import Struct
from typing import Any, NamedTuple, cast

from fastcrc.crc16 import mcrf4xx

from swarm_ctl.wire.tables import (
    CRC_EXTRAS,
    HEADER_FIELDS,
    IDS,
    PACK_ERRORS,
    TABLES,
    Field,
    octets,
    padded,
)
from swarm_ctl.wire.tally import Tally

V1, V2 = 0xFE, 0xFD
"""Magics of MAVLink 1 and 2."""
_CRC_SEEDS = {V1: 0x3086, V2: 0x3085}  # after the magic, which it leaves out, it is 0xFFFF again
_HEADS = {V1: "<BBBBBB", V2: "<BBxxBBB3s"}  # magic, length, seq, sysid, compid, id
_TRAILER = Struct("<H").pack  # the CRC
_COUNTED = slice(-2)
"""A frame without its CRC; to make the slice anew each time takes time."""
Data = bytes | bytearray | memoryview
Read = Callable[[Data, Data], Any]
"""Takes a frame up to its CRC, and the whole of it; see `Message.reader`."""


class Frame(NamedTuple):
    """A received frame whose CRC is right."""

    sysid: int
    compid: int
    seq: int
    id: int
    values: Any
    """The NamedTuple of the message, `message(id).values`."""
    raw: bytes


_PACK_SOURCE = """
def pack(seq, sysid, compid, {parameters}):
    try:
        {preparations}
        frame = layout({magic}, {size}, seq, sysid, compid, {number}, {arguments})
    except errors as error:
        raise blame((seq, sysid, compid, {values})) from error
    if {trims} and not frame[-1]:
        end = len(frame.rstrip(b"\\0"))
        frame = starts[end] + frame[cuts[end]]
    return frame + trailer(crc(frame + extra, {seed}))
"""
_STARTS = [bytes([V2, max(end - 10, 1)]) for end in range(10 + 256)]  # trimmed to this end
_CUTS = [slice(2, max(end, 11)) for end in range(10 + 256)]  # what follows it, likewise

_READ_SOURCE = """
def reader(tally):
    next_seq, follow = tally.next_seq, tally.follow

    def read(body, raw):
        plain = body[counted]
        {unpacking}
        if flags and (flags > 1 or raw is body) or crc(plain + extra, {seed}) != expected:
            return None
        source = sysid | compid << 8
        if next_seq[source] == seq:
            next_seq[source] = seq + 1 & 0xFF
        else:
            follow(source, seq)
        return {result}

    return read
"""
_WHOLE_FRAME = """
        if len(body) == {size}:
            flags, seq, sysid, compid, {slots} expected = unpack(body)
        else:
            flags, seq, sysid, compid, {slots} _ = unpack(plain.ljust({size}, b"\\0"))
            expected = body[-2] | body[-1] << 8
"""
_RIMS = """
        flags, seq, sysid, compid = unpack(body)
        expected = body[-2] | body[-1] << 8
"""


class Message:
    """One message of the dialect; its functions are generated when they are first asked for."""

    def __init__(self, table: Any) -> None:
        self.id: int = table.id
        self.name: str = table.msgname
        self.fields: tuple[str, ...] = tuple(table.fieldnames)
        self.wire_order: list[Field] = [
            Field(*field)
            for field in zip(
                table.ordered_fieldnames,
                table.native_format.decode().lstrip("<"),
                table.array_lengths,
                strict=True,
            )
        ]
        """The fields as they are sent."""
        # pymavlink gives defaults to extensions, and to the one constant of the dialect.
        has_default = len(table.__init__.__defaults__ or ()) - ("mavlink_version" in self.fields)
        self._base_count = len(self.fields) - has_default
        self._format = "".join(field.format for field in self.wire_order)
        self._size = struct.calcsize("<" + self._format)
        self._wire_indices = [table.ordered_fieldnames.index(name) for name in self.fields]
        self.declared = [self.wire_order[index] for index in self._wire_indices]
        """The same fields in the order in which `pack` takes them."""

    def __repr__(self) -> str:
        return f"message({self.name!r})"

    @cached_property
    def values(self) -> type[Any]:
        """The NamedTuple of this message, fields in declaration order."""
        return cast("type[Any]", namedtuple(self.name, self.fields))  # noqa: PYI024 - made at run time

    @cached_property
    def pack(self) -> Callable[..., bytes]:
        """Make a MAVLink 2 frame of seq, sysid, compid and the fields in declaration order.

        Numbers are as on the wire; extensions at the end may be left out. Text that is too long
        is cut. ValueError names the field of any other value that does not fit.
        """
        return self._packer(V2, self.id.to_bytes(3, "little"), self.wire_order)

    @cached_property
    def pack_v1(self) -> Callable[..., bytes]:
        """Make a MAVLink 1 frame, as `pack` does; extensions stay out of it."""
        if self.id > 0xFF:
            raise ValueError(f"{self.name} has id {self.id}, and MAVLink 1 ends at 255")
        return self._packer(V1, self.id, self.wire_order[: self._base_count])

    @cached_property
    def reader(self) -> Callable[[Tally], Read]:
        """Make what reads for one tally, whose `next_seq` has to know every source.

        It makes a `Frame` of a MAVLink 2 frame up to its CRC, and notes its seq. The whole frame
        with its signature, or the same object when it has none, is passed on as `raw`. A wrong
        CRC, or flags we do not know, give None; a payload longer than ours raises struct's error,
        a source that nobody knows KeyError.
        """
        slots = "".join(f"{s}, " for i, f in enumerate(self.wire_order) for s in f.slots(i))
        fields = ", ".join(self.wire_order[i].unpacking(i) for i in self._wire_indices)
        source = _READ_SOURCE.format(
            unpacking=_WHOLE_FRAME.format(size=self._size + 12, slots=slots).strip(),
            seed=_CRC_SEEDS[V2],
            result=f"new(Frame, (sysid, compid, seq, {self.id}, new(values, ({fields},)), raw))",
        )
        layout = Struct(f"<xxBxBBB3x{self._format}H")
        return self._generate("reader", source, {"unpack": layout.unpack})

    @cached_property
    def skimmer(self) -> Callable[[Tally], Read]:
        """Make what checks a frame and notes its seq as a `reader` does, but gives True for it."""
        source = _READ_SOURCE.format(unpacking=_RIMS.strip(), seed=_CRC_SEEDS[V2], result="True")
        return self._generate("reader", source, {"unpack": Struct("<xxBxBBB").unpack_from})

    @cached_property
    def _read(self) -> Read:
        tally = Tally()
        tally.next_seq[0] = 0
        return self.reader(tally)

    def plain(self, payload: bytes, seq: int = 0, source: int = 0) -> bytes:
        """Make the frame that `read` reads: MAVLink 2, unsigned, of full length."""
        head = struct.pack("<BxxBH", self._size, seq, source) + self.id.to_bytes(3, "little")
        body = head + payload[: self._size].ljust(self._size, b"\0")
        return b"\xfd" + body + checksum(body)

    def unpack(self, payload: bytes) -> Any:
        """Read `values` from a payload: what is missing is zero, what is too much is ignored."""
        return self._read(self.plain(payload), b"").values

    def _packer(self, magic: int, number: int | bytes, fields: list[Field]) -> Callable[..., bytes]:
        """Generate a pack function; the variable of the field declared i-th is v<i>."""
        names = {field.name: f"v{i}" for i, field in enumerate(self.declared)}
        parameters = [
            names[field.name] + (f"={field.default}" if i >= self._base_count else "")
            for i, field in enumerate(self.declared)
        ]
        prepared = (field.preparing(names[field.name], i) for i, field in enumerate(fields))
        arguments = ", ".join(
            ", ".join(field.slots(i)) if field.is_array else names[field.name]
            for i, field in enumerate(fields)
        )
        layout = Struct(_HEADS[magic] + "".join(field.format for field in fields))
        source = _PACK_SOURCE.format(
            parameters=", ".join(parameters),
            preparations="\n        ".join(filter(None, prepared)),
            arguments=arguments,
            values=", ".join(names.values()),
            number=repr(number),
            magic=magic,
            seed=_CRC_SEEDS[magic],
            size=layout.size - struct.calcsize(_HEADS[magic]),
            trims=magic == V2,
        )
        return self._generate("pack", source, {"layout": layout.pack})

    def _generate(self, name: str, source: str, names: dict[str, Any]) -> Callable[..., Any]:
        """Run generated source and give the function it defines."""
        scope = {
            "values": self.values,
            "errors": PACK_ERRORS,
            "blame": self._blame,
            "octets": octets,
            "padded": padded,
            "crc": mcrf4xx,
            "counted": _COUNTED,
            "extra": CRC_EXTRAS[self.id],
            "trailer": _TRAILER,
            "starts": _STARTS,
            "cuts": _CUTS,
            "new": tuple.__new__,
            "Frame": Frame,
        } | names
        exec(source, scope)  # noqa: S102 - the source is made of pymavlink's tables alone
        return cast("Callable[..., Any]", scope[name])

    def _blame(self, values: Sequence[Any]) -> ValueError:
        """Find the field that does not fit."""
        for field, value in zip([*HEADER_FIELDS, *self.declared], values, strict=True):
            try:
                field.check(value)
            except PACK_ERRORS as error:
                return ValueError(f"{self.name}.{field.name} cannot be {value!r}: {error}")
        return ValueError(f"{self.name} cannot be packed from {values!r}")


@cache
def _message(number: int) -> Message:
    return Message(TABLES[number])


def message(key: str | int) -> Message:
    """Look a message up by its name or id."""
    number = IDS.get(key) if isinstance(key, str) else key
    if number is None or number not in CRC_EXTRAS:
        raise ValueError(f"the dialect ardupilotmega has no message {key!r}")
    return _message(number)


def checksum(body: bytes) -> bytes:
    """Give the CRC of a MAVLink 2 frame of our dialect: of all that stands after its magic."""
    number = body[6] | body[7] << 8 | body[8] << 16
    return _TRAILER(mcrf4xx(body + CRC_EXTRAS[number]))
