"""Draw the map_server maps of this folder: `python missions/worlds/make_maps.py [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

RESOLUTION_M = 0.05
SIZE_M = (20.0, 15.0)
MARGIN_M = 0.6
"""Unknown space around the building."""
FREE, UNKNOWN, OCCUPIED = 254, 205, 0
"""The grey levels that map_saver writes."""
WALLS_M = (
    (0.6, 0.6, 19.4, 0.6),
    (0.6, 14.4, 19.4, 14.4),
    (0.6, 0.6, 0.6, 14.4),
    (19.4, 0.6, 19.4, 14.4),
    (0.6, 6.2, 2.4, 6.2),
    (4.0, 6.2, 9.0, 6.2),
    (10.6, 6.2, 15.4, 6.2),
    (17.0, 6.2, 19.4, 6.2),
    (0.6, 8.6, 4.6, 8.6),
    (6.2, 8.6, 11.4, 8.6),
    (13.0, 8.6, 19.4, 8.6),
    (6.6, 0.6, 6.6, 6.2),
    (13.2, 0.6, 13.2, 3.0),
    (13.2, 4.6, 13.2, 6.2),
    (8.0, 8.6, 8.0, 14.4),
    (15.0, 8.6, 15.0, 10.6),
    (15.0, 12.2, 15.0, 14.4),
)
"""From x, y to x, y; the gaps are doors of 1.6 m."""
FURNITURE_M = (
    (1.2, 1.0, 2.8, 1.8),
    (8.6, 2.6, 11.0, 3.6),
    (17.6, 1.0, 18.8, 3.4),
    (2.4, 11.6, 4.4, 12.6),
    (10.0, 13.2, 13.0, 14.0),
    (17.4, 12.6, 18.8, 13.8),
)
"""Low x, low y, high x, high y."""

Image = NDArray[np.uint8]


def fill(image: Image, low_m: tuple[float, float], high_m: tuple[float, float], grey: int) -> None:
    """Paint the rectangle from `low_m` to `high_m` (x, y in metres); row 0 is the lowest y."""
    (x0, x1), (y0, y1) = (
        [round(edge / RESOLUTION_M) for edge in pair] for pair in zip(low_m, high_m, strict=True)
    )
    image[y0:y1, x0:x1] = grey


def ragged(image: Image, rng: np.random.Generator) -> Image:
    """Roughen walls as a laser does: some cells behind a surface fill up, some of it is missed."""
    solid = image == OCCUPIED
    beside = np.zeros_like(solid)
    for axis in (0, 1):
        for shift in (-1, 1):
            beside |= np.roll(solid, shift, axis)
    rough = image.copy()
    rough[beside & ~solid & (rng.random(image.shape) < 0.35)] = OCCUPIED
    return rough


def small_office() -> Image:
    """Draw the map, (rows, columns) from the top as images are: six rooms along a corridor."""
    shape = (round(SIZE_M[1] / RESOLUTION_M), round(SIZE_M[0] / RESOLUTION_M))
    image = np.full(shape, UNKNOWN, dtype=np.uint8)
    far = (SIZE_M[0] - MARGIN_M, SIZE_M[1] - MARGIN_M)
    fill(image, (MARGIN_M, MARGIN_M), far, FREE)
    for x0, y0, x1, y1 in WALLS_M:
        half = 0.05
        fill(image, (x0 - half, y0 - half), (x1 + half, y1 + half), OCCUPIED)
    for x0, y0, x1, y1 in FURNITURE_M:
        fill(image, (x0, y0), (x1, y1), OCCUPIED)
        fill(image, (x0 + 0.1, y0 + 0.1), (x1 - 0.1, y1 - 0.1), UNKNOWN)
    return np.flipud(ragged(image, np.random.default_rng(2016)))


def write(folder: Path) -> None:
    """Write `small_office.pgm` (binary PGM) and `small_office.yaml` into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    image = small_office()
    rows, columns = image.shape
    header = f"P5\n# {RESOLUTION_M} m per pixel\n{columns} {rows}\n255\n".encode()
    (folder / "small_office.pgm").write_bytes(header + image.tobytes())
    (folder / "small_office.yaml").write_text(
        "image: small_office.pgm\n"
        f"resolution: {RESOLUTION_M}\n"
        "origin: [0.0, 0.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n",
        encoding="utf-8",
    )


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "maps")
