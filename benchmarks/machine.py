"""What every benchmark tells beside its figures: the machine, versions, and how fast it was."""

from __future__ import annotations

import json
import os
import platform
import statistics
import struct
import time
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from swarm_ctl.model import Vec3

PACKAGES = ("swarm-ctl", "numpy", "numba", "pymavlink", "fastcrc", "uvloop")


def machine() -> dict[str, Any]:
    """Name the machine and what runs on it."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": {name: found for name in PACKAGES if (found := _version(name))},
    }


def calibrate_s() -> float:
    """Time what flights are made of: calls, tuples, dictionaries, struct, arrays of three.

    CPU time; what is measured in between is told in this unit where machines are compared.
    """
    layout = struct.Struct("<IfffffBB")
    table: dict[int, float] = {}
    began_s = time.process_time()
    for turn in range(1500):
        data = layout.pack(turn, 1.0, 2.0, 3.0, 0.5, 0.25, 1, 2)
        _, x, y, z, *_ = layout.unpack(data)
        place = Vec3(x + turn, y, z)._replace(z=max(z, 0.5))
        doubled = [value * 2.0 for value in place]
        table[turn % 100] = sum(doubled)
    for _ in range(60):
        np.sqrt(np.einsum("ij,ij->i", ways := np.ones((10, 3)), ways))
    return time.process_time() - began_s


def write(path: Path | None, figures: Any) -> None:
    """Write figures to a file, if one is wanted, with what they were measured on, and when."""
    if path is None:
        return
    content = {
        "benchmark": path.stem,
        "measured_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "calibration_ms": round(1e3 * statistics.median(calibrate_s() for _ in range(9)), 3),
        "figures": figures,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _processor() -> str:
    """Say what the kernel calls it, or else Python."""
    file = Path("/proc/cpuinfo")
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
