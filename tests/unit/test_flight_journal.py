"""Journals of controllers: what they keep, and what they notice."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl import wire
from swarm_ctl.errors import SwarmError
from swarm_ctl.model import Vec3
from swarm_ctl.record import flight_journal
from swarm_ctl.record.append import AppendFile
from swarm_ctl.record.flight_journal import FlightJournal, Story, read_flight_journal
from swarm_ctl.record.folder import RunFolder
from swarm_ctl.record.paths import PathRecorder
from swarm_ctl.record.resume import find_unfinished
from swarm_ctl.record.tlog import TlogWriter

HEAD = {"mission": "hall", "sysid": 3}
RESOLVED = {"name": "hall", "seed": 1, "vehicles": 2, "world": "world.yaml"}


def written(path: Path, pages: int) -> bytes:
    journal = FlightJournal(path, HEAD)
    for number in range(pages):
        journal.append({"time_s": float(number), "phase": "exploring"})
    journal.close()
    return path.read_bytes()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "vehicle-003.jsonl"


def read(path: Path) -> Story:
    return read_flight_journal(path, HEAD)


def test_what_is_written_is_read(file: Path) -> None:
    data = written(file, 3)
    story = read(file)
    assert story.head["sysid"] == 3
    assert [page["time_s"] for page in story.pages] == [0.0, 1.0, 2.0]
    assert (story.fault, story.size, story.is_whole) == ("", len(data), True)
    assert all(json.loads(line) for line in data.splitlines()), "every line is JSON"


def test_a_successor_goes_on_in_the_same_file_and_counts_itself(file: Path) -> None:
    before = written(file, 3)
    for restart in (1, 2):
        journal = FlightJournal(file, HEAD, read(file))
        assert read(file).restarts == restart - 1, "not before it has something to say"
        journal.append({"time_s": 9.0})
        journal.close()
        assert read(file).restarts == restart
    assert file.read_bytes().startswith(before)
    assert len(read(file).pages) == 5


def test_it_may_be_torn_at_any_byte_and_loses_no_whole_line(file: Path) -> None:
    data = written(file, 3)
    for size in range(len(data)):
        file.write_bytes(data[:size])
        story = read(file)
        assert story.fault == ""
        assert len(story.pages) == max(0, data[:size].count(b"\n") - 1)
        journal = FlightJournal(file, HEAD, story)
        journal.append({"time_s": 10.0})
        journal.close()
        assert read(file).pages[-1]["time_s"] == 10.0


@given(where=st.floats(0.0, 1.0, exclude_max=True), flips=st.integers(1, 255))
def test_no_changed_byte_in_its_middle_goes_unnoticed(
    tmp_path_factory: pytest.TempPathFactory, where: float, flips: int
) -> None:
    file = tmp_path_factory.mktemp("journal") / "vehicle-003.jsonl"
    whole = written(file, 4)
    at = int(where * whole.rindex(b"\n", 0, -1))
    file.write_bytes(whole[:at] + bytes([whole[at] ^ flips]) + whole[at + 1 :])
    assert read(file).fault


def test_a_lost_or_swapped_line_is_noticed(file: Path) -> None:
    lines = written(file, 4).splitlines(keepends=True)
    for kept in ([0, 1, 3, 4], [0, 2, 1, 3, 4], [1, 2, 3, 4]):
        file.write_bytes(b"".join(lines[index] for index in kept))
        assert "broken in line" in read(file).fault


def test_the_journal_of_another_vehicle_is_none_of_ours(file: Path) -> None:
    written(file, 2)
    fault = read_flight_journal(file, {**HEAD, "sysid": 4}).fault
    assert fault == "its journal is of another mission, vehicle or version"


def test_two_processes_cannot_write_one_journal(file: Path) -> None:
    first = FlightJournal(file, HEAD)
    with pytest.raises(SwarmError, match="another process is flying this vehicle"):
        FlightJournal(file, HEAD, read(file))
    first.close()


def test_after_a_boot_the_end_may_be_missing(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written(file, 2)
    assert read(file).is_whole
    monkeypatch.setattr(flight_journal, "boot_id", lambda: "another boot")
    assert not read(file).is_whole


def test_a_full_disk_ends_the_record_and_not_the_flight() -> None:
    full = AppendFile(Path("/dev/full"))
    for _ in range(3):
        full.write(b"a line\n")
    with pytest.raises(OSError, match="No space left on device"):
        full.sync()
    full.close()
    full.close()


# -- the other parts of a run folder -------------------------------------------------------------


Create = Callable[[], RunFolder]


@pytest.fixture
def create(tmp_path: Path) -> Create:
    def begin() -> RunFolder:
        folder = RunFolder.create(
            tmp_path / "runs" / "hall-20240101T000000Z",
            *("hall", RESOLVED),
            seed=1,
            mode="fly",
            journaled=[1, 2],
        )
        for sysid in (1, 2):
            journal = folder.flight_journal(sysid)
            assert journal is not None
            journal.append({"time_s": 1.0})
        return folder

    return begin


def test_a_run_that_was_killed_is_found_by_its_mission_and_vehicles(create: Create) -> None:
    folder = create()
    folder.close()
    runs, now = folder.path.parent, datetime.now(UTC)
    assert find_unfinished(runs, RESOLVED, [2, 1], now) == folder.path
    assert find_unfinished(runs, RESOLVED, [1, 2, 3], now) is None
    assert find_unfinished(runs, {**RESOLVED, "seed": 2}, [1, 2], now) is None
    assert find_unfinished(runs, RESOLVED, [1, 2], now + timedelta(minutes=11)) is None
    (folder.path / "summary.json").write_text("{}")
    assert find_unfinished(runs, RESOLVED, [1, 2], now) is None


def test_only_a_run_of_the_same_mission_that_has_not_ended_is_taken_up(create: Create) -> None:
    folder = create()
    folder.close()
    with pytest.raises(SwarmError, match="another mission"):
        RunFolder.reopen(folder.path, {**RESOLVED, "seed": 2}, [1, 2])
    with pytest.raises(SwarmError, match="other vehicles"):
        RunFolder.reopen(folder.path, RESOLVED, [1, 3])
    with pytest.raises(SwarmError, match="holds no run"):
        RunFolder.reopen(folder.path.parent, RESOLVED, [1, 2])
    (folder.path / "summary.json").write_text("{}")
    with pytest.raises(SwarmError, match="has ended"):
        RunFolder.reopen(folder.path, RESOLVED, [1, 2])


def test_mission_time_goes_on_with_the_clock(create: Create) -> None:
    folder = create()
    folder.close()
    with RunFolder.reopen(folder.path, RESOLVED, [1, 2], speed=2.0) as again:
        assert again.resumed_s is not None
        assert 1.0 <= again.resumed_s <= again.now(2.0) < 30.0
        assert again.started_utc == folder.started_utc


def test_events_go_on_behind_the_last_whole_line(create: Create) -> None:
    folder = create()
    folder.close()
    events = folder.path / "events.jsonl"
    before = events.read_bytes()
    events.write_bytes(before + b'{"event": "Phase')
    RunFolder.reopen(folder.path, RESOLVED, [1, 2]).close()
    after = events.read_bytes()
    assert after.startswith(before)
    assert json.loads(after[len(before) :])["event"] == "RunResumed"


def heartbeat(seq: int) -> bytes:
    return wire.message("HEARTBEAT").pack(seq, 1, 1, 2, 3, 81, 0, 3, 3)


def test_a_log_goes_on_behind_its_last_whole_frame(tmp_path: Path) -> None:
    path = tmp_path / "vehicle-001.tlog"
    log = TlogWriter(path, flush_s=0.0)
    for seq in range(5):
        log.write(heartbeat(seq), float(seq))
    whole = path.read_bytes()
    log.close()
    record = len(whole) // 5
    for torn in range(1, record):
        path.write_bytes(whole[:-torn])
        TlogWriter(path).close()
        assert path.read_bytes() == whole[:-record]
    path.write_bytes(whole)
    TlogWriter(path).close()
    assert path.read_bytes() == whole


def test_a_log_that_is_no_log_is_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "vehicle-001.tlog"
    path.write_bytes(b"something else entirely")
    TlogWriter(path).close()
    assert path.read_bytes() == b"something else entirely"


def test_a_path_goes_on_with_what_it_was_written_as() -> None:
    path = PathRecorder(1)
    path.target(0.5, Vec3(3.0, 0.0, -1.0))
    path.target(0.6, Vec3(1.0, 0.0, -1.0))
    for second in range(3):
        path.visited(float(second), Vec3(0.5 * second, 0.0, -1.0), [2])
    again = PathRecorder.decoded(json.loads(path.text()))
    for recorder in (path, again):
        recorder.visited(3.0, Vec3(3.0, 0.0, -1.0), [])
    assert again.encoded() == path.encoded()
    assert again.length_m == pytest.approx(path.length_m)
    assert again.until_s == 3.0
