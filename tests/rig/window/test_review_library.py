"""The library of the Review page: search, filters, keyboard, runs that come, grow or are damaged, both screens."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QDate, QPersistentModelIndex, Qt
from pytestqt.qtbot import QtBot

from rig.analysis.judging import GearVerdict
from rig.library import reading
from rig.runfile.write import RunWriter
from rig.window.main import MainWindow
from rig.window.review import library_table
from rig.window.review.page import ReviewPage
from rig.window.review.table_model import VERDICT, LibraryFilter, LibraryModel, Wanted
from rig.window.review.table_source import LibrarySource
from rig.window.shell.session import WindowSession
from rig.window.work.verdicts import ListedVerdict
from tests.rig.runfile.making import block, header, write_run
from tests.rig.window.reviewing import LONGEST, destroy, drawn, indexed, several, shown


def test_the_library_is_searched_filtered_and_sorted(
    opened: Callable[..., ReviewPage], session: WindowSession
) -> None:
    several(session.folder)
    page = opened()
    filters = page.library.filters
    assert shown(page) == ["3", "2", "1"]
    assert shown(page, "outcome") == ["▲ TRIPPED", "■ ABORTED", "✓ COMPLETED"]
    assert shown(page, "origin") == ["SIMULATED"] * 3
    filters.text.setText("ada b2")
    assert shown(page) == ["3", "2"]
    filters.outcome.setCurrentText("ABORTED")
    assert shown(page) == ["2"]
    assert page.library.count.text() == "1 of 3 runs"
    filters.clear()
    filters.gear.setCurrentText("A1")
    assert shown(page) == ["1"]
    filters.clear()
    filters.protocol.setCurrentText("friction")
    assert shown(page) == ["3", "2", "1"]
    page.library.table.sortByColumn(0, Qt.SortOrder.AscendingOrder)
    assert shown(page) == ["1", "2", "3"]


def test_the_library_is_filtered_by_days(
    opened: Callable[..., ReviewPage], session: WindowSession
) -> None:
    several(session.folder)
    page = opened()
    period = page.library.filters.period
    for chosen, found in (
        ("today", ["3"]),
        ("last 7 days", ["3", "2", "1"]),
        ("this year", ["3", "2", "1"]),
    ):
        period.setCurrentText(chosen)
        assert shown(page) == found, chosen
    period.setCurrentIndex(period.count() - 1)
    page.library.filters.since.setDate(QDate(2025, 11, 20))
    page.library.filters.until.setDate(QDate(2025, 11, 21))
    assert shown(page) == ["2", "1"]


def test_the_library_goes_by_keyboard(
    opened: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot
) -> None:
    several(session.folder)
    page = opened()
    page.activateWindow()
    qtbot.keyClick(page, Qt.Key.Key_F, Qt.KeyboardModifier.ControlModifier)
    qtbot.waitUntil(page.library.filters.text.hasFocus)
    qtbot.keyClicks(page.library.filters.text, "B2")
    qtbot.keyClick(page.library.filters.text, Qt.Key.Key_Return)
    assert page.library.table.hasFocus()
    qtbot.waitUntil(lambda: page.details.path is not None)
    assert page.details.header.title.text() == "00003-friction-B2"
    qtbot.keyClick(page.library.table, Qt.Key.Key_Down)
    qtbot.waitUntil(lambda: page.details.header.title.text() == "00002-friction-B2")


def test_a_thousand_runs_are_filtered_at_once(session: WindowSession) -> None:
    model = LibraryModel(lambda: session.palette)
    filtered = LibraryFilter()
    filtered.setSourceModel(model)
    model.set_runs([indexed(number) for number in range(1, 1001)])
    filtered.sort(0, Qt.SortOrder.DescendingOrder)
    filtered.set_wanted(Wanted(text="sn-3 a. ex", since="2025-11-10"))
    found = [filtered.index(row, 0).data() for row in range(filtered.rowCount())]
    wanted = [n for n in range(1000, 0, -1) if n % 7 == 3 and 1 + n % 28 >= 10]
    assert found == [str(n) for n in wanted]
    model.set_runs([indexed(number) for number in range(1, 1002)])
    assert model.rowCount() == 1001


def test_a_run_that_comes_is_listed_without_asking(
    opened: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot
) -> None:
    page = opened()
    assert "No runs" in page.library.count.text()
    write_run(session.folder, 200)
    qtbot.waitUntil(lambda: shown(page) == ["1"], timeout=LONGEST)


def test_a_damaged_file_is_listed_and_says_what_is_wrong(
    opened: Callable[..., ReviewPage], session: WindowSession, friction: list[Path], qtbot: QtBot
) -> None:
    bad = session.folder / "00007-friction-SN_0815.h5"
    bad.write_bytes(friction[0].read_bytes()[:30_000])
    page = opened()
    assert shown(page, "outcome")[0] == "! unreadable"
    assert "1 cannot be read" in page.library.count.text()
    page.show_run(bad)
    assert page.details.problem.isVisible()
    assert not page.details.tabs.isVisible()
    assert "cannot be read" in page.details.problem.text()
    page.library.select(bad, friction[0])
    assert not page.library.buttons["overlay"].isEnabled()
    assert not page.library.buttons["difference"].isEnabled()
    page.show_run(friction[0])
    assert page.details.tabs.isVisible()
    assert not page.details.problem.isVisible()


def test_a_run_being_written_is_shown_grows_and_is_followed_to_its_seal(
    opened: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot
) -> None:
    writer = RunWriter(
        session.folder / "00001-friction-A1.h5", header(), compress=False, chunk_rows=64
    )
    writer.append(block(0, 100))
    writer.flush()
    page = opened()
    assert shown(page, "outcome") == ["● being written"]
    page.show_run(writer.part)
    details = page.details
    assert details.header.outcome.text() == "● being written"
    assert "is being written" in details.results.hint.text()
    assert not details.bar.isEnabled()
    assert not page.library.buttons["report"].isEnabled()
    details.tabs.setCurrentWidget(details.signals)
    qtbot.waitUntil(lambda: drawn(details.signals.curves["torque"])[1] > 0.09, timeout=LONGEST)
    writer.append(block(100, 60))
    writer.flush()
    details.refresh()
    assert "160 rows" in details.header.file.text()
    writer.seal("COMPLETED", "2025-11-21T04:41:00.000+00:00")
    qtbot.waitUntil(lambda: details.header.outcome.text() == "✓ COMPLETED", timeout=LONGEST)
    qtbot.waitUntil(lambda: shown(page, "outcome") == ["✓ COMPLETED"], timeout=LONGEST)
    assert details.bar.isEnabled()


def test_a_run_that_is_not_indexed_yet_is_opened_and_chosen_when_it_comes(
    opened: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot
) -> None:
    page = opened()
    path = write_run(session.folder, 200)
    page.show_run(path)
    assert page.details.header.title.text() == "00001-friction-A1"
    qtbot.waitUntil(lambda: page.library.selected == [path], timeout=LONGEST)


def test_everything_fits_both_screens_in_both_themes(
    friction: list[Path], session: WindowSession, qtbot: QtBot
) -> None:
    window = MainWindow(session)
    window.resize(1366, 768)
    window.show()
    window.show_review(friction[1])
    page = window.review
    assert isinstance(page, ReviewPage)
    assert page.minimumSizeHint().width() <= 1366
    for width, height, theme in ((1366, 768, "light"), (1920, 1080, "dark")):
        session.set_theme(theme)
        window.resize(width, height)
        assert (window.width(), window.height()) == (width, height)
        for view in (page.details.results, page.details.signals, page.details.files):
            page.details.tabs.setCurrentWidget(view)
            corner = view.mapTo(window, view.rect().bottomRight())
            assert corner.x() < width
            assert corner.y() < height
        for button in page.library.buttons.values():
            assert (
                button.width()
                >= button.fontMetrics().horizontalAdvance(button.text().replace("&", "")) + 10
            )
    destroy(window)


def test_the_first_reading_of_a_large_folder_says_how_far_it_is(
    friction: list[Path], opened: Callable[..., ReviewPage]
) -> None:
    page = opened()
    page.library.source.progressed.emit(40, 100)
    assert "40 of 100" in page.library.count.text()
    page.library.source.progressed.emit(0, 0)
    assert page.library.count.text() == "2 runs"


def test_a_window_that_goes_reads_no_further(
    friction: list[Path], session: WindowSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []
    source = LibrarySource(session.folder)

    read_one = reading.read_one

    def slowly(path: Path) -> tuple[dict[str, Any], str]:
        read.append(path)
        source._stopped = True  # the window goes while the first file is being read
        return read_one(path)

    monkeypatch.setattr(reading, "read_one", slowly)
    source.look()
    source.stop()
    assert source._thread is not None
    assert not source._thread.is_alive()
    assert len(read) <= 1 < len(friction)


def test_rows_keep_their_order_and_choice_when_runs_and_verdicts_come(
    session: WindowSession,
) -> None:
    model = LibraryModel(lambda: session.palette)
    runs = [indexed(number) for number in range(1, 8)]
    model.set_runs(runs[:5])
    model.sort(0, Qt.SortOrder.DescendingOrder)
    chosen = QPersistentModelIndex(model.index(4, 0))
    assert [run.number for run in model.rows] == [5, 4, 3, 2, 1]
    model.set_runs(runs)
    assert [run.number for run in model.rows] == [7, 6, 5, 4, 3, 2, 1]
    assert (chosen.row(), chosen.data()) == (6, "1")
    assert [run.number for run in model.runs] == list(range(1, 8))
    model.sort(VERDICT)
    assert model.is_sorted_by_verdict
    good = GearVerdict(verdict="PASS")
    model.take_verdicts({runs[3].path: ListedVerdict(good)})
    assert model.rows[-1] is runs[3]
    assert (chosen.row(), chosen.data()) == (0, "1")
    model.take_verdicts({runs[3].path: None})
    assert [run.number for run in model.rows] == list(range(1, 8))


def test_only_what_is_in_view_is_judged_unless_the_order_needs_all(
    opened: Callable[..., ReviewPage], session: WindowSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    several(session.folder)
    library = opened().library
    looked: list[list[int]] = []
    monkeypatch.setattr(library_table, "JUDGED_AT_ONCE", 2)
    monkeypatch.setattr(library.desk, "look", lambda runs: looked.append([r.number for r in runs]))
    library._judge()
    library.table.sortByColumn(VERDICT, Qt.SortOrder.AscendingOrder)
    library._judge()
    every = sorted(run.number for run in library.model.runs)
    assert len(looked[0]) == 2 < len(every)
    assert sorted(looked[1]) == every
