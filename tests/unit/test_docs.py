from __future__ import annotations

from pathlib import Path

import doctor_tables
import mock_tables

from swarm_ctl.autopilot.ardupilot import ARDUPILOT
from swarm_ctl.autopilot.px4 import PX4

AUTOPILOTS = Path(__file__).parents[2] / "docs" / "autopilots.md"


def test_the_page_on_mock_vehicles_says_what_they_support() -> None:
    assert mock_tables.page() == mock_tables.PAGE.read_text(encoding="utf-8"), (
        "run: python tests/mock_tables.py"
    )


def test_the_page_on_the_doctor_says_what_it_looks_at() -> None:
    assert doctor_tables.page() == doctor_tables.PAGE.read_text(encoding="utf-8"), (
        "run: python tests/doctor_tables.py"
    )


def test_the_page_on_autopilots_names_their_streams_and_failsafes() -> None:
    words = AUTOPILOTS.read_text(encoding="utf-8").replace("`", "").replace(",", " ").split()
    for pilot in (PX4, ARDUPILOT):
        assert set(pilot.streams_hz) <= set(words)
        assert {pilot.mode_name(mode) for mode in pilot.failsafe_modes} <= {
            word.rstrip(".") for word in words
        }
