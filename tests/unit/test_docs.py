from __future__ import annotations

import mock_tables


def test_the_page_on_mock_vehicles_says_what_they_support() -> None:
    assert mock_tables.page() == mock_tables.PAGE.read_text(encoding="utf-8"), (
        "run: python tests/mock_tables.py"
    )
