"""Jobs computed in this process or in several, that are kept as they finish when Ctrl-C comes."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TypeVar

from swarm_ctl.errors import SwarmError

Job = TypeVar("Job")
Result = TypeVar("Result")


@contextmanager
def processes(
    workers: int, run: Callable[[Job], Result]
) -> Iterator[Callable[[Sequence[Job]], Iterator[tuple[Job, Result]]]]:
    """Compute in this process, or in several on this machine that live as long as the block."""
    if workers == 1:
        yield lambda jobs: ((job, run(job)) for job in jobs)
        return
    # spawn: a fork would copy whatever threads numpy and the caller have
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_ignore_ctrl_c)
    try:
        yield lambda jobs: _through(pool, run, jobs)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _through(
    pool: ProcessPoolExecutor, run: Callable[[Job], Result], jobs: Sequence[Job]
) -> Iterator[tuple[Job, Result]]:
    waiting: dict[Future[Result], Job] = {pool.submit(run, job): job for job in jobs}
    try:
        while waiting:
            done, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                yield waiting.pop(future), future.result()
    except KeyboardInterrupt:
        pool.shutdown(wait=True, cancel_futures=True)
        for future, job in waiting.items():
            if not future.cancelled() and future.exception() is None:
                yield job, future.result()
        raise
    except BrokenProcessPool:
        reason = "a worker process was killed; the same command continues"
        raise SwarmError(reason) from None


def _ignore_ctrl_c() -> None:
    """Leave Ctrl-C to the parent, which lets running jobs finish."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
