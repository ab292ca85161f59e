"""Random values for every message of the dialect, from pymavlink's tables."""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

TABLES: dict[int, Any] = dialect.mavlink_map


def random_values(table: Any, rng: np.random.Generator) -> list[Any]:
    """Draw a value per field as both codecs take it; extremes and zeros are frequent."""

    def number(code: str) -> int | float:
        if code in "fd":
            exact = struct.unpack(f"<{code}", struct.pack(f"<{code}", rng.normal() * 1e3))
            return float(rng.choice([exact[0], 0.0, math.inf]))
        bits = 8 * struct.calcsize(code)
        low, high = (
            (-(1 << bits - 1), (1 << bits - 1) - 1) if code.islower() else (0, (1 << bits) - 1)
        )
        drawn = low + int.from_bytes(rng.bytes(bits // 8), "little")
        return [0, low, high, drawn, drawn][rng.integers(5)]

    def value(code: str, length: int) -> Any:
        if code == "c":
            return bytes(rng.integers(32, 127, rng.integers(length + 1), dtype=np.uint8))
        return [number(code) for _ in range(length)] if length else number(code)

    codes = table.native_format.decode().lstrip("<")
    return [value(codes[i], table.array_lengths[i]) for i in table.orders]
