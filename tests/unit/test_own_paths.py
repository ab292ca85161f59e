"""The record of real vehicles, who have no referee: what they knew, and pictures of that."""

from __future__ import annotations

import io
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from swarm_ctl.model import Vec3
from swarm_ctl.record.own_paths import draw_own_paths, own_paths_figure, read_flown
from swarm_ctl.record.paths import PathRecorder, write_paths
from swarm_ctl.record.summary import VehicleResult, report_lines, summarise

MISSION: dict[str, Any] = {
    "name": "search",
    "world": None,
    "vehicles": 2,
    "autopilot": "mixed",
    "duration_s": 60.0,
    "planner": {"kind": "lf-pso"},
    "seed": 7,
}
RESULTS = [
    VehicleResult(4, "done", "", victims=[1, 3], explored_from_s=5.0, path_length_m=5.0),
    VehicleResult(5, "done", "", victims=[3], explored_from_s=6.0, path_length_m=2.5),
]


def flown(run: Path, *paths: list[Vec3]) -> None:
    recorders = [PathRecorder(4 + index) for index in range(len(paths))]
    for recorder, path in zip(recorders, paths, strict=True):
        for second, place in enumerate(path):
            recorder.visited(float(second), place, ())
        recorder.target(9.0, Vec3(100.0, 100.0, 0.0))
    deque(write_paths(run / "paths.json", recorders))


def summary(run: Path) -> dict[str, Any]:
    return summarise(
        run,
        mission=MISSION,
        mode="fly",
        outcome="flown",
        time_s=90.0,
        wall_s=90.0,
        results=RESULTS,
        run_sha256="",
    )


def test_only_what_the_vehicles_know_is_told(tmp_path: Path) -> None:
    told = summary(tmp_path)
    assert (told["victims_found"], told["victims_total"]) == (2, None), "1 and 3, one of them twice"
    assert (told["path_length_m"], told["coverage_fraction"], told["notes"]) == (7.5, None, [])
    console = Console(width=80, file=io.StringIO())
    with console.capture() as capture:
        console.print(report_lines(told))
    page = capture.get()
    assert "2 seen" in page
    assert "8 m in all" in page
    assert "explored" not in page
    assert "contacts" not in page
    assert "unknown" not in page


def test_a_path_is_as_long_as_its_legs() -> None:
    path = PathRecorder(1)
    for second, place in enumerate([Vec3(0, 0, 0), Vec3(3, 4, 0), Vec3(3, 4, -2)]):
        path.visited(float(second), place, ())
    assert path.length_m == pytest.approx(7.0)


def test_each_vehicle_has_a_panel_to_the_same_scale(tmp_path: Path) -> None:
    east = [Vec3(0.0, 0.0, -1.5), Vec3(0.0, 8.0, -1.5)]
    flown(tmp_path, east, [])
    paths = read_flown(tmp_path)
    assert paths == {4: [(0.0, 0.0), (8.0, 0.0)], 5: []}, "east first; targets are not flown"
    figure = own_paths_figure(paths, {4: [(1.0, 2.0)]}, summary(tmp_path))
    first, second = figure.axes
    assert first.get_xlim() == second.get_xlim() == pytest.approx((-8.8, 8.8))
    assert np.array_equal(first.lines[0].get_xydata(), [[0.0, 0.0], [8.0, 0.0]])
    assert [text.get_text() for text in second.texts] == ["did not fly"]
    seen = {4: {1: Vec3(2.0, 1.0, 0.0)}, 5: {}}
    assert draw_own_paths(tmp_path, summary(tmp_path), seen) == []
    assert (tmp_path / "paths.png").stat().st_size > 10_000


def test_where_nothing_was_flown_there_is_no_picture(tmp_path: Path) -> None:
    deque(write_paths(tmp_path / "paths.json", []))
    assert draw_own_paths(tmp_path, summary(tmp_path), {}) == ["no pictures: nothing was flown"]
    assert not (tmp_path / "paths.png").exists()
