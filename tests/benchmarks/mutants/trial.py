"""One mutant tried: put into a copy of the tree, the tests that reach it run there until one fails."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.benchmarks.mutants.draw import Mutant
from tests.benchmarks.mutants.reach import Reach, searched_first

AT_ONCE = 400
"""Tests that one call of pytest is given."""
START_S = 60.0
"""s that Python, collection and compiled kernels may take beside the tests."""
LOOKS = 3
"""How often a test that fails without the mutant too is left out and the rest tried again."""
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S.*?)(?: - .*)?$", re.MULTILINE)


@dataclass(frozen=True)
class Copy:
    """A copy of the tree, in which one module at a time is changed."""

    root: Path

    @classmethod
    def of(cls, root: Path, to: Path) -> Copy:
        """The files that git knows, those that are new among them."""
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=root, check=True, capture_output=True, text=True,
        ).stdout  # fmt: skip
        for name in filter(None, listed.split("\0")):
            if (root / name).is_file():
                (to / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(root / name, to / name)
        return cls(to)

    def put(self, module: str, source: str) -> None:
        """Change a module; what was compiled of it before is forgotten."""
        path = self.root / module
        path.write_text(source, encoding="utf-8")
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
            compiled.unlink()

    def test(self, tests: Sequence[str], seconds: float) -> tuple[str, str]:
        """Run tests until one fails: "passed", "failed" with its name, or "too long"."""
        environment = {
            key: value for key, value in os.environ.items() if key != "PYTHONPYCACHEPREFIX"
        }
        environment |= {"PYTHONPATH": searched_first(self.root), "PYTHONDONTWRITEBYTECODE": ""}
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-x",
            "-rfE",
            "--tb=no",
            "-p",
            "no:cacheprovider",
        ]
        with subprocess.Popen(
            [*command, *tests], cwd=self.root, env=environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        ) as process:  # fmt: skip
            try:
                said, _ = process.communicate(timeout=seconds)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, 9)
                return "too long", ""
        if process.returncode == 0:
            return "passed", ""
        named = FAILED.search(said)
        return "failed", named.group(1) if named else said.strip()[-300:]


def chosen_tests(mutant: Mutant, reach: Reach, each: float) -> tuple[list[str], list[str], int]:
    """The tests that reach the mutant's lines, then those of its module's files, as many as fit into `each` seconds;
    and how many that reach its lines did not fit.
    """
    near = reach.of_lines(mutant.module, mutant.line, mutant.last_line)
    far = [test for test in reach.of_module(mutant.module) if test not in set(near)]
    spent, fitting = 0.0, set[str]()
    for test in (*near, *far):
        spent += reach.seconds.get(test, 0.0)
        if spent > each:
            break
        fitting.add(test)
    asked = [test for test in near if test in fitting]
    return asked, [test for test in far if test in fitting], len(near) - len(asked)


def tried(
    copy: Copy, mutant: Mutant, source: str, reach: Reach, each: float, factor: float
) -> dict[str, Any]:
    """The row of a mutant: its verdict, who killed it, how long that took."""
    begun = time.monotonic()
    near, far, left_out = chosen_tests(mutant, reach, each)
    verdict, by = "survived" if near else "not reached", ""
    for tests in (*_in_parts(near), *_in_parts(far)):
        verdict_of_part, by = _asked(copy, mutant, source, tests, reach, factor)
        if verdict_of_part:
            verdict = verdict_of_part
            break
    return {
        "module": mutant.module,
        "line": mutant.line,
        "kind": mutant.kind,
        "diff": mutant.diff(source),
        "verdict": verdict,
        "by": by,
        "tests": len(near),
        "other_tests": len(far),
        "not_asked": left_out,
        "seconds": round(time.monotonic() - begun, 1),
    }


def _in_parts(tests: list[str]) -> list[list[str]]:
    return [tests[start : start + AT_ONCE] for start in range(0, len(tests), AT_ONCE)]


def _asked(
    copy: Copy, mutant: Mutant, source: str, tests: list[str], reach: Reach, factor: float
) -> tuple[str, str]:
    """Whether these tests kill the mutant, and which of them; a test that fails without it as well says nothing."""
    left = list(tests)
    for _ in range(LOOKS):
        patience = START_S + factor * sum(reach.seconds.get(test, 0.0) for test in left)
        copy.put(mutant.module, mutant.applied(source))
        try:
            ended, by = copy.test(left, patience)
        finally:
            copy.put(mutant.module, source)
        if ended == "passed":
            return "", ""
        if ended == "too long":
            return "killed by time", ""
        if by not in left or copy.test([by], patience)[0] == "passed":
            return "killed", by
        left.remove(by)
        if not left:
            return "", ""
    return "", ""
