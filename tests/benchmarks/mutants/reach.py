"""Which tests reach which line: one run of the tests with every line noted, kept in a file."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PLUGIN = "tests.benchmarks.mutants.cover"


@dataclass(frozen=True)
class Reach:
    """Tests by module and line, how long each takes [s], and those that cannot be asked: they fail as it is."""

    lines: dict[str, dict[int, list[str]]]
    seconds: dict[str, float]
    failed: frozenset[str]

    def of_lines(self, module: str, first: int, last: int) -> list[str]:
        """The tests that reach one of these lines, the quickest first."""
        reached = self.lines.get(module, {})
        found = {test for line in range(first, last + 1) for test in reached.get(line, ())}
        return self._in_order(found)

    def of_module(self, module: str) -> list[str]:
        """All tests of every file in which a test reaches the module, those that reach it first."""
        direct = {test for tests in self.lines.get(module, {}).values() for test in tests}
        files = {test.partition("::")[0] for test in direct}
        beside = {test for test in self.seconds if test.partition("::")[0] in files} - direct
        return self._in_order(direct) + self._in_order(beside)

    def _in_order(self, tests: set[str]) -> list[str]:
        able = tests - self.failed
        return sorted(able, key=lambda test: (self.seconds.get(test, 0.0), test))


def searched_first(root: Path) -> str:
    """PYTHONPATH by which this tree is imported, by the processes that tests start as well."""
    return os.pathsep.join(filter(None, (str(root), os.environ.get("PYTHONPATH"))))


def reached(
    root: Path, modules: Sequence[str], tests: Sequence[str], where: Path, processes: int
) -> Reach:
    """Who reaches what, from the file if it is of these modules and tests as they are now."""
    said = [*tests, *(f"{module} {(root / module).read_text('utf-8')}" for module in modules)]
    stamp = hashlib.sha256("\n".join(said).encode()).hexdigest()
    found = json.loads(where.read_text()) if where.exists() else {}
    if found.get("stamp") != stamp:
        found = {"stamp": stamp, **_run(root, modules, tests, processes)}
        where.write_text(json.dumps(found))
    lines = {
        module: {int(line): who for line, who in by_line.items()}
        for module, by_line in found["lines"].items()
    }
    return Reach(lines, found["seconds"], frozenset(found["failed"]))


def _run(
    root: Path, modules: Sequence[str], tests: Sequence[str], processes: int
) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="mutants-map-") as folder:
        environment = {
            **os.environ,
            "MUTANTS_MODULES": ":".join(modules),
            "MUTANTS_MAP": folder,
            "PYTHONPATH": searched_first(root),
        }
        parallel = ["-n", str(processes), "--dist", "loadfile"] if processes > 1 else []
        command = [sys.executable, "-m", "pytest", "-q", "-p", PLUGIN, "-p", "no:cacheprovider"]
        subprocess.run(
            [*command, *parallel, *tests], cwd=root, env=environment, stdout=sys.stderr, check=False
        )
        parts = [json.loads(path.read_text()) for path in sorted(Path(folder).glob("map-*.json"))]
    if not parts:
        raise RuntimeError("the tests did not run: see above")
    return _joined(parts)


def _joined(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    lines: dict[str, dict[str, set[str]]] = {}
    seconds: dict[str, float] = {}
    failed: set[str] = set()
    for part in parts:
        seconds |= part["seconds"]
        failed |= set(part["failed"])
        for module, by_line in part["lines"].items():
            for line, who in by_line.items():
                lines.setdefault(module, {}).setdefault(line, set()).update(who)
    ordered = {
        module: {line: sorted(who) for line, who in by_line.items()}
        for module, by_line in lines.items()
    }
    return {"lines": ordered, "seconds": seconds, "failed": sorted(failed)}
