"""What a page names is there: every file and folder of the repository, every module, class and function."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.test_paper import resolve

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    page
    for page in (*ROOT.glob("[!C]*.md"), ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/**/*.md"))
    if not {"generated", "_build"} & set(page.parts)
)
"""All but the changelog, which names modules of earlier versions."""

_FLOORS = "rig|model|drivers|experiments|sim_backend"
_PATH = re.compile(rf"`((?:{_FLOORS}|tests|docs|\.ci|\.github)/[^`\s]*)`")
_DOTTED = re.compile(rf"`((?:{_FLOORS})(?:\.\w+)+)`")

pytest.importorskip("experiments.quantity")
pytest.importorskip("experiments.steps.vocabulary")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_place_that_a_page_names_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for path in _PATH.findall(text):
        assert (ROOT / path.partition("::")[0]).exists(), path
    for dotted in _DOTTED.findall(text):
        if not dotted.endswith(".toml"):
            resolve(dotted)
