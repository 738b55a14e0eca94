"""The commands that a page prints, run as they stand in a folder that has what its reader is taken to have."""

from __future__ import annotations

import shlex
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from rig import main
from tests.docs.building import DOCS, commands_of, hold_against_kept
from tests.docs.given_files import lay_out
from tests.outside_package import found_in, installed_into
from tests.rig.slow_computer import says_too_slow

ROOT = DOCS.parent
PAGES = sorted(
    path
    for path in (*DOCS.glob("*.md"), *DOCS.glob("[!_]*/*.md"), ROOT / "README.md")
    if "generated" not in path.parts
)
WITH_EXTRAS = {"fit-a-thousand-runs", "export-to-mujoco", "export-to-ros"}
"""Pages whose commands need packages of an extra: run by `tests/extras`."""
PACKAGED = {"add-a-protocol", "add-a-fit"}
"""Pages whose commands are those of the package that the page prints."""
STARTING_TIME = 600.0
"""s that a process in the background may take until it has written the file that others wait for."""


def with_commands(pages: Iterable[Path]) -> list[Any]:
    """These pages as parameters of a test, those without a command left out. One that serves a rig on a bus, and turns
    it, does so in wall time.
    """
    return [
        pytest.param(
            page,
            marks=[pytest.mark.realtime] if commands_of(page)[0].endswith("&") else [],
            id=str(page.relative_to(ROOT)),
        )
        for page in pages
        if commands_of(page)
    ]


def hold_page(
    page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Run every command of a page, and hold what they print against what the site shows."""
    monkeypatch.chdir(folder)
    lay_out(page, folder)
    commands = commands_of(page)
    if commands[0].endswith("&"):
        with in_background(commands[0].rstrip("& ")):
            ended = [(one, *run_here(one, capsys, real_time=True)) for one in commands[1:]]
    elif page.stem in PACKAGED:
        with found_in(installed_into(folder / "site")):
            ended = [(one, *run_here(one, capsys)) for one in commands]
    else:
        ended = [(one, *run_here(one, capsys)) for one in commands]
    # 3 is MARGINAL and 1 FAIL: verdicts of a gear, as a reader of the page would get them.
    wrong = {command: code for command, code, _ in ended if code not in (0, 3)}
    assert not wrong
    if DOCS in page.parents and not commands[0].endswith("&"):
        hold_against_kept(page, [(one, text) for one, _, text in ended], folder)


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
