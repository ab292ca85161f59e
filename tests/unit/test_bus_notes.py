"""What is kept of a flight until a broker has taken it: events, and ground that was seen."""

from __future__ import annotations

import asyncio
import math
import re
from pathlib import Path

import pytest

from swarm_ctl import model
from swarm_ctl.bus.ground import SeenGround
from swarm_ctl.bus.journal import EventJournal
from swarm_ctl.bus.messages import Event
from swarm_ctl.bus.news import news
from swarm_ctl.explore.planner import PlannerParams
from swarm_ctl.model import Vec3

PACKAGE = Path(__file__).parents[2] / "swarm_ctl"
RUN = "2026-11-22T09:00:00+00:00"

# -- events --------------------------------------------------------------------------------------


def told(number: int) -> Event:
    return Event(RUN, 1, number, 0.0, "phase", "PhaseChanged", "exploring", {})


def take(journal: EventJournal, most: int = 1000) -> list[int]:
    """Take what is due, as a broker does; give its ids."""
    ids: list[int] = []
    while (event := journal.due()) is not None and len(ids) < most:
        journal.taken(event)
        ids.append(event.id)
    return ids


def test_events_are_told_in_order_and_once() -> None:
    journal = EventJournal()
    for number in (1, 2, 3):
        journal.add(told(number))
    assert take(journal) == [1, 2, 3]
    journal.add(told(4))
    assert take(journal) == [4]


def test_an_event_that_was_not_taken_is_due_again() -> None:
    journal = EventJournal()
    journal.add(told(1))
    assert journal.due() is journal.due()
    assert journal.waiting == 1


def test_a_broker_that_comes_back_is_told_the_news_first_and_then_all_it_may_have_forgotten() -> (
    None
):
    journal = EventJournal()
    for number in (1, 2, 3):
        journal.add(told(number))
    take(journal)
    journal.add(told(4))
    journal.begin()
    assert take(journal) == [4, 1, 2, 3]
    assert take(journal) == []


def test_news_that_come_while_all_is_told_again_come_first() -> None:
    journal = EventJournal()
    for number in (1, 2, 3):
        journal.add(told(number))
    take(journal)
    journal.begin()
    take(journal, most=1)
    journal.add(told(4))
    assert take(journal) == [4, 2, 3]


def test_what_no_broker_ever_took_is_counted_when_it_must_make_room() -> None:
    journal = EventJournal(most=3)
    for number in range(1, 6):
        journal.add(told(number))
    assert journal.lost == 2
    assert take(journal) == [3, 4, 5]
    assert journal.retire() is None


def test_what_a_broker_keeps_is_bounded_as_well() -> None:
    journal = EventJournal(most=3)
    for number in range(1, 4):
        journal.add(told(number))
    take(journal)
    journal.begin()
    for number in (4, 5):
        journal.add(told(number))
    assert journal.lost == 0
    assert [journal.retire(), journal.retire(), journal.retire()] == [1, 2, None]
    assert take(journal) == [4, 5, 3], "what was retired is not told again"


async def test_who_waits_for_something_to_tell_is_woken() -> None:
    journal = EventJournal()
    async with asyncio.timeout(5.0), asyncio.TaskGroup() as tasks:
        waiting = tasks.create_task(journal.stir())
        await asyncio.sleep(0)
        assert not waiting.done()
        journal.add(told(1))
    await journal.stir()


@pytest.mark.parametrize(
    ("event", "kind", "words"),
    [
        (("PhaseChanged", {"after": "holding", "reason": "low"}), "phase", "holding: low"),
        (("PhaseChanged", {"after": "exploring", "reason": ""}), "phase", "exploring"),
        (("PhaseChanged", {"after": "done", "reason": "landed"}), "done", "done: landed"),
        (("PhaseChanged", {"after": "failed", "reason": "it"}), "done", "failed: it"),
        (("VictimFound", {"victim": 4, "position_ned_m": []}), "victim", "victim 4 found"),
        (("PeerTooClose", {"distance_m": 0.41}), "contact", "a peer is only 0.41 m away"),
        (("OrderRefused", {"order": "land", "phase": "done"}), "order", "land refused: it is done"),
        (("StatusText", {"text": "battery low", "severity": 2}), "fault", "battery low"),
        (("LinkRegained", {}), "fault", "its autopilot is heard again"),
    ],
)
def test_an_event_is_a_sentence(
    event: tuple[str, dict[str, object]], kind: str, words: str
) -> None:
    told = news(model.Event(12.5, 3, *event), RUN, 7)
    assert told == Event(RUN, 3, 7, 12.5, kind, event[0], words, event[1])


