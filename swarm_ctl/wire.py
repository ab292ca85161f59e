"""Turn MAVLink bytes into messages and back, by functions generated from pymavlink's tables."""

from __future__ import annotations

import re
from collections import namedtuple
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from struct import Struct
from struct import error as StructError  # noqa: N812 - a class deserves a class's name
from typing import Any, NamedTuple, cast

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as dialect

_V1, _V2 = 0xFE, 0xFD
_SIGNED = 0x01
_SIGNATURE_LENGTH = 13
_GARBAGE, _UNREADABLE = -1, -2  # in place of an id: no frame here; a frame with unknown flags
_MAGICS = b"\xfd\xfe"
_MAGIC = re.compile(b"[" + _MAGICS + b"]")
_Decode = Callable[[bytes, int, int], Any]
_UNKNOWN: tuple[bytes, None] = (b"", None)
_HEAD_V1 = Struct("<xBBHB").unpack_from  # length, seq, source, id
_HEAD_V2 = Struct("<BBBxBHI").unpack_from  # magic, length, flags, seq, source, id and one byte more
_CRC_EXTRAS = {number: bytes([table.crc_extra]) for number, table in dialect.mavlink_map.items()}
_IDS = {table.msgname: number for number, table in dialect.mavlink_map.items()}
_new = tuple.__new__
_PACK_ERRORS = (StructError, TypeError, ValueError, OverflowError)


class _Field(NamedTuple):
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
            arguments = (_octets(value, self.length),)
        elif self.length:
            arguments = _padded(value, self.length)
        Struct("<" + self.format).pack(*arguments)


_HEADER_FIELDS = [_Field(name, "B", 0) for name in ("seq", "sysid", "compid")]


def _padded(values: Sequence[Any], length: int) -> tuple[Any, ...]:
    """Fill an array with zeros up to its length."""
    if len(values) > length:
        raise ValueError(f"at most {length} elements fit, not {len(values)}")
    return (*values, *(0,) * (length - len(values)))


def _octets(values: Iterable[int], length: int) -> bytes:
    """Give an array of bytes as struct wants it."""
    return bytes(_padded(tuple(values), length))


_PACK_SOURCE = """
def pack(seq, sysid, compid, {parameters}):
    try:
        {preparations}
        payload = {payload}
        body = {header} + payload
    except errors as error:
        raise blame((seq, sysid, compid, {values})) from error
    return {magic} + body + trailer(crc(extra, crc(body)))
"""

_DECODE_SOURCE = """
def decode(data, at, length):
    if length < {size}:
        data, at = data[at : at + length].ljust({size}, b"\\0"), 0
    {read}
    return new(values, {fields})
"""


