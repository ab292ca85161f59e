"""The examination on real links: sockets, a clock, and nothing that decides."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from swarm_ctl.controller import Clock
from swarm_ctl.doctor.diagnosis import diagnose, fixes
from swarm_ctl.doctor.examination import Examination, Question
from swarm_ctl.link import Link, open_link

TICK_S = 0.02
"""Short beside the time a parameter takes, several of which are on their way at once."""


async def examine(
    question: Question, clock: Clock, show: Callable[[float], None], *, is_fixing: bool
) -> Examination:
    """Examine everybody on the links of a question, and set right what may be, if told to."""
    with _open(question.urls) as links:
        examination = Examination(question, clock.now())
        for url, link in links.items():
            link.watch(partial(_hear, examination, clock, url))
        await _go_on(examination, links, clock, show)
        if is_fixing:
            _fix(examination, clock.now())
            await _go_on(examination, links, clock, show)
            for patient in examination.patients:
                patient.check_fixed()
    return examination


async def _go_on(
    examination: Examination,
    links: dict[str, Link],
    clock: Clock,
    show: Callable[[float], None],
) -> None:
    while not examination.is_over(now := clock.now()):
        for outgoing in examination.tick(now):
            links[outgoing.url].send(outgoing.data, outgoing.to)
        show(examination.progress(now))
        await clock.sleep_until(now + TICK_S)


def _hear(
    examination: Examination, clock: Clock, url: str, data: bytes, source: tuple[str, int]
) -> None:
    examination.receive(url, source, data, clock.now())


def _fix(examination: Examination, now: float) -> None:
    for patient, findings in diagnose(examination).items():
        wanted = fixes(findings)
        if wanted and not patient.chart.armed:
            patient.fix(wanted, now)


@contextlib.contextmanager
def _open(urls: Sequence[str]) -> Iterator[dict[str, Link]]:
    with contextlib.ExitStack() as stack:
        links = {}
        for url in urls:
            links[url] = open_link(url)
            stack.callback(links[url].close)
        yield links


def run(question: Question, show: Callable[[float], None], *, is_fixing: bool) -> Examination:
    """Examine from outside an event loop."""
    return asyncio.run(examine(question, Clock(question.speed), show, is_fixing=is_fixing))
