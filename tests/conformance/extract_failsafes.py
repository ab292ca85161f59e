"""Cut the moments out of the recordings in which an autopilot took itself away from its client."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from transcript import CLIENT

from swarm_ctl import wire
from swarm_ctl.autopilot.ardupilot import ARDUPILOT
from swarm_ctl.autopilot.px4 import PX4

BEFORE_S, AFTER_S = 3.0, 25.0
"""What is kept around the moment."""
EVERY_S = 1.0
"""Of the estimator's word, unless it changes."""
TOLD = ("HEARTBEAT", "CURRENT_MODE", "STATUSTEXT", "EVENT", "EKF_STATUS_REPORT", "ESTIMATOR_STATUS")
MODE_TOLD = ("HEARTBEAT", "CURRENT_MODE")
POSITION = "LOCAL_POSITION_NED"
KEPT = {
    "HEARTBEAT": ("type", "autopilot", "base_mode", "custom_mode", "system_status"),
    "CURRENT_MODE": ("custom_mode", "intended_custom_mode"),
    "STATUSTEXT": ("severity", "text"),
    "EVENT": ("id", "log_levels", "sequence", "arguments"),
    "EKF_STATUS_REPORT": ("flags",),
    "ESTIMATOR_STATUS": ("flags",),
}
LOGS = {
    "ardupilot/fail_battery_low_land": "battery low: LAND",
    "ardupilot/fail_gps_loss": "satellites lost: LAND",
    "ardupilot/gcsfs1": "ground station lost: RTL",
    "px4/failsafe_default": "setpoints lost, no sticks",
    "px4/failsafe_resume": "setpoints lost and found",
}
STATES = {"UNINIT": 0, "ACTIVE": 4, "CRITICAL": 5, "FLIGHT_TERMINATION": 8}
ARMED, QUADROTOR = 128, 2
ENTERED = 31382480
"""commander_failsafe_enter_generic, whose arguments behaviour.json has."""
PX4_BASE_MODE, PX4_END_S = 17, 14.0
MODES = {name: number for number, name in PX4.mode_names.items()}

Line = list[Any]
"""Time, message, fields."""


def failsafes(reference: Path) -> list[dict[str, Any]]:
    """Give every case: who, what happened, what was said."""
    px4 = json.loads((reference / "px4/behaviour.json").read_text("utf-8"))["failsafe"]
    ardupilot = json.loads((reference / "ardupilot/behaviour.json").read_text("utf-8"))
    lost_sticks = ardupilot["failures"]["fail_rc_loss"]["events"]
    lost_ground = ardupilot["gcs_failsafe"]["gcsfs5"]["events"]
    cases = [
        *(_from_log(reference / f"{path}.tlog", name) for path, name in LOGS.items()),
        _case("ardupilot/sticks lost: RTL", list(_ardupilot(lost_sticks))),
        _case("ardupilot/ground station lost: LAND", list(_ardupilot(lost_ground))),
    ]
    told = {name: case for name, case in px4.items() if _is_told(case)}
    return cases + [_case(f"px4/{name}", _px4(case)) for name, case in told.items()]


def _is_told(case: Mapping[str, Any]) -> bool:
    """Whether the mode changed, and is told from the beginning."""
    changes = case.get("transitions", ())
    return len(changes) > 1 and changes[0][0] == 0.0


def _case(name: str, said: list[Line], position_until_s: float | None = None) -> dict[str, Any]:
    said.sort(key=lambda line: float(line[0]))
    return {"case": name, "position_until_s": position_until_s, "said": said}


def _from_log(path: Path, name: str) -> dict[str, Any]:
    heard = list(_received(path))
    ours = (PX4 if path.parent.name == "px4" else ARDUPILOT).offboard_mode
    beats = ((at_s, values) for at_s, message, values in heard if message == "HEARTBEAT")
    flying = (ours, STATES["ACTIVE"])
    flown_s = next(at_s for at_s, v in beats if (v.custom_mode, v.system_status) == flying)
    modes = ((at_s, v.custom_mode) for at_s, message, v in heard if message in MODE_TOLD)
    left_s = next(at_s for at_s, mode in modes if at_s > flown_s and mode != ours)
    begin_s, end_s = left_s - BEFORE_S, left_s + AFTER_S
    said: list[Line] = [
        [round(at_s - begin_s, 3), message, _fields(message, values)]
        for at_s, message, values in _thinned(heard)
        if begin_s <= at_s <= end_s
    ]
    positions = [at_s for at_s, message, _ in heard if message == POSITION and at_s <= end_s]
    last_s = round(positions[-1] - begin_s, 3)
    return _case(f"{path.parent.name}/{name}", said, last_s if last_s < said[-1][0] - 2.0 else None)


