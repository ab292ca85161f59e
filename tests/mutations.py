"""Mutated MAVLink frames for a mock vehicle: broken ones, hostile ones and nonsense."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from messages import TABLES

from mock_vehicle.vehicle import Vehicle
from swarm_ctl import wire

NAN, INF = math.nan, math.inf
MAX, TINY = 3.4028234663852886e38, 1e-45
NO_NUMBERS = (NAN, INF, -INF)
FLOATS = (*NO_NUMBERS, 0.0, -0.0, 1.0, -1.0, 0.5, MAX, -MAX, TINY, 1e20, -1e9, 2.0**31, 2.0**63)
PASSIVE_COMMANDS = (0, 510, 511, 512, 519, 520, 31999, 65535)
"""Requests, and what nobody knows."""
PASSIVE_MESSAGES = frozenset(
    wire.message(name).id
    for name in (
        *("COMMAND_LONG", "COMMAND_INT", "HEARTBEAT", "PING", "TIMESYNC"),
        *("PARAM_REQUEST_LIST", "PARAM_REQUEST_READ"),
    )
)
SETUP_SIGNING = wire.message("SETUP_SIGNING").id
"""Not made: a vehicle that took a key would rightly heed nobody any more."""
SETPOINT = wire.message("SET_POSITION_TARGET_LOCAL_NED")
MASKS = (0xDC7, 0xDF8, 0xDC0, 0xC3F, 0xC00, 0x9C7, 0x000)
FAR = (500.0, 500.0, -500.0, 5.0, 5.0, -5.0, 3.0, 3.0, -3.0, 1.0, 0.5)
SENDERS = ((7, 191), (255, 190), (254, 1), (1, 1), (2, 191), (0, 0))


class Dice:
    """Cheap draws of a seeded generator."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._drawn: Iterator[float] = iter(())

    def below(self, limit: int) -> int:
        """Draw a whole number from 0 to limit - 1."""
        for value in self._drawn:
            return int(value * limit)
        self._drawn = iter(self._rng.random(1 << 14).tolist())
        return self.below(limit)

    def pick(self, options: Sequence[Any]) -> Any:
        """Draw one of several."""
        return options[self.below(len(options))]

    def octets(self, count: int) -> bytes:
        """Draw bytes."""
        return self._rng.bytes(count)


class Shape(NamedTuple):
    """A message and what its fields are made of, in declaration order."""

    message: wire.Message
    codes: tuple[str, ...]
    lengths: tuple[int, ...]

    def at(self, name: str) -> int:
        """Find a field."""
        fields = self.message.fields
        return fields.index(name) if name in fields else -1


def shape(number: int) -> Shape:
    """Look a message up in pymavlink's tables."""
    table = TABLES[number]
    codes = table.native_format.decode().lstrip("<")
    return Shape(
        wire.message(number),
        tuple(codes[i] for i in table.orders),
        tuple(table.array_lengths[i] for i in table.orders),
    )


def hostile(dice: Dice, code: str, length: int) -> Any:
    """Draw a value that a careless receiver trips over."""
    if code == "c":
        return dice.pick((b"", b"\xff" * length, b"A" * length, dice.octets(length)))
    if length:
        return [hostile(dice, code, 0) for _ in range(length)]
    if code in "fd":
        return dice.pick(FLOATS)
    bits = {"b": 8, "h": 16, "i": 32, "q": 64}[code.lower()]
    low = -(1 << bits - 1) if code.islower() else 0
    top = low + (1 << bits) - 1
    return dice.pick((0, 1, low, top, top - 1, low + dice.below(1 << min(bits, 52))))


