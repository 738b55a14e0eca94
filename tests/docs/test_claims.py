"""What the pages promise: each sentence stands on its page and has its test; what is no longer so stands nowhere."""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
CLAIMS: list[dict[str, Any]] = tomllib.loads(
    (Path(__file__).parent / "claims.toml").read_text(encoding="utf-8")
)["claim"]
NO_LONGER_SO = (
    "there is no public python interface yet",
    "eight layers of its own",
    "a file may point at data outside itself",
    "rung of the ladder",
    "birge",
    "dip by chance",
    "left by measured input",
)
"""Sentences of earlier pages that were wrong, and words of the house that no engineer would look for."""


def on_one_line(text: str) -> str:
    """A page without its line breaks: a sentence may be broken anywhere."""
    return " ".join(text.split())


@pytest.mark.parametrize(
    "claim", CLAIMS, ids=lambda one: f"{Path(one['page']).stem}-{one['says'][:40]}"
)
def test_a_claim_stands_on_its_page_and_a_test_holds_it(claim: dict[str, Any]) -> None:
    page = on_one_line((ROOT / claim["page"]).read_text(encoding="utf-8"))
    assert on_one_line(claim["says"]) in page, (
        "the page says it otherwise by now: does the test still hold it?"
    )
    path, _, name = claim["test"].partition("::")
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    assert name in {one.name for one in tree.body if isinstance(one, ast.FunctionDef)}


def test_the_pages_that_people_trust_are_on_the_list() -> None:
    pages = {one["page"] for one in CLAIMS}
    assert {"README.md", "SECURITY.md", "docs/explanation/safety.md"} <= pages
    assert len(CLAIMS) >= 40


def test_what_is_no_longer_so_stands_nowhere() -> None:
    written = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    told = {
        f"{page.relative_to(ROOT)}: {words}"
        for page in written
        if "generated" not in page.parts and page.name != "CHANGELOG.md"
        for words in NO_LONGER_SO
        if words in on_one_line(page.read_text(encoding="utf-8")).lower()
    }
    assert told == set()
