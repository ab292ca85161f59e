"""The mock answers as the real autopilots were recorded to answer."""

import pytest
from differences import outdated, unexplained, waiting
from report import PAGE, SUITES, compared, page


@pytest.mark.parametrize("suite", SUITES)
def test_the_mock_answers_as_recorded(suite: str) -> None:
    kinds = set(unexplained(compared(suite)))
    waits = set(waiting().get(suite, []))
    assert not kinds - waits, "new differences"
    assert not waits - kinds, "gone: run report.py --accept"


def test_every_known_difference_still_occurs() -> None:
    assert not outdated([compared(suite) for suite in SUITES])


def test_the_page_is_current() -> None:
    written = page([compared(suite) for suite in SUITES])
    assert PAGE.read_text("utf-8") == written, "run report.py --accept"
