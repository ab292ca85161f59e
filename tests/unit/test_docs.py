from __future__ import annotations

import doctor_tables
import mock_tables


def test_the_page_on_mock_vehicles_says_what_they_support() -> None:
    assert mock_tables.page() == mock_tables.PAGE.read_text(encoding="utf-8"), (
        "run: python tests/mock_tables.py"
    )


def test_the_page_on_the_doctor_says_what_it_looks_at() -> None:
    assert doctor_tables.page() == doctor_tables.PAGE.read_text(encoding="utf-8"), (
        "run: python tests/doctor_tables.py"
    )
