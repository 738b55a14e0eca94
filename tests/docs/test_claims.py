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
    # Sentences of the pages of 0.2.0 that were wrong, then or by now.
    "there is no public python interface yet",  # `import rig`, and a page of it
    "a file may point at data outside itself",  # refused since: the run file's layout
    "a header and no rows, or with less than a header, holds nothing",  # it held 361 kB of rows
    "page one alone is enough",  # its points were moved, not measured
    "what is not said is in no budget",  # an assumed line of its kind
    "it holds at the temperature of the run",  # the starting torque is given at 20 degC as well
    "an order that may be nothing is never called identified",  # a whole order from a quarter of its turn was
    'an estimate is "yes" unless you say otherwise',  # the contract finds what a protocol did not say
    "another motor of the same name on the same bench",  # cards and other tares are asked
    "standstill is verified whatever happens",  # verified, or said to be not verified
    "belongs to a made-up maker and judges simulated rigs only",  # and one part only
    # Words of the house that no engineer would look for.
    "eight layers of its own",
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