def _received(path: Path) -> Iterator[tuple[float, str, Any]]:
    """Read what the vehicle sent."""
    data, at = path.read_bytes(), 0
    parser = wire.Parser([*TOLD, POSITION])
    while at + 8 < len(data):
        length = data[at + 9] + (12 if data[at + 8] == 0xFD else 8)
        at_s = int.from_bytes(data[at : at + 8], "big") * 1e-6
        for frame in parser.feed(data[at + 8 : at + 8 + length]):
            if (frame.sysid, frame.compid) != CLIENT:
                yield at_s, wire.message(frame.id).name, frame.values
        at += 8 + length


def _thinned(heard: list[tuple[float, str, Any]]) -> Iterator[tuple[float, str, Any]]:
    """Leave positions out, and what the estimator repeats."""
    told: dict[str, tuple[float, int]] = {}
    for at_s, message, values in heard:
        if message == POSITION:
            continue
        if message in {"EKF_STATUS_REPORT", "ESTIMATOR_STATUS"}:
            before_s, flags = told.get(message, (-EVERY_S, -1))
            if values.flags == flags and at_s - before_s < EVERY_S:
                continue
            told[message] = (at_s, values.flags)
        yield at_s, message, values


def _fields(message: str, values: Any) -> dict[str, Any]:
    fields = {name: getattr(values, name) for name in KEPT[message]}
    if message == "EVENT":
        fields["arguments"] = values.arguments.rstrip(b"\0").hex()
    return fields


def _ardupilot(events: list[list[Any]]) -> Iterator[Line]:
    """Tell what behaviour.json tells of ArduPilot: heartbeats, and texts with or without weight."""
    for at_s, what, *rest in events:
        if what in {"HB", "HEARTBEAT"}:
            base, mode, status = rest if what == "HB" else rest[0]
            yield [at_s, "HEARTBEAT", _beat(ARDUPILOT.heartbeat_id, base, mode, status)]
        else:
            severity = what if isinstance(what, int) else 4
            yield [at_s, "STATUSTEXT", {"severity": severity, "text": rest[-1]}]


def _px4(case: Mapping[str, Any]) -> list[Line]:
    """Tell what behaviour.json tells of PX4: changes of mode and status, texts, events by args."""
    changes = case["transitions"]
    said: list[Line] = [
        [at_s, "EVENT", {"id": ENTERED, "log_levels": 0x42, "sequence": 1, "arguments": arguments}]
        for at_s, name, _, arguments in case.get("event_names", ())
        if name == "commander_failsafe_enter_generic"
    ]
    for at_s, mode, *_ in changes:
        modes = {"custom_mode": MODES[mode], "intended_custom_mode": PX4.offboard_mode}
        said.append([at_s, "CURRENT_MODE", modes])
    for beat_s in range(round(PX4_END_S + changes[-1][0])):
        mode, status, armed = _state(changes, float(beat_s))
        base = PX4_BASE_MODE | ARMED * armed
        said.append(
            [float(beat_s), "HEARTBEAT", _beat(PX4.heartbeat_id, base, MODES[mode], status)]
        )
    return said


def _state(changes: list[list[Any]], at_s: float) -> tuple[str, int, bool]:
    """Give mode, status and whether it is armed at a time; not every case tells all three."""
    mode, status, armed = "OFFBOARD", STATES["ACTIVE"], True
    for since_s, *state in changes:
        if since_s <= at_s:
            mode = state[0]
            status = STATES[state[1]] if len(state) > 1 else status
            armed = state[2] if len(state) > 2 else armed
    return mode, status, armed


def _beat(autopilot: int, base: int, mode: int, status: int) -> dict[str, int]:
    names = KEPT["HEARTBEAT"]
    return dict(zip(names, (QUADROTOR, autopilot, base, mode, status), strict=True))
