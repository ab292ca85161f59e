from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from swarm_ctl.controller import WAITING_MAX, Clock, Controller, fly
from swarm_ctl.flight import controllers_for
from swarm_ctl.link import Link, Source
from swarm_ctl.link.base import Heard
from swarm_ctl.mission import load_mission
from swarm_ctl.record.unrecorded import Unrecorded

MISSION = Path(__file__).parents[2] / "missions" / "open_3d.yaml"


def controller() -> Controller:
    (one,) = controllers_for(load_mission(MISSION, vehicles=1), Unrecorded())
    return one


def test_ticks_in_time_miss_no_deadline() -> None:
    one = controller()
    assert [one.keep_time(late_s) for late_s in (0.0, 0.0004, -0.001, 0.019)] == [0, 0, 0, 0]
    assert (one.ticks_due, one.ticks_late) == (4, 0)


def test_a_late_tick_has_missed_its_deadline_and_so_have_those_left_out() -> None:
    one = controller()
    assert [one.keep_time(late_s) for late_s in (0.03, 0.35)] == [0, 3]
    assert (one.ticks_due, one.ticks_late) == (5, 5)
    assert (one.result().ticks_due, one.result().ticks_late) == (5, 5)


class Flood(Link):
    """A link on which very much arrives before the first tick."""

    url = ""

    def watch(self, heard: Heard) -> None:
        for number in range(WAITING_MAX + 3):
            heard(str(number).encode(), ("127.0.0.1", 14550))

    def send(self, data: bytes, to: Source | None = None) -> bool:  # noqa: ARG002
        return True

    def reach(self, to: Source | None = None) -> str:  # noqa: ARG002
        return ""

    def close(self) -> None:
        pass


def test_of_what_waits_for_a_tick_the_oldest_beyond_a_bound_are_dropped_and_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one, read = controller(), list[bytes]()
    monkeypatch.setattr(one, "receive", lambda data, _: read.append(data))

    async def one_tick() -> None:
        ticked = asyncio.Event()
        async with asyncio.TaskGroup() as tasks:
            flight = fly(one, Flood(), Clock(), tell=lambda *_: ticked.set())
            flying = tasks.create_task(flight)
            await ticked.wait()
            flying.cancel()

    asyncio.run(one_tick())
    assert read == [str(number).encode() for number in range(3, WAITING_MAX + 3)]
    assert one.unheard == one.result().unheard == 3