class Message:
    """One message of the dialect; its functions are generated when they are first asked for."""

    def __init__(self, table: Any) -> None:
        self.id: int = table.id
        self.name: str = table.msgname
        self.fields: tuple[str, ...] = tuple(table.fieldnames)
        self._wire_order = [
            _Field(*field)
            for field in zip(
                table.ordered_fieldnames,
                table.native_format.decode().lstrip("<"),
                table.array_lengths,
                strict=True,
            )
        ]
        # pymavlink gives defaults to extensions, and to the one constant of the dialect.
        has_default = len(table.__init__.__defaults__ or ()) - ("mavlink_version" in self.fields)
        self._base_count = len(self.fields) - has_default

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
        number = self.id.to_bytes(3, "little")
        return self._packer(
            fields=self._wire_order,
            payload='payload_struct({arguments}).rstrip(b"\\0") or b"\\0"',
            header=f"header(len(payload), 0, seq, sysid, compid, {number!r})",
            header_format="<BHBBB3s",
            magic=_V2,
        )

    @cached_property
    def pack_v1(self) -> Callable[..., bytes]:
        """Make a MAVLink 1 frame, as `pack` does; extensions stay out of it."""
        if self.id > 0xFF:
            raise ValueError(f"{self.name} has id {self.id}, and MAVLink 1 ends at 255")
        return self._packer(
            fields=self._wire_order[: self._base_count],
            payload="payload_struct({arguments})",
            header=f"header(len(payload), seq, sysid, compid, {self.id})",
            header_format="<BBBBB",
            magic=_V1,
        )

    @cached_property
    def decode(self) -> _Decode:
        """Read `values` from data, the offset of the payload in it and the payload's length."""
        slots = "".join(f"{s}, " for i, f in enumerate(self._wire_order) for s in f.slots(i))
        fields = "".join(f"{self._wire_order[i].unpacking(i)}, " for i in self._wire_indices)
        read, made = (f"{slots} = unpack(data, at)", f"({fields})")
        if slots == fields:
            read, made = "", "unpack(data, at)"
        source = _DECODE_SOURCE.format(size=self._struct.size, read=read, fields=made)
        names = {"unpack": self._struct.unpack_from, "new": _new}
        return self._generate("decode", source, names)

    def unpack(self, payload: bytes) -> Any:
        """Read `values` from a payload: what is missing is zero, what is too much is ignored."""
        return self.decode(payload, 0, len(payload))

    @cached_property
    def _struct(self) -> Struct:
        return Struct("<" + "".join(field.format for field in self._wire_order))

    @cached_property
    def _wire_indices(self) -> list[int]:
        """Where on the wire each field of the declaration stands."""
        names = [field.name for field in self._wire_order]
        return [names.index(name) for name in self.fields]

    def _packer(
        self, *, fields: list[_Field], payload: str, header: str, header_format: str, magic: int
    ) -> Callable[..., bytes]:
        """Generate a pack function; the variable of the field declared i-th is v<i>."""
        declared = [self._wire_order[index] for index in self._wire_indices]
        names = {field.name: f"v{i}" for i, field in enumerate(declared)}
        parameters = [
            names[field.name] + (f"={field.default}" if i >= self._base_count else "")
            for i, field in enumerate(declared)
        ]
        prepared = (field.preparing(names[field.name], i) for i, field in enumerate(fields))
        arguments = ", ".join(
            ", ".join(field.slots(i)) if field.is_array else names[field.name]
            for i, field in enumerate(fields)
        )
        source = _PACK_SOURCE.format(
            parameters=", ".join(parameters),
            preparations="\n        ".join(filter(None, prepared)),
            payload=payload.format(arguments=arguments),
            header=header,
            values=", ".join(names.values()),
            magic=bytes([magic]),
        )
        layout = Struct("<" + "".join(field.format for field in fields))
        structs = {"payload_struct": layout.pack, "header": Struct(header_format).pack}
        return self._generate("pack", source, structs | {"trailer": Struct("<H").pack})

    def _generate(self, name: str, source: str, names: dict[str, Any]) -> Callable[..., Any]:
        """Run generated source and give the function it defines."""
        scope = {
            "values": self.values,
            "errors": _PACK_ERRORS,
            "blame": self._blame,
            "octets": _octets,
            "padded": _padded,
            "crc": mcrf4xx,
            "extra": _CRC_EXTRAS[self.id],
        } | names
        exec(source, scope)  # noqa: S102 - the source is made of pymavlink's tables alone
        return cast("Callable[..., Any]", scope[name])

    def _blame(self, values: Sequence[Any]) -> ValueError:
        """Find the field that does not fit."""
        declared = [self._wire_order[index] for index in self._wire_indices]
        for field, value in zip([*_HEADER_FIELDS, *declared], values, strict=True):
            try:
                field.check(value)
            except _PACK_ERRORS as error:
                return ValueError(f"{self.name}.{field.name} cannot be {value!r}: {error}")
        return ValueError(f"{self.name} cannot be packed from {values!r}")


@cache
def _message(number: int) -> Message:
    return Message(dialect.mavlink_map[number])


def message(key: str | int) -> Message:
    """Look a message up by its name or id."""
    number = _IDS.get(key) if isinstance(key, str) else key
    if number is None or number not in _CRC_EXTRAS:
        raise ValueError(f"the dialect ardupilotmega has no message {key!r}")
    return _message(number)


class Frame(NamedTuple):
    """A received frame whose CRC is right."""

    sysid: int
    compid: int
    seq: int
    id: int
    values: Any
    """The NamedTuple of the message, `message(id).values`."""
    raw: bytes


@dataclass(slots=True)
class Stats:
    """What a parser has met so far."""

    frames: int = 0
    """Frames of known ids with a right CRC, subscribed or not."""
    bad_crc: int = 0
    """Frames of known ids with a wrong CRC."""
    unknown: int = 0
    """Frames whose id is not in the dialect."""
    bad_flags: int = 0
    """Frames with an incompat flag other than "signed"."""
    skipped_bytes: int = 0
    """Bytes that belonged to no frame, or to one with a wrong CRC."""
    lost: int = 0
    """Sequence numbers that never came, over all sources; late and repeated frames do not count."""


@cache
def _readers(subscribed: frozenset[int]) -> dict[int, tuple[bytes, _Decode | None]]:
    """Give the CRC extra byte of each id, and how to decode it if it is subscribed."""
    readers: dict[int, tuple[bytes, _Decode | None]] = {}

    def decode_first(number: int, extra: bytes) -> _Decode:
        def decode(data: bytes, at: int, length: int) -> Any:
            readers[number] = extra, message(number).decode
            return message(number).decode(data, at, length)

        return decode

    for number, extra in _CRC_EXTRAS.items():
        readers[number] = extra, decode_first(number, extra) if number in subscribed else None
    return readers


