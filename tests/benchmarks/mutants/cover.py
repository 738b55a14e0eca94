"""A plugin of pytest that notes which test reaches which line: `python -m pytest -p tests.benchmarks.mutants.cover`.

`MUTANTS_MODULES` names the modules (paths, joined by ":"), `MUTANTS_MAP` the folder that takes what was found, one file
of each process. Lines that a fixture of a wider scope than one test reaches belong to every test that asks for it.
Needs `coverage` (a tool of this script: `pip install coverage`).
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Any

import coverage
import pytest

SHARED = "fixture:"


class Cover:
    """Lines by test, how long each test took, and which did not pass."""

    def __init__(self) -> None:
        self.root = Path.cwd()
        self.modules = [
            str(self.root / module) for module in os.environ["MUTANTS_MODULES"].split(":")
        ]
        self.cover = coverage.Coverage(data_file=None, include=self.modules, config_file=False)
        self.users: dict[str, list[str]] = defaultdict(list)
        self.seconds: dict[str, float] = defaultdict(float)
        self.failed: set[str] = set()
        self.context = ""
        self.cover.start()

    @pytest.hookimpl
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        for item in items:
            for name in getattr(item, "fixturenames", ()):
                self.users[name].append(item.nodeid)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        self._switch(item.nodeid)
        try:
            return (yield)
        finally:
            self._switch("")

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, Any, Any]:
        before = self.context
        if fixturedef.scope != "function":
            self._switch(SHARED + fixturedef.argname)
        try:
            return (yield)
        finally:
            self._switch(before)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] += report.duration
        if report.outcome != "passed":
            self.failed.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        self.cover.stop()
        data = self.cover.get_data()
        lines: dict[str, dict[int, list[str]]] = {}
        for module in self.modules:
            reached = data.contexts_by_lineno(module)
            name = Path(module).relative_to(self.root).as_posix()
            lines[name] = {line: sorted(self._tests(who)) for line, who in reached.items()}
        found = {"lines": lines, "seconds": self.seconds, "failed": sorted(self.failed)}
        folder = Path(os.environ["MUTANTS_MAP"])
        (folder / f"map-{os.getpid()}.json").write_text(json.dumps(found))

    def _tests(self, contexts: Iterable[str]) -> set[str]:
        tests: set[str] = set()
        for context in contexts:
            if context.startswith(SHARED):
                tests.update(self.users[context.removeprefix(SHARED)])
            elif context:
                tests.add(context)
        return tests

    def _switch(self, context: str) -> None:
        self.context = context
        self.cover.switch_context(context)


def pytest_configure(config: pytest.Config) -> None:
    """In every process that runs tests, not in the one that hands them out."""
    if not getattr(config.option, "numprocesses", None):
        config.pluginmanager.register(Cover(), "mutants-cover")
