"""What a run leaves behind can be read: by pymavlink, by a person, after a kill."""

from __future__ import annotations

import builtins
import json
import math
import re
from collections import deque
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from pymavlink import mavutil  # noqa: TID251 - the reader our logs are written for
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rich.console import Console

from swarm_ctl.errors import SwarmError
from swarm_ctl.model import Event, Vec3
from swarm_ctl.record.folder import RunFolder, RunHash
from swarm_ctl.record.journal import read_journal
from swarm_ctl.record.paths import PathRecorder, write_paths
from swarm_ctl.record.plots import draw_pictures
from swarm_ctl.record.summary import VehicleResult, report_lines, summarise, write_summary
from swarm_ctl.record.tlog import EPOCH_S, TlogWriter

UTC_NOON = datetime(2025, 3, 4, 12, 0, 5, tzinfo=UTC)
RESOLVED: dict[str, Any] = {
    "name": "search",
    "world": "/worlds/office.yaml",
    "vehicles": 3,
    "autopilot": "px4",
    "duration_s": 60.0,
    "planner": {"kind": "lf-pso"},
    "seed": 7,
}


def frame(seq: int = 0, sysid: int = 1) -> bytes:
    link = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)
    link.seq = seq
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 81, seq, 4, 3)
    return bytes(heartbeat.pack(link))


Make = Callable[..., RunFolder]


@pytest.fixture
def make() -> Iterator[Make]:
    """Make run folders; what a test leaves open, as a killed run would, is closed behind it."""
    folders = []

    def create(out: Path | None, mode: Literal["udp", "virtual"] = "virtual") -> RunFolder:
        folder = RunFolder.create(out, "search", RESOLVED, seed=7, mode=mode, utc=UTC_NOON)
        folders.append(folder)
        return folder

    yield create
    for folder in folders:
        folder.close()


# -- folder ----------------------------------------------------------------------------------------


def test_a_run_folder_says_at_once_how_to_repeat_the_run(make: Make, tmp_path: Path) -> None:
    make(tmp_path / "run")  # killed: never closed
    started = json.loads((tmp_path / "run" / "mission.json").read_text())
    assert started["mission"] == RESOLVED
    assert (started["seed"], started["mode"]) == (7, "virtual")
    assert set(started["versions"]) == {"swarm_ctl", "python", "numpy", "pymavlink"}


