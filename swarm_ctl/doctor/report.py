"""What an examination found, as a table for people and as JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from statistics import median
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from swarm_ctl.doctor.diagnosis import Finding
from swarm_ctl.doctor.examination import Examination
from swarm_ctl.doctor.looks import MULTIROTORS
from swarm_ctl.doctor.patient import Patient
from swarm_ctl.doctor.ranging import SIDE_BY_ORIENTATION
from swarm_ctl.doctor.rows import Severity

RELEASES = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: ""}
"""FIRMWARE_VERSION_TYPE by its least number."""
STYLES = {Severity.ERROR: "bold red", Severity.WARNING: "yellow"}
Diagnosis = dict[Patient, list[Finding]]


def tables(examination: Examination, diagnosis: Diagnosis, *, is_fixing: bool) -> RenderableType:
    """Show every vehicle with what would bite, and end with one sentence."""
    parts: list[RenderableType] = []
    for patient, findings in diagnosis.items():
        parts.append(Text(f"\nvehicle {patient.chart.sysid}: {facts(patient)['summary']}"))
        parts += [Text(line) for line in _details(patient)]
        if findings:
            parts.append(_table(findings))
        parts += [Text(line) for line in _changes(patient, findings, is_fixing=is_fixing)]
    parts += [Text(line, "bold red") for line in silences(examination)]
    return Group(*parts, Text(f"\n{verdict(examination, diagnosis)}"))


def as_json(examination: Examination, diagnosis: Diagnosis, *, is_fit: bool) -> str:
    """Give everything as one JSON object."""
    vehicles = [
        {
            **facts(patient),
            "findings": [_finding(finding) for finding in findings],
            "changed": {
                name: {"old": old, "new": new} for name, (old, new) in patient.changed.items()
            },
            "not_taken": sorted(patient.refused),
        }
        for patient, findings in diagnosis.items()
    ]
    whole = {"fit": is_fit, "vehicles": vehicles, "silent": silences(examination)}
    return json.dumps({**whole, "verdict": verdict(examination, diagnosis)}, indent=2)


def facts(patient: Patient) -> dict[str, Any]:
    """Give who a vehicle is and what was measured; None for what is not known."""
    chart = patient.chart
    autopilot = chart.autopilot.name if chart.autopilot else None
    firmware = _version(chart.version.flight_sw_version) if chart.version is not None else None
    kind = MULTIROTORS.get(chart.heartbeat.type, f"MAV_TYPE {chart.heartbeat.type}")
    mode = chart.telemetry.mode_name if chart.autopilot else None
    status = chart.status
    charge = None if status is None or status.battery_remaining < 0 else status.battery_remaining
    trips = chart.round_trips_s
    return {
        "sysid": chart.sysid,
        "place": chart.place,
        "summary": ", ".join(
            filter(None, [f"{autopilot or 'unknown'} {firmware or ''}".strip(), kind, mode])
        ),
        "autopilot": autopilot,
        "firmware": firmware,
        "kind": kind,
        "capabilities": chart.version.capabilities if chart.version is not None else None,
        "uids": sorted(chart.uids),
        "mode": mode,
        "armed": chart.armed,
        "battery_percent": charge,
        "gnss_fix": chart.gnss_fix,
        "clock_rate": chart.clock_rate,
        "round_trip_min_ms": min(trips) * 1e3 if trips else None,
        "round_trip_median_ms": median(trips) * 1e3 if trips else None,
        "messages": chart.frames,
        "messages_lost": chart.lost,
        "link_bytes_per_s": round(chart.bytes_s),
        "streams_hz": {
            name: round(chart.rate_hz(name), 1)
            for name in (chart.autopilot.streams_hz if chart.autopilot else ())
        },
        "rangefinders": {
            side: {"hz": ranges.count / chart.measured_s, "max_m": ranges.farthest_m}
            for orientation, side in SIDE_BY_ORIENTATION.items()
            if (ranges := chart.ranges.get(orientation)) is not None and chart.measured_s
        },
        "parameters_missing": sorted(patient.parameters.missing) if patient.parameters else [],
    }


def silences(examination: Examination) -> list[str]:
    """Say who was not heard."""
    links = [f"{url}: no autopilot is heard" for url in examination.silent_urls]
    vehicles = examination.silent_vehicles
    return links + [f"{url}: vehicle {sysid} is not heard" for url, sysid in vehicles]


def verdict(examination: Examination, diagnosis: Diagnosis) -> str:
    """Sum it up in one sentence."""
    if not diagnosis:
        return "Nobody was heard."
    found = [finding.severity for findings in diagnosis.values() for finding in findings]
    errors = found.count(Severity.ERROR) + len(silences(examination))
    warnings = _count(found.count(Severity.WARNING), "warning")
    who = _count(len(diagnosis), "vehicle")
    if errors:
        return f"Do not fly: {_count(errors, 'error')} and {warnings} on {who}."
    return f"Fit to fly: {who}, {warnings}."


def _details(patient: Patient) -> Iterator[str]:
    known = facts(patient)
    trip, rate = known["round_trip_median_ms"], known["clock_rate"]
    link = [f"{known['link_bytes_per_s'] / 1000:.1f} kB/s", f"{known['messages_lost']} lost"]
    if trip is not None:
        link.append(f"round trip {known['round_trip_min_ms']:.1f} ms, median {trip:.1f} ms")
    if rate is not None:
        link.append(f"clock {rate:.2f}")
    if known["battery_percent"] is not None:
        link.append(f"battery {known['battery_percent']} %")
    uids = (uid.lstrip("0") or "0" for uid in known["uids"])
    yield f"  {known['place']}, uid {', '.join(uids) or 'unknown'}"
    yield f"  {', '.join(link)}"
    if known["rangefinders"]:
        sides = (f"{side} {one['max_m']:g} m" for side, one in known["rangefinders"].items())
        yield f"  rangefinders: {', '.join(sides)}"


def _table(findings: Sequence[Finding]) -> Table:
    table = Table(box=None, show_header=False, padding=(0, 1, 0, 1))
    table.add_column(no_wrap=True)
    table.add_column(max_width=18, overflow="fold")
    table.add_column(overflow="fold")
    for finding in findings:
        severity = Text(finding.severity, STYLES[finding.severity])
        words = Text(f"{finding.found}; advised: {finding.advised}\n")
        table.add_row(severity, Text(finding.check), words.append(finding.why, "dim"))
    return table


def _changes(patient: Patient, findings: Sequence[Finding], *, is_fixing: bool) -> Iterator[str]:
    for name, (old, new) in patient.changed.items():
        yield f"  set {name}: {old:g} -> {new:g}"
    for name, wanted in patient.refused.items():
        yield f"  not set {name}: the vehicle did not take {wanted:g}"
    mine = [finding.check for finding in findings if finding.fix is not None]
    if mine and not is_fixing:
        yield f"  --fix would set {', '.join(mine)}"
    if is_fixing:
        left = [finding.check for finding in findings if finding.check.isupper()]
        if left:
            yield f"  left as they are: {', '.join(left)}"


def _finding(finding: Finding) -> dict[str, Any]:
    return {**finding._asdict(), "fix": dict([finding.fix]) if finding.fix else None}


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


def _version(number: int) -> str:
    """Read AUTOPILOT_VERSION.flight_sw_version, as 1.17.0 alpha."""
    release = RELEASES[max(least for least in RELEASES if least <= number & 0xFF)]
    return f"{number >> 24}.{number >> 16 & 0xFF}.{number >> 8 & 0xFF} {release}".strip()
