"""A swarm whose contacts are known: four in a chain, cut in two from 10 s to 20 s."""

import json
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarm_ctl.model import ZERO
from swarm_ctl.record.contacts import (
    Change,
    ContactGraph,
    changes,
    contact_details,
    contact_figures,
    contact_graph,
    encounters,
)
from swarm_ctl.record.contacts_plot import company, contacts_figure
from swarm_ctl.record.journal import read_journal
from swarm_ctl.record.own_paths import draw_own_paths
from swarm_ctl.record.paths import PathRecorder, write_paths
from swarm_ctl.record.spread import Contacts, read_contacts, spread, spread_figures
from swarm_ctl.record.truth import Truth

CHAIN = [(1, 2), (2, 3), (3, 4)]
CUT = [(1, 2), (3, 4)]


def phase(time_s: float, sysid: int, after: str) -> dict[str, Any]:
    data = {"before": "takeoff", "after": after, "reason": ""}
    return {"event": "PhaseChanged", "time_s": time_s, "sysid": sysid, "data": data}


def victim(event: str, time_s: float, sysid: int, number: int) -> dict[str, Any]:
    return {"event": event, "time_s": time_s, "sysid": sysid, "data": {"victim": number}}


def hears(time_s: float, sysid: int, *gained: int, lost: tuple[int, ...] = ()) -> dict[str, Any]:
    data = {"gained": list(gained), "lost": list(lost)}
    return {"event": "ContactsChanged", "time_s": time_s, "sysid": sysid, "data": data}


FLOWN = [phase(0.0, sysid, "exploring") for sysid in (1, 2, 3, 4)]
SEEN = [
    victim("VictimFound", 5.2, 1, 0),
    victim("VictimHeard", 5.3, 2, 0),
    victim("VictimHeard", 5.6, 3, 0),
    victim("VictimHeard", 5.7, 4, 0),
    victim("VictimFound", 12.0, 1, 1),
    victim("VictimHeard", 12.3, 2, 1),
    victim("VictimHeard", 20.4, 3, 1),
    victim("VictimHeard", 20.8, 4, 1),
]


def sampled(*seconds: list[tuple[int, int]], vehicles: int = 4) -> Truth:
    """Give a referee's truth: who heard whom in each second."""
    pairs = list(zip(*(side.tolist() for side in np.triu_indices(vehicles, 1)), strict=True))
    bits = [[(a + 1, b + 1) in linked for a, b in pairs] for linked in seconds]
    arrays = {
        "links": np.packbits(np.array(bits, dtype=bool), axis=1),
        "coverage_time_s": np.arange(float(len(seconds))),
        "sysids": np.arange(1, vehicles + 1),
    }
    return Truth(arrays=arrays)


def graph_of(truth: Truth, entries: list[dict[str, Any]]) -> ContactGraph:
    graph = contact_graph(entries, truth)
    assert graph is not None
    return graph


@pytest.fixture
def parted() -> ContactGraph:
    return graph_of(sampled(*[CHAIN] * 10, *[CUT] * 10, *[CHAIN] * 10), FLOWN)


def test_the_swarm_splits_and_rejoins_when_it_did(parted: ContactGraph) -> None:
    assert changes(parted) == [
        Change(10.0, True, ((1, 2), (3, 4))),
        Change(20.0, False, ((1, 2), (3, 4))),
    ]


def test_the_figures_are_those_of_the_chain(parted: ContactGraph) -> None:
    assert contact_figures(parted) == {
        "links_mean": pytest.approx((20 * 3 + 10 * 2) / 30, abs=1e-3),
        "encounters": 4,
        "groups_mean": pytest.approx(40 / 30, abs=1e-3),
        "largest_group_fraction": pytest.approx((20 * 1.0 + 10 * 0.5) / 30, abs=1e-4),
        "together_fraction": pytest.approx(20 / 30, abs=1e-4),
        "splits": 1,
        "rejoins": 1,
        "alone_longest_s": 0.0,
    }
    assert encounters(parted)[1, 2] == encounters(parted)[2, 1] == 2, "2 and 3 met again"