def test_without_a_name_the_folder_is_called_after_mission_and_time(
    make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert make(None).path == tmp_path / "runs/search-20250304T120005Z"
    assert make(None).path == tmp_path / "runs/search-20250304T120005Z-2", "two within one second"


def test_a_folder_that_holds_something_is_left_alone(make: Make, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(SwarmError, match="holds files already; name a new or an empty folder"):
        make(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_file_cannot_be_the_run_folder(make: Make, tmp_path: Path) -> None:
    (tmp_path / "run").touch()
    with pytest.raises(SwarmError, match="cannot be the run folder: this is a file"):
        make(tmp_path / "run")


def test_the_hash_tells_direction_vehicle_and_where_a_datagram_ends() -> None:
    runs = [
        [(0, False, b"ab")],
        [(0, True, b"ab")],
        [(1, False, b"ab")],
        [(0, False, b"a"), (0, False, b"b")],
        [(0, False, b"ab"), (0, False, b"")],
    ]
    digests = set()
    for run in runs:
        one, other = RunHash(), RunHash()
        for datagram in run:
            one.frame(*datagram)
            other.frame(*datagram)
        assert one.hexdigest() == other.hexdigest()
        digests.add(one.hexdigest())
    assert len(digests) == len(runs)


def test_two_virtual_runs_leave_the_same_bytes(make: Make, tmp_path: Path) -> None:
    for name in ("one", "two"):
        with make(tmp_path / name) as run:
            run.tlog(1).write(frame(), 1.0)
            run.journal.write(Event(1.0, 1, "VictimFound", {"victim": 2}))
            run.waypoints(1).visited(1.0, Vec3(0.0, 0.0, -1.5), (2,))
    for file in ("tlogs/vehicle-001.tlog", "events.jsonl", "paths.json"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


# -- telemetry log ---------------------------------------------------------------------------------


def read_tlog(path: Path) -> list[tuple[float, str, int]]:
    open_log: Callable[[str], Any] = mavutil.mavlink_connection
    log = open_log(str(path))
    messages = []
    while (message := log.recv_match()) is not None:
        messages.append((message._timestamp, message.get_type(), message.custom_mode))
    log.close()
    return messages


def test_pymavlink_reads_every_frame_of_a_datagram_at_its_time(make: Make, tmp_path: Path) -> None:
    with make(tmp_path / "run") as run:
        log = run.tlog(3)
        log.write(frame(1) + frame(2), 0.5)
        log.write(frame(3), 12.25)
        assert run.tlog(3) is log
    assert read_tlog(tmp_path / "run" / "tlogs" / "vehicle-003.tlog") == [
        (EPOCH_S + 0.5, "HEARTBEAT", 1),
        (EPOCH_S + 0.5, "HEARTBEAT", 2),
        (EPOCH_S + 12.25, "HEARTBEAT", 3),
    ]


def test_torn_bytes_do_not_spoil_the_log(tmp_path: Path) -> None:
    log = TlogWriter(tmp_path / "a.tlog")
    log.write(b"\x00noise" + frame(1) + frame(2)[:-3], 1.0)
    log.write(frame(3), 2.0)
    log.close()
    assert [mode for _, _, mode in read_tlog(tmp_path / "a.tlog")] == [1, 3]


def test_a_log_of_real_time_is_stamped_with_real_time(make: Make, tmp_path: Path) -> None:
    with make(tmp_path / "run", mode="udp") as run:
        run.tlog(1).write(frame(), 0.5)
    ((stamp, _, _),) = read_tlog(tmp_path / "run" / "tlogs" / "vehicle-001.tlog")
    assert stamp == pytest.approx(UTC_NOON.timestamp() + 0.5)


def test_a_kill_loses_two_seconds_of_telemetry_at_most(make: Make, tmp_path: Path) -> None:
    log = make(tmp_path / "run").tlog(1)
    for tick in range(100):
        log.write(frame(tick), tick / 10)
    size = (tmp_path / "run" / "tlogs" / "vehicle-001.tlog").stat().st_size
    assert size >= 79 * (8 + len(frame()))


# -- journal ---------------------------------------------------------------------------------------


def test_the_first_line_of_the_journal_holds_the_seed(make: Make, tmp_path: Path) -> None:
    run = make(tmp_path / "run")
    first = read_journal(run.path / "events.jsonl")[0]
    assert (first["event"], first["seed"], first["mission"]) == ("RunStarted", 7, "search")


def test_every_event_is_on_the_disk_when_it_happened(make: Make, tmp_path: Path) -> None:
    run = make(tmp_path / "run")
    run.journal.write(Event(3.2, 2, "PhaseChanged", {"after": "exploring"}))
    assert read_journal(run.path / "events.jsonl")[1] == {
        "event": "PhaseChanged",
        "time_s": 3.2,
        "sysid": 2,
        "data": {"after": "exploring"},
    }


def test_a_journal_is_readable_after_a_kill_in_mid_line(make: Make, tmp_path: Path) -> None:
    run = make(tmp_path / "run")
    for sysid in (1, 2, 3):
        run.journal.write(Event(1.0, sysid, "LinkLost"))
    path = run.path / "events.jsonl"
    path.write_bytes(path.read_bytes()[:-9])
    assert [entry.get("sysid") for entry in read_journal(path)] == [None, 1, 2]


def test_a_journal_broken_in_the_middle_is_not_hidden(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    path.write_text('{"event": "RunStarted"}\n{"eve\n{"event": "LinkLost"}\n')
    with pytest.raises(SwarmError, match=r"events\.jsonl: line 2 is not JSON"):
        read_journal(path)


# -- paths -----------------------------------------------------------------------------------------


def test_a_target_is_unexplored_until_the_vehicle_flies_by() -> None:
    path = PathRecorder(4)
    path.visited(0.0, Vec3(0.0, 0.0, -1.5), ())
    path.target(0.1, Vec3(2.5, 0.4, -1.5))  # beside the way between two fixes
    path.target(0.2, Vec3(0.0, 9.0, -1.5))
    path.visited(1.0, Vec3(2.0, 0.0, -1.5), (5, 6))
    assert path.encoded()["waypoints"][1]["status"] == "unexplored"
    path.visited(2.0, Vec3(3.0, 0.0, -1.5), ())
    encoded = path.encoded()
    assert (encoded["sysid"], encoded["frame"]) == (4, "local NED, origin at its own start")
    statuses = [one["status"] for one in encoded["waypoints"]]
    assert statuses == ["visited", "visited", "unexplored", "visited", "visited"]
    assert [one["next"] for one in encoded["waypoints"]] == [3, 4, None, 4, None]
    assert encoded["waypoints"][3] == {
        "time_s": 1.0,
        "position_m": [2.0, 0.0, -1.5],
        "next": 4,
        "peers": [5, 6],
        "status": "visited",
        "kind": "flown",
    }


def test_half_a_metre_counts_as_passing_and_more_does_not() -> None:
    path = PathRecorder(1)
    path.visited(0.0, Vec3(0.0, 0.0, 0.0), ())
    path.target(0.0, Vec3(1.0, 0.5, 0.0))
    path.target(0.0, Vec3(1.0, 0.51, 0.0))
    path.visited(1.0, Vec3(2.0, 0.0, 0.0), ())
    statuses = [one["status"] for one in path.encoded()["waypoints"]]
    assert statuses == ["visited", "visited", "unexplored", "visited"]


def test_half_a_metre_beside_either_end_of_a_leg_counts_as_passing() -> None:
    path = PathRecorder(1)
    path.visited(0.0, Vec3(0.0, 0.0, 0.0), ())
    path.target(0.0, Vec3(4.0, 30.0, 0.0))
    path.target(0.0, Vec3(-0.5, 0.0, 0.0))
    path.target(0.0, Vec3(8.5, 0.0, 0.0))
    path.visited(1.0, Vec3(8.0, 0.0, 0.0), ())
    statuses = [one["status"] for one in path.encoded()["waypoints"]]
    assert statuses == ["visited", "unexplored", "visited", "visited", "visited"]


def test_paths_are_written_as_the_run_goes_and_at_the_end(make: Make, tmp_path: Path) -> None:
    run = make(tmp_path / "run")
    for now in range(25):
        run.waypoints(2).visited(now, Vec3(now, 0.0, -1.0), ())
        run.waypoints(1).visited(now, Vec3(0.0, now, -1.0), ())
        run.tick(now)
        if now < 5:
            continue
        vehicles = json.loads((run.path / "paths.json").read_text())["vehicles"]
        assert [one["sysid"] for one in vehicles] == [1, 2]
        for one in vehicles:
            assert one["waypoints"][-1]["time_s"] >= now - 10.0, "no older than two writings"
    run.close()
    vehicles = json.loads((run.path / "paths.json").read_text())["vehicles"]
    assert vehicles[1] == run.waypoints(2).encoded()
    assert len(vehicles[1]["waypoints"]) == 25
    assert not list(run.path.glob("*.tmp"))


def test_a_change_after_writing_is_written_next_time(tmp_path: Path) -> None:
    path, file = PathRecorder(1), tmp_path / "paths.json"
    path.visited(0.0, Vec3(0.0, 0.0, 0.0), ())
    path.target(0.0, Vec3(1.0, 0.0, 0.0))
    deque(write_paths(file, [path]))
    path.visited(1.0, Vec3(1.0, 0.0, 0.0), ())
    deque(write_paths(file, [path]))
    assert json.loads(file.read_text()) == {"vehicles": [path.encoded()]}
    assert [one["next"] for one in path.encoded()["waypoints"]] == [2, 2, None]


def test_what_was_written_is_held_as_text_until_it_changes() -> None:
    path = PathRecorder(1)
    path.visited(0.0, Vec3(0.0, 0.0, 0.0), ())
    path.target(0.0, Vec3(1.0, 0.0, 0.0))
    before = path.text()
    assert [type(one) for one in path._waypoints] == [str, str]
    path.visited(1.0, Vec3(0.1, 0.0, 0.0), ())
    assert [type(one) for one in path._waypoints] == [dict, str, dict]
    assert path.text() != before
    assert path.encoded() == json.loads(path.text())


def test_a_full_disk_is_told_and_paths_are_written_once_there_is_room(
    make: Make, tmp_path: Path
) -> None:
    run = make(tmp_path / "run")
    run.waypoints(1).visited(0.0, Vec3(0.0, 0.0, -1.0), ())
    (run.path / "paths.tmp").mkdir()
    with pytest.raises(OSError, match=r"paths\.tmp"):
        run.tick(5.0)
    (run.path / "paths.tmp").rmdir()
    run.tick(5.1)
    assert len(json.loads((run.path / "paths.json").read_text())["vehicles"]) == 1


# -- summary ---------------------------------------------------------------------------------------


def office_truth(run: Path, *, seed: int = 1, vehicles: int = 10, is_volume: bool = False) -> None:
    """Write a referee's files: three rooms, vehicles that bounce about, victims."""
    folder = run / "truth"
    folder.mkdir(parents=True, exist_ok=True)
    generator = np.random.default_rng(seed)
    north, east, cell, seconds = 12.0, 20.0, 0.25, 120
    walls: list[list[list[float]]] = [
        [[0, 8], [4, 8], [4, 8.2], [0, 8.2]],
        [[5.5, 8], [12, 8], [12, 8.2], [5.5, 8.2]],
        [[6, 8.2], [6, 13], [6.2, 13], [6.2, 8.2]],
        [[6, 15], [6, 20], [6.2, 20], [6.2, 15]],
    ]
    desk = [[2, 15], [3, 15], [3, 18], [2, 18]]
    n, e = np.mgrid[cell / 2 : north : cell, cell / 2 : east : cell]
    blocked = np.zeros(n.shape, dtype=bool)
    for points in walls:
        (n0, e0), (n1, e1) = np.min(points, axis=0), np.max(points, axis=0)
        blocked |= (n >= n0) & (n <= n1) & (e >= e0) & (e <= e1)
    steps = seconds * 2
    heading = np.cumsum(generator.normal(0.0, 0.25, (steps, vehicles)), axis=0)
    heading += generator.uniform(0.0, 6.0, vehicles)
    flat = np.cumsum(0.4 * np.stack([np.cos(heading), np.sin(heading)], axis=2), axis=0)
    flat += generator.uniform(1.0, 4.0, (vehicles, 2))
    span = np.array([north - 1.0, east - 1.0])
    flat = 0.5 + np.abs((flat % (2 * span)) - span)
    track = np.concatenate([flat, np.full((steps, vehicles, 1), -1.5)], axis=2)
    seen = np.full(n.shape, np.nan)
    for step in range(steps - 1, -1, -1):
        for at in flat[step]:
            seen[(n - at[0]) ** 2 + (e - at[1]) ** 2 <= 0.8] = step / 2
    free = ~blocked
    seen[blocked] = np.nan
    times = np.arange(0.0, seconds, 1.0)
    share = np.array([(seen <= time)[free].mean() for time in times])
    victims = np.array([[1.5, 3.0, 0.0], [9.0, 17.0, 0.0], [10.5, 11.0, 0.0]])
    np.savez_compressed(
        folder / "truth.npz",
        track_time_s=np.arange(steps) / 2,
        track_ned_m=track.astype(np.float32),
        coverage_time_s=times,
        coverage_fraction=share,
        seen_s=seen.astype(np.float32),
        seen_fraction=np.isfinite(seen)
        * (generator.uniform(0.2, 1.0, n.shape) if is_volume else 1),
        free=free,
        blocked=blocked,
        cell_m=np.array(cell),
        origin_ne_m=np.array([0.0, 0.0]),
        victims_ned_m=victims,
        victim_found_s=np.array([14.0, 63.0, np.nan]),
        victim_found_by=np.array([2, 5, 0]),
        starts_ned_m=track[0],
        sysids=np.arange(1, vehicles + 1),
    )
    numbers = {
        "time_s": 119.0,
        "coverage_fraction": float(share[-1]),
        "victims_found": 2,
        "victims_total": 3,
        "collisions": 0,
        "min_separation_m": 0.94,
        "path_length_m": 820.5,
        "energy_kwh": 0.0412,
        "sight_radius_m": 0.9,
        "setpoint_jitter_p99_ms": 1.7,
        "mock_late_fraction": 0.015,
        "mock_dropped": 7,
    }
    (folder / "truth.json").write_text(json.dumps(numbers))
    polygons = [{"points_ne_m": points, "bottom_m": 0.0, "top_m": 3.0} for points in walls]
    polygons.append({"points_ne_m": desk, "bottom_m": 0.0, "top_m": 0.75})
    outline = {"low": [0, 0, -3], "high": [north, east, 0], "polygons": polygons}
    (folder / "world.json").write_text(json.dumps(outline))


FLOWN = [
    VehicleResult(
        1,
        "done",
        "",
        600,
        9000,
        2,
        [1],
        5.0,
        65.0,
        ticks_due=800,
        ticks_late=4,
        unsent=1,
        unheard=5,
    ),
    VehicleResult(2, "done", "", 600, 9000, 0, [], 6.0, 66.0),
    VehicleResult(
        3, "failed", "vehicle 3: nothing heard from its autopilot since 61.2 s", 500, 1, 1
    ),
]


def summed(run: Path, results: list[VehicleResult] = FLOWN, **changes: Any) -> dict[str, Any]:
    given: dict[str, Any] = {
        "mission": RESOLVED,
        "mode": "udp",
        "outcome": "flown",
        "time_s": 90.0,
        "wall_s": 22.5,
        "run_sha256": "ab" * 32,
    }
    return summarise(run, results=results, **{**given, **changes})


def printed(renderable: Any, width: int = 100) -> str:
    console = Console(width=width, record=True, file=None, force_terminal=False, quiet=True)
    with console.capture() as capture:
        console.quiet = False
        console.print(renderable)
    return capture.get()


def test_a_summary_joins_the_controllers_with_the_truth(tmp_path: Path) -> None:
    office_truth(tmp_path)
    summary = summed(tmp_path)
    assert summary["planner"] == "lf-pso"
    assert (summary["victims_found"], summary["victims_total"], summary["collisions"]) == (2, 3, 0)
    assert (summary["messages_sent"], summary["messages_lost"]) == (1700, 3)
    assert (summary["setpoint_late_fraction"], summary["datagrams_unsent"]) == (0.005, 1)
    assert summary["datagrams_unheard"] == 5
    assert (summary["mock_late_fraction"], summary["mock_dropped"]) == (0.015, 7)
    assert (summary["duration_s"], summary["wall_s"], summary["exploration_s"]) == (
        90.0,
        22.5,
        61.0,
    )
    assert summary["notes"] == ["vehicle 3: nothing heard from its autopilot since 61.2 s"]
    assert [one["phase"] for one in summary["per_vehicle"]] == ["done", "done", "failed"]


def test_coverage_counts_when_the_exploration_time_is_over(tmp_path: Path) -> None:
    office_truth(tmp_path)
    curve = np.load(tmp_path / "truth" / "truth.npz")["coverage_fraction"]
    summary = summed(tmp_path)  # from 5 s, for 60 s: not what was seen on the way home
    assert summary["coverage_fraction"] == pytest.approx(curve[65], abs=1e-6)
    assert summary["coverage_final_fraction"] == pytest.approx(curve[-1], abs=1e-6)
    assert curve[65] < curve[-1]
    longer = summed(tmp_path, mission={**RESOLVED, "duration_s": 1000.0})
    assert longer["coverage_fraction"] == longer["coverage_final_fraction"]


def test_without_truth_the_summary_is_honest(tmp_path: Path) -> None:
    summary = summed(tmp_path, outcome="failed", notes=["the mock fleet died"])
    assert summary["coverage_fraction"] is None
    assert summary["collisions"] is None
    assert summary["notes"][:2] == [
        "the mock fleet died",
        "the referee left no truth: coverage, victims and contacts are unknown",
    ]
    assert "unknown" in printed(report_lines(summary))


def test_torn_truth_is_no_truth(tmp_path: Path) -> None:
    office_truth(tmp_path)
    npz = tmp_path / "truth" / "truth.npz"
    npz.write_bytes(npz.read_bytes()[:1000])
    summary = summed(tmp_path)
    assert summary["coverage_fraction"] == pytest.approx(summary["coverage_final_fraction"])
    assert "the referee's tracks (truth/truth.npz) are missing or torn" in summary["notes"]
    (tmp_path / "truth" / "truth.json").write_text('{"coverage_fr')
    assert summed(tmp_path)["coverage_fraction"] is None
    assert draw_pictures(tmp_path, summary) == [
        "no pictures: the referee's tracks are missing",
    ]


def test_a_vehicle_that_came_home_early_is_named(tmp_path: Path) -> None:
    early = VehicleResult(2, "done", "battery low at 24%", explored_from_s=5.0, explored_to_s=25.0)
    assert (
        "vehicle 2: explored 20 s instead of 60 s (battery low at 24%)"
        in (summed(tmp_path, [early])["notes"])
    )
    cut = summed(tmp_path, [early], outcome="interrupted")["notes"]
    assert not any("vehicle 2" in note for note in cut), "the operator knows why"


def test_vehicles_with_one_reason_share_a_note(tmp_path: Path) -> None:
    def ended(*sysids: int) -> list[VehicleResult]:
        return [VehicleResult(sysid, "failed", "did not arm") for sysid in sysids]

    notes = summed(tmp_path, ended(1, 4, 7))["notes"]
    assert "vehicles 1, 4 and 7: did not arm" in notes
    assert "no vehicle came to explore" in notes
    assert (
        "vehicles 1, 2, 3, 4, 5, 6 and 94 more: did not arm"
        in (summed(tmp_path, ended(*range(1, 101)))["notes"])
    )


def test_a_summary_is_plain_json(tmp_path: Path) -> None:
    office_truth(tmp_path)
    numbers = json.loads((tmp_path / "truth" / "truth.json").read_text())
    (tmp_path / "truth" / "truth.json").write_text(
        json.dumps({**numbers, "min_separation_m": math.inf})
    )
    summary = summed(tmp_path)
    summary["extra"] = np.float32(0.5)
    write_summary(tmp_path, summary)
    text = (tmp_path / "summary.json").read_text()
    assert json.loads(text)["min_separation_m"] is None, "one vehicle alone is near nobody"
    assert json.loads(text)["extra"] == 0.5
    assert not re.search("NaN|Infinity", text)


def test_the_report_speaks_plain_words(tmp_path: Path) -> None:
    office_truth(tmp_path)
    text = printed(report_lines(summed(tmp_path), tmp_path), width=160)
    for words in (
        "✔ search flown  3 vehicles, px4, planner lf-pso, seed 7",
        "explored",
        "with the way home",
        "victims  2 of 3 found",
        "contacts  none; two vehicles never closer than 0.94 m",
        "flown  820 m in all, 0.0412 kWh",
        "1,700 sent, 3 lost",
        "pace  0.50% of the setpoints late; 1.50% of the mock's steps late; ",
        "1 datagrams did not leave; 5 datagrams were dropped unread; the mock dropped 7 frames",
        "90 s of mission in 22 s (4.0 times real time)",
        "• vehicle 3: nothing heard from its autopilot since 61.2 s",
    ):
        assert words in text


def test_the_report_says_how_the_swarm_held_together(tmp_path: Path) -> None:
    office_truth(tmp_path)
    summary = summed(tmp_path)
    text = printed(report_lines(summary))
    assert not {"radio", "news", "overlap"} & set(text.split()), "nobody knows"
    summary |= {"together_fraction": 0.63, "splits": 2, "rejoins": 1, "alone_longest_s": 41.0}
    summary |= {"victim_lag_max_s": 0.54, "victim_all_max_s": 12.0, "victim_untold": 3}
    summary |= {"redundant_fraction": 0.31, "vehicles_per_cell": 1.4}
    text = " ".join(printed(report_lines(summary), width=200).split())
    for words in (
        "radio all in contact 63% of the time; fell apart twice, rejoined once; one vehicle was",
        "news victims told to peers at most 0.5 s after contact; all knew of each within 12 s; 3",
        "overlap 31% of what was seen was seen by several; 1.4 vehicles a place on average",
    ):
        assert words in text
    whole = printed(report_lines({**summary, "together_fraction": 1.0}))
    assert "all in contact all the time" in whole


# -- pictures --------------------------------------------------------------------------------------

PICTURES = ("paths.png", "coverage.png", "coverage_map.png")


@pytest.mark.parametrize(("vehicles", "is_volume"), [(10, False), (30, True)])
def test_a_run_is_drawn(tmp_path: Path, vehicles: int, is_volume: bool) -> None:
    office_truth(tmp_path, vehicles=vehicles, is_volume=is_volume)
    summary = {**summed(tmp_path), "vehicles": vehicles}
    assert draw_pictures(tmp_path, summary, speed_m_s=0.8) == []
    for name in PICTURES:
        picture = (tmp_path / name).read_bytes()
        assert picture.startswith(b"\x89PNG")
        assert len(picture) > 20_000


def test_pictures_need_neither_outline_nor_victims(tmp_path: Path) -> None:
    office_truth(tmp_path, vehicles=2)
    npz = tmp_path / "truth" / "truth.npz"
    arrays = dict(np.load(npz))
    arrays["victims_ned_m"], arrays["victim_found_s"] = np.empty((0, 3)), np.empty(0)
    arrays["track_ned_m"][:, 1] = np.nan  # a vehicle nobody ever saw
    np.savez(npz, **arrays)
    (tmp_path / "truth" / "world.json").unlink()
    assert draw_pictures(tmp_path, summed(tmp_path)) == []
    assert all((tmp_path / name).exists() for name in PICTURES)


def test_a_run_without_matplotlib_has_no_pictures_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    office_truth(tmp_path)
    genuine = builtins.__import__

    def without(name: str, *rest: Any, **more: Any) -> Any:
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return genuine(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    (note,) = draw_pictures(tmp_path, summed(tmp_path))
    assert note == "no pictures: matplotlib is missing (pip install 'swarm-ctl[plots]')"


def test_one_missing_array_costs_one_picture(tmp_path: Path) -> None:
    office_truth(tmp_path, vehicles=2)
    npz = tmp_path / "truth" / "truth.npz"
    arrays = dict(np.load(npz))
    del arrays["coverage_time_s"]
    np.savez(npz, **arrays)
    assert draw_pictures(tmp_path, summed(tmp_path)) == [
        "no coverage.png: the referee's tracks lack coverage_time_s"
    ]
    assert (tmp_path / "paths.png").exists()
