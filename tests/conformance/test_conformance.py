"""The mock answers as the real autopilots were recorded to answer."""

import pytest
from differences import unexplained
from report import PAGE, SUITES, compared, page, row, rows_of

WRITTEN = PAGE.read_text("utf-8")


@pytest.mark.parametrize("suite", SUITES)
def test_the_mock_answers_as_recorded(suite: str) -> None:
    comparison = compared(suite)
    assert not unexplained(comparison), "new differences"
    assert row(comparison) in rows_of(WRITTEN), "some are gone, or more: run report.py --accept"


def test_the_page_tells_of_every_suite_and_every_known_difference() -> None:
    rows = rows_of(WRITTEN)
    assert [line.split(" | ")[0] for line in rows] == [f"| {suite}" for suite in SUITES]
    assert page(rows) == WRITTEN, "run report.py --accept"