def test_news_goes_to_all_who_were_connected_and_later_to_those_who_came_back(
    parted: ContactGraph,
) -> None:
    first, second = spread(parted, SEEN)
    assert (first["found_by"], first["connected"], first["connected_s"]) == (1, [2, 3, 4], 0.5)
    assert (second["connected"], second["connected_s"]) == ([2], 0.3)
    assert (second["reachable"], second["all_s"]) == ([2, 3, 4], 8.8)
    assert second["lags_s"] == pytest.approx({2: 0.3, 3: 0.4, 4: 0.8}), "3 and 4 since they met 2"
    assert spread_figures([first, second]) == {
        "victim_told_median_s": 0.4,
        "victim_told_max_s": 0.5,
        "victim_lag_median_s": 0.4,
        "victim_lag_max_s": 0.8,
        "victim_all_max_s": 8.8,
        "victim_untold": 0,
    }


def test_who_was_connected_and_never_heard_is_counted(parted: ContactGraph) -> None:
    news = spread(parted, SEEN[:3])
    assert news[0]["connected_s"] is None
    figures = spread_figures(news)
    assert figures["victim_untold"] == 1
    assert figures["victim_told_max_s"] is figures["victim_all_max_s"] is None
    assert figures["victim_lag_max_s"] == 0.4


def test_news_travels_by_a_chain_of_meetings_but_never_back_in_time() -> None:
    seconds = [[(3, 4)], [(3, 4)], [(1, 2)], [(1, 2)], [], [(2, 3)], [(2, 3)], [(1, 4)], []]
    graph = graph_of(sampled(*seconds), FLOWN)
    (news,) = spread(graph, [victim("VictimFound", 0.5, 1, 0)])
    assert news["connected"] == []
    assert news["reachable"] == [2, 3], "4 had met 3 before, and met 1 too shortly"
    assert spread_figures([news])["victim_untold"] == 2, "nobody told them"
    assert set(spread_figures([]).values()) == {None}


def test_a_finder_counts_once_however_many_saw_it_themselves(parted: ContactGraph) -> None:
    both = [victim("VictimFound", 15.0, 3, 0), victim("VictimFound", 12.0, 1, 0)]
    (news,) = spread(parted, both)
    assert (news["found_by"], news["found_s"]) == (1, 12.0)
    assert news["knew_after_s"] == {1: 0.0, 3: 3.0}


def test_who_has_landed_parts_nobody_and_is_not_alone() -> None:
    landed = [*FLOWN, phase(5.0, 4, "done"), phase(5.0, 1, "done")]
    graph = graph_of(sampled(*[CHAIN] * 5, *[[(2, 3)]] * 5), landed)
    assert changes(graph) == []
    assert contact_figures(graph)["together_fraction"] == 1.0
    assert graph.alone.sum() == 0


def test_a_relay_that_lands_parts_those_whom_it_joined() -> None:
    landed = [*FLOWN, phase(5.0, 2, "done")]
    graph = graph_of(sampled(*[CHAIN] * 8), landed)
    assert changes(graph) == [Change(5.0, True, ((1,), (3, 4)))]
    assert contact_figures(graph)["alone_longest_s"] == 3.0


def test_without_a_referee_the_vehicles_own_notes_tell() -> None:
    meetings = [
        hears(0.2, 1, 2),
        hears(0.3, 2, 1),
        hears(2.5, 3, 2),  # 2 hears nothing of 3: no contact
        hears(4.5, 2, lost=(1,)),
        hears(6.0, 1, 77, lost=(2,)),  # 77 is another computer's
    ]
    entries = [*FLOWN[:3], *meetings, phase(9.0, 1, "landing")]
    graph = graph_of(Truth(), entries)
    assert graph.sysids == [1, 2, 3]
    assert graph.times_s[-1] == 9.0
    assert graph.link_counts.tolist() == [0, 1, 1, 1, 1, 0, 0, 0, 0, 0]


def test_nobody_knows_the_contacts_of_a_run_whose_referee_was_of_another_build() -> None:
    assert contact_graph(FLOWN, Truth(arrays={"track_ned_m": np.zeros((1, 4, 3))})) is None
    assert contact_graph([], sampled(CHAIN)) is None


def test_one_vehicle_alone_has_no_contacts_to_speak_of() -> None:
    graph = graph_of(sampled([], [], vehicles=1), FLOWN[:1])
    assert set(contact_figures(graph).values()) == {None}


