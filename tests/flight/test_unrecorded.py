"""Flights of which nothing is written down fly as any other."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from flight_log import Flight
from halls import write_hall

from swarm_ctl.agent.phases import Phase
from swarm_ctl.experiment.arena import Arena
from swarm_ctl.flight import Faults
from swarm_ctl.mission import load_mission
from swarm_ctl.model import Event
from swarm_ctl.record.unrecorded import Unrecorded

SECONDS, FAULTS = 40.0, ("controller:2@25", "radio-loss:1@20+5")


class Told:
    def __init__(self) -> None:
        self.names: list[str] = []

    def write(self, event: Event) -> None:
        self.names.append(event.name)


def fly(folder: Path, record: Unrecorded) -> Arena:
    mission = load_mission(write_hall(folder, {}))
    arena = Arena(mission, record, Faults.parse(FAULTS, mission.vehicles))
    arena.fly(until_s=SECONDS)
    return arena


def test_a_flight_is_the_same_whether_it_is_written_down_or_not(
    launch: Callable[..., Flight], tmp_path: Path
) -> None:
    recorded, other = launch(faults=FAULTS), Unrecorded(hashed=True)
    recorded.fly(SECONDS)
    unwritten = fly(tmp_path, other)
    lengths_m = [
        [controller.result().path_length_m for controller in arena.controllers]
        for arena in (recorded.arena, unwritten)
    ]
    assert lengths_m[0] == lengths_m[1] > [0.0]
    assert other.hash.hexdigest() == recorded.folder.hash.hexdigest()
    assert recorded.agent(2).phase is Phase.FAILED


def test_an_unrecorded_flight_opens_no_file_and_writes_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mission = load_mission(write_hall(tmp_path, {}))
    arena = Arena(mission, Unrecorded())
    monkeypatch.setattr(os, "open", lambda *_: pytest.fail("opened a file"))
    monkeypatch.setattr(Path, "open", lambda *_, **__: pytest.fail("opened a file"))
    arena.fly(until_s=20.0)
    assert arena.controllers[0].result().path_length_m > 0.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["hall.yaml", "world.yaml"]


def test_of_an_unrecorded_flight_nobody_keeps_what_was_to_be_written_down(tmp_path: Path) -> None:
    arena = fly(tmp_path, Unrecorded())
    assert arena.controllers[0].agent.trail.length_m() > 0.0
    assert [controller.agent.trail.fresh for controller in arena.controllers] == [None, None]
    told = arena.fleet.files()
    assert len(told["truth.npz"]["track_ned_m"]) == len(told["truth.npz"]["links"]) == 0
    assert told["truth.json"]["coverage_curve"] == []
    assert told["truth.json"]["coverage_fraction"] > 0.0


def test_facts_are_told_to_who_wants_them_and_no_hash_is_kept_unasked(tmp_path: Path) -> None:
    told = Told()
    record = Unrecorded(events=told)
    fly(tmp_path, record)
    assert "PhaseChanged" in told.names
    assert not record.hash.hexdigest()
