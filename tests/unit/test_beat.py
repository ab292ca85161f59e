"""When controllers in one process tick: never many at once."""

from __future__ import annotations

import asyncio
import gc
import itertools
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest

from swarm_ctl.agent.agent import Agent
from swarm_ctl.controller import TICK_S, Clock
from swarm_ctl.flight import controllers_for
from swarm_ctl.link import Link, Source
from swarm_ctl.link.base import Heard
from swarm_ctl.mission import load_mission
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.record.unrecorded import Unrecorded
from swarm_ctl.run import fleet

MISSION = Path(__file__).parents[2] / "missions" / "open_3d.yaml"


class Hand(Clock):
    """A clock that stands still but while somebody sleeps."""

    def __init__(self) -> None:
        super().__init__()
        self.time_s = 0.0
        self.naps = 0

    def now(self) -> float:
        return self.time_s

    async def sleep_until(self, moment_s: float) -> None:
        self.naps += 1
        self.time_s = max(self.time_s, moment_s)
        await asyncio.sleep(0.0)


class Wire(Link):
    """A link that remembers what was sent, and whether it is open."""

    url = ""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.is_open = False

    def watch(self, heard: Heard) -> None:  # noqa: ARG002 - nobody speaks
        self.is_open = True

    def send(self, data: bytes, to: Source | None = None) -> bool:  # noqa: ARG002
        self.sent.append(data)
        return True

    def reach(self, to: Source | None = None) -> str:  # noqa: ARG002
        return ""

    def close(self) -> None:
        self.is_open = False


class Crowd(fleet.Fleet):
    """Vehicles on a clock of our own that note when they tick, until so much time has passed."""

    def __init__(self, vehicles: int, monkeypatch: pytest.MonkeyPatch) -> None:
        folder = Unrecorded()
        mission = load_mission(MISSION, vehicles=vehicles)
        super().__init__(controllers_for(mission, folder), cast("RunFolder", folder), speed=1.0)
        self.clock = self.hand = Hand()
        self.wires = [Wire() for _ in self.controllers]
        self.ticks: list[tuple[float, int]] = []
        """Time and index."""
        self.until_s = 1.0
        for controller in self.controllers:
            monkeypatch.setattr(controller, "tick", self._noting(controller.index))

    def _noting(self, index: int) -> Callable[[float], bytes]:
        def tick(now: float) -> bytes:
            self.ticks.append((now, index))
            self.count(now)
            if now > self.until_s:
                self.controllers[index].kill("it is over", now)
            return b"setpoint"

        return tick

    def count(self, now: float) -> None:
        """Take note of a tick."""

    def run(self) -> None:
        asyncio.run(self._fly_all(self.wires))


def test_who_is_due_soon_has_a_turn_with_who_is_due_now(monkeypatch: pytest.MonkeyPatch) -> None:
    crowd = Crowd(100, monkeypatch)
    crowd.run()
    assert crowd.hand.naps < 0.6 * len(crowd.ticks)
    for index in (0, 42, 99):
        times = [now for now, who in crowd.ticks if who == index]
        due = [fleet.offset(index, 100) + TICK_S * number for number in range(len(times))]
        assert times == pytest.approx(due, abs=fleet.SOON_S + 1e-9)
    assert not any(wire.is_open for wire in crowd.wires)


def test_what_was_decided_together_is_sent_together(monkeypatch: pytest.MonkeyPatch) -> None:
    crowd = Crowd(100, monkeypatch)
    order: list[str] = []
    monkeypatch.setattr(crowd, "count", lambda _: order.append("decided"))

    def send(_: Wire, data: bytes) -> bool:
        order.append("sent")
        return bool(data)

    monkeypatch.setattr(Wire, "send", send)
    crowd.run()
    runs = [(word, len(list(words))) for word, words in itertools.groupby(order)]
    assert [size for word, size in runs if word == "decided"] == [
        size for word, size in runs if word == "sent"
    ]
    assert len(runs) < 0.6 * len(order)
    assert all(size <= fleet.MOST_TURNS for _, size in runs)


def test_after_a_hold_up_who_has_waited_longest_is_first_and_others_are_heard_in_between(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    crowd = Crowd(100, monkeypatch)
    one, naps = crowd.controllers[0], Counter[int]()
    tick = one.tick

    def hold_up(now: float) -> bytes:
        if 0.49 < now < 0.51:
            crowd.hand.time_s = 0.57
        return tick(now)

    monkeypatch.setattr(one, "tick", hold_up)
    monkeypatch.setattr(crowd, "count", lambda now: naps.update([crowd.hand.naps] * (now == 0.57)))
    crowd.run()
    late = [index for now, index in crowd.ticks if now == 0.57]
    assert late == list(range(late[0], late[0] + len(late)))
    assert len(late) == naps.total() > 60
    assert max(naps.values()) <= fleet.MOST_TURNS


def test_what_breaks_in_one_vehicle_stays_with_it_and_is_its_last_word(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    crowd = Crowd(4, monkeypatch)
    told: list[tuple[int, bool]] = []

    def breaks(*_: object) -> bytes:
        raise TypeError("no idea")

    def tell(agent: Agent, _: str) -> None:
        told.append((agent.sysid, agent.is_ended))
        if agent.sysid == 3 and agent.is_ended:
            raise OSError("nobody listens")

    crowd.tell = tell
    monkeypatch.setattr(crowd.controllers[1], "tick", breaks)
    monkeypatch.setattr(crowd.controllers[1].agent, "standstill", lambda: b"stand still")
    monkeypatch.setattr(crowd.wires[3], "watch", breaks)
    crowd.run()
    broken = "its controller broke: TypeError: no idea"
    troubles = [controller.agent.trouble for controller in crowd.controllers]
    assert troubles == ["it is over", broken, "it is over", broken]
    assert crowd.wires[1].sent == [b"stand still"]
    assert crowd.wires[3].sent == []
    assert [one for one in told if one[0] in {2, 4}] == [(2, True), (4, True)]
    assert len([now for now, index in crowd.ticks if index == 2]) >= 10
    assert not crowd.wires[1].is_open


def test_whose_mission_ends_is_heard_no_more_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    crowd = Crowd(2, monkeypatch)
    closed: list[float] = []
    monkeypatch.setattr(crowd.wires[0], "close", lambda: closed.append(crowd.hand.time_s))
    crowd.run()
    assert closed == [max(now for now, index in crowd.ticks if index == 0)]


def test_whoever_still_flies_when_all_is_called_off_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    crowd = Crowd(3, monkeypatch)

    async def call_off() -> None:
        async with asyncio.TaskGroup() as group:
            flying = group.create_task(crowd._fly_all(crowd.wires))
            for _ in range(7):
                await asyncio.sleep(0.0)
            assert crowd.ticks
            assert all(wire.is_open for wire in crowd.wires)
            flying.cancel()

    asyncio.run(call_off())
    assert not any(wire.is_open for wire in crowd.wires)


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
