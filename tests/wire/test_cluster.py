"""Experiments on a real Dask cluster: a scheduler and workers, each a process of its own."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml
from distributed import Client

import swarm_ctl
from swarm_ctl.errors import ClusterError
from swarm_ctl.experiment import cluster, sweep
from swarm_ctl.experiment.cluster import on_cluster
from swarm_ctl.experiment.sweep import Job, Row, run_experiment

pytestmark = pytest.mark.wire

WORLD = Path(__file__).resolve().parents[2] / "missions" / "worlds" / "open_2d.yaml"
PATIENCE_S = 60.0
RESULTS = ("trials.csv", "cells.csv", "summary.json")


class DaskCluster:
    """A scheduler and its workers on the loopback; their files are in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, workers: int = 2, *, allowed_failures: int = 3) -> str:
        """Start it and give its address."""
        file = self._folder / "scheduler.json"
        variable = "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES"
        environment = {variable: str(allowed_failures)}
        self._run("scheduler", "scheduler", f"--scheduler-file={file}", **environment)
        wait_until(lambda: file.exists() and file.read_text().endswith("}"))
        self.address = str(json.loads(file.read_text())["address"])
        for number in range(workers):
            self.add(f"worker-{number}")
        if workers:
            with self.watch() as watcher:
                watcher.wait_for_workers(workers, timeout=PATIENCE_S)
        return self.address

    def watch(self) -> Client:
        return Client(self.address, set_as_default=False)

    def add(self, name: str, *options: str) -> None:
        local = self._folder / name
        local.mkdir()
        plain = ("--no-nanny", "--nthreads=1", f"--local-directory={local}", f"--name={name}")
        self._run(name, "worker", self.address, *plain, *options)

    def send(self, number: signal.Signals, name: str) -> None:
        self._processes[name].send_signal(number)

    def stop(self) -> None:
        for process in self._processes.values():
            process.kill()
            process.wait()

    def _run(self, name: str, what: str, *words: str, **environment: str) -> None:
        words = (f"distributed.cli.dask_{what}", "--host=127.0.0.1", "--no-dashboard", *words)
        words += ("--port=0", "--no-show") if what == "scheduler" else ()
        with (self._folder / "dask.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                [sys.executable, "-m", *words],
                env=os.environ | environment,
                cwd=self._folder,
                stdout=log,
                stderr=log,
            )


