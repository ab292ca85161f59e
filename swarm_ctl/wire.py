"""Turn MAVLink bytes into messages and back, by functions generated from pymavlink's tables."""

from __future__ import annotations

import re
import struct
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
_CRC_SEEDS = {_V1: 0x3086, _V2: 0x3085}  # after the magic, which it leaves out, it is 0xFFFF again
_HEADS = {_V1: "<BBBBBB", _V2: "<BBxxBBB3s"}  # magic, length, seq, sysid, compid, id
_SIGNED = 0x01
_SIGNATURE_LENGTH = 13
_GARBAGE, _UNREADABLE = -1, -2  # in place of an id: no frame here; a frame with unknown flags
_MAGICS = b"\xfd\xfe"
_MAGIC = re.compile(b"[" + _MAGICS + b"]")
_TRAILER = Struct("<H").pack  # the CRC
_RIM = Struct("<xBB4x3s").unpack_from  # length, flags and id of MAVLink 2


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

_TABLES: dict[int, Any] = {**dialect.mavlink_map, **{table.id: table for table in _LEFT_OUT}}
_CRC_EXTRAS = {number: bytes([table.crc_extra]) for number, table in _TABLES.items()}
_IDS = {table.msgname: number for number, table in _TABLES.items()}
_PACK_ERRORS = (StructError, TypeError, ValueError, OverflowError)
_Read = Callable[[bytes, bytes, "Parser"], Any]


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
        frame = layout({magic}, {size}, seq, sysid, compid, {number}, {arguments})
    except errors as error:
        raise blame((seq, sysid, compid, {values})) from error
    if {trims} and not frame[-1]:
        end = len(frame.rstrip(b"\\0"))
        frame = starts[end] + frame[2 : end if end > 10 else 11]
    return frame + trailer(crc(frame + extra, {seed}))
"""
_STARTS = [bytes([_V2, max(end - 10, 1)]) for end in range(10 + 256)]  # trimmed to this end

_READ_SOURCE = """
def read(body, raw, parser):
    {unpacking}
    if magic != 0xFD or flags > 1 or crc(body[1:-2] + extra) != expected:
        return None
    source = sysid | compid << 8
    if parser._next_seq.get(source) == seq:
        parser._next_seq[source] = seq + 1 & 0xFF
    else:
        parser._follow(source, seq)
    return {result}
"""
_WHOLE_FRAME = """
    whole = body if len(body) == {size} else body[:-2].ljust({size} - 2, b"\\0") + body[-2:]
    magic, flags, seq, sysid, compid, {slots} expected = unpack(whole)
