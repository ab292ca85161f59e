"""The parameters of one vehicle, and the microservice that tells and changes them."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from mock_vehicle.autopilot.link import Link
from mock_vehicle.autopilot.parameter_files import INT32, INT_BITS, REAL32, check, read, unknown
from mock_vehicle.autopilot.traits import Severity
from swarm_ctl import wire

if TYPE_CHECKING:
    from mock_vehicle.autopilot.base import Autopilot

PARAM_REQUEST_LIST = wire.message("PARAM_REQUEST_LIST")
PARAM_REQUEST_READ = wire.message("PARAM_REQUEST_READ")
PARAM_SET = wire.message("PARAM_SET")
PARAM_VALUE = wire.message("PARAM_VALUE")

DATA = Path(__file__).parent / "data"
UINT32 = 5
NO_INDEX = 0xFFFF
BY_NAME = -1
"""param_index of a PARAM_REQUEST_READ that means its name."""
HASH = "_HASH_CHECK"
SYSIDS = range(1, 256)


@dataclass(frozen=True, slots=True)
class Dialect:
    """How an autopilot speaks of parameters; recorded."""

    name: str
    """Of the file of names, defaults and types, in the order of the list."""
    sysid: str
    """The parameter that becomes the sysid at the next boot."""
    encode: Callable[[float, int], float]
    """(value, type) -> param_value."""
    decode: Callable[[float, int, int], float | None]
    """(param_value, param_type, type) -> value, None for one that is ignored without a word."""
    list_after_s: float
    list_per_s: float
    """How fast a list comes."""
    has_hash: bool
    """Whether a list begins with a checksum of all parameters."""
    ignores_case: bool
    tells_index: bool
    """Whether a parameter that was asked for by name, or set, comes with its index."""
    repeat_after_s: float | None
    """A change is told on all links so much later; None is at once."""


def encode_bytewise(value: float, kind: int) -> float:
    """Hide the bits of an integer in the float (MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE)."""
    if kind == REAL32:
        return value
    return float(struct.unpack("<f", struct.pack("<I", int(value) & 0xFFFFFFFF))[0])


def decode_bytewise(value: float, claimed: int, kind: int) -> float | None:
    """Take a value of the right type alone, whatever it is, even NaN."""
    if claimed != kind:
        return None
    if kind == REAL32:
        return value
    return float(struct.unpack("<i", struct.pack("<f", value))[0])


def encode_cast(value: float, kind: int) -> float:  # noqa: ARG001 - a Dialect's encoder
    """Say the number as it is."""
    return value


def decode_cast(value: float, claimed: int, kind: int) -> float | None:  # noqa: ARG001
    """Take every number, cut to what the type can hold; what it claims to be does not count."""
    if not math.isfinite(value):
        return None
    if kind == REAL32:
        return value
    bound = 2 ** (INT_BITS[kind] - 1)
    return float(min(max(math.trunc(value), -bound), bound - 1))


PX4 = Dialect(
    name="px4",
    sysid="MAV_SYS_ID",
    encode=encode_bytewise,
    decode=decode_bytewise,
    list_after_s=0.010,
    list_per_s=1000.0,
    has_hash=True,
    ignores_case=False,
    tells_index=True,
    repeat_after_s=0.010,
)
ARDUPILOT = Dialect(
    name="ardupilot",
    sysid="MAV_SYSID",
    encode=encode_cast,
    decode=decode_cast,
    list_after_s=0.020,
    list_per_s=1660.0,
    has_hash=False,
    ignores_case=True,
    tells_index=False,
    repeat_after_s=None,
)


@dataclass(frozen=True, slots=True)
class _Table:
    """What all vehicles of one autopilot have in common."""

    names: list[str]
    index: Mapping[str, int]
    kinds: list[int]
    defaults: Mapping[str, float]


@cache
def table(dialect: Dialect) -> _Table:
    """Read the defaults of an autopilot, once."""
    lines = list(read(DATA / f"{dialect.name}.param"))
    names = [line.name for line in lines]
    return _Table(
        names,
        {name: index for index, name in enumerate(names)},
        [line.kind or REAL32 for line in lines],
        {line.name: line.value for line in lines},
    )


class Parameters(Mapping[str, float]):
    """The values of one vehicle: defaults, and what was changed; a reboot keeps them."""

    def __init__(self, dialect: Dialect, values: Mapping[str, float]) -> None:
        self.dialect = dialect
        self._table = table(dialect)
        self._changed: dict[str, float] = {}
        for name, value in values.items():
            if name not in self:
                raise unknown(dialect.name, name, self._table.index)
            check(dialect.name, name, float(value), self.kind(name))
            self[name] = float(value)

    def __getitem__(self, name: str) -> float:
        changed = self._changed.get(name)
        return self._table.defaults[name] if changed is None else changed

    def __setitem__(self, name: str, value: float) -> None:
        self._changed[name] = value

    def __iter__(self) -> Iterator[str]:
        return iter(self._table.names)

    def __len__(self) -> int:
        return len(self._table.names)

    def __contains__(self, name: object) -> bool:
        return name in self._table.index

    @property
    def changed(self) -> dict[str, float]:
        """Give the defaults of those that have been changed, all but the sysid."""
        return {n: self._table.defaults[n] for n in self._changed if n != self.dialect.sysid}

    def index(self, name: str) -> int:
        """Tell where in the list a parameter stands."""
        return self._table.index[name]

    def kind(self, name: str) -> int:
        """Tell the MAV_PARAM_TYPE."""
        return self._table.kinds[self._table.index[name]]

    def named(self, index: int) -> str | None:
        """Tell which parameter stands there."""
        return self._table.names[index] if 0 <= index < len(self) else None

    def finite(self, name: str, low: float = -math.inf, high: float = math.inf) -> float:
        """Read a number to compute with: within bounds, the default in place of NaN."""
        value = self[name]
        if not math.isfinite(value):
            value = self._table.defaults[name]
        return min(max(value, low), high)

    def share(self, name: str, low: float = 0.0) -> float:
        """Give a value, not below `low`, over its recorded default."""
        return self.finite(name, low, 1e6) / self._table.defaults[name]

    @property
    def sysid(self) -> int | None:
        """The sysid for the next boot, None when what is stored is none."""
        value = self[self.dialect.sysid]
        return int(value) if value in SYSIDS else None

    @property
    def checksum(self) -> int:
        """32 bits over all names and values; never those of a NaN, which no float carries whole."""
        content = b"".join(n.encode() + struct.pack("<f", value) for n, value in self.items())
        return zlib.crc32(content) & 0x7F7FFFFF


class ParameterService:
    """Tells and changes the parameters of one vehicle over its links."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._dialect = parameters.dialect
        self._lists: dict[Link, tuple[float, int]] = {}
        """Lists under way: when they began, and how many values have gone."""
        self._repeats: list[tuple[float, str]] = []
        """Changes that all links are still to hear of, and when."""

    def run(self, autopilot: Autopilot, now: float) -> None:
        """Go on with lists, and repeat changes that are due."""
        for link in (*self._lists,):
            with autopilot.serving(link):
                self._continue(autopilot, link, now)
        while self._repeats and self._repeats[0][0] <= now:
            self.tell(autopilot, self._repeats.pop(0)[1])

    def _continue(self, autopilot: Autopilot, link: Link, now: float) -> None:
        began, told = self._lists[link]
        due = int((now - began - self._dialect.list_after_s) * self._dialect.list_per_s)
        for index in range(told, min(due, len(self._parameters))):
            name = self._parameters.named(index) or ""
            self._send(autopilot, name, name, index)
            told += 1
        self._lists[link] = began, told
        if told == len(self._parameters):
            del self._lists[link]

    def begin_list(self, autopilot: Autopilot, now: float) -> None:
        """Start the list, again from the first where it is under way."""
        for text in autopilot.banner:
            autopilot.say(Severity.INFO, text, now)
        if self._dialect.has_hash:
            self._send_hash(autopilot)
        for link in autopilot.to:
            self._lists[link] = now, 0

    def _end_list(self, autopilot: Autopilot) -> None:
        """Stop the list: who asked knows its parameters by their checksum."""
        for link in autopilot.to:
            self._lists.pop(link, None)

    def tell(self, autopilot: Autopilot, name: str, spelt: str | None = None) -> None:
        """Send the value of a parameter, under its name as it was spelt, unless it is unknown."""
        if self._dialect.has_hash and name == HASH:
            self._send_hash(autopilot)
        elif name in self._parameters:
            index = self._parameters.index(name) if self._dialect.tells_index else NO_INDEX
            self._send(autopilot, name, spelt or name, index)

    def tell_indexed(self, autopilot: Autopilot, index: int) -> None:
        """Send the value of a parameter by its place in the list, unless it is beyond."""
        name = self._parameters.named(index)
        if name is not None:
            self._send(autopilot, name, name, index)

    def change(self, autopilot: Autopilot, spelt: str, raw: float, kind: int, now: float) -> None:
        """Take a value from the wire, and tell which one is in force; nothing for nonsense."""
        name = self.known(spelt)
        if self._dialect.has_hash and name == HASH:
            self._end_list(autopilot)
        if name not in self._parameters:
            return
        value = self._dialect.decode(raw, kind, self._parameters.kind(name))
        if value is None:
            return
        changes = value != self._parameters[name]
        autopilot.set_parameter(name, value)
        if self._dialect.repeat_after_s is None:
            with autopilot.serving(*autopilot.links):
                self.tell(autopilot, name, spelt)
            return
        self.tell(autopilot, name)
        if changes:
            self._repeats.append((now + self._dialect.repeat_after_s, name))

    def known(self, spelt: str) -> str:
        """Give the name as the table has it."""
        return spelt.upper() if self._dialect.ignores_case else spelt

    def _send(self, autopilot: Autopilot, name: str, spelt: str, index: int) -> None:
        kind = self._parameters.kind(name)
        value = self._dialect.encode(self._parameters[name], kind)
        autopilot.send(PARAM_VALUE, spelt, value, kind, len(self._parameters), index)

    def _send_hash(self, autopilot: Autopilot) -> None:
        value = encode_bytewise(self._parameters.checksum, INT32)
        autopilot.send(PARAM_VALUE, HASH, value, UINT32, len(self._parameters), NO_INDEX)


def on_request_list(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Start to send all parameters, a few per step."""
    v = frame.values
    if autopilot.accepts_command(v.target_system, v.target_component, 0):
        autopilot.parameter_service.begin_list(autopilot, now)


def on_request_read(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:  # noqa: ARG001
    """Send one parameter, by index or by name."""
    v, service = frame.values, autopilot.parameter_service
    if not autopilot.accepts_command(v.target_system, v.target_component, 0):
        return
    if v.param_index == BY_NAME:
        service.tell(autopilot, service.known(v.param_id), v.param_id)
    else:
        service.tell_indexed(autopilot, v.param_index)


def on_set(autopilot: Autopilot, frame: wire.Frame, now: float) -> None:
    """Change one parameter."""
    v, service = frame.values, autopilot.parameter_service
    if autopilot.accepts_command(v.target_system, v.target_component, 0):
        service.change(autopilot, v.param_id, v.param_value, v.param_type, now)


MESSAGES: Mapping[int, Callable[..., None]] = {
    PARAM_REQUEST_LIST.id: on_request_list,
    PARAM_REQUEST_READ.id: on_request_read,
    PARAM_SET.id: on_set,
}
"""The parameter microservice, by message id."""