@pytest.fixture
def dask(tmp_path: Path) -> Iterator[DaskCluster]:
    folder = tmp_path / "dask"
    folder.mkdir()
    running = DaskCluster(folder)
    yield running
    running.stop()


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Write an experiment of many small jobs, and its world beside it."""
    monkeypatch.setattr(sweep, "CHUNK", 2)
    shutil.copy(WORLD, tmp_path / "world.yaml")

    def writer(trials: int = 9, duration_s: float = 40.0) -> Path:
        content: dict[str, Any] = {
            "trials": trials,
            "pictures": False,
            "defaults": {
                "world": "world.yaml",
                "vehicles": 4,
                "duration_s": duration_s,
                "planner": {"period_s": 1.0},
            },
            "cells": [{"name": "hybrid"}, {"name": "LF", "planner": {"kind": "levy"}}],
        }
        path = tmp_path / "many.yaml"
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        return path

    return writer


def wait_until(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.02)  # noqa: TID251 - another process is waited for


def same_results(one: Path, other: Path) -> bool:
    return all((one / name).read_bytes() == (other / name).read_bytes() for name in RESULTS)


def address_of(watcher: Client, name: str) -> str:
    workers = watcher.scheduler_info(n_workers=-1)["workers"]
    [address] = [address for address, worker in workers.items() if worker["name"] == name]
    return str(address)


def jobs_done(watcher: Client, name: str) -> int:
    """Ask a worker how many jobs it has computed."""

    def count(dask_worker: Any) -> int:
        return int(dask_worker.state.executed_count)

    address = address_of(watcher, name)
    return int(watcher.run(count, workers=[address])[address])


def jobs_given(watcher: Client, name: str) -> int:
    """Ask the scheduler how many jobs a worker has been given and not finished."""
    address = address_of(watcher, name)
    return len(watcher.processing([address])[address])


def test_a_cluster_writes_the_same_bytes_and_its_workers_need_no_file(
    dask: DaskCluster, write: Callable[..., Path], tmp_path: Path
) -> None:
    path = write()
    run_experiment(path, workers=1, out=tmp_path / "here")
    with on_cluster(dask.start()) as compute, dask.watch() as watcher:

        def without_files(jobs: Sequence[Job]) -> Iterator[tuple[Job, list[Row]]]:
            (tmp_path / "world.yaml").unlink()
            path.unlink()
            yield from compute(jobs[::-1])

        run_experiment(path, out=tmp_path / "there", compute=without_files)
        done = [jobs_done(watcher, f"worker-{number}") for number in range(2)]
    assert same_results(tmp_path / "here", tmp_path / "there")
    assert sum(done) == 10
    assert all(done), "both have worked"


@pytest.mark.parametrize("allowed_failures", [3, 0])
def test_a_killed_worker_loses_no_result(
    dask: DaskCluster, write: Callable[..., Path], tmp_path: Path, allowed_failures: int
) -> None:
    path = write(trials=60, duration_s=150.0)
    run_experiment(path, workers=1, out=tmp_path / "here")
    lost = 0
    with (
        on_cluster(dask.start(allowed_failures=allowed_failures)) as compute,
        dask.watch() as watcher,
    ):

        def kill(done: int, _total: int, _cell: str) -> None:
            nonlocal lost
            if lost or done < 8 or not jobs_done(watcher, "worker-0"):
                return
            dask.send(signal.SIGSTOP, "worker-0")  # what it has now it will never finish
            lost = jobs_given(watcher, "worker-0")
            dask.send(signal.SIGKILL, "worker-0")

        run_experiment(path, out=tmp_path / "there", compute=compute, progress=kill)
        left = watcher.scheduler_info(n_workers=-1)["workers"].values()
    assert lost > 0
    assert [worker["name"] for worker in left] == ["worker-1"]
    assert same_results(tmp_path / "here", tmp_path / "there")


def test_a_job_that_kills_every_worker_is_given_up(
    dask: DaskCluster, write: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "ROUNDS", 1)
    poison = (
        "import os; from swarm_ctl.experiment import cluster as c; c.run_job = lambda _: os.abort()"
    )
    (tmp_path / "poison.py").write_text(poison)
    address = dask.start(workers=0, allowed_failures=0)
    dask.add("short-lived", f"--preload={tmp_path / 'poison.py'}")
    with (
        pytest.raises(ClusterError, match="every worker is lost that computes 'hybrid'"),
        on_cluster(address) as compute,
    ):
        run_experiment(write(), out=tmp_path / "there", compute=compute)


def test_a_lost_scheduler_is_one_sentence_and_what_is_done_is_kept(
    dask: DaskCluster, write: Callable[..., Path], tmp_path: Path
) -> None:
    path = write(trials=40)
    run_experiment(path, workers=1, out=tmp_path / "here")

    def kill(done: int, _total: int, _cell: str) -> None:
        if done == 6:
            dask.send(signal.SIGKILL, "scheduler")

    with (
        pytest.raises(ClusterError, match="the scheduler was lost; the same command continues"),
        on_cluster(dask.start()) as compute,
    ):
        run_experiment(path, out=tmp_path / "there", compute=compute, progress=kill)
    assert 3 <= len(list((tmp_path / "there" / "chunks").glob("*.json"))) < 40
    run_experiment(path, workers=1, out=tmp_path / "there")
    assert same_results(tmp_path / "here", tmp_path / "there")


def test_ctrl_c_keeps_what_is_done_cancels_the_rest_and_the_same_command_continues(
    dask: DaskCluster, write: Callable[..., Path], tmp_path: Path
) -> None:
    path = write(trials=30_000, duration_s=100.0)
    words = [sys.executable, "-m", "swarm_ctl", "experiment", str(path)]
    words += ["--out", str(tmp_path / "there"), "--cluster", dask.start()]
    chunks = tmp_path / "there" / "chunks"
    user = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: len(list(chunks.glob("*.json"))) >= 3)
    user.send_signal(signal.SIGINT)
    said, complained = user.communicate(timeout=PATIENCE_S)
    assert user.returncode == 130
    assert "interrupted: the same command continues" in said
    assert "Traceback" not in complained
    kept = len(list(chunks.glob("*.json")))
    assert kept >= 3
    with dask.watch() as watcher:
        wait_until(lambda: not any(watcher.processing().values()))
    user = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: len(list(chunks.glob("*.json"))) >= kept + 3)
    user.send_signal(signal.SIGINT)
    user.communicate(timeout=PATIENCE_S)


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("127.0.0.1:1", "no Dask scheduler answers"),
        ("localhost", "missing port number in address 'localhost'"),
        ("smoke://hill:1", "unknown address scheme 'smoke'"),
        ("tls://127.0.0.1:1", "TLS expects"),
    ],
)
def test_an_address_that_leads_nowhere_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, address: str, sentence: str
) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    began = time.monotonic()
    with pytest.raises(ClusterError, match=sentence) as caught, on_cluster(address):
        pass
    assert str(caught.value).startswith(f"--cluster {address}: no Dask scheduler answers")
    assert "\n" not in str(caught.value)
    assert time.monotonic() - began < 5.0


def test_one_who_listens_and_says_nothing_is_no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    with (
        socket.create_server(("127.0.0.1", 0)) as mute,
        pytest.raises(ClusterError, match="no Dask scheduler answers within 1 s"),
        on_cluster(f"127.0.0.1:{mute.getsockname()[1]}"),
    ):
        pass


def test_a_scheduler_without_workers_and_a_worker_are_told_apart(
    dask: DaskCluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = dask.start(workers=0)
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    with pytest.raises(ClusterError, match="the scheduler has no worker"), on_cluster(address):
        pass
    dask.add("alone")
    with dask.watch() as watcher:
        watcher.wait_for_workers(1, timeout=PATIENCE_S)
        worker = address_of(watcher, "alone")
    with pytest.raises(ClusterError, match="this is the address of a worker"), on_cluster(worker):
        pass


@pytest.mark.parametrize(
    ("preload", "sentence"),
    [
        (
            "import swarm_ctl; swarm_ctl.__version__ = '9.9.9'",
            f"a worker has swarm-ctl 9.9.9, but {swarm_ctl.__version__} here; install the same",
        ),
        ("import sys; sys.modules['swarm_ctl'] = None", "a worker cannot compute: .*swarm_ctl"),
    ],
)
def test_a_worker_with_another_version_or_none_is_one_sentence(
    dask: DaskCluster, write: Callable[..., Path], tmp_path: Path, preload: str, sentence: str
) -> None:
    address = dask.start(workers=0)
    (tmp_path / "preload.py").write_text(preload)
    dask.add("other", f"--preload={tmp_path / 'preload.py'}")
    with pytest.raises(ClusterError, match=sentence) as caught, on_cluster(address) as compute:
        run_experiment(write(), out=tmp_path / "there", compute=compute)
    assert "\n" not in str(caught.value)