"""
_RIMS = """
    magic, flags, seq, sysid, compid = unpack(body)
    expected = body[-2] | body[-1] << 8
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
        self._format = "".join(field.format for field in self._wire_order)
        self._size = struct.calcsize("<" + self._format)
        self._wire_indices = [table.ordered_fieldnames.index(name) for name in self.fields]
        self._declared = [self._wire_order[index] for index in self._wire_indices]

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
        return self._packer(_V2, self.id.to_bytes(3, "little"), self._wire_order)

    @cached_property
    def pack_v1(self) -> Callable[..., bytes]:
        """Make a MAVLink 1 frame, as `pack` does; extensions stay out of it."""
        if self.id > 0xFF:
            raise ValueError(f"{self.name} has id {self.id}, and MAVLink 1 ends at 255")
        return self._packer(_V1, self.id, self._wire_order[: self._base_count])

    @cached_property
    def read(self) -> _Read:
        """Make a `Frame` of a MAVLink 2 frame up to its CRC, and note its seq with a parser.

        The whole frame, its signature as well if it has one, is passed on as `raw`. A wrong CRC,
        or flags we do not know, give None; a payload longer than ours raises struct's error.
        """
        slots = "".join(f"{s}, " for i, f in enumerate(self._wire_order) for s in f.slots(i))
        fields = ", ".join(self._wire_order[i].unpacking(i) for i in self._wire_indices)
        source = _READ_SOURCE.format(
            unpacking=_WHOLE_FRAME.format(size=self._size + 12, slots=slots),
            result=f"new(Frame, (sysid, compid, seq, {self.id}, new(values, ({fields},)), raw))",
        )
        layout = Struct(f"<BxBxBBB3x{self._format}H")
        return self._generate("read", source, {"unpack": layout.unpack})

    @cached_property
    def skim(self) -> _Read:
        """Check a frame and note its seq as `read` does, but give True for it."""
        source = _READ_SOURCE.format(unpacking=_RIMS, result="True")
        return self._generate("read", source, {"unpack": Struct("<BxBxBBB").unpack_from})

    def plain(self, payload: bytes, seq: int = 0, source: int = 0) -> bytes:
        """Make the frame that `read` reads: MAVLink 2, unsigned, of full length."""
        head = struct.pack("<BxxBH", self._size, seq, source) + self.id.to_bytes(3, "little")
        body = head + payload[: self._size].ljust(self._size, b"\0")
        return b"\xfd" + body + checksum(body)

    def unpack(self, payload: bytes) -> Any:
        """Read `values` from a payload: what is missing is zero, what is too much is ignored."""
        return self.read(self.plain(payload), b"", Parser(())).values

    def _packer(
        self, magic: int, number: int | bytes, fields: list[_Field]
    ) -> Callable[..., bytes]:
        """Generate a pack function; the variable of the field declared i-th is v<i>."""
        names = {field.name: f"v{i}" for i, field in enumerate(self._declared)}
        parameters = [
            names[field.name] + (f"={field.default}" if i >= self._base_count else "")
            for i, field in enumerate(self._declared)
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
            trims=magic == _V2,
        )
        return self._generate("pack", source, {"layout": layout.pack})

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
            "trailer": _TRAILER,
            "starts": _STARTS,
            "new": tuple.__new__,
            "Frame": Frame,
        } | names
        exec(source, scope)  # noqa: S102 - the source is made of pymavlink's tables alone
        return cast("Callable[..., Any]", scope[name])

    def _blame(self, values: Sequence[Any]) -> ValueError:
        """Find the field that does not fit."""
        for field, value in zip([*_HEADER_FIELDS, *self._declared], values, strict=True):
            try:
                field.check(value)
            except _PACK_ERRORS as error:
                return ValueError(f"{self.name}.{field.name} cannot be {value!r}: {error}")
        return ValueError(f"{self.name} cannot be packed from {values!r}")


@cache
def _message(number: int) -> Message:
    return Message(_TABLES[number])


def message(key: str | int) -> Message:
    """Look a message up by its name or id."""
    number = _IDS.get(key) if isinstance(key, str) else key
    if number is None or number not in _CRC_EXTRAS:
        raise ValueError(f"the dialect ardupilotmega has no message {key!r}")
    return _message(number)


def checksum(body: bytes) -> bytes:
    """Give the CRC of a MAVLink 2 frame of our dialect: of all that stands after its magic."""
    number = body[6] | body[7] << 8 | body[8] << 16
    return _TRAILER(mcrf4xx(body + _CRC_EXTRAS[number]))


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


