"""What a test asks for: which vehicles, where, and in whose time."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from mock_vehicle.faults import Fault, parse_fault
from mock_vehicle.vehicle import MIXED, PERSONALITIES, personalities
from mock_vehicle.world import World, load_world
from mock_vehicle.world.field import open_field
from swarm_ctl.signing import key_of

SYSID_MAX = 255
SLOWEST, FASTEST = 0.1, 100.0
CHOICES: Mapping[str, tuple[str, ...]] = {
    "autopilot": (*PERSONALITIES, MIXED),
    "time": ("real", "virtual"),
    "rates": ("full", "lean"),
    "boot": ("fast", "real"),
}
"""What may be said of these, by the name of the argument."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The arguments of the marker `mock_vehicle`; ValueError says in a sentence what is wrong."""

    autopilot: str = "px4"
    """Personality: "px4", "ardupilot", or "mixed" for a swarm of both."""
    vehicles: int = 1
    """How many; their sysids count up from `sysid`."""
    world: str | Path | None = None
    """World file; none is an open field of 200 m x 200 m."""
    time: Literal["real", "virtual"] = "real"
    """Real time on UDP, or virtual time in memory, which passes when the test says so."""
    speed: float = 1.0
    """Mission seconds per second of real time."""
    seed: int = 1
    """Seed of starts, noise, wind and losses."""
    rates: Literal["full", "lean"] = "full"
    """Telemetry as the real autopilots send it, or 10 Hz at most."""
    boot: Literal["fast", "real"] = "fast"
    """Ready to arm with the first heartbeat, or as late as the real autopilots."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Those that are not at their defaults, by name."""
    faults: Sequence[str | Fault] = ()
    """What goes wrong, as "battery:1@30": kind, sysid and seconds."""
    signing_key: str | None = None
    """Obey only who signs with it: a passphrase, or 64 hexadecimal digits."""
    sysid: int = 1
    """sysid of the first vehicle."""
    one_port: bool = False
    """Whether all vehicles call one port, as they would a ground station."""

    @classmethod
    def of(cls, arguments: Mapping[str, Any]) -> Plan:
        """Read arguments by name; an unknown one is named with its nearest kin."""
        known = [each.name for each in fields(cls)]
        for name in arguments:
            if name not in known:
                near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
                hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
                raise ValueError(f"unknown argument {name}; {hint}")
        return cls(**arguments)

    def __post_init__(self) -> None:
        """Look at every argument."""
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                said = f"{getattr(self, name)!r}"
                raise ValueError(f"{name} should be one of {', '.join(choices)}, not {said}")
        for name, low, high in (("vehicles", 1, SYSID_MAX), ("sysid", 1, SYSID_MAX)):
            _check_whole(name, getattr(self, name), low, high)
        _check_whole("seed", self.seed, 0, None)
        if not isinstance(self.speed, int | float) or not SLOWEST <= self.speed <= FASTEST:
            raise ValueError(f"speed should be {SLOWEST} to {FASTEST:g}, not {self.speed!r}")
        if self.sysid + self.vehicles - 1 > SYSID_MAX:
            last = self.sysid + self.vehicles - 1
            raise ValueError(f"sysids would end at {last}, beyond {SYSID_MAX}")
        if self.signing_key is not None:
            key_of(str(self.signing_key))
        if not isinstance(self.parameters, Mapping):
            raise ValueError(f"parameters should be a mapping, not {self.parameters!r}")  # noqa: TRY004
        if isinstance(self.faults, str):
            raise ValueError(f"faults should be a list, as [{self.faults!r}]")  # noqa: TRY004

    @property
    def kinds(self) -> list[str]:
        """One personality per vehicle."""
        return personalities(self.autopilot, self.vehicles)

    def fleet_arguments(self) -> dict[str, Any]:
        """Give what `Fleet` takes beside world and personalities."""
        return {
            "seed": self.seed,
            "first_sysid": self.sysid,
            "boot_s": 0.0 if self.boot == "fast" else None,
            "rates": self.rates,
            "faults": [_fault(fault) for fault in self.faults],
            "parameters": self.parameters,
        }

    def load_world(self) -> World:
        """Read the world file, or give the open field."""
        return open_field() if self.world is None else load_world(Path(self.world))


def _check_whole(name: str, value: object, low: int, high: int | None) -> None:
    is_whole = isinstance(value, int) and not isinstance(value, bool)
    if not is_whole or not low <= float(str(value)) <= (math.inf if high is None else high):
        span = f"from {low} on" if high is None else f"{low} to {high}"
        raise ValueError(f"{name} should be a whole number, {span}, not {value!r}")


def _fault(fault: str | Fault) -> Fault:
    if isinstance(fault, Fault):
        return fault
    try:
        return parse_fault(fault)
    except ValueError as error:
        raise ValueError(str(error).removeprefix("--")) from None
