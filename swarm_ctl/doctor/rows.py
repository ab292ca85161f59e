"""The words that the tables of checks are written in: when a row counts, and what is good."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from swarm_ctl.doctor.chart import Chart
from swarm_ctl.mission import Mission


class Severity(StrEnum):
    """How badly something would bite."""

    ERROR = "error"
    """Not fit to fly."""
    WARNING = "warning"
    """To be known; fails only a strict examination."""


@dataclass(frozen=True, slots=True)
class Case:
    """Everything that a row may look at: one vehicle, and what it is to do."""

    chart: Chart
    parameters: Mapping[str, float]
    """Those that the vehicle has, of those that were asked for."""
    mission: Mission | None = None
    is_open_air: bool = False
    """Whether it may fly without rangefinders: `--open-air`, or the mission's flight.open_air."""
    speed: float = 1.0
    """How many times real time the vehicle was said to go."""
    has_key: bool = False
    """Whether all that is said is to be signed."""

    def value(self, name: str) -> float:
        """Give a parameter, 0 when the vehicle has none of that name."""
        return self.parameters.get(name, 0.0)


class When(NamedTuple):
    """A condition under which a row counts at all."""

    words: str
    holds: Callable[[Case], bool]
    reads: tuple[str, ...] = ()
    """Parameters that it looks at."""


class Bound(NamedTuple):
    """A number that a mission sets; it exists only with a mission."""

    words: str
    of: Callable[[Mission], float]


class Good(NamedTuple):
    """Which values are good, and which one to take instead of a bad one."""

    words: str
    holds: Callable[[float, Case], bool]
    advised: Callable[[float, Case], float | None]
    """None where the number is for the vehicle's owner to choose."""
    reads: tuple[str, ...] = ()
    """Parameters that it looks at beside its own."""


class Parameter(NamedTuple):
    """A parameter that bites when it is not good."""

    name: str
    good: Good
    severity: Severity
    why: str
    when: tuple[When, ...] = ()
    """All must hold."""
    meanings: Mapping[int, str] = {}
    """What its values are called."""
    unit: str = ""
    older: Mapping[str, float] = {}
    """Names in other versions of the autopilot, with what their values are multiplied by."""
    is_safe_to_set: bool = False
    """Whether `--fix` may; never where it would weaken a protection."""
    needs_reboot: bool = False

    @property
    def names(self) -> Mapping[str, float]:
        """All its names with their factors, this version's first."""
        return {self.name: 1.0, **self.older}

    @property
    def reads(self) -> set[str]:
        """All parameters that the row looks at."""
        return {*self.names, *self.good.reads, *(name for when in self.when for name in when.reads)}

    def shown(self, value: float) -> str:
        """Show a value with its unit or its meaning."""
        meaning = self.meanings.get(int(value)) if value.is_integer() else None
        plain = f"{value:.6g}" + (f" {self.unit}" if self.unit else "")
        return f"{plain} ({meaning})" if meaning else plain


class Check(NamedTuple):
    """Something of the vehicle itself that bites."""

    name: str
    severity: Severity
    look: Callable[[Case], Iterable[str]]
    """Say what was found, once for each thing that is not as it should be."""
    advised: str
    why: str
    when: tuple[When, ...] = ()
    """All must hold."""


def between(low: float, high: float) -> Good:
    """Want a number within bounds, the nearer of them instead."""
    return Good(
        f"{low:g} to {high:g}",
        lambda value, _: low <= value <= high,
        lambda value, _: min(max(value, low), high),
    )


def one_of(*values: int, instead: int | None = None) -> Good:
    """Want one of a few values, the first of them unless another one is named."""
    words = " or ".join(f"{value}" for value in values)
    advised = values[0] if instead is None else instead
    return Good(words, lambda value, _: value in values, lambda *_: float(advised))


def anything_but(*values: int, instead: float | None = None) -> Good:
    """Want none of a few values."""
    words = "not " + " or ".join(f"{value}" for value in values)
    return Good(words, lambda value, _: value not in values, lambda *_: instead)


