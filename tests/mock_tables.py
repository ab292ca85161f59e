"""Tables of what mock vehicles understand and say; `python tests/mock_tables.py` writes them.

They are made of the tables that the personalities work by, into docs/mock_vehicle.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from mock_vehicle.autopilot import requests
from mock_vehicle.autopilot.base import Autopilot
from mock_vehicle.vehicle import PERSONALITIES
from swarm_ctl import wire

PAGE = Path(__file__).parents[1] / "docs" / "mock_vehicle.md"
BEGIN, END = "<!-- tables -->\n", "<!-- end of tables -->\n"
PX4, ARDUPILOT = PERSONALITIES["px4"], PERSONALITIES["ardupilot"]
BOTH = (PX4, ARDUPILOT)
SERVICES: Mapping[str, tuple[str, ...]] = {
    # By the beginning of the names of their messages.
    "heartbeat": ("HEARTBEAT",),
    "commands": ("COMMAND_",),
    "modes": ("SET_MODE",),
    "offboard control": ("SET_POSITION_TARGET", "SET_ATTITUDE_TARGET", "MANUAL_CONTROL", "RC_"),
    "parameters": ("PARAM_",),
    "missions, fences, rally points": ("MISSION_", "FENCE_", "RALLY_"),
    "streams": ("REQUEST_DATA_STREAM",),
    "time and reachability": ("TIMESYNC", "PING", "SYSTEM_TIME"),
    "home and origin": ("SET_HOME", "SET_GPS_GLOBAL_ORIGIN"),
    "file transfer": ("FILE_TRANSFER",),
    "signing": ("SETUP_SIGNING",),
}


def tables() -> str:
    """Write all tables."""
    return "\n".join(
        [
            "## What is supported",
            "",
            "Written by `python tests/mock_tables.py` from the tables that the vehicles work by.",
            "",
            "Messages that are understood:",
            "",
            *_table(["microservice", "PX4", "ArduPilot"], _services()),
            "",
            "Commands, by COMMAND_LONG or COMMAND_INT; all others are UNSUPPORTED:",
            "",
            *_table(["MAV_CMD", "PX4", "ArduPilot"], _commands()),
            "",
            "Telemetry at full rates, Hz; *asked*: when its interval is set; *once*: on request;",
            "*silent*: asking is accepted, and there is nothing to say:",
            "",
            *_table(
                ["message", "PX4, companion", "PX4, ground station", "ArduPilot"],
                _telemetry(),
            ),
            "",
            "Modes; arming is possible in those marked with *:",
            "",
            *_table(["PX4", "ArduPilot"], [[_modes(PX4), _modes(ARDUPILOT)]]),
            "",
        ]
    )


def _table(head: list[str], rows: Iterable[list[str]]) -> Iterator[str]:
    yield from (f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows))


def _services() -> Iterator[list[str]]:
    heard = [{dialect.mavlink_map[n].msgname for n in kind.message_table} for kind in BOTH]
    for service, beginnings in SERVICES.items():
        cells = [sorted(name for name in names if name.startswith(beginnings)) for names in heard]
        if any(cells):
            yield [service, *(", ".join(cell) or "-" for cell in cells)]
    known = tuple(beginning for beginnings in SERVICES.values() for beginning in beginnings)
    others = [sorted(name for name in names if not name.startswith(known)) for names in heard]
    if any(others):
        yield ["others", *(", ".join(other) or "-" for other in others)]


def _commands() -> Iterator[list[str]]:
    for number in sorted({number for kind in BOTH for number in kind.command_table}):
        name = dialect.enums["MAV_CMD"][number].name.removeprefix("MAV_CMD_")
        yield [f"{number} {name}", *_yes(number in kind.command_table for kind in BOTH)]


def _telemetry() -> Iterator[list[str]]:
    numbers = {n for kind in BOTH for n in (*kind.streamable, *kind.requestable)}
    known = {*dialect.mavlink_map, wire.message("PROTOCOL_VERSION").id}
    names = {n: wire.message(n).name for n in numbers & known}
    for number, name in sorted(names.items(), key=lambda item: item[1]):
        companion, ground = (_rate(PX4, link, number) for link in (0, 1))
        yield [name, companion, ground, _rate(ARDUPILOT, 0, number)]


def _rate(kind: type[Autopilot], link: int, number: int) -> str:
    interval_s = kind.traits.intervals_s["full"][link].get(number)
    if interval_s is not None:
        return f"{1.0 / interval_s:.3g}"
    if number in kind.streamable:
        return "silent" if kind.streamable[number] is requests.nothing else "asked"
    return "once" if number in kind.requestable else "-"


def _modes(kind: type[Autopilot]) -> str:
    return ", ".join(mode.name + "*" * mode.can_arm for mode in kind.traits.modes.values())


def _yes(answers: Iterable[bool]) -> list[str]:
    return ["yes" if answer else "-" for answer in answers]


def page() -> str:
    """Put the tables into the page."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    return before + BEGIN + tables() + END + after


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
