"""Every test of something optional says what it needs, and nothing else in the suite needs it."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from tests.extras.conftest import NEEDS

HERE = Path(__file__).parent
TESTS = HERE.parent
DISTRIBUTIONS = {"mujoco": "mujoco-core", "myst_parser": "myst-parser", "nptdms": "npTDMS"}
"""Module: its distribution, where that has another name."""


def test_every_test_here_names_the_extra_that_it_needs() -> None:
    files = {path.name for path in HERE.glob("test_*.py")} - {Path(__file__).name}
    assert files == set(NEEDS)


def test_what_is_optional_is_imported_nowhere_else() -> None:
    optional = "|".join(sorted({module for modules in NEEDS.values() for module in modules}))
    imported = re.compile(rf"^\s*(?:import|from) (?:{optional})\b", re.MULTILINE)
    elsewhere = [path for path in TESTS.rglob("*.py") if HERE not in path.parents]
    assert len(elsewhere) > 100
    found = [str(path) for path in elsewhere if imported.search(path.read_text(encoding="utf-8"))]
    assert not found


def test_the_suite_s_own_extra_is_without_them_and_the_gate_s_has_all() -> None:
    project = tomllib.loads((TESTS.parent / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]

    def names(extra: str) -> set[str]:
        found: set[str] = set()
        for requirement in extras[extra]:
            inner = re.fullmatch(r"harmonic-rig\[(.*)\]", requirement)
            if inner is None:
                found.add(re.split(r"[<>=!~;\s]", requirement, maxsplit=1)[0])
            else:
                found |= {name for part in inner[1].split(",") for name in names(part.strip())}
        return found

    optional = {
        DISTRIBUTIONS.get(module, module) for modules in NEEDS.values() for module in modules
    }
    assert not optional & names("test")
    assert optional <= names("check")