def at_least(bound: float | Bound) -> Good:
    """Want a number that is large enough."""
    words, of = _bound(bound)
    return Good(
        f"at least {words}",
        lambda value, case: value >= of(case, -1e9),
        lambda _, case: of(case, 0.0),
    )


def at_most(bound: float | Bound, *, instead: Bound | None = None) -> Good:
    """Want a number that is small enough."""
    words, of = _bound(bound)
    _, advised = _bound(instead or bound)
    return Good(
        f"at most {words}",
        lambda value, case: value <= of(case, 1e9),
        lambda _, case: advised(case, 0.0),
    )


def off_or_at_least(bound: Bound) -> Good:
    """Want a fence that is off (0), or wide enough."""
    words, of = _bound(bound)
    return Good(
        f"0 or at least {words}",
        lambda value, case: value <= 0.0 or value >= of(case, 0.0),
        lambda _, case: of(case, 0.0),
    )


def bits(*, clear: int = 0, set_: int = 0) -> Good:
    """Want bits of a mask to be clear, others to be set."""
    words = [f"without {clear}"] * bool(clear) + [f"with {set_}"] * bool(set_)
    return Good(
        ", ".join(words),
        lambda value, _: not int(value) & clear and int(value) & set_ == set_,
        lambda value, _: float((int(value) & ~clear) | set_),
    )


def setting(name: str, good: Callable[[float], bool], words: str) -> When:
    """Count only beside another parameter that is so; not when the vehicle has none of it."""
    return When(
        f"{name} is {words}",
        lambda case: name in case.parameters and good(case.parameters[name]),
        (name,),
    )


def flies_blind(case: Case) -> bool:
    """Whether the estimator is set up to do without satellites."""
    known = case.parameters
    is_off = known.get("EKF2_GPS_CTRL") == 0.0 or known.get("SYS_HAS_GPS") == 0.0
    return is_off or known.get("EK3_SRC1_POSXY", 3.0) != 3.0


def _bound(bound: float | Bound) -> tuple[str, Callable[[Case, float], float]]:
    if isinstance(bound, Bound):
        return (
            bound.words,
            lambda case, unknown: unknown if case.mission is None else bound.of(case.mission),
        )
    return f"{bound:g}", lambda *_: bound


RADIUS = Bound("limits.radius_m + 5", lambda mission: mission.limits.radius_m + 5.0)
CEILING = Bound("limits.ceiling_m", lambda mission: mission.limits.ceiling_m)
ABOVE_CEILING = Bound("limits.ceiling_m + 2", lambda mission: mission.limits.ceiling_m + 2.0)
HEIGHT = Bound("flight.height_m", lambda mission: mission.flight.height_m)
SPEED = Bound("flight.speed_m_s", lambda mission: mission.flight.speed_m_s)
CLIMB = Bound("flight.climb_m_s", lambda mission: mission.flight.climb_m_s)
WALL = Bound("limits.wall_m", lambda mission: mission.limits.wall_m)
LONGEST = Bound("limits.max_time_s", lambda mission: mission.limits.max_time_s)
CRITICAL = Bound("limits.battery_critical", lambda mission: mission.limits.battery_critical)
BEYOND_SWARM = Bound("vehicles + 1", lambda mission: mission.vehicles + 1.0)

WITH_MISSION = When("with `--mission`", lambda case: case.mission is not None)
WITH_PILOT = When("a pilot's transmitter is heard", lambda case: case.chart.has_pilot)
WITHOUT_PILOT = When("no pilot's transmitter is heard", lambda case: not case.chart.has_pilot)
WITHOUT_GROUND_STATION = When(
    "no ground station is heard", lambda case: not case.chart.ground_stations
)
IN_SWARM = When(
    "the mission has several vehicles, or none is given",
    lambda case: case.mission is None or case.mission.vehicles > 1,
)
WITH_SATELLITES = When("it is to use satellites", lambda case: not flies_blind(case))
OPEN_AIR = When("in open air", lambda case: case.is_open_air)
AMONG_WALLS = When("not in open air", lambda case: not case.is_open_air)
