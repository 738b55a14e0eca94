"""What a page names is there: every file and folder of the repository, every module, class and function."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

import pytest

from tests.docs.test_paper import resolve

ROOT = Path(__file__).parents[2]
MOST_LINKS = 3
"""Links from README to any page."""
PAGES = sorted(
    page
    for page in (*ROOT.glob("[!C]*.md"), ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/**/*.md"))
    if not {"generated", "_build"} & set(page.parts)
)
"""All but the changelog, which names modules of earlier versions."""

_FLOORS = "rig|model|drivers|experiments|sim_backend"
_PATH = re.compile(rf"`((?:{_FLOORS}|tests|docs|\.ci|\.github)/[^`\s]*)`")
_DOTTED = re.compile(rf"`((?:{_FLOORS})(?:\.\w+)+)`")
_LINK = re.compile(r"\]\(([^)#\s]+\.md)")
_TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```", re.DOTALL | re.MULTILINE)

pytest.importorskip("experiments.quantity")
pytest.importorskip("experiments.steps.vocabulary")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_place_that_a_page_names_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for path in _PATH.findall(text):
        file, _, name = path.partition("::")
        assert (ROOT / file).exists(), path
        assert not name or is_defined(ROOT / file, name), path
    for dotted in _DOTTED.findall(text):
        if not dotted.endswith(".toml"):
            resolve(dotted)


def test_every_page_is_within_three_links_of_readme() -> None:
    reached = {ROOT / "README.md"}
    for _ in range(MOST_LINKS):
        reached |= {link for page in reached for link in links_of(page)}
    assert set(PAGES) - reached == set()


def is_defined(file: Path, name: str) -> bool:
    """Whether a function, class or constant is defined in a file; of a class by `Class.name`."""
    body: list[ast.stmt] = parsed(file).body
    for part in name.split("."):
        found = next((node for node in body if part in names_of(node)), None)
        if found is None:
            return False
        body = found.body if isinstance(found, ast.ClassDef) else []
    return True


@functools.cache
def parsed(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def names_of(node: ast.stmt) -> set[str]:
    """The names that a statement defines."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return {node.name}
    if isinstance(node, ast.Assign):
        named = [leaf for target in node.targets for leaf in ast.walk(target)]
        return {leaf.id for leaf in named if isinstance(leaf, ast.Name)}
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        return {node.target.id}
    return set()


def links_of(page: Path) -> set[Path]:
    """The pages of the repository that a page links to, or has in its table of contents."""
    text = page.read_text(encoding="utf-8")
    listed = [word for block in _TOCTREE.findall(text) for word in block.split() if word[0] != ":"]
    paths = [*_LINK.findall(text), *(f"{name}.md" for name in listed)]
    linked = {(page.parent / path).resolve() for path in paths if "://" not in path}
    return {path for path in linked if path.is_file() and "generated" not in path.parts}
