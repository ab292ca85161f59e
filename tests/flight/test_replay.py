"""A flown mission, played back as the console does it."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from flight_log import Flight

from swarm_ctl.console.picture import Cursor
from swarm_ctl.console.player import Player
from swarm_ctl.console.replay import Replay
from swarm_ctl.record.truth import read_truth


class Clock:
    """A clock that a test winds."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def run(launch: Callable[..., Flight]) -> Path:
    flight = launch(duration_s=20.0)
    flight.fly_to_the_end()
    flight.arena.write_truth(flight.folder.path)
    flight.folder.close()
    return flight.folder.path


def test_a_replay_begins_on_the_ground_and_ends_with_everybody_landed(
    run: Path,
) -> None:
    replay = Replay.read(run)
    assert {one.phase for one in replay.at(0.0).vehicles.values()} == {"connecting"}
    assert {one.phase for one in replay.at(15.0).vehicles.values()} <= {"exploring", "avoiding"}
    assert {one.phase for one in replay.at(replay.duration_s).vehicles.values()} == {"done"}


def test_vehicles_are_where_the_referee_saw_them(run: Path) -> None:
    truth = read_truth(run)
    picture = Replay.read(run).at(1e9)
    for sysid, vehicle in picture.vehicles.items():
        assert vehicle.place_ned_m is not None
        expected = truth.arrays["track_ned_m"][-1][sysid - 1]
        assert vehicle.place_ned_m == pytest.approx(expected, abs=1e-3)


def test_playing_on_shows_the_same_as_jumping_there(run: Path) -> None:
    replay = Replay.read(run)
    played = replay.at(0.0)
    for tenth in range(1, 201):
        replay.advance(played, tenth / 10.0)
    assert whole(played.frame(Cursor())) == whole(replay.at(20.0).frame(Cursor()))


def test_the_seen_ground_grows_to_what_the_curve_says(run: Path) -> None:
    replay = Replay.read(run)
    early, late = replay.at(12.0), replay.at(replay.duration_s)
    assert 0 < early.seen < late.seen == len(replay.cells)
    shares = [share for _, share in replay.head["curve"]]
    assert shares == sorted(shares)


def test_a_player_keeps_time_by_its_speed_and_stops_at_the_end(run: Path) -> None:
    clock, replay = Clock(), Replay.read(run)
    player = Player(replay, clock)
    clock.now += 5.0
    assert player.picture().time_s == 0.0  # it was not told to play
    player.play(True)
    player.set_speed(2.0)
    clock.now += 3.0
    assert player.picture().time_s == pytest.approx(6.0)
    player.play(False)
    clock.now += 3.0
    assert player.picture().time_s == pytest.approx(6.0)
    player.seek(4.0)
    player.play(True)
    clock.now += 1e6
    assert player.picture().time_s == replay.duration_s
    assert player.state()["playing"] is False
    player.play(True)
    assert player.picture().time_s == 0.0


@pytest.mark.parametrize("nonsense", [None, "soon", float("nan"), float("inf"), [], -1.0])
def test_nonsense_from_a_browser_changes_nothing(run: Path, nonsense: object) -> None:
    player = Player(Replay.read(run), Clock())
    player.seek(nonsense)
    player.set_speed(nonsense)
    player.play(nonsense)
    assert (player.picture().time_s, player.state()["playing"]) == (0.0, False)


def whole(frame: dict[str, Any]) -> dict[str, Any]:
    """Leave out how the cells came to be in their order: those of one instant may swap."""
    return {**frame, "cells": sorted(zip(frame["cells"][::2], frame["cells"][1::2], strict=True))}


def test_without_a_referee_everybody_is_drawn_from_its_own_start(run: Path) -> None:
    shutil.rmtree(run / "truth")
    replay = Replay.read(run)
    starts = [one.place_ned_m for one in replay.at(0.0).vehicles.values()]
    assert all(place is not None and math.hypot(place.x, place.y) < 0.5 for place in starts)
    assert "each is drawn from its own start" in replay.head["note"]
    assert (replay.head["curve"], replay.at(replay.duration_s).seen) == ([], 0)
