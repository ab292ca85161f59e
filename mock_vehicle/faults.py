"""What goes wrong, when and with whom."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mock_vehicle.errors import WorldError

if TYPE_CHECKING:
    from mock_vehicle.world import World

KINDS = {
    "dead": "the vehicle falls silent and drops",
    "silent-radio": "its radio neither sends nor hears",
    "battery": "its battery falls to 10 %",
    "rangefinder": "its rangefinders stop reporting",
    "freeze": "its autopilot is silent for 5 s, then back",
    "fleet": "the mock itself dies without a word",
}
BATTERY_LEFT = 0.1
FREEZE_S = 5.0


class FleetKilled(SystemExit):
    """The fault `fleet`: the process ends here, with nothing written."""

    def __init__(self) -> None:
        super().__init__(70)


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong."""

    time_s: float
    """Mission time."""
    vehicle: int | None
    """sysid; none strikes all of them."""
    kind: str
    """One of `KINDS`."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"{self.kind!r} is no fault{_nearest(self.kind)}")
        if self.kind == "fleet" and self.vehicle is not None:
            raise ValueError("'fleet' takes no vehicle")
        if not self.time_s >= 0.0:
            raise ValueError(f"{self.kind!r} needs a time from 0 s on")


class Schedule:
    """Faults in the order of their time."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._waiting = sorted(faults, key=lambda fault: fault.time_s)[::-1]

    def due(self, now: float) -> list[Fault]:
        """Take the faults whose time has come."""
        struck: list[Fault] = []
        while self._waiting and self._waiting[-1].time_s <= now:
            struck.append(self._waiting.pop())
        return struck


def check(faults: Iterable[Fault], sysids: Iterable[int]) -> None:
    """Raise ValueError for a fault that strikes a vehicle which does not fly."""
    known = set(sysids)
    for fault in faults:
        if fault.vehicle is not None and fault.vehicle not in known:
            raise ValueError(
                f"fault {fault.kind!r} strikes vehicle {fault.vehicle}, "
                f"but the fleet is {min(known)} to {max(known)}"
            )


def parse_fault(text: str) -> Fault:
    """Read `KIND:SYSID@SECONDS`, as `dead:3@60`; without a sysid it strikes all."""
    what, at, when = text.partition("@")
    kind, colon, vehicle = what.partition(":")
    if not at:
        raise ValueError(f"--fault {text}: expected KIND:SYSID@SECONDS, as dead:3@60")
    try:
        return Fault(_number(when), _sysid(vehicle) if colon else None, kind)
    except ValueError as error:
        raise ValueError(f"--fault {text}: {error}") from None


def world_faults(world: World) -> list[Fault]:
    """Read the faults a world file asks for, or say which one it cannot have."""
    faults: list[Fault] = []
    for index, spec in enumerate(world.spec.faults):
        try:
            faults.append(Fault(spec.time_s, spec.vehicle, spec.kind))
        except ValueError as error:
            raise WorldError(world.path, f"faults[{index}].kind", str(error)) from None
    return faults


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{text!r} is no number") from None


def _sysid(text: str) -> int:
    if not text.isdecimal():
        raise ValueError(f"{text!r} is no sysid")
    return int(text)


def _nearest(kind: str) -> str:
    near = difflib.get_close_matches(kind, KINDS, n=1, cutoff=0.4)
    return f"; did you mean {near[0]!r}?" if near else f"; known are {', '.join(KINDS)}"
