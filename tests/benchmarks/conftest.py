"""Collects the ratios that the benchmarks measure and prints them as one table at the end."""

from __future__ import annotations

from collections.abc import Callable

import pytest

Note = Callable[[str, float, str, str], None]
_ROWS: list[tuple[str, float, str, str]] = []


@pytest.fixture(scope="session")
def note() -> Note:
    """note(what, value, unit, aim): one line of the table of results."""

    def add(what: str, value: float, unit: str, aim: str) -> None:
        _ROWS.append((what, value, unit, aim))

    return add


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """The table, in the form that the documentation keeps."""
    if not _ROWS:
        return
    terminalreporter.section("measured")
    terminalreporter.write_line("| what | measured | aim |")
    terminalreporter.write_line("|---|---|---|")
    for what, value, unit, aim in _ROWS:
        terminalreporter.write_line(f"| {what} | {value:.4g} {unit} | {aim} |")