def test_a_big_swarm_s_groups_are_its_components() -> None:
    generator, vehicles = np.random.default_rng(1), 40
    pairs = [
        [(a, b) for a in range(1, 41) for b in range(a + 1, 41) if generator.random() < 0.03]
        for _ in range(70)
    ]
    flown = [phase(0.0, sysid, "exploring") for sysid in range(1, vehicles + 1)]
    graph = graph_of(sampled(*pairs, vehicles=vehicles), flown)
    for groups, linked in zip(graph.groups, pairs, strict=True):
        told = list(range(vehicles))
        for _ in range(vehicles):
            for a, b in linked:
                told[a - 1] = told[b - 1] = min(told[a - 1], told[b - 1])
        assert groups.tolist() == told


def test_the_details_are_written_beside_the_summary(tmp_path: Path) -> None:
    events = "".join(json.dumps(line) + "\n" for line in [{"event": "RunStarted"}, *FLOWN, *SEEN])
    (tmp_path / "events.jsonl").write_text(events)
    (tmp_path / "truth").mkdir()
    truth = sampled(*[CHAIN] * 10, *[CUT] * 10, *[CHAIN] * 10)
    np.savez(tmp_path / "truth" / "truth.npz", **truth.arrays)  # type: ignore[arg-type]
    assert len(read_journal(tmp_path / "events.jsonl")) == 13
    contacts = read_contacts(tmp_path)
    assert contacts is not None
    contacts.write(tmp_path / "contacts.json")
    told = json.loads((tmp_path / "contacts.json").read_text())
    assert told["changes"][0] == {"time_s": 10.0, "kind": "split", "parts": [[1, 2], [3, 4]]}
    assert told["pairs"][1] == {"sysids": [2, 3], "encounters": 2, "together_s": 20.0}
    assert told["groups"] == [1] * 10 + [2] * 10 + [1] * 10
    assert [one["victim"] for one in told["victims"]] == [0, 1]
    assert told["victims"][0]["knew_after_s"]["4"] == 0.5
    assert contact_details(contacts.graph)["vehicles"][0]["flown_s"] == 30.0


def test_a_folder_without_events_has_no_contacts(tmp_path: Path) -> None:
    assert read_contacts(tmp_path) is None


# -- the picture -----------------------------------------------------------------------------------

SUMMARY = {"mission": "search", "vehicles": 4, "planner": "explore", "seed": 1, "duration_s": 30.0}


def test_the_picture_shows_each_one_s_company_and_when_it_learnt(parted: ContactGraph) -> None:
    sizes = company(parted)
    assert (sizes[:10] == 4).all()
    assert (sizes[10:20] == 2).all()
    contacts = Contacts(parted, spread(parted, SEEN))
    figure = contacts_figure(contacts, SUMMARY, Truth())
    lanes, groups = figure.axes[:2]
    assert lanes.get_ylabel() == "vehicle"
    assert groups.get_ylabel().startswith("groups")
    learnt, found = (np.asarray(line.get_xydata()) for line in lanes.lines)
    assert found[:, 0].tolist() == [5.2, 12.0]
    assert sorted(learnt[:, 0].tolist()) == pytest.approx([5.3, 5.6, 5.7, 12.3, 20.4, 20.8])
    assert "2 3 4" in [text.get_text() for text in lanes.texts], "with whom 1 was"


@pytest.mark.parametrize("vehicles", [2, 10, 50])
def test_the_picture_is_drawn_for_few_and_for_many(tmp_path: Path, vehicles: int) -> None:
    pairs = [(sysid, sysid + 1) for sysid in range(1, vehicles)]
    flown = [phase(float(sysid), sysid, "exploring") for sysid in range(1, vehicles + 1)]
    truth = sampled(*[pairs[: second % vehicles] for second in range(60)], vehicles=vehicles)
    graph = graph_of(truth, flown)
    figure = contacts_figure(Contacts(graph, spread(graph, SEEN)), SUMMARY, truth)
    figure.savefig(tmp_path / "contacts.png")
    assert (tmp_path / "contacts.png").stat().st_size > 20_000


def test_real_vehicles_have_a_picture_of_their_contacts(tmp_path: Path) -> None:
    met = [hears(0.2, 1, 2), hears(0.3, 2, 1), phase(9.0, 1, "landing")]
    events = "".join(json.dumps(line) + "\n" for line in [*FLOWN[:2], *met])
    (tmp_path / "events.jsonl").write_text(events)
    path = PathRecorder(1)
    path.visited(0.0, ZERO, ())
    deque(write_paths(tmp_path / "paths.json", [path]))
    contacts = read_contacts(tmp_path)
    assert draw_own_paths(tmp_path, SUMMARY, {}, contacts) == []
    assert (tmp_path / "contacts.png").stat().st_size > 20_000
