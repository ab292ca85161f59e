"""What was found, held against the tables: findings, and what may be set right."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from swarm_ctl.doctor.checks import CHECKS
from swarm_ctl.doctor.examination import Examination
from swarm_ctl.doctor.patient import Patient
from swarm_ctl.doctor.rows import Case, Parameter, Severity


class Finding(NamedTuple):
    """One thing that would bite."""

    severity: Severity
    check: str
    """A parameter's name, or what of the vehicle was looked at."""
    found: str
    advised: str
    why: str
    fix: tuple[str, float] | None = None
    """The parameter and the value that `--fix` may set."""


class SwarmCheck(NamedTuple):
    """Something that bites only because of the others."""

    name: str
    advised: str
    why: str


ONE_SYSID = SwarmCheck(
    "one sysid, several vehicles",
    "MAV_SYS_ID (PX4), MAV_SYSID (ArduPilot), each its own",
    "peers cannot tell them apart, and neither can a ground station",
)
TWO_LINKS = SwarmCheck(
    "one vehicle, several links",
    "one `--connect` per vehicle",
    "two controllers would fly it at once",
)
SWARM_CHECKS = (ONE_SYSID, TWO_LINKS)


def diagnose(examination: Examination) -> dict[Patient, list[Finding]]:
    """Give what would bite of each vehicle, the worst first."""
    shared = _shared_sysids(examination.patients)
    found = {}
    for patient in examination.patients:
        findings = [*shared.get(patient, ()), *_findings(patient, case_of(patient, examination))]
        found[patient] = sorted(findings, key=lambda finding: finding.severity != Severity.ERROR)
    return found


def fixes(findings: Iterable[Finding]) -> dict[str, float]:
    """Give what may be set, by the parameter's name."""
    return dict(finding.fix for finding in findings if finding.fix is not None)


def case_of(patient: Patient, examination: Examination) -> Case:
    """Put together what the rows may look at."""
    question, mission = examination.question, examination.question.mission
    known = patient.parameters.values if patient.parameters else {}
    return Case(
        chart=patient.chart,
        parameters={name: value for name, value in known.items() if math.isfinite(value)},
        mission=mission,
        is_open_air=question.is_open_air or (mission is not None and mission.flight.open_air),
        speed=question.speed,
        has_key=question.key is not None,
    )


def _findings(patient: Patient, case: Case) -> Iterator[Finding]:
    for check in CHECKS:
        if all(when.holds(case) for when in check.when):
            for found in check.look(case):
                yield Finding(check.severity, check.name, found, check.advised, check.why)
    values = patient.parameters.values if patient.parameters else {}
    bitten: set[str] = set()
    for row in patient.table:
        finding = None if row.name in bitten else _parameter(row, values, patient, case)
        if finding is not None:
            bitten.add(row.name)
            yield finding


def _parameter(
    row: Parameter, values: Mapping[str, float], patient: Patient, case: Case
) -> Finding | None:
    """Hold a parameter against its row, under the first of its names that the vehicle has."""
    name = next((name for name in row.names if name in values), None)
    if name is None or not all(when.holds(case) for when in row.when):
        return None
    if row.needs_reboot and name in patient.changed:
        found = f"{row.shown(values[name])}, set just now"
        return Finding(row.severity, name, found, "restart the vehicle", row.why)
    factor = row.names[name]
    value = values[name] * factor
    if math.isfinite(value) and row.good.holds(value, case):
        return None
    better = row.good.advised(value if math.isfinite(value) else 0.0, case)
    words = row.good.words if better is None else row.shown(better)
    reboot = ", and restart it" if row.needs_reboot else ""
    fix = None if better is None or not row.is_safe_to_set else (name, better / factor)
    return Finding(row.severity, name, row.shown(value), words + reboot, row.why, fix)


def _shared_sysids(patients: Iterable[Patient]) -> dict[Patient, list[Finding]]:
    """Find those who are heard at several places under one sysid."""
    by_sysid: dict[int, list[Patient]] = defaultdict(list)
    for patient in patients:
        by_sysid[patient.chart.sysid].append(patient)
    shared = {}
    for sysid, twins in by_sysid.items():
        if len(twins) > 1:
            check = ONE_SYSID if len(_uids(twins)) > 1 else TWO_LINKS
            places = ", ".join(twin.chart.place for twin in twins)
            found = f"sysid {sysid} at {places}"
            finding = Finding(Severity.ERROR, check.name, found, check.advised, check.why)
            shared.update({twin: [finding] for twin in twins})
    return shared


def _uids(patients: Iterable[Patient]) -> set[str]:
    return {uid for patient in patients for uid in patient.chart.uids}
