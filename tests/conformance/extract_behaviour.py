"""Make scripts of what is told in behaviour.json alone: requests by name, answers in few words.

The times between the requests are ours; the record does not have them.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Line = list[Any]
"""A line of a script: time, direction, message, fields."""

PX4_BOOTING_S, PX4_READY_S, ARDUPILOT_READY_S = 2.0, 9.0, 45.0
APART_S = 1.5
"""Time between two requests."""
TARGETS = {
    "wrong_target_system_77": (77, 1),
    "wrong_component_50": (1, 50),
    "broadcast_0_0_request_msg": (0, 0),
    "target_1_0": (1, 0),
}
ELSEWHERE = ("arming_", "flight_")
"""Commands that stand in the tlogs."""
LEGACY = {
    "target_1_0": "REQUEST_MESSAGE_AUTOPILOT_VERSION_148",
    "legacy_REQUEST_AUTOPILOT_CAPABILITIES_520": "REQUEST_MESSAGE_AUTOPILOT_VERSION_148",
    "legacy_REQUEST_PROTOCOL_VERSION_519": "REQUEST_MESSAGE_PROTOCOL_VERSION_300",
    "legacy_GET_HOME_POSITION_410": "REQUEST_MESSAGE_HOME_POSITION_242",
}
"""Requests that give the same message as another."""
PX4_OFFBOARD = 6 << 16
INT32, REAL32, UINT8 = 6, 9, 1
DENORMAL = 2.0**-149
"""A float whose bytes are the integer 1."""


@dataclass(frozen=True)
class Param:
    """A request for a parameter, or a change, with its name in the record."""

    key: str
    name: str
    value: float | None = None
    type: int = REAL32
    index: int = -1
    target: tuple[int, int] = (1, 1)


PX4_PARAMS = (
    Param("read_unknown", "NO_SUCH_PARAM"),
    Param("read_by_index_5", "", index=5),
    Param("read_index_out_of_range", "", index=9999),
    Param("read__HASH_CHECK", "_HASH_CHECK"),
    Param("set_int_ok", "NAV_DLL_ACT", 1 * DENORMAL, INT32),
    Param("set_int_back", "NAV_DLL_ACT", 0.0, INT32),
    Param("set_float_ok", "MIS_TAKEOFF_ALT", 3.5),
    Param("set_float_back", "MIS_TAKEOFF_ALT", 2.5),
    Param("set_out_of_range (NAV_DLL_ACT=99)", "NAV_DLL_ACT", 99 * DENORMAL, INT32),
    Param("read_after", "NAV_DLL_ACT"),
    Param("set_float_out_of_range (COM_OF_LOSS_T=9999)", "COM_OF_LOSS_T", 9999.0),
    Param("read_after2", "COM_OF_LOSS_T"),
    Param("set_float_as_INT32 (MIS_TAKEOFF_ALT=4 type 6)", "MIS_TAKEOFF_ALT", 4 * DENORMAL, INT32),
    Param("read_after4", "MIS_TAKEOFF_ALT"),
    Param("set_unknown", "NO_SUCH_PARAM", 1.0),
)
ARDUPILOT_PARAMS = (
    Param("read_by_name GUID_TIMEOUT", "GUID_TIMEOUT"),
    Param("read_by_name MAV_SYSID", "MAV_SYSID"),
    Param("read_by_name SYSID_THISMAV (old name)", "SYSID_THISMAV"),
    Param("read_by_index 10", "", index=10),
    Param("read_by_index 9999 (out of range)", "", index=9999),
    Param("read unknown name", "NO_SUCH_PARAM"),
    Param("read index -2", "", index=-2),
    Param("read lower-case", "guid_timeout"),
    Param("set GUID_TIMEOUT 2.5 REAL32", "GUID_TIMEOUT", 2.5),
    Param("set GUID_TIMEOUT 2.5 again (same value)", "GUID_TIMEOUT", 2.5),
    Param("read back", "GUID_TIMEOUT"),
    Param("set GUID_TIMEOUT 3", "GUID_TIMEOUT", 3.0),
    Param("set int param LOG_DISARMED 1.7 REAL32", "LOG_DISARMED", 1.7),
    Param("set int param FS_GCS_ENABLE type INT8", "FS_GCS_ENABLE", 0.0, 2),
    Param("set wrong type UINT32 bytes", "LOG_DISARMED", DENORMAL, 5),
    Param("set out of range WP_YAW_BEHAVIOR 99", "WP_YAW_BEHAVIOR", 99.0),
    Param("set int8 overflow 300 WP_YAW_BEHAVIOR", "WP_YAW_BEHAVIOR", 300.0),
    Param("set NaN", "GUID_TIMEOUT", math.nan),
    Param("set inf", "GUID_TIMEOUT", math.inf),
    Param("set unknown", "NO_SUCH_PARAM", 1.0),
    Param("set read-only FORMAT_VERSION", "FORMAT_VERSION", 1.0),
    Param("set read-only STAT_BOOTCNT", "STAT_BOOTCNT", 5.0),
    Param("read with component 99", "GUID_TIMEOUT", target=(1, 99)),
    Param("read with target 0/0", "GUID_TIMEOUT", target=(0, 0)),
    Param("read with target system 9", "GUID_TIMEOUT", target=(9, 1)),
)

MALFORMED = {
    "good frame": "good",
    "bad_crc": "checksum",
    "bad CRC": "checksum",
    "payload_flip_bit": "payload bit",
    "incompat_flag_unknown_0x80": "incompatible",
    "unknown incompat flag 0x40": "incompatible",
    "compat flags 0x55 (CRC not redone)": "compatible",
    "unknown message id 12345": "unknown id",
    "truncated": "cut",
    "truncated to 10 bytes": "cut",
    "empty_datagram": "empty",
    "empty-ish: single 0xFD": "lone start",
    "65 kB... 1400 B of 0xFD": "many starts",
    "two_frames_one_datagram": "two at once",
    "two frames in one datagram": "two at once",
    "split_over_two_datagrams(2nd half)": "in two",
    "one frame split over two datagrams": "in two",
    "source sysid 0": "sysid 0",
    "source sysid 1": "sysid 1",
    "source sysid 254": "sysid 254",
    "five commands, same seq": "same number",
    "MAVLink1 COMMAND_LONG": "MAVLink 1",
}
"""Cases of the records by our names; those with random bytes cannot be repeated."""


def malformed(behaviour: Mapping[str, Any]) -> dict[str, list[int | None]]:
    """Give how often each case was answered, and the command after it."""
    cases = behaviour.get("malformed") or behaviour["wire"]["malformed"]
    found = {MALFORMED[name]: _obeyed(name, v) for name, v in cases.items() if name in MALFORMED}
    if behaviour.get("mavlink1"):
        found["MAVLink 1"] = [len(behaviour["mavlink1"]["v1_command_acked"]), None]
    return found


def _obeyed(name: str, entry: Mapping[str, Any]) -> list[int | None]:
    if "replies" in entry:
        answers = sum(reply[0] == "COMMAND_ACK" for reply in entry["replies"])
        return [answers, int(entry["alive_after"] != "NO_ACK")]
    answers = int(entry["acked"]) * (2 if name.startswith("two frames") else 1)
    alive = entry.get("then_alive")
    return [answers, int(alive[0] != "NO_ACK") if alive else None]


def told(behaviour: Mapping[str, Any]) -> Iterator[tuple[str, list[Line]]]:
    """Give the suites that only behaviour.json knows: name and lines."""
    if "param_protocol" in behaviour:
        yield "commands", list(_commands(behaviour))
        yield "intervals", list(_intervals(behaviour["set_message_interval"]))
        found = behaviour["param_protocol"]["basic"]
        yield "params", list(_params(PX4_PARAMS, found, PX4_READY_S))
    else:
        yield "params", list(_params(ARDUPILOT_PARAMS, behaviour["params"], ARDUPILOT_READY_S))


def _commands(behaviour: Mapping[str, Any]) -> Iterator[Line]:
    at_s = PX4_BOOTING_S
    for name, entry in behaviour["commands"].items():
        if name.startswith(ELSEWHERE):
            continue
        if "before_ready" not in name:
            at_s = max(at_s, PX4_READY_S)
        yield [at_s, ">", *_command(name, entry)]
        number = entry.get("command", 176)
        for ack in entry["acks"]:
            late_ms, result = (ack["ms"], ack["result"]) if isinstance(ack, dict) else ack[::2]
            yield _acknowledged(at_s + late_ms * 1e-3, number, result)
        message = behaviour["requested_messages"].get(LEGACY.get(name, name))
        if message:
            yield [round(at_s + entry.get("msg_ms", 0.0) * 1e-3, 4), "<", *parsed(message)]
        at_s += APART_S


def _command(name: str, entry: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    system, component = TARGETS.get(name, (1, 1))
    target = {"target_system": system, "target_component": component}
    if "command" not in entry:
        return "SET_MODE", {"target_system": 1, "base_mode": 1, "custom_mode": PX4_OFFBOARD}
    params = [math.nan if p is None else float(p) for p in entry["params"]]
    names = [f"param{k}" for k in range(1, 8)]
    kind = "COMMAND_LONG"
    if name.endswith("_int"):
        kind, names, params = "COMMAND_INT", names[:4], params[:4]
    return kind, {**target, "command": entry["command"], **dict(zip(names, params, strict=True))}


def _acknowledged(at_s: float, command: int, result: str) -> Line:
    number = mavlink.enums["MAV_RESULT"]
    value = next(k for k, entry in number.items() if entry.name == f"MAV_RESULT_{result}")
    target = {"target_system": 255, "target_component": 190}
    return [round(at_s, 4), "<", "COMMAND_ACK", {"command": command, "result": value, **target}]


def parsed(text: str) -> tuple[str, dict[str, Any]]:
    """Read a message as pymavlink writes it."""
    name, _, content = text.partition(" ")
    fields = re.findall(r"(\w+) : (\[.*?\]|[^,}]*)", content)
    return name, {field: _number(value) for field, value in fields}


def _number(value: str) -> Any:
    try:
        return json.loads(value)
    except ValueError:
        return value


def _intervals(found: Mapping[str, Any]) -> Iterator[Line]:
    """Set and get intervals; the record names the message, its id and the rate."""
    at_s = PX4_READY_S
    for name, entry in found.items():
        if name == "REQUEST_DATA_STREAM":
            continue
        command, wanted, interval_us = interval(name)
        fields = {"target_system": 1, "target_component": 1, "command": command}
        asked = {"param1": float(wanted), "param2": interval_us}
        yield [at_s, ">", "COMMAND_LONG", {**fields, **asked}]
        for late_ms, result, *_ in entry["acks"]:
            yield _acknowledged(at_s + late_ms * 1e-3, command, result)
        for number, known_us in entry["MESSAGE_INTERVAL"] or ():
            fields = {"message_id": number, "interval_us": known_us}
            # It comes before the acknowledgement, as every requested message of PX4.
            yield [at_s, "<", "MESSAGE_INTERVAL", fields]
        at_s += APART_S


def interval(name: str) -> tuple[int, int, float]:
    """Give command, message id and interval of an entry."""
    if name.startswith("GET"):
        return 510, int(name.rpartition("_")[2]), 0.0
    if name.startswith("ATTITUDE "):
        return 511, 30, -1.0 if "stop" in name else 0.0
    message, _, rate_hz = name.partition("@")
    return 511, int(message.rpartition("_")[2]), 1e6 / float(rate_hz)


def _params(requests: Sequence[Param], found: Mapping[str, Any], at_s: float) -> Iterator[Line]:
    for request in requests:
        fields = {
            "target_system": request.target[0],
            "target_component": request.target[1],
            "param_id": request.name,
        }
        if request.value is None:
            yield [at_s, ">", "PARAM_REQUEST_READ", {**fields, "param_index": request.index}]
        else:
            change = {"param_value": request.value, "param_type": request.type}
            yield [at_s, ">", "PARAM_SET", {**fields, **change}]
        answer = _param_value(request, found[request.key])
        if answer:
            late_s = answer.pop("ms", 1.0) * 1e-3
            yield [round(at_s + late_s, 4), "<", "PARAM_VALUE", answer]
        at_s += APART_S


def _param_value(request: Param, found: Any) -> dict[str, Any] | None:
    """Understand an answer: none, a dict, a text, or value, type and delay."""
    if not found:
        return None
    if isinstance(found, str):
        return parsed(found)[1]
    if isinstance(found, dict):
        return dict(found["reply"] or ()) if "reply" in found else dict(found)
    value, kind, late_ms, *_ = found
    value = value * DENORMAL if kind == INT32 else value
    index = {"NAV_DLL_ACT": 631, "MIS_TAKEOFF_ALT": 567, "COM_OF_LOSS_T": 284}[request.name]
    fields = {"param_id": request.name, "param_value": value, "param_type": kind}
    return {**fields, "param_count": 893, "param_index": index, "ms": late_ms}