@pytest.mark.parametrize(
    "event",
    [
        ("ContactsChanged", {"gained": [2], "lost": []}),
        ("StatusText", {"text": "all well", "severity": 6}),
        ("Connected", {"autopilot": "px4"}),
    ],
)
def test_what_is_no_news_is_left_to_the_record(event: tuple[str, dict[str, object]]) -> None:
    assert news(model.Event(12.5, 3, *event), RUN, 7) is None


def test_the_words_fit_what_agents_note() -> None:
    """Every event that is told is noted somewhere, with what its words need."""
    source = " ".join(path.read_text() for path in (PACKAGE / "agent").glob("*.py"))
    noted = dict(re.findall(r'\.note\(\s*"(\w+)"(.*?)\)\n', source, re.DOTALL))
    noted["VictimHeard"] += " told_by="
    for name, keywords in noted.items():
        data = dict.fromkeys(re.findall(r"(\w+)=", keywords), "x")
        news(model.Event(0.0, 1, name, {**data, "severity": 0}), RUN, 1)
    assert {"PhaseChanged", "VictimFound", "LinkLost", "OperatorOrder"} <= noted.keys()


# -- ground --------------------------------------------------------------------------------------

PARAMS = PlannerParams(kind="explore", dimensions=2, footprint_m=1.0)


def area_m2(rows: list[list[int]], cell_m: float) -> float:
    return sum(count for *_, count in rows) * cell_m**2


def cells(rows: list[list[int]]) -> set[tuple[int, int]]:
    return {(i, j + n) for i, j, count in rows for n in range(count)}


def test_a_straight_way_is_seen_as_wide_as_the_footprint() -> None:
    ground = SeenGround(PARAMS)
    for step in range(101):
        ground.fly_to(Vec3(0.1 * step, 0.0, -1.5))
    rows = ground.news()
    capsule_m2 = 10.0 * 2.0 + math.pi
    assert area_m2(rows, ground.cell_m) == pytest.approx(capsule_m2, rel=0.05)
    assert ground.cells * ground.cell_m**2 == pytest.approx(area_m2(rows, ground.cell_m))
    (north, east) = zip(*cells(rows), strict=True)
    assert (min(north) * ground.cell_m, (max(north) + 1) * ground.cell_m) == pytest.approx(
        (-1.0, 11.0), abs=0.21
    )
    assert (min(east), max(east)) == (-5, 4), "to both sides of the way, north is the first index"


def test_no_square_is_told_twice_and_all_that_was_told_can_be_told_again() -> None:
    ground, deltas = SeenGround(PARAMS), []
    for step in range(600):
        angle = 0.02 * step
        ground.fly_to(Vec3(0.3 * angle * math.cos(angle), 0.3 * angle * math.sin(angle), -1.5))
        if step % 20 == 0:
            deltas.append(cells(ground.news()))
    deltas.append(cells(ground.news()))
    assert sum(map(len, deltas)) == len(set[tuple[int, int]]().union(*deltas)) == ground.cells
    assert set[tuple[int, int]]().union(*deltas) == cells(ground.told())
    assert ground.news() == []


def test_the_way_across_a_jump_was_not_flown() -> None:
    ground = SeenGround(PARAMS)
    for north_m in (0.0, 0.2, 20.0, 20.2):
        ground.fly_to(Vec3(north_m, 0.0, -1.5))
    seen = cells(ground.news())
    assert (50, 0) not in seen
    assert {(0, 0), (100, 0)} <= seen