class Parser:
    """Cut a stream of bytes into frames and decode those of the subscribed messages."""

    def __init__(self, subscribed: Iterable[str | int | Message] | None) -> None:
        """Subscribe to messages, or to all of the dialect by None."""
        self.stats = Stats()
        self._rest = b""
        self._next_seq: dict[int, int] = {}
        keys = _CRC_EXTRAS if subscribed is None else subscribed
        ids = (key.id if isinstance(key, Message) else message(key).id for key in keys)
        self._readers = _readers(frozenset(ids))

    def feed(self, data: bytes) -> list[Frame]:
        """Take the next bytes, in any chunks, and give the subscribed frames they complete.

        One long loop, because every call in it would cost each frame a tenth of its time.
        """
        if self._rest or data.__class__ is not bytes:
            return self._resume(data)
        frames: list[Frame] = []
        readers, next_seq = self._readers, self._next_seq
        at, end, good = 0, len(data), 0
        while at < end:
            try:
                magic, length, flags, seq, source, number = _HEAD_V2(data, at)
            except StructError:  # the last few bytes
                magic = flags = 0
            if magic == _V2 and not flags:
                start, stop, number = at + 10, at + 12 + length, number & 0xFFFFFF
            else:
                start, stop, number, length, flags, seq, source = _rare_header(data, at)
            if stop > end:
                break
            extra, decode = readers.get(number, _UNKNOWN)
            tail = start + length
            if (
                not extra
                or mcrf4xx(data[at + 1 : tail] + extra) != data[tail] | data[tail + 1] << 8
            ):
                at = self._refuse(data, at, stop, number, flags, source, seq)
                continue
            if next_seq.get(source) == seq:
                next_seq[source] = seq + 1 & 0xFF
            else:
                self._follow(source, seq)
            good += 1
            if decode is not None:
                values = decode(data, start, length)
                fields = (source & 0xFF, source >> 8, seq, number, values, data[at:stop])
                frames.append(_new(Frame, fields))
            at = stop
        if at < end:
            self._rest = data[at:]
        self.stats.frames += good
        return frames

    def _resume(self, data: bytes) -> list[Frame]:
        """Go on with the incomplete frame of the last time."""
        data = bytes(data)
        rest, self._rest = self._rest, b""
        frames = self.feed(rest + data)
        if len(self._rest) == len(rest) + len(data) and _starts_with_frame(data):
            # A whole frame came while we still wait: the rest of the old one was never sent.
            self.stats.skipped_bytes += len(rest)
            self._rest = b""
            return self.feed(data)
        return frames

    def _refuse(
        self, data: bytes, at: int, stop: int, number: int, flags: int, source: int, seq: int
    ) -> int:
        """Count what gives no message, and say where to go on."""
        if number == _GARBAGE or number in _CRC_EXTRAS:
            self.stats.bad_crc += number != _GARBAGE
            return self._skip(data, at)
        if flags > _SIGNED:
            self.stats.bad_flags += 1
        else:
            self.stats.unknown += 1
            if source in self._next_seq:
                self._follow(source, seq)
        # No CRC vouches for its length, hence another frame must follow it, or nothing.
        is_plausible = stop == len(data) or data[stop] in _MAGICS
        return stop if is_plausible else self._skip(data, at)

    def _skip(self, data: bytes, at: int) -> int:
        """Go to the next byte after `at` that could start a frame."""
        start = _seek(data, at + 1)
        self.stats.skipped_bytes += start - at
        return start

    def _follow(self, source: int, seq: int) -> None:
        """Count what a source has lost; half a turn behind is late or repeated, not lost."""
        lost = seq - self._next_seq.get(source, seq) & 0xFF
        if lost < 0x80:
            self.stats.lost += lost
            self._next_seq[source] = seq + 1 & 0xFF


def split(data: bytes) -> Iterator[bytes]:
    """Walk over the whole frames of a datagram by magic and length, without checking them."""
    at = _seek(data, 0)
    while at < len(data):
        stop = _rare_header(data, at)[1]
        if stop <= len(data):
            yield data[at:stop]
        at = _seek(data, stop if stop <= len(data) else at + 1)


def _seek(data: bytes, at: int) -> int:
    """Find the first byte from `at` on that could start a frame, or the end."""
    found = _MAGIC.search(data, at)
    return found.start() if found else len(data)


def _rare_header(data: bytes, at: int) -> tuple[int, int, int, int, int, int, int]:
    """Read whatever is at `at`: payload start, frame end, id, payload length, flags, seq, source.

    Bytes that have not come yet read as zero; the end of the frame then lies beyond the data.
    """
    head = data[at : at + 12].ljust(12, b"\0")
    if head[0] == _V1:
        length, seq, source, number = _HEAD_V1(head)
        return at + 6, at + 8 + length, number, length, 0, seq, source
    magic, length, flags, seq, source, number = _HEAD_V2(head)
    if magic != _V2:
        return at, at + 1, _GARBAGE, 0, 0, 0, 0
    stop = at + 12 + length + (_SIGNATURE_LENGTH if flags & _SIGNED else 0)
    number = _UNREADABLE if flags > _SIGNED else number & 0xFFFFFF
    return at + 10, stop, number, length, flags, seq, source


def _starts_with_frame(data: bytes) -> bool:
    """Whether the data starts with a whole frame of a known id with a right CRC."""
    first = next(split(data), b"")
    probe = Parser(())
    probe.feed(first)
    return probe.stats.frames == 1 and data.startswith(first)
