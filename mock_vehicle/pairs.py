"""Who of a fleet is meant with whom, out of an array with a place for each pair."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def pairs(among: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Give rows and columns of what is true in (k, n) as `nonzero` does, which takes longer."""
    (flat,) = among.ravel().nonzero()
    rows, columns = np.divmod(flat, among.shape[1])
    return rows, columns
