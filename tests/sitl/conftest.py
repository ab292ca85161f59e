"""Simulators of real autopilots, started once per session; tests skip without them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pytest import TerminalReporter  # noqa: PT013 - a type
from sitl.airfield import Airfield, Report
from sitl.simulators import Hangar

MEASURED = "sitl"


@pytest.fixture(scope="session")
def hangar(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hangar]:
    hangar = Hangar(tmp_path_factory.mktemp("simulators"))
    yield hangar
    hangar.close()


@pytest.fixture
def airfield(hangar: Hangar, tmp_path: Path) -> Iterator[Airfield]:
    airfield = Airfield(hangar, tmp_path)
    yield airfield
    airfield.close()


@pytest.fixture(params=["px4", "ardupilot"])
def autopilot(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def report(record_property: Callable[[str, object], None]) -> Report:
    return lambda what, value: record_property(MEASURED, (what, value))


def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    """Print what was measured on the real autopilots."""
    lines = [
        f"{report.nodeid.split('::')[-1]}: {what} {value}"
        for report in terminalreporter.getreports("passed")
        for name, (what, value) in report.user_properties
        if name == MEASURED
    ]
    if lines:
        terminalreporter.section("sitl: measured")
        terminalreporter.line("\n".join(lines))
