"""Faults at work: who is struck when, what it does to the fleet, and when it heals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol

import numpy as np

from mock_vehicle.dynamics import Dynamics
from mock_vehicle.faults import Fault, Trouble
from mock_vehicle.lossy import EFFECTS, LossyLinks
from mock_vehicle.radio import Radio
from mock_vehicle.sensors.battery import Batteries
from mock_vehicle.sensors.gnss import Gnss
from mock_vehicle.sensors.odometry import Odometry
from mock_vehicle.sensors.rangefinder import Rangefinders
from mock_vehicle.vehicle import Vehicle
from mock_vehicle.wind import Wind, blowing_from


class FleetKilled(SystemExit):
    """The fault `fleet`: the process ends here, with nothing written."""

    def __init__(self) -> None:
        super().__init__(70)


class Stage(Protocol):
    """The parts of a fleet that can break."""

    vehicles: list[Vehicle]
    dynamics: Dynamics
    batteries: Batteries
    radio: Radio
    odometry: Odometry
    rangefinders: Rangefinders
    gnss: Gnss
    wind: Wind
    links: LossyLinks


# What happens at once.


def _die(stage: Stage, index: int, fault: Fault, now: float) -> None:  # noqa: ARG001
    stage.vehicles[index].die()


def _discharge(stage: Stage, index: int, fault: Fault, now: float) -> None:  # noqa: ARG001
    stage.batteries.discharge_to(index, fault["fraction"])


def _reboot(stage: Stage, index: int, fault: Fault, now: float) -> None:  # noqa: ARG001
    stage.vehicles[index].autopilot.reboot(now)


def _lose_parameters(stage: Stage, index: int, fault: Fault, now: float) -> None:  # noqa: ARG001
    autopilot = stage.vehicles[index].autopilot
    for name, default in autopilot.parameters.changed.items():
        autopilot.set_parameter(name, default)


def _lose_place(stage: Stage, index: int, fault: Fault, now: float) -> None:  # noqa: ARG001
    stage.odometry.jump(index, -blowing_from(fault["towards_deg"], fault["jump_m"]))


AT_ONCE: Mapping[str, Callable[[Stage, int, Fault, float], None]] = {
    "dead": _die,
    "battery": _discharge,
    "reboot": _reboot,
    "parameters-lost": _lose_parameters,
    "drift": _lose_place,
}
"""What a fault does in the moment that it strikes."""


# What lasts: each gets the troubles of its kinds that a vehicle has now, perhaps none.


def _stop_motor(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    stage.dynamics.motor_lost[index] = bool(troubles)


def _blow(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    gusts = [blowing_from(t.fault["from_deg"], t.fault["speed_m_s"]) for t in troubles]
    stage.wind.strike(index, np.sum([np.zeros(3), *gusts], axis=0))


def _drain(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    stage.batteries.extra_w[index] = sum(t.fault["power_w"] for t in troubles)


def _spoil_ranges(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    kinds = {t.fault.kind for t in troubles}
    noises = [t.fault["noise_m"] for t in troubles if t.fault.kind == "rangefinder-noise"]
    stage.rangefinders.spoil(
        index,
        lost="rangefinder" in kinds,
        stuck="rangefinder-stuck" in kinds,
        noise_m=math.hypot(*noises),
    )


def _spoil_gnss(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    glitches = [t.fault for t in troubles if t.fault.kind == "gnss-glitch"]
    offsets = [-blowing_from(f["towards_deg"], f["offset_m"]) for f in glitches]
    glitch_ned_m = np.sum([np.zeros(3), *offsets], axis=0)
    stage.gnss.spoil(index, lost=len(glitches) < len(troubles), glitch_ned_m=glitch_ned_m)


def _drift(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    stage.odometry.add_drift(index, sum(t.fault["fraction"] for t in troubles))


def _freeze(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    stage.vehicles[index].frozen = bool(troubles)


def _freeze_telemetry(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    autopilot = stage.vehicles[index].autopilot
    autopilot.stale_state = (autopilot.stale_state or autopilot.state) if troubles else None


def _refuse(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    stage.vehicles[index].autopilot.refusals = troubles


def _silence(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    sysid = stage.vehicles[index].sysid
    (stage.radio.silence if troubles else stage.radio.restore)(sysid)


def _weaken(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:  # noqa: ARG001
    kept = math.prod(1.0 - t.fault["fraction"] for t in troubles)
    stage.radio.weaken(index, 1.0 - kept)


def _spoil_links(stage: Stage, index: int, troubles: Sequence[Trouble], now: float) -> None:
    stage.links.spoil(index, stage.vehicles[index].links, troubles, now)


LASTING: Mapping[str, Callable[[Stage, int, Sequence[Trouble], float], None]] = {
    "motor": _stop_motor,
    "wind-gust": _blow,
    "battery-drain": _drain,
    "rangefinder": _spoil_ranges,
    "rangefinder-stuck": _spoil_ranges,
    "rangefinder-noise": _spoil_ranges,
    "gnss-loss": _spoil_gnss,
    "gnss-glitch": _spoil_gnss,
    "drift": _drift,
    "freeze": _freeze,
    "frozen-telemetry": _freeze_telemetry,
    "nack": _refuse,
    "silent-radio": _silence,
    "radio-loss": _weaken,
    **dict.fromkeys(EFFECTS, _spoil_links),
}
"""What a fault does as long as it lasts."""


class Troubles:
    """What is broken at the moment and what will be."""

    def __init__(self, stage: Stage, faults: Iterable[Fault]) -> None:
        self._stage = stage
        self._waiting = sorted(faults, key=lambda fault: fault.time_s)[::-1]
        self._now: list[Trouble] = []
        self._ordered = [frozenset[str]()] * len(stage.vehicles)

    def turn(self, now: float) -> None:
        """Heal what has lasted long enough, and strike where the time has come."""
        over = [trouble for trouble in self._now if trouble.ends_s <= now]
        if over:
            self._end(over, now)
        while self._waiting and self._waiting[-1].time_s <= now:
            self.strike(self._waiting.pop(), now)

    def obey(self, now: float) -> None:
        """Break what autopilots' own parameters ask for, and mend it."""
        ordered = [vehicle.autopilot.ordered_faults for vehicle in self._stage.vehicles]
        if ordered == self._ordered:
            return
        for vehicle, before in zip(self._stage.vehicles, self._ordered, strict=True):
            asked = vehicle.autopilot.ordered_faults
            for kind in sorted(asked - before):
                self.strike(Fault(now, vehicle.sysid, kind), now)
            for kind in sorted(before - asked):
                self.heal(now, vehicle=vehicle.sysid, kind=kind)
        self._ordered = [vehicle.autopilot.ordered_faults for vehicle in self._stage.vehicles]

    def strike(self, fault: Fault, now: float) -> None:
        """Break something now; FleetKilled when it is the mock itself."""
        if fault.kind == "fleet":
            raise FleetKilled
        for vehicle in self._stage.vehicles:
            if fault.vehicle in {None, vehicle.sysid}:
                self._strike(vehicle.index, fault, now)

    def _strike(self, index: int, fault: Fault, now: float) -> None:
        if fault.kind in AT_ONCE:
            AT_ONCE[fault.kind](self._stage, index, fault, now)
        if fault.kind in LASTING:
            self._now.append(Trouble(fault, index, now + fault.lasts_s, fault.times))
            self._apply(index, fault.kind, now)

    def heal(self, now: float, *, vehicle: int | None = None, kind: str | None = None) -> None:
        """End what lasts: of one vehicle (sysid) or all, of one kind or all."""
        self._end(
            [
                trouble
                for trouble in self._now
                if vehicle in {None, self._stage.vehicles[trouble.index].sysid}
                and kind in {None, trouble.fault.kind}
            ],
            now,
        )

    def _end(self, troubles: Sequence[Trouble], now: float) -> None:
        for trouble in troubles:
            self._now.remove(trouble)
            self._apply(trouble.index, trouble.fault.kind, now)

    def _apply(self, index: int, kind: str, now: float) -> None:
        """Let a vehicle suffer from what it has of a kind and its relatives."""
        act = LASTING[kind]
        act(
            self._stage,
            index,
            [t for t in self._now if t.index == index and LASTING[t.fault.kind] is act],
            now,
        )
