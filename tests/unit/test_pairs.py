from __future__ import annotations

import numpy as np
import pytest

from mock_vehicle.pairs import pairs


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (5, 3), (3, 5)])
def test_pairs_come_as_nonzero_gives_them(shape: tuple[int, int]) -> None:
    among = np.random.default_rng(3).random(shape) < 0.4
    for mask in (among, among.T, ~among):
        rows, columns = pairs(mask)
        expected_rows, expected_columns = mask.nonzero()
        assert np.array_equal(rows, expected_rows)
        assert np.array_equal(columns, expected_columns)
