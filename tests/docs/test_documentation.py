"""The documentation is short and whole: every command in it exists, every page shows something and can be found."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import typer

from rig import main
from tests.docs.building import DOCS, building, versions
from tests.docs.page_commands import PAGES, ROOT

_INLINE = re.compile(r"`(rig [a-z][^`\n]*)`")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_command_that_is_mentioned_exists(page: Path) -> None:
    top = typer.main.get_command(main.app)
    for text in _INLINE.findall(page.read_text(encoding="utf-8")):
        command, words = top, text.split()[1:]
        while words and hasattr(command, "commands") and not words[0].startswith("-"):
            if words[0] == "COMMAND":
                return
            assert words[0] in command.commands, f"{page.name}: {text}"
            command = command.commands[words.pop(0)]
        known = {
            name
            for parameter in command.params
            for name in (*parameter.opts, *parameter.secondary_opts)
        }
        takes_more = command.context_settings.get("ignore_unknown_options", False)
        for word in words:
            if word.startswith("--") and not takes_more:
                assert word.partition("=")[0] in {*known, "--help"}, f"{page.name}: {text}"


MADE = (DOCS / "drills.md", DOCS / "reference" / "safety-path.md")
"""Pages that the program writes, beside those of `reference/generated`."""


def test_the_pages_stay_short() -> None:
    """What is added to a page takes something away: they are read once, at a bench."""
    written = [
        page
        for page in DOCS.rglob("*.md")
        if page not in MADE and not {"generated", "_build"} & set(page.parts)
    ]
    assert len(written) > 60
    words = sum(len(page.read_text(encoding="utf-8").split()) for page in written)
    assert words <= 40_000
    unreleased = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")[1]
    assert len(unreleased.split()) <= 800, "what is not released yet is one page"


FIGURES = (*MADE, DOCS / "measured.md")
"""Pages that are figures from their first table on."""
FIRST_SCREEN = 26
"""Lines of a page that one sees without scrolling."""
_SHOWN = re.compile(r"!\[|\]\([^)]*screenshots/|^```(sh|text|\{code-cell\})", re.MULTILINE)


@pytest.mark.parametrize(
    "page",
    [one for one in PAGES if one.is_relative_to(DOCS) and one not in FIGURES],
    ids=lambda p: str(p.relative_to(DOCS)),
)
def test_every_page_shows_something_on_its_first_screen(page: Path) -> None:
    """A picture, or what a command prints: it is kept under each command by `hold_against_kept`."""
    first = page.read_text(encoding="utf-8").splitlines()[:FIRST_SCREEN]
    assert _SHOWN.search("\n".join(first))


@pytest.mark.parametrize(
    ("kept", "printed", "is_same"),
    [
        ("drift  10.0 ± 7.9  × 10⁻⁶ N m/s", "drift  14.0 ± 8.0  × 10⁻⁶ N m/s", True),
        ("drift  10.0 ± 7.9  × 10⁻⁶ N m/s", "drift  19.0 ± 8.0  × 10⁻⁶ N m/s", False),
        ("running torque: 81.0 ± 2.8 mN m", "running torque: 85.0 ± 2.8 mN m", False),
        ("K/J_o: 473\u202f777 ± 6\u202f160 1/s²", "K/J_o: 473\u202f735 ± 6\u202f240 1/s²", True),
        ("static  1.193 ± ?  × 10⁶ N  no", "static  167\u202f457 ± ?  N  no", True),
        ("offset  0.01 ± 0.11 mN m  yes", "offset  0.01 ± 0.11 mN m  weakly", False),
    ],
)
def test_another_processor_may_print_another_value_within_its_uncertainty(
    kept: str, printed: str, is_same: bool
) -> None:
    assert (building("printed_output").differing([kept], [printed]) == []) is is_same


def test_what_pages_print_is_of_the_analyses_as_they_are() -> None:
    """A value is held within its U alone: each processor has its own last digits."""
    kept = building("printed_output").VERSIONS.read_text(encoding="utf-8")
    assert kept == versions(), "RENEW_PRINTED=1 pytest tests/docs tests/extras writes it anew"


def test_the_picture_of_the_house_is_that_of_the_contracts() -> None:
    house = building("make_house_picture")
    assert house.shown() == house.layers(), "python docs/make_house_picture.py makes it anew"


def test_every_picture_that_is_kept_stands_in_a_page() -> None:
    pages = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    kept = {picture.name for picture in (DOCS / "screenshots").iterdir()}
    assert kept
    assert {name for name in kept if f"screenshots/{name}" not in pages} == set()


def test_the_pictures_of_the_window_are_those_of_the_window_as_it_is() -> None:
    assert building("picture_sources").are_new(), "python docs/make_screenshots.py makes them anew"


def test_every_page_is_in_the_table_of_contents() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for page in PAGES:
        if page.is_relative_to(DOCS) and page.name != "index.md":
            assert str(page.relative_to(DOCS).with_suffix("")) in index
