"""When the mock writes the truth down while its fleet flies."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from mock_vehicle.fleet import Fleet
from mock_vehicle.keeper import EVERY, PART, Keeper
from mock_vehicle.server import Server


def test_the_longer_the_flight_the_seldomer_all_of_it_is_written_again(tmp_path: Path) -> None:
    written: list[int] = []
    looks: list[None] = []

    def files(**_: Any) -> dict[str, Any]:
        written.append(len(looks))
        return {"truth.json": {"looks": len(looks)}}

    referee = SimpleNamespace(write_world=lambda _: None)
    fleet = cast("Fleet", SimpleNamespace(files=files, referee=referee))
    server = cast("Server", SimpleNamespace(pace=dict))

    async def fly() -> None:
        keeper = Keeper(fleet, server, tmp_path)
        while len(looks) < 3600:
            looks.append(None)
            keeper.look()
            if keeper._writing:
                await keeper._writing
        await keeper.close()

    asyncio.run(fly())
    gaps = [after - before for before, after in pairwise([0, *written[:-1]])]
    assert set(gaps[:PART]) == {EVERY}, "what is short is written often"
    assert gaps == sorted(gaps)
    assert max(gaps) <= 3600 / PART
    assert len(written) < 120
    assert (tmp_path / "truth.json").read_text() == '{"looks": 3600}'
