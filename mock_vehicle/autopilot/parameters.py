"""The parameters of one vehicle: recorded defaults, types, and how they are put into a float."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mock_vehicle.autopilot.parameter_files import INT_BITS, REAL32, check, read, unknown

DATA = Path(__file__).parent / "data"
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
    boot_news: Sequence[tuple[float, str]]
    """(seconds since a boot of the recorded length, NAME or NAME=VALUE told unasked then)."""


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
    boot_news=(
        (1.22, "CAL_ACC0_ID CAL_ACC1_ID CAL_ACC2_ID CAL_BARO0_ID CAL_BARO0_OFF CAL_BARO0_PRIO"),
        (1.22, "CAL_GYRO0_ID CAL_GYRO1_ID CAL_GYRO2_ID"),
        (1.22, "CAL_MAG0_ID CAL_MAG0_PRIO CAL_MAG1_ID CAL_MAG1_PRIO"),
        (1.22, "SENS_BOARD_X_OFF SENS_DPRES_OFF SYS_AUTOCONFIG SYS_AUTOSTART"),
        (5.69, "CAL_BARO0_ID CAL_BARO0_OFF CAL_BARO0_PRIO"),
    ),
)
GYROSCOPES = (
    "INS_GYROFFS_X INS_GYROFFS_Y INS_GYROFFS_Z INS_GYR_ID INS_GYR1_CALTEMP "
    "INS_GYR2OFFS_X INS_GYR2OFFS_Y INS_GYR2OFFS_Z INS_GYR2_ID INS_GYR2_CALTEMP "
    "INS_GYR3OFFS_X INS_GYR3OFFS_Y INS_GYR3OFFS_Z INS_GYR3_ID"
)
"""What a calibration of ArduPilot's gyroscopes measures; one happens at each boot."""
BAROMETERS = "BARO1_GND_PRESS BARO2_GND_PRESS"
"""And one of its barometers."""
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
    boot_news=(
        (1.93, f"{BAROMETERS} INS_GYR_ID INS_ACC_ID INS_GYR2_ID INS_ACC2_ID"),
        (2.46, GYROSCOPES),
        (3.45, "EK3_SRC1_POSXY"),
        (20.05, "BARO1_GND_PRESS=101325 BARO2_GND_PRESS=101323.625"),
    ),
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


def read_values(path: Path, dialects: Collection[Dialect]) -> dict[str, float]:
    """Read a parameter file for a fleet that speaks these dialects; ParameterError names the line.

    A parameter that only some of the fleet have is none of the others' business.
    """
    values: dict[str, float] = {}
    for line in read(path):
        kinds = _kinds(line.place, line.name, dialects)
        for kind in kinds:
            check(line.place, line.name, line.value, kind)
        values[line.name] = line.value
    return values


def share_out(values: Mapping[str, float], dialects: Sequence[Dialect]) -> list[dict[str, float]]:
    """Give each vehicle of a fleet those parameters that it has; somebody must have each."""
    for name in values:
        _kinds("parameters", name, dialects)
    return [
        {name: value for name, value in values.items() if name in table(dialect).index}
        for dialect in dialects
    ]


def _kinds(place: str, name: str, dialects: Collection[Dialect]) -> list[int]:
    tables = [table(dialect) for dialect in {*dialects}]
    kinds = [t.kinds[t.index[name]] for t in tables if name in t.index]
    if not kinds:
        raise unknown(place, name, [known for t in tables for known in t.names])
    return kinds


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
