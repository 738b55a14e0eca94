"""The pages on Python are true: every cell of the tutorial runs, the recipe passes, every public name is described."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import pytest

import rig
from tests.docs.building import hold_against_kept

DOCS = Path(__file__).parents[2] / "docs"
_CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)
_TEST = re.compile(r"^```python\n# (tests/\S+\.py)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def run_cell(code: str, names: dict[str, Any]) -> None:
    """A cell as a notebook runs it: the value of its last expression is shown."""
    tree = ast.parse(code)
    last = tree.body[-1]
    shown = None
    if isinstance(last, ast.Expr):
        shown = ast.Expression(last.value)
        del tree.body[-1]
    exec(compile(tree, "cell", "exec"), names)
    if shown is not None:
        print(repr(eval(compile(shown, "cell", "eval"), names)))


def test_every_cell_of_the_tutorial_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("xarray")
    monkeypatch.chdir(tmp_path)
    page = DOCS / "tutorial" / "python.md"
    cells = _CELL.findall(page.read_text(encoding="utf-8"))
    assert len(cells) > 10
    names: dict[str, Any] = {}
    printed = []
    for number, cell in enumerate(cells, start=1):
        run_cell(cell, names)
        printed.append((f"cell {number}", capsys.readouterr().out))
    hold_against_kept(page, printed, tmp_path)
    told = "".join(text for _, text in printed)
    assert "('COMPLETED', 1000.0, 'N m')" in told
    assert "tare: 00001-motor_tare-unknown" in told
    assert "was not used" not in told
    assert "the kind of fit must be named" in told
    assert (tmp_path / "report.html").is_file()
    assert names["coulomb"].uncertainty > 0.0


def test_the_cell_of_the_reference_runs(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    page = DOCS / "reference" / "python.md"
    (cell,) = _CELL.findall(page.read_text(encoding="utf-8"))
    run_cell(cell, {})
    hold_against_kept(page, [("cell 1", capsys.readouterr().out)], tmp_path)


def test_the_recipe_for_another_project_passes(tmp_path: Path) -> None:
    text = (DOCS / "howto" / "test-in-ci.md").read_text(encoding="utf-8")
    ((_, code),) = _TEST.findall(text)
    names: dict[str, Any] = {}
    exec(compile(code, "recipe", "exec"), names)
    (test,) = [made for name, made in names.items() if name.startswith("test_")]
    test(tmp_path)
    assert list(tmp_path.rglob("*.h5")), "the recipe runs something"


def test_every_public_name_is_on_the_reference_page() -> None:
    text = (DOCS / "reference" / "python.md").read_text(encoding="utf-8")
    described = set(re.findall(r"^\.\. auto\w+:: rig\.(\w+)$", text, re.MULTILINE))
    assert described == set(rig.__all__)
