"""Turn recordings into the scripts beside this file: extract.py REFERENCE_FOLDER."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from extract_behaviour import malformed, told
from extract_failsafes import failsafes
from extract_rates import rates
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from transcript import CLIENT, FAILSAFES, HERE, MALFORMED, RATES, Listener, Said

CLOCKS = {"ATTITUDE", "LOCAL_POSITION_NED", "SYSTEM_TIME"}
"""Messages whose time_boot_ms says when they were sent."""
CLOCK_EVERY_S = 1.0
SENT_EARLIER_S = 0.001
"""The recorder noted what it sent after sending it; some answers came before that."""
REPEATED = {"HEARTBEAT", "SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT"}
"""Runs of these are written as one line."""
NOT_REPLAYED = {"wire"}
"""Suites whose malformed requests were not recorded."""


class Heard(NamedTuple):
    """One frame of a recording."""

    at_s: float
    """Time on the recorder's clock."""
    is_request: bool
    name: str
    fields: dict[str, Any]


def main(reference: Path) -> None:
    """Write one script per recording."""
    cases = ",\n".join(json.dumps(case) for case in failsafes(reference))
    FAILSAFES.write_text(f"[\n{cases}\n]\n", "utf-8")
    for path in sorted(reference.glob("*/behaviour.json")):
        behaviour = json.loads(path.read_text("utf-8"))
        for suite, lines in told(behaviour):
            known, left_out = understood(lines)
            heard = sorted({line[2] for line in known if line[1] == "<"})
            write(HERE / path.parent.name / f"{suite}.json", known, left_out, {}, heard)
        broken = json.dumps(malformed(behaviour), indent=1)
        (HERE / path.parent.name / f"{MALFORMED}.json").write_text(f"{broken}\n", "utf-8")
        found = rates(behaviour)
        cases = ",\n".join(json.dumps(case) for case in found)
        (HERE / path.parent.name / f"{RATES}.json").write_text(f"[\n{cases}\n]\n", "utf-8")
    for path in sorted(reference.glob("*/*.tlog")):
        behaviour = json.loads((path.parent / "behaviour.json").read_text("utf-8"))
        suite = path.stem.rstrip("0123456789") if path.stem == "protocol2" else path.stem
        if suite not in NOT_REPLAYED:
            write(
                HERE / path.parent.name / f"{suite}.json", *extract(path), setup(behaviour, suite)
            )


def understood(lines: Sequence[list[Any]]) -> tuple[list[list[Any]], Counter[str]]:
    """Leave out what pymavlink does not know, and fields that are zero."""
    names = {m.msgname for m in mavlink.mavlink_map.values()}
    left_out = Counter(line[2] for line in lines if line[2] not in names)
    return [[*line[:3], told_fields(line[3])] for line in lines if line[2] in names], left_out


def told_fields(values: Mapping[str, Any]) -> dict[str, Any]:
    """Give the fields that are not zero, short."""
    short = {name: spare(value) for name, value in values.items()}
    return {name: value for name, value in short.items() if value not in (0, "", [])}


def extract(path: Path) -> tuple[list[list[Any]], Counter[str]]:
    """Give what was said in a recording, and what is left out."""
    left_out: Counter[str] = Counter()
    heard = list(frames(path, left_out))
    since_boot_s = boot_clock(heard)
    said: list[tuple[float, str, Said]] = []
    for frame in heard:
        at_s = round(float(since_boot_s(frame.at_s)), 4)
        at_s = max(at_s - SENT_EARLIER_S * frame.is_request, 0.0)
        said.append((at_s, ">" if frame.is_request else "<", Said(at_s, frame.name, frame.fields)))
    said.sort(key=lambda entry: entry[0])
    return compact(list(answers(path.parent.name, said))), left_out


def setup(behaviour: Any, suite: str) -> dict[str, float]:
    """Find the parameters that a suite started with."""
    if isinstance(behaviour, dict):
        if behaviour.get("suite") == suite:
            return dict(behaviour["extra_params"])
        if isinstance(behaviour.get(suite), dict) and "extra_params" in behaviour[suite]:
            return dict(behaviour[suite]["extra_params"])
        return next(filter(None, (setup(part, suite) for part in behaviour.values())), {})
    return {}


