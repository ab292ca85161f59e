"""When controllers in one process tick: never many at once."""

import asyncio
import gc
import itertools
from collections import Counter

import pytest

from swarm_ctl.controller import TICK_S
from swarm_ctl.run import fleet


@pytest.mark.parametrize("vehicles", [1, 3, 10, 24])
def test_a_few_vehicles_share_out_one_tick(vehicles: int) -> None:
    offsets = [fleet.offset(index, vehicles) for index in range(vehicles)]
    assert offsets == pytest.approx([TICK_S * index / vehicles for index in range(vehicles)])


@pytest.mark.parametrize("vehicles", [100, 250])
def test_what_many_do_once_a_second_is_spread_over_it(vehicles: int) -> None:
    offsets = [fleet.offset(index, vehicles) for index in range(vehicles)]
    assert max(offsets) < 10.0 * TICK_S
    phases = sorted(offset % TICK_S for offset in offsets)
    assert min(b - a for a, b in itertools.pairwise(phases)) > 0.9 * TICK_S / vehicles
    ticks = Counter(int(offset / TICK_S + 1e-9) for offset in offsets)
    assert max(ticks.values()) <= fleet.TOGETHER


def test_nothing_is_collected_on_its_own_while_vehicles_fly_and_again_afterwards() -> None:
    async def look() -> bool:
        async with asyncio.TaskGroup() as group:
            task = group.create_task(fleet._set_aside())
            await asyncio.sleep(0)
            was_enabled = gc.isenabled()
            task.cancel()
        return was_enabled

    assert not asyncio.run(look())
    assert gc.isenabled()
    gc.unfreeze()
