"""Where mock vehicles are examined in virtual time: their datagrams, and nothing else, go about."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

from halls import write_hall

from mock_vehicle.testing import Plan, VirtualSwarm, VirtualVehicle, launch
from swarm_ctl import wire
from swarm_ctl.doctor.diagnosis import Finding, diagnose, fixes
from swarm_ctl.doctor.examination import Examination, Question, Source
from swarm_ctl.doctor.patient import Patient
from swarm_ctl.mission import Mission, load_mission

STEP_S = 0.02
PATIENCE_S = 60.0
HEALTHY: dict[str, dict[str, float]] = {
    "px4": {"COM_OBL_RC_ACT": 4, "COM_RC_IN_MODE": 1},
    "ardupilot": {"GUID_TIMEOUT": 1, "BATT_FS_LOW_ACT": 1, "FS_OPTIONS": 20},
}
"""What differs from the defaults where nothing bites."""
_COMMAND_LONG = wire.message("COMMAND_LONG")


def hall_mission(folder: Path, **changes: Any) -> Mission:
    """Load the hall mission, changed as asked for."""
    return load_mission(write_hall(folder, changes))


class Surgery:
    """Vehicles on lines, and the doctor; `with` ends them."""

    def __init__(self) -> None:
        self.now = 0.0
        self.clock_rate = 1.0
        """How fast the doctor's clock goes by the vehicles'."""
        self._lines: dict[tuple[str, Source], list[VirtualVehicle]] = {}
        self._swarms: list[VirtualSwarm] = []
        self._running = contextlib.ExitStack()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._running.close()

    def admit(
        self, autopilot: str = "px4", *, url: str = "udpin://0.0.0.0:14540", **plan: Any
    ) -> VirtualVehicle:
        """Let a vehicle call a port; it differs from a healthy one as the plan says."""
        parameters = HEALTHY[autopilot] | plan.pop("parameters", {})
        arguments = {"autopilot": autopilot, "time": "virtual", "parameters": parameters, **plan}
        swarm = self._running.enter_context(launch(Plan.of(arguments)))
        assert isinstance(swarm, VirtualSwarm)
        (vehicle,) = swarm
        self._swarms.append(swarm)
        self._lines[url, ("10.0.0.1", 1 + len(self._lines))] = [vehicle]
        return vehicle

    def share_line(self) -> None:
        """Let all be heard from one place, as by one radio."""
        url, source = next(iter(self._lines))
        everybody = [vehicle for line in self._lines.values() for vehicle in line]
        self._lines = {(url, source): everybody}

    def pass_time(self, seconds: float) -> None:
        """Let the vehicles live for a while before the doctor comes."""
        for _ in range(round(seconds / STEP_S)):
            self._step()
        list(self._take())

    def begin(self, **question: Any) -> Examination:
        """Ask a question, about everybody on every link unless it says otherwise."""
        urls = list(dict.fromkeys(url for url, _ in self._lines))
        return Examination(Question(**{"urls": urls, **question}), self.now)

    def examine(self, **question: Any) -> list[Finding]:
        """Examine everybody, and give what was found of all."""
        return self.findings(self.go_on(self.begin(**question)))

    def findings(self, examination: Examination) -> list[Finding]:
        """Give what was found of all."""
        return [finding for found in diagnose(examination).values() for finding in found]

    def go_on(self, examination: Examination, until_s: float = 1e9) -> Examination:
        """Let time pass until the examination is over, or a moment has come."""
        end_s = self.now + PATIENCE_S
        while not examination.is_over(self.now) and self.now < until_s:
            assert self.now < end_s, "it does not end"
            self.listen(examination, STEP_S)
            for outgoing in examination.tick(self.now):
                self._deliver(outgoing.url, outgoing.to, outgoing.data)
        return examination

    def listen(self, examination: Examination, seconds: float) -> None:
        """Let time pass in which the doctor says nothing."""
        for _ in range(round(seconds / STEP_S)):
            self._step()
            for (url, source), data in self._take():
                examination.receive(url, source, data, self.now)

    def operate(self, examination: Examination) -> Patient:
        """Set right what may be set, of one vehicle."""
        for patient, findings in diagnose(examination).items():
            patient.fix(fixes(findings), self.now)
        self.go_on(examination)
        (patient,) = examination.patients
        patient.check_fixed()
        return patient

    def command(self, vehicle: VirtualVehicle, number: int, *parameters: float) -> None:
        """Order a vehicle about, as a ground station would."""
        padded = (*parameters, *([0.0] * (7 - len(parameters))))
        vehicle.send(_COMMAND_LONG.pack(0, 255, 190, vehicle.sysid, 1, number, 0, *padded))

    def _step(self) -> None:
        self.now += STEP_S * self.clock_rate
        for swarm in self._swarms:
            swarm.fly(STEP_S)

    def _take(self) -> Iterator[tuple[tuple[str, Source], bytes]]:
        for line, vehicles in self._lines.items():
            for vehicle in vehicles:
                for data in vehicle.receive():
                    yield line, data

    def _deliver(self, url: str, to: Source | None, data: bytes) -> None:
        for line, vehicles in self._lines.items():
            if line == (url, to):
                for vehicle in vehicles:
                    vehicle.send(data)
