"""Compare the CPU time of our MAVLink codec with pymavlink's, message by message."""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict, astuple, dataclass
from pathlib import Path
from statistics import fmean, median
from typing import TYPE_CHECKING, Any, cast

import machine
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl import wire
from swarm_ctl.wire import batch

if TYPE_CHECKING:
    from collections.abc import Callable

SEQS = range(256)
FLEETS = (10, 100, 250)
HOT: dict[str, tuple[Any, ...]] = {
    "HEARTBEAT": (2, 12, 209, 0x60000, 4, 3),
    "ATTITUDE": (123456, 0.01, -0.02, 1.57, 0.1, -0.1, 0.05),
    "LOCAL_POSITION_NED": (123456, 12.5, -7.25, -3.1, 0.9, -0.4, 0.02),
    "GLOBAL_POSITION_INT": (123456, 473977420, 85455940, 488000, 3000, 10, -20, 5, 9000),
    "DISTANCE_SENSOR": (123456, 20, 4000, 812, 0, 3, 100, 255, 0.1, 0.1, (0.7, 0.1, 0.2, 0.6), 90),
    "SYS_STATUS": (7, 7, 7, 300, 15800, 1200, 87, 0, 0, 0, 0, 0, 0, 1, 1, 1),
    "SET_POSITION_TARGET_LOCAL_NED": (
        *(123456, 1, 1, 1, 0x0DC7, 1.5, 2.5, -3.5, 0.5, 0.25, -0.1, 0.01, 0.02, 0.03, 1.57, 0.1),
    ),
    "COMMAND_LONG": (1, 1, 511, 0, 32.0, 100000.0, 1.0, 2.0, 3.0, 4.0, 5.0),
}


@dataclass(frozen=True)
class Row:
    """Median CPU microseconds per message."""

    name: str
    frame_bytes: float
    pack_us: float
    pymavlink_pack_us: float
    parse_us: float
    pymavlink_parse_us: float


def cpu_us(run: Callable[[], object], repeats: int, messages: int = len(SEQS)) -> float:
    """Give the median CPU time per message of a function that handles so many at once."""
    times = []
    for _ in range(repeats):
        start = time.process_time_ns()
        run()
        times.append(time.process_time_ns() - start)
    return median(times) / messages / 1000


def our_pack(name: str) -> Callable[[], object]:
    """Pack one frame per seq."""
    return packing("pack(seq, 1, 1, {values})", name, pack=wire.message(name).pack)


def pymavlink_pack(name: str) -> Callable[[], object]:
    """Build and pack one message of pymavlink per seq."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    table = dialect.mavlink_map[wire.message(name).id]
    return packing("mav.seq = seq; table({values}).pack(mav)", name, mav=mav, table=table)


def packing(statement: str, name: str, **names: object) -> Callable[[], object]:
    """Write the arguments out, for both alike: to spread a tuple costs more than a CRC."""
    values = ", ".join(f"v{index}" for index in range(len(HOT[name])))
    source = f"def run():\n    for seq in seqs:\n        {statement.format(values=values)}"
    scope = {"seqs": SEQS, **names, **{f"v{i}": value for i, value in enumerate(HOT[name])}}
    exec(source, scope)  # noqa: S102 - the source stands here
    return cast("Callable[[], object]", scope["run"])


def parse(one: Callable[[bytes], object], frames: list[bytes]) -> Callable[[], None]:
    """Parse one datagram per frame and forget the result."""

    def run() -> None:
        for frame in frames:
            one(frame)

    return run


def measure(name: str, repeats: int = 60) -> Row:
    """Measure one message, ours and pymavlink's in turn."""
    message = wire.message(name)
    frames = [message.pack(seq, 1, 1, *HOT[name]) for seq in SEQS]
    return Row(
        name=name,
        frame_bytes=len(frames[0]),
        pack_us=cpu_us(our_pack(name), repeats),
        pymavlink_pack_us=cpu_us(pymavlink_pack(name), repeats),
        parse_us=cpu_us(parse(wire.Parser([name]).feed, frames), repeats),
        pymavlink_parse_us=cpu_us(parse(dialect.MAVLink(None).parse_buffer, frames), repeats),
    )


@dataclass(frozen=True)
class FleetRow:
    """Median CPU microseconds per message, encoded for a whole fleet at once."""

    name: str
    vehicles: int
    compiled_us: float | None
    """None where numba is not installed."""
    plain_us: float


def measure_fleet(name: str, vehicles: int, repeats: int = 60) -> FleetRow:
    """Measure the frames of many vehicles at once, made of columns of the wire's own types."""
    message = wire.message(name)
    seqs = (np.arange(vehicles) & 0xFF).astype(np.uint8)
    fleet = batch.Batch(message, np.arange(vehicles) % 255 + 1, 1)
    columns = [
        np.array([value] * vehicles, f"<{field.code}")
        for field, value in zip(message.declared, HOT[name], strict=True)
    ]

    def run() -> None:
        fleet.pack(seqs, *columns)

    costs_us = []
    for finish in batch.FINISHERS:
        batch.finish = finish
        run()  # which may have to be compiled
        costs_us.append(cpu_us(run, repeats, vehicles))
    return FleetRow(name, vehicles, costs_us[0] if is_compiled() else None, costs_us[-1])


def is_compiled() -> bool:
    """Tell whether numba is installed."""
    return batch.FINISHERS[0] is not batch.finish_plainly


def mean(rows: list[Row]) -> Row:
    """Average over the messages."""
    figures = [astuple(row)[1:] for row in rows]
    return Row("mean", *(round(fmean(column), 3) for column in zip(*figures, strict=True)))


def table(rows: list[Row]) -> str:
    """Lay the rows out for reading."""
    head = f"{'us of CPU per message':31}{'bytes':>5}"
    lines = [head + "".join(f"{title:>8}{'pymav':>8}{'ratio':>7}" for title in ("pack", "parse"))]
    for row in [*rows, mean(rows)]:
        pairs = ((row.pack_us, row.pymavlink_pack_us), (row.parse_us, row.pymavlink_parse_us))
        cells = "".join(f"{ours:8.2f}{theirs:8.2f}{theirs / ours:7.1f}" for ours, theirs in pairs)
        lines.append(f"{row.name:31}{row.frame_bytes:5.0f}{cells}")
    return "\n".join(lines)


def fleet_table(rows: list[FleetRow]) -> str:
    """Lay the rows of fleets out for reading."""
    lines = [f"{'us of CPU per message, at once':31}{'fleet':>5}{'numba':>8}{'numpy':>8}"]
    for row in rows:
        compiled = "-" if row.compiled_us is None else f"{row.compiled_us:.2f}"
        lines.append(f"{row.name:31}{row.vehicles:5}{compiled:>8}{row.plain_us:8.2f}")
    return "\n".join(lines)


def main() -> None:
    """Measure the hot messages and print tables; `--json FILE` writes the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there as well")
    options = parser.parse_args()
    rows = [measure(name) for name in HOT]
    print(table(rows))
    fleets = [measure_fleet(name, vehicles) for vehicles in FLEETS for name in HOT]
    print(fleet_table(fleets))
    machine.write(
        options.json,
        {"single": [asdict(row) for row in rows], "fleet": [asdict(r) for r in fleets]},
    )


if __name__ == "__main__":
    main()
