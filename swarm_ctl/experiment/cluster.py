"""Compute the jobs of an experiment on a Dask cluster, with the same results as at home."""

from __future__ import annotations

import asyncio
import logging
import pickle
import select
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import Any

import numpy as np
from distributed import Client, Future, Security, as_completed
from distributed.comm.core import CommClosedError
from distributed.core import rpc
from distributed.scheduler import KilledWorker

import swarm_ctl
from swarm_ctl.errors import ClusterError
from swarm_ctl.experiment.sweep import Compute, Job, Row, run_job

POLL_S = 0.02
CONNECT_S = 5.0
"""Time in which a scheduler must answer, and then have a worker."""
ROUNDS = 5
"""Times that a job is submitted before it is said to kill its workers. Dask gives it up after four
workers (`distributed.scheduler.allowed-failures`) were lost with it, running or waiting."""
CALL = "__import__('pkgutil').resolve_name('swarm_ctl.experiment.cluster:compute')(versions, job)"
"""What a worker does. It is text, since a worker that cannot unpickle a function ends, and so does
its successor; this way one without the package, or with an older one, says so."""


@contextmanager
def on_cluster(address: str) -> Iterator[Compute]:
    """Compute with the workers of the scheduler at `address`, as `tcp://10.0.0.5:8786`.

    A worker needs the package in the same version and no file. ClusterError, in one sentence, if
    nobody answers, if there is no worker or the wrong one, or if the scheduler is lost.
    """
    # what it has to say in tracebacks is said in our sentences
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    client = _client(address)
    try:
        yield lambda jobs: _through(client, address, jobs)
    finally:
        client.close()


def compute(versions: dict[str, str], job: bytes) -> list[Row] | str:
    """Compute a pickled job on a worker, or say which package it has in another version."""
    for name, here in _versions().items():
        if here != versions.get(name):
            return f"{name} {here}, but {versions.get(name)} here"
    unpacked: Job = pickle.loads(job)  # noqa: S301 - a scheduler's word is trusted by its workers
    return run_job(unpacked)


def _versions() -> dict[str, str]:
    """Give what decides on the bytes of a result."""
    return {"swarm-ctl": swarm_ctl.__version__, "numpy": np.__version__}


def _client(address: str) -> Client:
    try:
        asyncio.run(asyncio.wait_for(_ask_who(address), CONNECT_S))
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except TimeoutError:
        reason = f"no Dask scheduler answers within {CONNECT_S:g} s"
        raise ClusterError(address, reason) from None
    except Exception as error:  # noqa: BLE001 - every transport has its own
        reason = f"no Dask scheduler answers: {_first_line(error)}"
        raise ClusterError(address, reason) from None
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        client.close()
        reason = f"the scheduler has no worker; start one with `dask worker {address}`"
        raise ClusterError(address, reason) from None
    return client


async def _ask_who(address: str) -> None:
    """Ask who is there; `Client` would wait for ever for one that listens and says nothing."""
    arguments = Security().get_connection_args("client")
    async with rpc(address, timeout=CONNECT_S, connection_args=arguments) as there:
        who = (await there.identity())["type"]
    if who != "Scheduler":
        raise ValueError(f"this is the address of a {who.lower()}")


def _through(client: Client, address: str, jobs: Sequence[Job]) -> Iterator[tuple[Job, list[Row]]]:
    """Give results as they come; what is still to do is cancelled at the end, however it comes."""
    rounds: dict[str, int] = {}

    def submit(job: Job) -> Future[list[Row] | str]:
        rounds[job.file_name] = rounds.get(job.file_name, 0) + 1
        names = {"versions": _versions(), "job": pickle.dumps(job)}
        return client.submit(eval, CALL, names, pure=False)

    waiting = {submit(job): job for job in jobs}
    try:
        running = as_completed(list(waiting), loop=client.loop)
        for future in _heeding_ctrl_c(running):
            job = waiting.pop(future)
            try:
                rows = future.result()
            except KilledWorker:
                if rounds[job.file_name] == ROUNDS:
                    reason = f"every worker is lost that computes {job.cell.name!r}; out of memory?"
                    raise ClusterError(address, reason) from None
                again = submit(job)
                waiting[again] = job
                running.add(again)
                continue
            except (CancelledError, CommClosedError):
                reason = "the scheduler was lost; the same command continues"
                raise ClusterError(address, reason) from None
            except Exception as error:
                reason = f"a worker cannot compute: {_first_line(error)}"
                raise ClusterError(address, reason) from error
            if isinstance(rows, str):
                reason = f"a worker has {rows}; install the same version everywhere"
                raise ClusterError(address, reason)
            yield job, rows
    finally:
        if client.status == "running":
            client.cancel(list(waiting))


def _heeding_ctrl_c(futures: as_completed) -> Iterator[Any]:
    """Give each future; a Ctrl-C counts between two of them: Dask's callbacks would swallow it."""
    if threading.current_thread() is not threading.main_thread():
        yield from futures
        return
    came: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _frame: came.append(number))
    try:
        while not futures.is_empty():
            if came:
                raise KeyboardInterrupt
            if futures.has_ready():
                yield next(futures)
            else:
                select.select([], [], [], POLL_S)
    finally:
        signal.signal(signal.SIGINT, before)


def _first_line(error: Exception) -> str:
    if isinstance(error, MemoryError):  # it took words of another protocol for a length
        return "something else does, as a dashboard would"
    said = str(error).splitlines()
    return said[0] if said else type(error).__name__
