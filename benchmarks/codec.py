"""Compare the CPU time of our MAVLink codec with pymavlink's, message by message."""

from __future__ import annotations

import argparse
import json
import platform
import time
from dataclasses import asdict, astuple, dataclass
from importlib.metadata import version
from pathlib import Path
from statistics import fmean, median
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl import wire

if TYPE_CHECKING:
    from collections.abc import Callable

SEQS = range(256)
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


def cpu_us(run: Callable[[], object], repeats: int) -> float:
    """Give the median CPU time per message of a function that handles one message per seq."""
    times = []
    for _ in range(repeats):
        start = time.process_time_ns()
        run()
        times.append(time.process_time_ns() - start)
    return median(times) / len(SEQS) / 1000


def our_pack(name: str) -> Callable[[], None]:
    """Pack one frame per seq."""
    pack, values = wire.message(name).pack, HOT[name]

    def run() -> None:
        for seq in SEQS:
            pack(seq, 1, 1, *values)

    return run


def pymavlink_pack(name: str) -> Callable[[], None]:
    """Build and pack one message of pymavlink per seq."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    table, values = dialect.mavlink_map[wire.message(name).id], HOT[name]

    def run() -> None:
        for seq in SEQS:
            mav.seq = seq
            table(*values).pack(mav)

    return run


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


def machine() -> dict[str, str]:
    """Name what the figures were measured on."""
    names = ("pymavlink", "fastcrc")
    return {
        "python": platform.python_version(),
        "system": platform.platform(),
        "machine": platform.machine(),
        **{name: version(name) for name in names},
    }


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


def main() -> None:
    """Measure the hot messages and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there as well")
    path: Path | None = parser.parse_args().json
    rows = [measure(name) for name in HOT]
    print(", ".join(f"{name} {value}" for name, value in machine().items()))
    print(table(rows))
    if path:
        result = {"machine": machine(), "rows": [asdict(row) for row in rows]}
        path.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
