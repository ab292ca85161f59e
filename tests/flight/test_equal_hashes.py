"""One flight in two Python processes: the same seed, the same frames, whatever goes wrong."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from halls import write_hall

BAD_RADIO: dict[str, Any] = {
    "radius_m": 4.0,
    "delay_s": 0.05,
    "jitter_s": 0.2,
    "loss_fraction": 0.2,
    "duplicate_fraction": 0.1,
    "reorder_fraction": 0.1,
    "partitions": [{"from_s": 18.0, "until_s": 25.0, "groups": [[1, 2], [3, 4]]}],
    "ranging": {
        "range_noise_m": 0.05,
        "outlier_fraction": 0.05,
        "bearing_noise_deg": 2.0,
        "blind": [{"from_deg": 170, "to_deg": 190}],
        "delay_s": 0.1,
    },
}
WORLD = {
    "radio": BAD_RADIO,
    "wind": {"speed_m_s": 1.0, "gust_m_s": 0.5},
    "sensors": {"range_noise_m": 0.05, "odometry_drift_fraction": 0.01},
}
FAULTS = (
    "silent-radio:2@15+5",
    "link-loss:3@14+3",
    "wind-gust:1@20",
    "controller:4@24",
    "dead:1@28",
)

OLDER_PROCESSOR = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F,-AVX2_Usable,-FMA_Usable",
    "NPY_DISABLE_CPU_FEATURES": " ".join(
        np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    ),
    "OPENBLAS_CORETYPE": "Prescott",
}
"""The C library, NumPy and its BLAS do here what they do on a processor of 2005: the last bit of a
sine is another one now and then (glibc 2.36 with and without fused multiply-add)."""


@pytest.fixture
def hall(tmp_path: Path) -> Path:
    return write_hall(
        tmp_path,
        {
            "vehicles": 4,
            "autopilot": "mixed",
            "duration_s": 25.0,
            "planner": {"kind": "explore"},
        },
        WORLD,
    )


def start(
    hall: Path, hash_seed: str, seed: int, environment: dict[str, str]
) -> tuple[subprocess.Popen[bytes], Path]:
    """Fly in an interpreter of its own; everything that is hashed comes in another order there."""
    out = hall.parent / f"run-{hash_seed}-{seed}"
    words = ["run", str(hall), "--virtual", "--seed", str(seed), "--out", str(out)]
    words += [word for fault in FAULTS for word in ("--fault", fault)]
    process = subprocess.Popen(
        [sys.executable, "-m", "swarm_ctl", *words],
        env={**os.environ, **environment, "PYTHONHASHSEED": hash_seed},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    return process, out


def run_sha256(flown: tuple[subprocess.Popen[bytes], Path]) -> str:
    process, out = flown
    told, _ = process.communicate(timeout=120.0)
    assert process.returncode == 0, told.decode()
    return str(json.loads((out / "summary.json").read_text("utf-8"))["run_sha256"])


def test_a_bad_day_repeats_bit_for_bit_in_a_process_on_another_processor(hall: Path) -> None:
    flown = [start(hall, "0", 5, {}), start(hall, "1", 5, OLDER_PROCESSOR), start(hall, "2", 6, {})]
    one, other, another_seed = map(run_sha256, flown)
    assert one == other
    assert one != another_seed
