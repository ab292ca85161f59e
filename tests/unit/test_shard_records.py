"""Shards of a run: who flies what, and their records as one."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from halls import write_hall
from typer.testing import CliRunner

from swarm_ctl.cli import app
from swarm_ctl.errors import MockError, SwarmError
from swarm_ctl.experiment.check import check_shards, take_shard
from swarm_ctl.flight import Faults, Shard, controllers_for
from swarm_ctl.mission import Mission, load_mission
from swarm_ctl.record.reader import Run
from swarm_ctl.record.report import write_report
from swarm_ctl.record.shards import join_records, join_shards
from swarm_ctl.record.summary import report_lines
from swarm_ctl.record.unrecorded import Unrecorded

TWO = "127.0.0.1:14700,127.0.0.1:14701"
NAN = math.nan


@pytest.fixture
def mission(tmp_path: Path) -> Callable[[int], Mission]:
    """Give a function that makes a mission of so many vehicles."""
    return lambda vehicles: load_mission(write_hall(tmp_path, {}), vehicles=vehicles)


# -- who flies what ------------------------------------------------------------------------------


def test_shards_of_one_network_share_its_sysids(mission: Callable[[int], Mission]) -> None:
    assert take_shard(mission(3), TWO, 1) == Shard(1, TWO, 6, 1, range(1, 4))
    assert take_shard(mission(3), TWO, 2) == Shard(2, TWO, 6, 1, range(4, 7))


def test_more_vehicles_than_a_network_has_are_groups(mission: Callable[[int], Mission]) -> None:
    assert take_shard(mission(250), TWO, 1) == Shard(1, TWO, 500, 1, range(1, 251), True)
    assert take_shard(mission(250), TWO, 2) == Shard(2, TWO, 500, 2, range(1, 251), True)
    check_shards(mission(250), 4)
    with pytest.raises(MockError, match="300 vehicles are 2 groups of at most 250"):
        check_shards(mission(100), 3)


@pytest.mark.parametrize(
    ("addresses", "number", "sentence"),
    [
        ("here", 1, r"--shards here: expected IP:PORT for each shard"),
        (TWO, None, r"--shard is missing: say which of the 2 --shards this one is"),
        (TWO, 3, r"--shard 3: say which of the 2 --shards this one is"),
    ],
)
def test_a_shard_that_is_none_is_one_sentence(
    mission: Callable[[int], Mission], addresses: str, number: int | None, sentence: str
) -> None:
    with pytest.raises(MockError, match=sentence):
        take_shard(mission(2), addresses, number)


def test_vehicles_of_two_groups_draw_numbers_of_their_own(
    mission: Callable[[int], Mission],
) -> None:
    chosen = mission(2)
    agents = [controllers_for(chosen, Unrecorded(), group=group)[0].agent for group in (1, 1, 2, 3)]
    plans = [
        agent._ask([0.0, 0.0, -1.5][: chosen.planner.dimensions], 0.0, [math.inf] * 6, [])
        for agent in agents
    ]
    first, again, *others = [tuple(plan.target_m) for plan in plans]
    assert first == again
    assert len({first, *others}) == 3


def test_a_fault_names_a_vehicle_of_its_shard() -> None:
    assert Faults.parse(["controller:5@2"], 3, first=4).controllers == ((2.0, 5),)
    with pytest.raises(Exception, match="there is no vehicle 3; they are 4 to 6"):
        Faults.parse(["controller:3@2"], 3, first=4)


# -- their records as one ------------------------------------------------------------------------

SUMMARY: dict[str, Any] = {
    **dict.fromkeys(("world", "seed", "planner", "autopilot", "mode"), "same"),
    **dict.fromkeys(("collisions", "messages_sent", "messages_received", "messages_lost"), 1),
    **dict.fromkeys(("datagrams_unsent", "datagrams_unheard", "mock_dropped"), 0),
    **dict.fromkeys(("duration_s", "exploration_s", "wall_s"), 10.0),
    **dict.fromkeys(("path_length_m", "energy_kwh"), 5.0),
    **dict.fromkeys(("setpoint_jitter_p99_ms", "setpoint_late_fraction", "mock_late_fraction"), 0),
    "vehicles": 1,
    "outcome": "flown",
    "min_separation_m": 2.0,
    "notes": [],
    "per_vehicle": [],
}


def shard(
    folder: Path,
    number: int,
    seen_s: list[float],
    *,
    times_s: list[float],
    found_s: float = NAN,
    free: tuple[bool, ...] = (True, True, True, False),
    **changes: Any,
) -> Path:
    """Write the record of a shard with one vehicle in a corridor of four cells, one unreachable."""
    path = folder / f"shard{number}"
    (path / "truth").mkdir(parents=True)
    (path / "summary.json").write_text(json.dumps({**SUMMARY, **changes}))
    volume = np.array([[free]])
    track = np.zeros((len(times_s), 1, 3))
    track[:, 0, 0] = 100.0 * number + np.array(times_s)
    np.savez(
        path / "truth" / "truth.npz",
        volume_seen_s=np.array([[seen_s]], dtype=np.float32),
        volume_free=volume,
        free=volume.any(axis=0),
        blocked=~volume.any(axis=0),
        cell_m=0.5,
        origin_ne_m=np.zeros(2),
        coverage_time_s=np.array(times_s),
        track_time_s=np.array(times_s),
        track_ned_m=track,
        sysids=np.array([number]),
        starts_ned_m=np.zeros((1, 3)),
        victims_ned_m=np.zeros((1, 3)),
        victim_found_s=np.array([found_s]),
    )
    (path / "truth" / "truth.json").write_text(json.dumps({"sight_radius_m": 1.0}))
    (path / "truth" / "world.json").write_text("{}")
    return path


def tell(path: Path, mission: Mission, sysid: int, done_s: float, **shard: int) -> Path:
    """Let a shard have written of its one vehicle what every run does."""
    started = {"mission": mission.dump(), "seed": 1, "mode": "udp", "faults": [], "versions": {}}
    started["shard"] = {"number": sysid, "of": 2, "group": 1} | shard
    started["started_utc"] = "2026-11-23T08:20:41+00:00"
    (path / "mission.json").write_text(json.dumps(started))
    phase = {"before": "landing", "after": "done", "reason": ""}
    done = {"event": "PhaseChanged", "time_s": done_s, "sysid": sysid, "data": phase}
    lines = [json.dumps(entry) for entry in ({"event": "RunStarted", "seed": 1}, done)]
    (path / "events.jsonl").write_text("\n".join(lines) + "\n")
    waypoints = [{"time_s": 1.0, "position_m": [0.0, 0.0, -1.0], "kind": "flown"}]
    (path / "paths.json").write_text(
        json.dumps({"vehicles": [{"sysid": sysid, "waypoints": waypoints}]})
    )
    vehicle = {"sysid": sysid, "phase": "done", "path_length_m": 5.0, "autopilot": "px4"}
    vehicle |= dict.fromkeys(("messages_sent", "messages_received", "messages_lost"), 1)
    summary = json.loads((path / "summary.json").read_text())
    (path / "summary.json").write_text(json.dumps({**summary, "per_vehicle": [vehicle]}))
    (path / "tlogs").mkdir()
    (path / "tlogs" / f"vehicle-{sysid:03d}.tlog").write_bytes(b"")
    return path


def test_the_folder_above_shards_is_a_run_folder_with_a_report(
    tmp_path: Path, mission: Callable[[int], Mission]
) -> None:
    seen: dict[str, Any] = {"seen_s": [1.0, NAN, NAN, NAN], "times_s": [0.0, 2.0]}
    parts = [
        tell(shard(tmp_path, number, **seen), mission(1), number, done_s)
        for number, done_s in ((1, 9.0), (2, 7.0))
    ]
    summary = join_shards(tmp_path, "corridor", parts)
    assert summary["notes"] == []
    run = Run.read(tmp_path)
    assert run.sysids == [1, 2]
    assert [entry.get("sysid") for entry in run.entries] == [None, 2, 1], "by their time"
    assert run.tlog(2) == parts[1] / "tlogs" / "vehicle-002.tlog"
    assert [vehicle["sysid"] for vehicle in run.summary["per_vehicle"]] == [1, 2]
    page = (tmp_path / "report.html").read_text()
    assert "2 shards" in page
    assert f"swarm-ctl run {tmp_path.name}/mission.json --shards 2" in page
    written = page.encode()
    (tmp_path / "report.html").unlink()
    assert write_report(tmp_path).read_bytes() == written, "as `swarm-ctl report` writes it"


def two_hosts(folder: Path, mission: Mission, **told: int) -> tuple[Path, Path]:
    """Write the records of two shards as they come from two hosts, under names of their own."""
    seen: dict[str, Any] = {"seen_s": [1.0, NAN, NAN, NAN], "times_s": [0.0, 2.0]}
    first = tell(shard(folder, 1, **seen), mission, 1, 9.0, **told)
    other = tell(shard(folder, 2, **seen), mission, 2, 7.0)
    return first.rename(folder / "zulu"), other.rename(folder / "alpha")


def test_records_of_several_hosts_are_joined_in_the_order_of_their_shards(
    tmp_path: Path, mission: Callable[[int], Mission]
) -> None:
    _, other = two_hosts(tmp_path, mission(1))
    for _ in range(2):  # a second time over what the first has written
        typed = CliRunner().invoke(app, ["join", str(tmp_path)])
        assert typed.exit_code == 0
        assert "✔ hall flown  2 vehicles" in typed.output
        summary = json.loads((tmp_path / "summary.json").read_text())
        assert [one["folder"] for one in summary["shards"]] == ["zulu", "alpha"]
        assert (summary["mission"], summary["outcome"], summary["vehicles"]) == ("hall", "flown", 2)
        run = Run.read(tmp_path)
        assert run.sysids == [1, 2]
        assert run.tlog(2) == other / "tlogs" / "vehicle-002.tlog"
        assert (run.started["shards"], "shard" in run.started) == (2, False)


def test_a_shard_whose_host_is_lost_is_missed(
    tmp_path: Path, mission: Callable[[int], Mission]
) -> None:
    first, _ = two_hosts(tmp_path, mission(1))
    shutil.rmtree(first)
    summary = join_records(tmp_path)
    assert summary["outcome"] == "failed"
    assert "shard 1 left no summary" in summary["notes"]


def test_groups_are_joined_under_the_name_of_the_whole(
    tmp_path: Path, mission: Callable[[int], Mission]
) -> None:
    seen: dict[str, Any] = {"seen_s": [1.0, NAN, NAN, NAN], "times_s": [0.0, 2.0]}
    for number in (1, 2):
        named = mission(1).model_copy(update={"name": f"hall-group{number}"})
        tell(shard(tmp_path, number, **seen), named, 1, 9.0, number=number, group=number)
    assert join_records(tmp_path)["mission"] == "hall"


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        ({"of": 3}, r"zulu: is of another mission than alpha"),
        ({"number": 2}, r"zulu: is shard 2, and so is alpha"),
    ],
)
def test_records_that_do_not_belong_together_are_one_sentence(
    tmp_path: Path, mission: Callable[[int], Mission], told: dict[str, int], sentence: str
) -> None:
    two_hosts(tmp_path, mission(1), **told)
    with pytest.raises(SwarmError, match=sentence):
        join_records(tmp_path)
    assert not (tmp_path / "summary.json").exists()


def test_a_folder_without_shards_is_one_sentence(
    tmp_path: Path, mission: Callable[[int], Mission]
) -> None:
    with pytest.raises(SwarmError, match="has no folder with the record of a shard; copy those"):
        join_records(tmp_path)
    first, other = two_hosts(tmp_path, mission(1))
    (first / "mission.json").write_text("{")  # cut short
    (other / "mission.json").write_text('{"shard": {"number": 2}}')
    with pytest.raises(SwarmError, match="its record is damaged or of another version"):
        join_records(tmp_path)


def test_groups_share_sysids_and_have_no_report_together(
    tmp_path: Path, mission: Callable[[int], Mission]
) -> None:
    seen: dict[str, Any] = {"seen_s": [1.0, NAN, NAN, NAN], "times_s": [0.0, 2.0]}
    parts = [tell(shard(tmp_path, number, **seen), mission(1), 1, 9.0) for number in (1, 2)]
    (note,) = join_shards(tmp_path, "corridor", parts)["notes"]
    assert note.startswith("no report.html: vehicles of several groups share sysids")
    (parts[1] / "summary.json").unlink()  # as of one that was killed
    *_, note = join_shards(tmp_path, "corridor", parts)["notes"]
    assert note.startswith("no report.html: vehicles of several groups share sysids")
    assert not (tmp_path / "mission.json").exists()


def test_what_shards_saw_is_seen_and_counts_once(tmp_path: Path) -> None:
    first = shard(tmp_path, 1, [1.0, 5.0, NAN, NAN], times_s=[0.0, 2.0, 4.0, 6.0])
    other = shard(
        tmp_path, 2, [3.0, 2.0, NAN, NAN], times_s=[0.0, 2.0], found_s=1.5, min_separation_m=0.9
    )
    summary = join_shards(tmp_path, "corridor", [first, other])
    assert summary == json.loads((tmp_path / "summary.json").read_text())
    assert (summary["mission"], summary["outcome"], summary["vehicles"]) == ("corridor", "flown", 2)
    assert summary["coverage_fraction"] == pytest.approx(2 / 3, abs=1e-6)
    assert (summary["victims_found"], summary["victims_total"]) == (1, 1)
    assert (summary["collisions"], summary["min_separation_m"]) == (2, 0.9)
    with np.load(tmp_path / "truth" / "truth.npz") as truth:
        assert truth["coverage_time_s"].tolist() == [0.0, 2.0, 4.0, 6.0]
        np.testing.assert_allclose(truth["coverage_fraction"], [0.0, 2 / 3, 2 / 3, 2 / 3])
        assert truth["track_ned_m"][:, :, 0].tolist() == [
            [100.0, 200.0],
            [102.0, 202.0],
            [104.0, 202.0],  # who has ended stays where it is
            [106.0, 202.0],
        ]
    assert report_lines(summary, tmp_path) is not None


def test_ground_counts_that_can_be_reached_from_the_starts_of_any_shard(tmp_path: Path) -> None:
    west = shard(tmp_path, 1, [1.0, NAN, NAN, NAN], times_s=[0.0], free=(True, True, False, False))
    east = shard(tmp_path, 2, [NAN, NAN, 2.0, NAN], times_s=[0.0], free=(False, False, True, True))
    assert join_shards(tmp_path, "corridor", [west, east])["coverage_fraction"] == 0.5
    with np.load(tmp_path / "truth" / "truth.npz") as truth:
        assert truth["free"].tolist() == [[True] * 4]


def test_a_shard_that_left_no_record_fails_the_run_and_is_named(tmp_path: Path) -> None:
    first = shard(tmp_path, 1, [1.0, NAN, NAN, NAN], times_s=[0.0, 2.0], notes=["a gust"])
    summary = join_shards(tmp_path, "corridor", [first, tmp_path / "shard2"])
    assert (summary["outcome"], summary["vehicles"]) == ("failed", 1)
    assert summary["notes"][:2] == ["shard 1: a gust", "shard 2 left no summary"]
    assert summary["coverage_fraction"] is None, "nobody knows what the other one saw"
    summary = join_shards(tmp_path, "corridor", [tmp_path / "shard2", first])
    assert [one["folder"] for one in summary["shards"]] == ["shard1"]


def test_one_interrupted_shard_is_an_interrupted_run(tmp_path: Path) -> None:
    parts = [
        shard(tmp_path, number, [NAN] * 4, times_s=[0.0], outcome=outcome)
        for number, outcome in enumerate(("flown", "interrupted"), start=1)
    ]
    assert join_shards(tmp_path, "corridor", parts)["outcome"] == "interrupted"
