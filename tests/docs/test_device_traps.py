"""The page of devices that differ: every line names a test, and every test that it names is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from drivers.bus.cia402.plausible import Statement, rated_torque

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "device-traps.md"
TEST = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")


def rows() -> list[str]:
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.startswith("| ") and not line.startswith("| what ")]


def test_the_question_that_it_shows_is_the_one_that_is_asked() -> None:
    (shown,) = re.findall(r"^```text\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    stated = Statement(rated_torque=637_000, rated_current=1600, largest_speed=6000)
    assert " ".join(shown.split()) == str(rated_torque(stated, 0.637))


def test_every_line_names_its_test() -> None:
    assert len(rows()) >= 25
    for row in rows():
        last = row.rstrip("| ").rsplit("|", 1)[1]
        assert TEST.search(last) or last.strip() == "the same", row


def test_every_test_that_it_names_is_there() -> None:
    for path, name in TEST.findall(PAGE.read_text(encoding="utf-8")):
        tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
        assert name in {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}, name
