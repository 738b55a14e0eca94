"""The window has no verdict of its own: banner, library, head of a run and passport say what `rig.analysis` says."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from rig.analysis.in_force import in_force
from rig.analysis.judging import GearVerdict, judge_run, not_judged, stored_result
from rig.gears.acceptance import acceptance_for
from rig.run.state import RunState, State
from rig.window.main import MainWindow
from rig.window.review.page import ReviewPage
from rig.window.shell.session import WindowSession
from tests.rig.library.stored import write
from tests.rig.test_one_verdict import random_store
from tests.rig.window.reviewing import LONGEST, shown


def judged_by_analysis(run: Path) -> GearVerdict:
    found = in_force(run, "friction")
    stored = stored_result(found, "simulated", "COMPLETED", "A1", path=run)
    return judge_run(stored, acceptance_for(run.parent, "A1"))


def word(text: str) -> str:
    """A verdict without its sign and without what else stands beside it."""
    return text.split(maxsplit=1)[1].removesuffix(", stale") if text else ""


def banner_of(window: MainWindow, run: Path, qtbot: QtBot) -> str:
    """What the banner says once a run that lies there has ended."""
    page = window.run
    page.state = replace(RunState(), state=State.FINISHED, outcome="COMPLETED", ended=True)
    page.outcome.show_end(page.state, {}, run)
    qtbot.waitUntil(lambda: not page.outcome._reading.is_running, timeout=LONGEST)
    assert f"Verdict: {page.state.verdict}" in page.outcome.results.text()
    return page.banner.word


@pytest.mark.parametrize("seed", range(5))
def test_every_place_of_the_window_says_what_the_analysis_says(
    session: WindowSession,
    window: MainWindow,
    opened: Callable[..., ReviewPage],
    qtbot: QtBot,
    seed: int,
) -> None:
    run = random_store(session.folder, random.Random(seed))
    broken_off = write(session.folder, 3, outcome="ABORTED")
    judged, found = judged_by_analysis(run), in_force(run, "friction")
    page = opened()
    page.show_run(run)
    details, library = page.details, page.library
    qtbot.waitUntil(
        lambda: not library.desk.is_running and not details._judging.is_running, timeout=LONGEST
    )
    row = shown(page, "#").index("2")
    assert word(shown(page, "verdict")[row]) == judged.verdict
    assert shown(page, "verdict")[row].endswith("stale") == bool(found.stale)
    assert word(shown(page, "outcome")[row]) == "COMPLETED"
    assert word(details.header.verdict.text()) == judged.verdict
    assert word(details.header.outcome.text()) == "COMPLETED"
    if judged.because:
        assert judged.because[0] in details.header.because.text()
    row = shown(page, "#").index("3")
    assert word(shown(page, "verdict")[row]) == "NOT JUDGED"
    assert word(shown(page, "outcome")[row]) == "ABORTED"

    page.show_passport("A1")
    passport = page.passport
    qtbot.waitUntil(lambda: not passport.is_busy, timeout=LONGEST)
    assert word(passport.verdict.text()) == judged.verdict
    rows = dict(zip(passport.runs.texts("file"), passport.runs.texts("verdict"), strict=True))
    assert word(rows[run.name]) == judged.verdict
    assert broken_off.name not in rows or word(rows[broken_off.name]) == "NOT JUDGED"

    assert banner_of(window, run, qtbot) == f"COMPLETED: {judged.verdict}"


def test_a_broken_off_run_says_so_at_its_head(
    session: WindowSession, opened: Callable[..., ReviewPage], qtbot: QtBot
) -> None:
    run = write(session.folder, 3, outcome="ABORTED")
    page = opened()
    page.show_run(run)
    header = page.details.header
    qtbot.waitUntil(lambda: not page.details._judging.is_running, timeout=LONGEST)
    assert word(header.verdict.text()) == "NOT JUDGED"
    assert not_judged("the run ended as ABORTED").because[0] in header.because.text()
    # Neutral: nothing was judged.
    assert header.verdict.property("part") == "muted"