class Parser:
    """Cut a stream of bytes into frames and decode those of the subscribed messages."""

    def __init__(self, subscribed: Iterable[str | int | Message] | None) -> None:
        """Subscribe to messages, or to all of the dialect by None."""
        self.stats = Stats()
        self._rest = b""
        self._next_seq: dict[int, int] = {}
        self._lost: dict[int, int] = {}
        keys = _CRC_EXTRAS if subscribed is None else subscribed
        ids = (key.id if isinstance(key, Message) else message(key).id for key in keys)
        self._subscribed = frozenset(ids)
        self._readers: dict[bytes, _Read] = {}

    def feed(self, data: bytes) -> list[Frame]:
        """Take the next bytes, in any chunks, and give the subscribed frames they complete.

        One long loop, because every call in it would cost each frame a tenth of its time; for
        the same reason a datagram of one plain frame goes round it.
        """
        if self._rest or data.__class__ is not bytes:
            return self._resume(data)
        readers, at, end = self._readers, 0, len(data)
        if end > 11 and data[1] + 12 == end and not data[2]:
            try:
                frame = readers[data[7:10]](data, data, self)
            except (StructError, KeyError):
                frame = None
            if frame is not None:
                self.stats.frames += 1
                return [] if frame is True else [frame]
        frames: list[Frame] = []
        good = 0
        while at < end:
            try:
                length, flags, number = _RIM(data, at)
                tail = at + 12 + length
                body = data[at:tail]
                # flags mean a signature, or what `read` refuses
                stop = tail + _SIGNATURE_LENGTH if flags else tail
                raw = data[at:stop] if flags else body
                frame = readers[number](body, raw, self) if stop <= end else None
            except (StructError, KeyError):
                frame = None
            if frame is None:
                stop = self._read_odd(data, at, frames)
                if stop == at:
                    self._rest = data[at:]
                    break
            else:
                good += 1
                if frame is not True:
                    frames.append(frame)
            at = stop
        self.stats.frames += good
        return frames

    def lost_of(self, sysid: int) -> int:
        """Count the lost frames of one system, over all its components."""
        return self._lost.get(sysid, 0)

    def _read_odd(self, data: bytes, at: int, frames: list[Frame]) -> int:
        """Take what is no frame of MAVLink 2 as we know it, or the first of its id.

        Gives where to go on; that is `at` while bytes are missing.
        """
        start, stop, number, length, flags, seq, source = _header(data, at)
        if stop > len(data):
            return at
        tail = start + length
        extra = _CRC_EXTRAS.get(number)
        if not extra or mcrf4xx(data[at + 1 : tail] + extra) != data[tail] | data[tail + 1] << 8:
            return self._refuse(data, at, stop, number, flags, source, seq)
        known = _message(number)
        read = known.read if number in self._subscribed else known.skim
        self._readers[number.to_bytes(3, "little")] = read
        frame = read(known.plain(data[start:tail], seq, source), data[at:stop], self)
        if frame is not True:
            frames.append(frame)
        self.stats.frames += 1
        return stop

    def _resume(self, data: bytes) -> list[Frame]:
        """Go on with the incomplete frame of the last time."""
        data = bytes(data)
        rest, self._rest = self._rest, b""
        frames = self.feed(rest + data)
        if len(self._rest) > len(data) and _starts_with_frame(data):
            # A whole frame came while we still wait: the rest of the old one was never sent.
            self.stats.skipped_bytes += len(self._rest) - len(data)
            self._rest = b""
            frames += self.feed(data)
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
            self._lost[source & 0xFF] = self._lost.get(source & 0xFF, 0) + lost
            self._next_seq[source] = seq + 1 & 0xFF


def split(data: bytes) -> Iterator[bytes]:
    """Walk over the whole frames of a datagram by magic and length, without checking them."""
    at, end = 0, len(data)
    while at + 2 < end:
        if data[at] == _V2 and not data[at + 2]:
            stop = at + 12 + data[at + 1]
        else:
            at = _seek(data, at)
            stop = _header(data, at)[1]
        if stop <= end:
            yield data[at:stop]
            at = stop
        else:
            at = _seek(data, at + 1)


def _seek(data: bytes, at: int) -> int:
    """Find the first byte from `at` on that could start a frame, or the end."""
    found = _MAGIC.search(data, at)
    return found.start() if found else len(data)


def _header(data: bytes, at: int) -> tuple[int, int, int, int, int, int, int]:
    """Read whatever is at `at`: payload start, frame end, id, payload length, flags, seq, source.

    Bytes that have not come yet read as zero; the end of the frame then lies beyond the data.
    """
    head = data[at : at + 12].ljust(12, b"\0")
    if head[0] == _V1:
        length, seq, source, number = struct.unpack_from("<xBBHB", head)
        return at + 6, at + 8 + length, number, length, 0, seq, source
    magic, length, flags, seq, source, number = struct.unpack_from("<BBBxBHI", head)
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
