"""Which vehicle is behind which link."""

from __future__ import annotations

import pytest

from swarm_ctl.errors import SwarmError
from swarm_ctl.run.places import pair_up

A, B, C = "udpin://0.0.0.0:14540", "udpin://0.0.0.0:14541", "serial:///dev/ttyACM0:57600"


@pytest.mark.parametrize(
    ("urls", "sysids", "pairs"),
    [
        ([A], [7], [(A, 7)]),
        ([A, B, C], [7], [(A, 7), (B, 8), (C, 9)]),
        ([A, B], [9, 4], [(A, 9), (B, 4)]),
        ([A], [1, 2, 5], [(A, 1), (A, 2), (A, 5)]),
        ([A, A, B], [1, 2, 3], [(A, 1), (A, 2), (B, 3)]),
    ],
)
def test_links_and_sysids_pair_up(
    urls: list[str], sysids: list[int], pairs: list[tuple[str, int]]
) -> None:
    assert pair_up(urls, sysids) == pairs


@pytest.mark.parametrize(
    ("urls", "sysids", "sentence"),
    [
        ([A, B, C], [1, 2], "3 --connect and 2 --sysid do not pair up"),
        ([A], [0], "--sysid 0: a vehicle's sysid is 1 to 255"),
        ([A, B], [255], "--sysid 256: a vehicle's sysid is 1 to 255"),
        ([A], [3, 3], "--sysid 3: given twice"),
    ],
)
def test_what_does_not_pair_up_is_one_sentence(
    urls: list[str], sysids: list[int], sentence: str
) -> None:
    with pytest.raises(SwarmError, match=sentence):
        pair_up(urls, sysids)
