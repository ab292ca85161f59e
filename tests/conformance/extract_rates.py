"""Make the measurements of rates out of what behaviour.json tells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from extract_behaviour import interval
from pymavlink.dialects.v20 import ardupilotmega as mavlink

PX4_TIME = 0.988
"""Seconds of PX4's simulator per second of the recorder's clock."""
DATA_STREAMS = {
    "RAW_SENSORS": 1,
    "EXTENDED_STATUS": 2,
    "RC_CHANNELS": 3,
    "RAW_CONTROLLER": 4,
    "POSITION": 6,
    "EXTRA1": 10,
    "EXTRA2": 11,
    "EXTRA3": 12,
}
INTERVALS_HZ = (10, 50, 100, 200, 400, 1000)


def rates(behaviour: Any) -> Iterator[dict[str, Any]]:
    """Find what flows how often: unasked, and after requests."""
    if "default_streams" in behaviour:
        links = behaviour["default_streams"]
        for link, name in enumerate(("offboard_14540", "gcs_14550")):
            yield rate(name, 5.0, 20.0, sim_hz(links[name]["hz"]), link=link)
        asked = behaviour["set_message_interval"]
        measured = ((name, entry["measured_hz"]) for name, entry in asked.items())
        for k, (name, hz) in enumerate((name, hz) for name, hz in measured if hz is not None):
            message = "ATTITUDE" if name.startswith("ATTITUDE") else name.rpartition("_")[0]
            start = interval_request(*interval(name)[1:])
            yield rate(name, 30.0 + 5.0 * k, 4.0, sim_hz({message: hz}), start=start)
        return
    streams = behaviour["streams"]
    yield rate("unasked", 5.0, 14.0, behaviour["boot"]["default_rates_with_gcs_heartbeat"])
    heard = streams["REQUEST_DATA_STREAM_ALL_4Hz"]
    yield rate("stream ALL 4 Hz", 21.0, 14.77, heard, **data_stream(0, 4))
    for k, (name, number) in enumerate(DATA_STREAMS.items()):
        heard = streams[f"stream_{name}"]
        yield rate(f"stream {name} 5 Hz", 45.0 + 5.0 * k, 3.8, heard, **data_stream(number, 5))
    for k, rate_hz in enumerate(INTERVALS_HZ):
        hz = streams[f"interval_{rate_hz}hz"]["got_hz"]
        start = interval_request(32, 1e6 / rate_hz)
        name = f"LOCAL_POSITION_NED at {rate_hz} Hz"
        yield rate(name, 90.0 + 5.0 * k, 4.0, {"LOCAL_POSITION_NED": hz}, start=start)


def sim_hz(heard: Mapping[str, float]) -> dict[str, float]:
    """Convert PX4's rates from the recorder's clock to the vehicle's."""
    return {name: hz / PX4_TIME for name, hz in heard.items()}


def rate(
    case: str,
    from_s: float,
    span_s: float,
    heard: Mapping[str, Any],
    *,
    link: int = 0,
    start: Any = None,
    stop: Any = None,
) -> dict[str, Any]:
    """Describe one measurement: when to repeat it, how long it took, messages per second."""
    known = {m.msgname for m in mavlink.mavlink_map.values()} | {"CURRENT_MODE"}
    hz = {
        name: round(hz["hz"] if isinstance(hz, dict) else hz, 2)
        for name, hz in heard.items()
        if name in known
    }
    times = {"from_s": from_s, "span_s": span_s}
    return {"case": case, **times, "link": link, "start": start, "stop": stop, "hz": hz}


def interval_request(message: int, interval_us: float) -> Any:
    """Ask for a message at an interval."""
    asked = {"command": 511, "param1": float(message), "param2": interval_us}
    return ["COMMAND_LONG", {"target_system": 1, "target_component": 1, **asked}]


def data_stream(number: int, rate_hz: int) -> dict[str, Any]:
    """Ask for a stream, and for its end."""
    fields = {"target_system": 1, "target_component": 1, "req_stream_id": number}
    start = {**fields, "req_message_rate": rate_hz, "start_stop": 1}
    return {"start": ["REQUEST_DATA_STREAM", start], "stop": ["REQUEST_DATA_STREAM", fields]}
