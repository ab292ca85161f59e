"""What a test run says at its end."""

from __future__ import annotations

from pytest import TerminalReporter  # noqa: PT013 - a type


def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    """Print how long each row of docs/safety.md took to be detected, in mission time."""
    rows: dict[str, list[tuple[float, float]]] = {}
    for report in terminalreporter.getreports("passed"):
        for name, value in report.user_properties:
            if name == "detected":
                row, took_s, within_s = value
                rows.setdefault(row, []).append((took_s, within_s))
    if not rows:
        return
    terminalreporter.section("safety: detected after, seconds of mission time")
    for row, times in sorted(rows.items()):
        worst_s, within_s = max(took for took, _ in times), max(within for _, within in times)
        terminalreporter.line(f"{row:32} {worst_s:6.2f}  (table: {within_s:g} s, and two ticks)")
