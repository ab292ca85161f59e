"""What the vehicles reported of each victim, joined to one place and how sure it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from swarm_ctl.model import Vec3
from swarm_ctl.record.reader import Run


class Report(NamedTuple):
    """One vehicle's word on where a victim lies."""

    time_s: float
    sysid: int
    is_seen: bool
    """By its own sensor; else told by a peer."""
    own_ned_m: Vec3
    """From the reporting vehicle's own start."""
    ned_m: Vec3 | None
    """In the launch frame; None where nobody knows how the two lie."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """A victim that was found, as the vehicles reported it."""

    number: int
    """What the sensor calls it."""
    name: str
    """What the world calls it; empty when nobody knows."""
    truth_ned_m: Vec3 | None
    """Where it lies, by the referee."""
    accuracy_m: float | None
    """Standard deviation of the finder's own place, level, by its autopilot."""
    reports: tuple[Report, ...]
    """In the order of time."""

    @property
    def found(self) -> Report:
        """Give the first report of a vehicle that saw it."""
        return next((report for report in self.reports if report.is_seen), self.reports[0])

    @property
    def ned_m(self) -> Vec3 | None:
        """Estimate its place in the launch frame: the median of those who saw it themselves."""
        seen = [report.ned_m for report in self.reports if report.is_seen and report.ned_m]
        told = [report.ned_m for report in self.reports if report.ned_m]
        places = seen or told
        return Vec3(*np.median(places, axis=0).tolist()) if places else None

    @property
    def uncertainty_m(self) -> float | None:
        """Give the level radius around the estimate in which the victim lies 95 times of 100.

        Two things add up, as squares do: twice the standard deviation of the finder's own place,
        and how far 95 % of all vehicles' reports lie from the estimate. None when its autopilot
        does not tell and no second vehicle reported it.
        """
        places = [report.ned_m for report in self.reports if report.ned_m]
        if self.ned_m is None or (self.accuracy_m is None and len(places) < 2):
            return None
        spread_m = float(np.percentile([_level_m(place, self.ned_m) for place in places], 95))
        return math.hypot(2.0 * (self.accuracy_m or 0.0), spread_m)

    @property
    def error_m(self) -> float | None:
        """Give the level distance from the estimate to where the referee knows it lies."""
        if self.ned_m is None or self.truth_ned_m is None:
            return None
        return _level_m(self.ned_m, self.truth_ned_m)


def sightings(run: Run) -> list[Sighting]:
    """Give every victim that a vehicle saw or heard of, in the order of their discovery."""
    reports: dict[int, list[Report]] = {}
    for entry in run.events("VictimFound", "VictimHeard"):
        data = entry["data"]
        own = Vec3(*data["position_ned_m"])
        place = run.in_launch_frame(entry["sysid"], own)
        is_seen = entry["event"] == "VictimFound"
        report = Report(entry["time_s"], entry["sysid"], is_seen, own, place)
        reports.setdefault(data["victim"], []).append(report)
    found = [_sighting(run, number, told) for number, told in reports.items()]
    return sorted(found, key=lambda one: one.found.time_s)


def missed(run: Run, found: Sequence[Sighting]) -> list[tuple[str, Vec3]]:
    """Give name and place of each victim that the referee knows and nobody reported."""
    numbers = {one.number for one in found}
    return [
        (str(victim.get("name", "")), Vec3(*victim["position_ned_m"]))
        for number, victim in enumerate(_victims(run))
        if number not in numbers
    ]


def _sighting(run: Run, number: int, reports: Sequence[Report]) -> Sighting:
    first = next((report for report in reports if report.is_seen), reports[0])
    accuracy_m = run.accuracy_m(first.sysid, first.time_s)
    return Sighting(number, *_known(run, number), accuracy_m, tuple(reports))


def _known(run: Run, number: int) -> tuple[str, Vec3 | None]:
    """Give what the referee knows of a victim: its name and place."""
    victims = _victims(run)
    if number >= len(victims):
        return "", None
    return str(victims[number].get("name", "")), Vec3(*victims[number]["position_ned_m"])


def _victims(run: Run) -> list[dict[str, Any]]:
    victims: list[dict[str, Any]] = run.truth.world.get("victims") or []
    return victims


def _level_m(one: Vec3, other: Vec3) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)
