"""What goes wrong, when and with whom, and how people write it down."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mock_vehicle.faults.kinds import KINDS, Parameter


class FaultError(ValueError):
    """A fault that cannot be, and the key that says so."""

    def __init__(self, key: str, reason: str) -> None:
        self.key = key
        self.reason = reason
        super().__init__(reason)


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong."""

    time_s: float
    """Mission time."""
    vehicle: int | None
    """sysid; none strikes all of them."""
    kind: str
    """One of `KINDS`."""
    duration_s: float | None = None
    """None: as long as its kind lasts by itself."""
    values: Mapping[str, float | str | None] = field(default_factory=dict)
    """The kind's parameters that are not as usual."""

    def __post_init__(self) -> None:
        if not isinstance(self.kind, str) or self.kind not in KINDS:
            near = _nearest(self.kind, KINDS)
            raise FaultError("kind", f"{self.kind!r} is no fault; {near}")
        if self.kind == "fleet" and self.vehicle is not None:
            raise FaultError("vehicle", "'fleet' takes no vehicle")
        if not _is_number(self.time_s) or not 0.0 <= self.time_s < math.inf:
            raise FaultError("time_s", f"{self.kind!r} needs a time from 0 s on")
        if self.vehicle is not None and type(self.vehicle) is not int:
            raise FaultError("vehicle", f"{self.vehicle!r} is no sysid")
        self._check_duration()
        for name, value in self.values.items():
            self._check(name, value)

    def _check_duration(self) -> None:
        if self.duration_s is None:
            return
        if not KINDS[self.kind].lasts:
            raise FaultError("duration_s", f"{self.kind!r} happens at once and takes no duration")
        if not _is_number(self.duration_s) or not self.duration_s > 0.0:
            raise FaultError("duration_s", f"{self.kind!r} needs a duration of more than 0 s")

    def _check(self, name: str, value: Any) -> None:
        known = self.parameters
        if name not in known:
            raise FaultError(name, f"{self.kind!r} has no such key; {_nearest(name, known)}")
        if value is None and known[name].default is None:
            return
        try:
            known[name].check(value)
        except ValueError as error:
            raise FaultError(name, str(error)) from None

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """What its kind can be told."""
        return KINDS[self.kind].parameters

    @property
    def times(self) -> float:
        """How often it does harm, infinity when that is not counted."""
        count = self["count"] if "count" in self.parameters else None
        return math.inf if count is None else count

    @property
    def lasts_s(self) -> float:
        """How long it lasts, infinity for good."""
        told = KINDS[self.kind].duration_s if self.duration_s is None else self.duration_s
        return math.inf if told is None else told

    def __getitem__(self, name: str) -> Any:
        """Give a parameter, as told or as usual."""
        return self.values.get(name, self.parameters[name].default)


@dataclass(slots=True)
class Trouble:
    """A fault that one vehicle has at the moment."""

    fault: Fault
    index: int
    """The vehicle, counted from 0."""
    ends_s: float
    """Mission time at which it heals; infinity is never."""
    left: float = math.inf
    """How often it may still do harm, of a fault that is counted."""

    def spend(self) -> bool:
        """Do harm once more, unless it has been done as often as told."""
        self.left -= 1.0
        return self.left >= 0.0


def check(faults: Iterable[Fault], sysids: Iterable[int]) -> None:
    """Raise ValueError for a fault that strikes a vehicle which does not fly."""
    known = set(sysids)
    for fault in faults:
        if fault.vehicle is not None and fault.vehicle not in known:
            raise ValueError(
                f"fault {fault.kind}:{fault.vehicle}@{fault.time_s:g}: there is no vehicle "
                f"{fault.vehicle}; they are {min(known)} to {max(known)}"
            )


COMMON_KEYS = ("time_s", "vehicle", "kind", "duration_s")


def read_fault(keys: Any) -> Fault:
    """Take a fault from the keys of a YAML mapping; FaultError says which one is wrong."""
    if isinstance(keys, Fault):
        return keys
    if not isinstance(keys, dict):
        raise FaultError("", f"should hold keys like time_s: and kind:, not {keys!r}")
    for key in ("kind", "time_s"):
        if key not in keys:
            raise FaultError(key, "is required")
    values = {str(key): value for key, value in keys.items() if key not in COMMON_KEYS}
    return Fault(keys["time_s"], keys.get("vehicle"), keys["kind"], keys.get("duration_s"), values)


FORM = "KIND:SYSID@SECONDS"


def parse_fault(text: str) -> Fault:
    """Read `KIND[:SYSID]@SECONDS[+DURATION][,NAME=VALUE...]`, as `link-delay:2@10+5,delay_s=0.3`.

    Without a sysid it strikes all.
    """
    head, *pairs = text.split(",")
    what, at, when = head.partition("@")
    kind, colon, vehicle = what.partition(":")
    start, plus, duration = when.partition("+")
    if not at:
        raise ValueError(f"--fault {text}: expected {FORM}, as dead:3@60")
    try:
        return Fault(
            _number(start),
            _sysid(vehicle) if colon else None,
            kind,
            _number(duration) if plus else None,
            dict(map(_pair, pairs)),
        )
    except FaultError as error:
        named = f"{error.key}: " if error.key not in COMMON_KEYS else ""
        raise ValueError(f"--fault {text}: {named}{error.reason}") from None
    except ValueError as error:
        raise ValueError(f"--fault {text}: {error}") from None


def _pair(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"expected NAME=VALUE, not {text!r}")
    try:
        return name.strip(), float(value)
    except ValueError:
        return name.strip(), value.strip()


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{text!r} is no number") from None


def _sysid(text: str) -> int:
    if not text.isdecimal():
        raise ValueError(f"{text!r} is no sysid")
    return int(text)


def _nearest(name: object, known: Iterable[str]) -> str:
    names = list(known)
    near = difflib.get_close_matches(str(name), names, n=1, cutoff=0.4)
    return f"did you mean {near[0]!r}?" if near else f"known are {', '.join(names) or 'none'}"
