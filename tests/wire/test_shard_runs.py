"""`swarm-ctl run --shards`: one world, several processes, one record."""

from __future__ import annotations

import json
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from session import PATIENCE_S, Session

from swarm_ctl.record.shards import join_records

pytestmark = pytest.mark.wire

Type = Callable[..., Session]
Hall = Callable[..., Path]
Processes = Callable[[str], list[int]]
NEAR = {"starts": {"grid": {"origin_m": [6, 6], "spacing_m": 1.5, "columns": 2}}}


def phases(session: Session, shard: int) -> list[str]:
    """Tell what the vehicles of a shard have come to, by its journal."""
    file = session.out / f"shard{shard}" / "events.jsonl"
    if not file.exists():
        return []
    events = [json.loads(line) for line in file.read_text().split("\n")[:-1]]
    return [event["data"]["after"] for event in events if "after" in event.get("data", {})]


def explores(session: Session) -> bool:
    return all("exploring" in phases(session, shard) for shard in (1, 2))


def radio(session: Session, shard: int) -> set[tuple[int, int]]:
    """Give who delivered frames to whom, by a shard's books."""
    file = session.out / f"shard{shard}" / "truth" / "radio.json"
    return {(one["from"], one["to"]) for one in json.loads(file.read_text())["links"]}


def only_shards(folder: str, names: list[str]) -> list[str]:
    """Leave out what the one who started shards has written above them."""
    return [name for name in names if (Path(folder) / "shard1").exists() and "shard" not in name]


def test_two_shards_fly_one_world_and_leave_one_record(
    hall: Hall, swarm_ctl_run: Type, tmp_path: Path
) -> None:
    session = swarm_ctl_run(hall(world=NEAR, vehicles=2), "--shards", 2, "--speed", 3)
    session.process.wait(timeout=90.0)
    code, out, complaints = session.end()
    assert (code, complaints) == (0, "")
    assert out.count("hall flown") == 1, "shards leave the last word to who started them"
    assert {line[:8] for line in out.splitlines() if line.startswith("shard")} == {
        "shard 1:",
        "shard 2:",
    }
    summary = session.summary()
    assert (summary["vehicles"], summary["outcome"]) == (4, "flown")
    assert [one["vehicles"] for one in summary["shards"]] == [2, 2]
    assert {(3, 1), (4, 2)} <= radio(session, 1), "one network, whose members hear one another"
    with np.load(session.out / "truth" / "truth.npz") as truth:
        assert truth["sysids"].tolist() == [1, 2, 3, 4]
        assert truth["track_ned_m"].shape[1:] == (4, 3)
        assert np.isfinite(truth["track_ned_m"]).all()
        assert truth["coverage_fraction"][-1] == pytest.approx(
            summary["coverage_fraction"], abs=0.01
        )
    alone = [
        json.loads((session.out / one["folder"] / "summary.json").read_text())
        for one in summary["shards"]
    ]
    most = max(one["coverage_final_fraction"] for one in alone)
    both = sum(one["coverage_final_fraction"] for one in alone)
    assert most < summary["coverage_fraction"] <= both + 1e-6
    for key in ("messages_sent", "path_length_m", "collisions"):
        assert summary[key] == pytest.approx(sum(one[key] for one in alone))
    assert not [note for note in summary["notes"] if "complaint" in note], (
        "all ended as they should"
    )
    left = {entry.name for entry in session.out.iterdir()}
    assert {"paths.png", "coverage.png", "coverage_map.png", "report.html"} <= left
    copied = shutil.copytree(session.out, tmp_path / "copied", ignore=only_shards)
    (copied / "shard1").rename(copied / "host")
    assert join_records(copied) == summary | {
        "shards": [
            one | {"folder": folder}
            for one, folder in zip(summary["shards"], ("host", "shard2"), strict=True)
        ]
    }
    assert {entry.name for entry in copied.iterdir()} == left - {"shard1"} | {"host"}


def test_ctrl_c_lands_the_vehicles_of_all_shards(hall: Hall, swarm_ctl_run: Type) -> None:
    session = swarm_ctl_run(hall(duration_s=300.0), "--shards", 2, "--speed", 3)
    session.wait_until(lambda: explores(session))
    session.ctrl_c()
    code, out, complaints = session.end()
    assert (code, complaints) == (130, "")
    assert "hall interrupted" in out
    assert all(phases(session, shard).count("done") == 2 for shard in (1, 2))


def test_shards_land_when_who_started_them_is_killed(
    hall: Hall, swarm_ctl_run: Type, processes: Processes
) -> None:
    session = swarm_ctl_run(hall(duration_s=300.0), "--shards", 2, "--speed", 3)
    session.wait_until(lambda: explores(session))
    session.process.send_signal(signal.SIGKILL)
    session.process.wait()
    deadline_s = time.monotonic() + PATIENCE_S
    while processes("swarm_ctl"):
        assert time.monotonic() < deadline_s, [phases(session, shard) for shard in (1, 2)]
        time.sleep(0.05)  # noqa: TID251 - other processes are waited for
    for shard in (1, 2):
        assert phases(session, shard).count("done") == 2
        summary = json.loads((session.out / f"shard{shard}" / "summary.json").read_text())
        assert summary["outcome"] == "interrupted"


def test_a_shard_that_cannot_begin_ends_all_and_leaves_nothing(
    hall: Hall, swarm_ctl_run: Type, tmp_path: Path
) -> None:
    session = swarm_ctl_run(hall(), "--shards", 2, "--signing-key", tmp_path / "none")
    code, out, complaints = session.end()
    assert (code, complaints) == (2, "")
    assert f"signing key {tmp_path}/none: No such file or directory" in out
    assert not session.out.exists()