class Forge:
    """Makes mutated frames for one vehicle."""

    def __init__(self, vehicle: Vehicle, dice: Dice) -> None:
        self.vehicle, self.dice = vehicle, dice
        autopilot = vehicle.autopilot
        self._shapes = {n: shape(n) for n in autopilot.message_table if n != SETUP_SIGNING}
        self._all = list(self._shapes)
        self._harmless = [number for number in self._all if number in PASSIVE_MESSAGES]
        parameters = autopilot.parameters
        self._names = [name for name in parameters if name != parameters.dialect.sysid]
        self._commands = (*autopilot.command_table, *PASSIVE_COMMANDS)
        self.calm = False
        """Make nothing that may rightly change the flight."""
        self.hovers = False
        self.hover_ned_m: tuple[float, ...] = (0.0, 0.0, 0.0)
        self._seq = 0

    def make(self) -> tuple[str, list[bytes]]:
        """Give the name of a mutation, and its datagrams."""
        kind = self.dice.pick(KINDS)
        return kind, MUTATIONS[kind](self)

    def frame(self, *, heard: bool = True, v1: bool = False) -> bytes:
        """Make a frame with hostile fields; one that is `heard` reaches its vehicle's handlers."""
        dice = self.dice
        one = self._shapes[dice.pick(self._harmless if heard and self.calm else self._all)]
        if one.message is SETPOINT and dice.below(2):
            return self.setpoint()
        values: list[Any] = [
            (0,) * length if length and code != "c" else b"" if code == "c" else 0
            for code, length in zip(one.codes, one.lengths, strict=True)
        ]
        for _ in range(dice.pick((0, 1, 1, 1, 2, 4, len(values)))):
            at = dice.below(len(values))
            values[at] = hostile(dice, one.codes[at], one.lengths[at])
        self._address(one, values, ours=heard)
        is_v1 = v1 and one.message.id < 256
        return self._packed(one.message.pack_v1 if is_v1 else one.message.pack, values)

    def _address(self, one: Shape, values: list[Any], *, ours: bool) -> None:
        """Set the target, a command that may be given in this mood, and a name that is known."""
        dice, sysid = self.dice, self.vehicle.sysid
        system, component, command = map(one.at, ("target_system", "target_component", "command"))
        if system >= 0:
            values[system] = sysid if ours else (sysid + 1 + dice.below(254)) % 256 or sysid + 1
        if component >= 0:
            values[component] = dice.pick((0, 1, 1)) if ours else dice.below(256)
        if command >= 0:
            calm = ours and self.calm
            values[command] = dice.pick(PASSIVE_COMMANDS if calm else self._commands)
        if one.at("param_id") >= 0 and dice.below(2):
            values[one.at("param_id")] = dice.pick(self._names)

    def setpoint(self) -> bytes:
        """Make a setpoint far away that must stop a vehicle: where it is used, it is no number.

        ArduPilot stops for any. To PX4 a NaN is an axis that is not used, and half a plane stops.
        """
        dice = self.dice
        mask, coordinates = dice.pick(MASKS), dice.pick((1, 1, 1, 1, 0, 12, 99, 255))
        used = [at for at in range(9) if not mask >> at & 1]
        values = list(FAR)
        if self.vehicle.personality == "ardupilot":
            read = [at for at in used if at < 6] or used  # acceleration beside others is not
            values[dice.pick(read)] = dice.pick(NO_NUMBERS)
        else:
            at = dice.pick(used)
            values[at] = dice.pick(NO_NUMBERS if at % 3 < 2 else (INF, -INF))
        return self._packed(SETPOINT.pack, [0, self.vehicle.sysid, 1, coordinates, mask, *values])

    def _packed(self, pack: Callable[..., bytes], values: Sequence[Any]) -> bytes:
        self._seq = (self._seq + 1) & 0xFF
        return pack(self._seq, *self.dice.pick(SENDERS), *values)

    def sealed(self, body: bytes) -> bytes:
        """Make a MAVLink 2 frame of a body by its right CRC, or a wrong one for unknown ids."""
        known = int.from_bytes(body[6:9], "little") in TABLES
        return b"\xfd" + body + (wire.checksum(body) if known else b"\0\0")

    def flipped(self, frame: bytes, first: int, stop: int) -> bytes:
        """Turn one bit over."""
        at = first + self.dice.below(stop - first)
        return frame[:at] + bytes([frame[at] ^ 1 << self.dice.below(8)]) + frame[at + 1 :]


def cut(forge: Forge) -> list[bytes]:
    """Leave the end out."""
    frame = forge.frame(heard=False)
    return [frame[: forge.dice.below(len(frame))]]


def wrong_crc(forge: Forge) -> list[bytes]:
    """Turn over a bit of the payload or the CRC."""
    frame = forge.frame(heard=False)
    return [forge.flipped(frame, 10, len(frame))]


def wrong_length(forge: Forge) -> list[bytes]:
    """Lie about the length of the payload."""
    frame = forge.frame(heard=False)
    return [frame[:1] + bytes([frame[1] ^ 1 + forge.dice.below(255)]) + frame[2:]]


def wrong_header(forge: Forge) -> list[bytes]:
    """Turn over a bit of flags, seq, sender or id, and put the CRC right again.

    The id only in wild moods: COMMAND_INT could become SET_MODE. HEARTBEAT never becomes
    SETUP_SIGNING, whose id has another second byte.
    """
    frame = forge.flipped(forge.frame(), 2, 7 if forge.calm else 8)
    return [forge.sealed(frame[1:-2])]


def unknown_id(forge: Forge) -> list[bytes]:
    """Name a message that nobody knows."""
    frame = forge.frame(heard=False)
    return [frame[:7] + b"\xab\xcd\xef" + frame[10:]]


def extended(forge: Forge) -> list[bytes]:
    """Lengthen the payload beyond the message, with a right CRC."""
    frame = forge.frame()
    payload = frame[10:-2] + forge.dice.octets(255)
    length = len(frame) - 12 + forge.dice.below(256 - (len(frame) - 12))
    return [forge.sealed(bytes([length]) + frame[2:10] + payload[:length])]


def split(forge: Forge) -> list[bytes]:
    """Spread a frame over two datagrams."""
    frame = forge.frame()
    at = 1 + forge.dice.below(len(frame) - 1)
    return [frame[:at], frame[at:]]


def signed(forge: Forge) -> list[bytes]:
    """Sign with nonsense."""
    frame = forge.frame()
    return [forge.sealed(frame[1:2] + b"\x01" + frame[3:-2]) + forge.dice.octets(13)]


def garbage(forge: Forge) -> list[bytes]:
    """Send noise, perhaps behind a magic."""
    return [forge.dice.pick((b"", b"\xfd", b"\xfe")) + forge.dice.octets(forge.dice.below(280))]


MUTATIONS: Mapping[str, Callable[[Forge], list[bytes]]] = {
    "hostile fields": lambda forge: [forge.frame()],
    "hostile fields, MAVLink 1": lambda forge: [forge.frame(v1=True)],
    "NaN setpoints": lambda forge: [forge.setpoint()],
    "several in a datagram": lambda forge: [b"".join(forge.frame() for _ in range(3))],
    "split": split,
    "signed with nonsense": signed,
    "extended": extended,
    "wrong target": lambda forge: [forge.frame(heard=False)],
    "wrong CRC": wrong_crc,
    "wrong length": wrong_length,
    "wrong header": wrong_header,
    "truncated": cut,
    "unknown id": unknown_id,
    "garbage": garbage,
}
KINDS = tuple(MUTATIONS)
