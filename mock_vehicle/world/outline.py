"""What a drawing of the world needs, in JSON values."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from mock_vehicle.maps import OccupancyMap
    from mock_vehicle.world.shapes import Prism

_DRAWN_CELLS = 250_000
"""A map with more cells is drawn coarser."""


def polygon(prism: Prism) -> dict[str, Any]:
    """Describe a shape from above."""
    points = prism.outline_ne_m().round(3).tolist()
    return {"points_ne_m": points, "bottom_m": prism.bottom_m, "top_m": prism.top_m}


def drawn_map(chart: OccupancyMap) -> dict[str, Any]:
    """Describe a map for drawing, in runs; a big one coarser, solid wherever any cell is."""
    factor = math.ceil(math.sqrt(max(1.0, chart.blocked.size / _DRAWN_CELLS)))
    padding = [(0, -size % factor) for size in chart.blocked.shape]
    padded = np.pad(chart.blocked, padding, constant_values=True)
    nx, ny = (size // factor for size in padded.shape)
    blocked = padded.reshape(nx, factor, ny, factor).any(axis=(1, 3))
    edges = np.flatnonzero(np.diff(blocked.reshape(-1), prepend=False, append=False))
    return {
        "origin_ne_m": list(chart.origin_ne_m),
        "cell_m": chart.cell_m * factor,
        "yaw_rad": chart.yaw_rad,
        "height_m": chart.height_m,
        "shape": [nx, ny],
        "blocked_rle": np.diff(edges, prepend=0, append=blocked.size).tolist(),
    }
