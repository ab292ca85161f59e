"""`swarm-ctl run` with a key: controllers and vehicles sign all that they say to each other."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pymavlink import mavutil  # noqa: TID251 - the reader of logs that everybody has

from swarm_ctl.signing import KEY_VARIABLE

pytestmark = pytest.mark.wire

Hall = Callable[..., Path]
PASSPHRASE = "correct horse battery staple"  # noqa: S105 - of nothing but this test
PATIENCE_S = 60.0


def fly(mission: Path, *options: object, **environment: str) -> subprocess.CompletedProcess[str]:
    out = ("--out", mission.parent / "run")
    words = [sys.executable, "-m", "swarm_ctl", "run", mission, *out, "--speed", 10, *options]
    return subprocess.run(
        [str(word) for word in words],
        check=False,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        env=os.environ | environment,
    )


def frames(tlog: Path) -> Iterator[bytes]:
    log = mavutil.mavlink_connection(str(tlog))  # type: ignore[no-untyped-call]
    try:
        while (message := log.recv_msg()) is not None:
            yield message.get_msgbuf()
    finally:
        log.close()


def flown_and_signed(mission: Path, flight: subprocess.CompletedProcess[str]) -> bool:
    assert (flight.returncode, flight.stderr) == (0, "")
    out = mission.parent / "run"
    phases = [one["phase"] for one in json.loads((out / "summary.json").read_text())["per_vehicle"]]
    assert phases == ["done", "done"]
    tlogs = sorted((out / "tlogs").iterdir())
    assert len(tlogs) == 2
    return all(frame[2] & 1 for tlog in tlogs for frame in frames(tlog))


def test_a_signed_swarm_flies_its_mission(hall: Hall, tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_text(PASSPHRASE)
    mission = hall()
    options = ("--signing-key", key, "--autopilot", "mixed", "--vehicles", 2)
    assert flown_and_signed(mission, fly(mission, *options))


def test_the_key_may_come_from_the_environment(hall: Hall) -> None:
    mission = hall()
    flight = fly(mission, "--vehicles", 2, **{KEY_VARIABLE: PASSPHRASE})
    assert flown_and_signed(mission, flight)


def test_without_a_key_nothing_is_signed(hall: Hall) -> None:
    mission = hall()
    assert not flown_and_signed(mission, fly(mission, "--vehicles", 2))


def test_a_bad_key_is_one_sentence_and_nothing_flies(hall: Hall, tmp_path: Path) -> None:
    mission = hall()
    flight = fly(mission, "--signing-key", tmp_path / "nowhere")
    assert flight.returncode == 2
    assert flight.stderr == f"signing key {tmp_path / 'nowhere'}: No such file or directory\n"
    assert not (tmp_path / "run").exists()
