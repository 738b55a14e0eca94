"""The documentation is true: every command in it is run as it stands, and every page can be found."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest
import typer

from rig import main
from tests.docs.building import building, commands_of, hold_against_kept, versions
from tests.docs.given_files import lay_out
from tests.outside_package import found_in, installed_into
from tests.rig.slow_computer import says_too_slow

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(
    path
    for path in (*DOCS.glob("*.md"), *DOCS.glob("[!_]*/*.md"), ROOT / "README.md")
    if "generated" not in path.parts
)
_INLINE = re.compile(r"`(rig [a-z][^`\n]*)`")
STARTING_TIME = 600.0
"""s that a process in the background may take until it has written the file that others wait for."""


def run_here(
    command: str, capsys: pytest.CaptureFixture[str], *, real_time: bool = False
) -> tuple[int, str]:
    """A command in this process, as the shell would give it; its exit code and what it prints. In real time the page is
    right as well where the command says that this computer was too slow.
    """
    words = [
        str(match)
        for word in shlex.split(command)[1:]
        for match in (sorted(Path().glob(word)) if "*" in word else [word])
    ]
    with pytest.raises(SystemExit) as ended:
        main.run(words)
    code = ended.value.code
    told = capsys.readouterr()
    if code not in (0, None):
        print(f"{command}: {code}\n{told.out[-2000:]}\n{told.err[-2000:]}")
        if real_time and says_too_slow(told.out + told.err):
            return 0, told.out
    return int(code or 0), told.out


@contextmanager
def in_background(command: str) -> Iterator[None]:
    """A command that goes on until the page is done, once it has written the file that it names."""
    words = shlex.split(command)
    expected = Path(words[words.index("--config-out") + 1])
    with subprocess.Popen([sys.executable, "-m", *words], stdout=subprocess.DEVNULL) as process:
        until = time.monotonic() + STARTING_TIME
        while not expected.exists() and process.poll() is None and time.monotonic() < until:
            pass
        yield
        process.terminate()
        assert process.wait(STARTING_TIME) == 0


EXTRAS = {
    "fit-a-thousand-runs": ("pyarrow", "distributed", "duckdb"),
    "export-to-mujoco": ("mujoco",),
    "export-to-ros": ("mujoco",),
}
"""Pages whose commands need packages of an extra; where one is missing the gate is the one that runs them."""


PACKAGED = {"add-a-protocol", "add-a-fit"}
"""Pages whose commands are those of the package that the page prints."""


def lacks_extra(page: Path) -> bool:
    """Whether the commands of a page cannot be run here."""
    return (
        not all(map(find_spec, EXTRAS.get(page.stem, ())))
        and os.environ.get("HARMONIC_RIG_EXTRAS") != "all"
    )


def marks_of(page: Path) -> list[pytest.MarkDecorator]:
    """A page that serves a rig on a bus, and turns it, does so in wall time."""
    return [pytest.mark.realtime] if commands_of(page)[0].endswith("&") else []


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=marks_of(page), id=str(page.relative_to(ROOT)))
        for page in PAGES
        if commands_of(page)
    ],
)
def test_every_command_of_a_page_works(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if lacks_extra(page):
        pytest.skip("its extra is not installed")
    monkeypatch.chdir(tmp_path)
    lay_out(page, tmp_path)
    commands = commands_of(page)
    if commands[0].endswith("&"):
        with in_background(commands[0].rstrip("& ")):
            ended = [(one, *run_here(one, capsys, real_time=True)) for one in commands[1:]]
    elif page.stem in PACKAGED:
        with found_in(installed_into(tmp_path / "site")):
            ended = [(one, *run_here(one, capsys)) for one in commands]
    else:
        ended = [(one, *run_here(one, capsys)) for one in commands]
    # 3 is MARGINAL and 1 FAIL: verdicts of a gear, as a reader of the page would get them.
    wrong = {command: code for command, code, _ in ended if code not in (0, 3)}
    assert not wrong
    if DOCS in page.parents and not commands[0].endswith("&"):
        hold_against_kept(page, [(one, text) for one, _, text in ended], tmp_path)


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
    assert kept == versions(), "RENEW_PRINTED=1 pytest tests/docs writes it anew"


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