def frames(path: Path, left_out: Counter[str]) -> Iterator[Heard]:
    """Read the frames of a tlog, both directions."""
    data, at = path.read_bytes(), 0
    parser = mavlink.MAVLink(None)
    while at + 8 < len(data):
        length = data[at + 9] + (12 if data[at + 8] == 0xFD else 8)
        frame = bytearray(data[at + 8 : at + 8 + length])
        number = int.from_bytes(frame[7:10], "little") if frame[0] == 0xFD else frame[5]
        at_s = int.from_bytes(data[at : at + 8], "big") * 1e-6
        at += 8 + length
        if number in mavlink.mavlink_map:
            message = parser.decode(frame)
            source = (message.get_srcSystem(), message.get_srcComponent())
            yield Heard(at_s, source == CLIENT, message.get_type(), fields(message))
        else:
            left_out[f"message {number}"] += 1


def fields(message: Any) -> dict[str, Any]:
    """Give the fields that are not zero."""
    return told_fields({name: getattr(message, name) for name in message.fieldnames})


def spare(value: Any) -> Any:
    """Write a value as short as it can be."""
    if isinstance(value, float):
        return float(f"{value:.9g}")  # a float32 has no more digits
    if isinstance(value, list):
        values = [spare(v) for v in value]
        while values and values[-1] == 0:
            values.pop()
        return values
    return value


def boot_clock(heard: Sequence[Heard]) -> Any:
    """Make the function from the recorder's clock to the vehicle's time since its first boot."""
    recorder_s: list[float] = []
    vehicle_s: list[float] = []
    for frame in heard:
        if frame.name in CLOCKS and not frame.is_request:
            boot_s = frame.fields.get("time_boot_ms", 0) * 1e-3
            if vehicle_s and boot_s < vehicle_s[-1]:
                break
            if not vehicle_s or frame.at_s > recorder_s[-1] + CLOCK_EVERY_S:
                recorder_s.append(frame.at_s)
                vehicle_s.append(boot_s)
    slopes = np.diff(vehicle_s) / np.diff(recorder_s)

    def since_boot_s(at_s: float) -> float:
        if at_s <= recorder_s[0]:
            return float(vehicle_s[0] + (at_s - recorder_s[0]) * np.median(slopes[:5]))
        if at_s >= recorder_s[-1]:
            return float(vehicle_s[-1] + (at_s - recorder_s[-1]) * np.median(slopes[-5:]))
        return float(np.interp(at_s, recorder_s, vehicle_s))

    return since_boot_s


def answers(
    personality: str, said: Sequence[tuple[float, str, Said]]
) -> Iterator[tuple[str, Said]]:
    """Leave the telemetry out."""
    listener = Listener(personality)
    for at_s, direction, message in said:
        if direction == ">":
            listener.ask(message)
            yield direction, message
        elif listener.hear(at_s, message.name, message.fields):
            yield direction, message


def compact(said: Sequence[tuple[str, Said]]) -> list[list[Any]]:
    """Make lines of it; runs of one request become one line with times and interval."""
    lines: list[list[Any]] = []
    runs: dict[str, list[Any]] = {}
    for direction, message in said:
        at_s, name = round(message.at_s, 3), message.name
        content = {k: v for k, v in message.fields.items() if k != "time_boot_ms"}
        if direction == "<" or name not in REPEATED:
            lines.append([round(message.at_s, 4), direction, name, dict(message.fields)])
            if direction == ">" and name not in REPEATED:
                runs.clear()
            continue
        run = runs.get(name)
        if run is not None and run[3] == content and _continues(run, at_s):
            run[4] += 1
            run[5] = round((at_s - run[0]) / (run[4] - 1), 5)
        else:
            runs[name] = [at_s, direction, name, content, 1, 0.0]
            lines.append(runs[name])
    return [line[:4] if line[4:] == [1, 0.0] else line for line in lines]


def _continues(run: Sequence[Any], at_s: float) -> bool:
    """Tell whether the run's interval, or any at first, leads to this time."""
    start_s, times, every_s = run[0], run[4], run[5]
    gap_s = at_s - (start_s + (times - 1) * every_s)
    return bool(gap_s < 2.0 if times == 1 else abs(gap_s - every_s) < 0.3 * every_s)


def write(
    path: Path,
    said: Sequence[Sequence[Any]],
    left_out: Mapping[str, int],
    setup: Mapping[str, float],
    heard: Sequence[str] = (),
) -> None:
    """Write a script, one line per message."""
    path.parent.mkdir(exist_ok=True)
    lines = ",\n".join(json.dumps(line, separators=(",", ":")) for line in said)
    counts = json.dumps(dict(sorted(left_out.items())))
    head = f'{{"left_out": {counts},\n"setup": {json.dumps(setup)},\n'
    head += f'"heard": {json.dumps(heard)},\n"said": [\n'
    path.write_text(f"{head}{lines}\n]}}\n", "utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
