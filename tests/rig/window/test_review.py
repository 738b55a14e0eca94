"""The Review page as a person uses it: search, open, fit, overlay, compare, difference, report; and files that are not whole."""

from __future__ import annotations

import contextlib
import io
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QCoreApplication, QDate, QEvent, QPointF, Qt, QTimer, QUrl
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

import rig.main
from model.gear_file import save_gear, shipped_gear
from model.motor import shipped_motor
from rig.fit import fit_files, store
from rig.library import IndexedRun, ListedRun, read_listed
from rig.results import read_analyses
from rig.run.start import RunRequest, run_request
from rig.runfile.write import RunWriter
from rig.window.background import BackgroundCommand
from rig.window.library_table_model import COLUMNS, LibraryFilter, LibraryModel, Wanted
from rig.window.library_table_source import LibrarySource
from rig.window.main import MainWindow
from rig.window.plots import Curve
from rig.window.review import ReviewPage, report_path
from rig.window.review_fit import FitOrder, ResultCache
from rig.window.review_signals_data import shapes_of
from rig.window.session import WindowSession
from tests.rig.runfile.making import block, header, write_run

LONGEST = 40_000
"""ms that a test waits before it fails."""
QUICK = {"points": 6, "lowest_rpm": 300.0, "highest_rpm": 1500.0, "up_and_down": False, "bracket_every": 1000,
         "measure_time": 0.3, "settle_time": 0.2, "zero_time": 0.5}  # fmt: skip
TODAY = date(2025, 11, 25)


@pytest.fixture(scope="session")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two short friction runs of one gear on the simulated rig; the second one is analysed."""
    folder = tmp_path_factory.mktemp("simulated")
    for seed in (1, 2):
        request = RunRequest("friction", shipped_gear(), shipped_motor(), folder, QUICK, gear_serial="SN-0815",
                             operator="A. Example", seed=seed)  # fmt: skip
        assert run_request(request).outcome == "PASS"
    store(fit_files(sorted(folder.glob("*.h5"))[1:])[0], "2025-11-21T05:00:00+00:00")
    return folder


@pytest.fixture
def friction(simulated: Path, session: WindowSession) -> list[Path]:
    """The two runs, in the folder of the window."""
    shutil.copytree(simulated, session.folder, dirs_exist_ok=True)
    return sorted(session.folder.glob("*.h5"))


@pytest.fixture
def opened(session: WindowSession, qtbot: QtBot) -> Iterator[Callable[..., ReviewPage]]:
    """Opens the page over the folder of the session; waits until the folder was read."""
    pages: list[ReviewPage] = []

    def make(**given: object) -> ReviewPage:
        page = ReviewPage(session, today=lambda: TODAY, **given)  # type: ignore[arg-type]
        pages.append(page)
        page.resize(1366, 700)
        page.show()
        qtbot.waitUntil(lambda: page.library.source.runs is not None, timeout=LONGEST)
        return page

    yield make
    for page in pages:
        page.details.cancel()
        page.overlay.cancel()
        destroy(page)


def destroy(widget: QWidget) -> None:
    """Delete a widget now: the next change of theme would style it again."""
    widget.close()
    widget.deleteLater()
    QCoreApplication.sendPostedEvents(widget, QEvent.Type.DeferredDelete)


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands work in this process instead of one of their own: the same words, without the seconds of a start."""

    def start(command: BackgroundCommand) -> None:
        out, aside = io.StringIO(), io.StringIO()
        code = 0
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(aside):
            try:
                rig.main.run(command._arguments[2:])
            except SystemExit as ended:
                code = int(ended.code or 0)
        QTimer.singleShot(0, lambda: command.done.emit(code, out.getvalue(), aside.getvalue()))

    monkeypatch.setattr(BackgroundCommand, "start", start)


def indexed(number: int, **changes: object) -> IndexedRun:
    """A line of the index."""
    made = IndexedRun(
        Path(f"{number:05d}-friction-SN.h5"), f"{number:05d}-friction-SN", number, "sealed", "friction", f"SN-{number % 7}",
        "CSF-25-120", "A. Example", f"2025-11-{1 + number % 28:02d}T10:00:00+00:00", 61.0, "PASS", "simulated", "sim", 61_000,
        "", "",
    )  # fmt: skip
    return replace(made, **changes)  # type: ignore[arg-type]


def several(folder: Path) -> None:
    """Runs of different gears, operators and days, by their headers alone."""
    for number, (serial, day, outcome) in enumerate(
        (("A1", "20", "PASS"), ("B2", "21", "FAIL"), ("B2", "25", "TRIPPED")), 1
    ):
        made = header(f"{number:05d}-friction-{serial}")
        metadata = replace(made.metadata, gear_serial=serial, start_time=f"2025-11-{day}T12:00:00.000+00:00")
        writer = RunWriter(folder / f"{number:05d}-friction-{serial}.h5", replace(made, metadata=metadata))
        writer.append(block(0, 100))
        writer.seal(outcome, f"2025-11-{day}T12:01:00.000+00:00")


def shown(page: ReviewPage, heading: str = "#") -> list[str]:
    """What stands in a column of the library."""
    place = next(i for i, column in enumerate(COLUMNS) if column.heading == heading)
    model = page.library.filtered
    return [str(model.index(row, place).data()) for row in range(model.rowCount())]


def test_the_library_is_searched_filtered_and_sorted(opened: Callable[..., ReviewPage], session: WindowSession) -> None:
    several(session.folder)
    page = opened()
    filters = page.library.filters
    assert shown(page) == ["3", "2", "1"]
    assert shown(page, "outcome") == ["▲ TRIPPED", "✗ FAIL", "✓ PASS"]
    assert shown(page, "origin") == ["SIMULATED"] * 3
    filters.text.setText("ada b2")
    assert shown(page) == ["3", "2"]
    filters.outcome.setCurrentText("FAIL")
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


def test_the_library_is_filtered_by_days(opened: Callable[..., ReviewPage], session: WindowSession) -> None:
    several(session.folder)
    page = opened()
    period = page.library.filters.period
    for chosen, found in (("today", ["3"]), ("last 7 days", ["3", "2", "1"]), ("this year", ["3", "2", "1"])):
        period.setCurrentText(chosen)
        assert shown(page) == found, chosen
    period.setCurrentIndex(period.count() - 1)
    page.library.filters.since.setDate(QDate(2025, 11, 20))
    page.library.filters.until.setDate(QDate(2025, 11, 21))
    assert shown(page) == ["2", "1"]


def test_the_library_goes_by_keyboard(opened: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot) -> None:
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


def test_an_opened_run_says_what_when_who_on_which_gear(
    opened: Callable[..., ReviewPage], friction: list[Path]
) -> None:
    page = opened()
    page.show_run(friction[0])
    head = page.details.header
    assert head.title.text() == friction[0].name.removesuffix(".h5")
    assert (head.mark.text(), head.outcome.text()) == ("SIMULATED", "✓ PASS")
    for word in ("friction", "CSF-25-120", "SN-0815", "A. Example", "33"):
        assert word in head.facts.text()
    assert "SHA-256" in head.file.text()
    assert len(head.file.toolTip()) == 64
    assert "Press Fit" in page.details.results.hint.text()
    assert page.library.selected == [friction[0]]


def test_a_stored_analysis_shows_verdict_interval_and_catalogue(
    opened: Callable[..., ReviewPage], friction: list[Path]
) -> None:
    page = opened()
    page.show_run(friction[1])
    results = page.details.results
    assert results.table.texts("quantity")[0] == "Coulomb friction"
    assert "no" in results.table.texts("identifiable")
    assert "yes" in results.table.texts("identifiable")
    catalogue = dict(zip(results.table.texts("quantity"), results.table.texts("limit or catalogue"), strict=True))
    assert catalogue["running torque 500 r/min"].startswith("catalogue 100 mN m (recalled: ")
    assert "20 C" in catalogue["running torque 500 r/min"]
    assert catalogue["Coulomb friction"] == ""
    assert "Without a valid tare" in results.page.toPlainText()


def test_a_run_is_fitted_beside_the_window_and_its_figures_are_marked(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    page = opened()
    page.show_run(friction[0])
    details = page.details
    qtbot.mouseClick(details.bar.fit, Qt.MouseButton.LeftButton)
    assert details.is_busy
    assert details.bar.cancel.isVisible()
    qtbot.waitUntil(lambda: not details.is_busy, timeout=LONGEST)
    assert [a.kind for a in read_analyses(friction[0])] == ["friction"]
    assert details.files.table.texts("kind of fit") == ["friction"]
    assert details.results.table.rowCount() == 9
    details.tabs.setCurrentWidget(details.figures)
    assert [plot.name for plot in details.gallery.plots][:2] == ["friction-curve", "friction-curve-low"]
    for row in range(len(details.gallery.plots)):
        details.gallery.titles.setCurrentRow(row)
        assert details.gallery.plot.mark == "SIMULATED"
        assert "[" in details.gallery.plot.item.getAxis("left").labelText


def test_a_fit_is_given_up(opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot) -> None:
    page = opened()
    page.show_run(friction[0])
    page.details.bar.fit.click()
    qtbot.mouseClick(page.details.bar.cancel, Qt.MouseButton.LeftButton)
    assert not page.details.is_busy
    assert page.details.bar.says.text() == "Given up."
    assert page.details.bar.fit.isEnabled()
    assert read_analyses(friction[0]) == ()


@pytest.mark.usefixtures("in_process")
def test_figures_of_a_stored_analysis_are_worked_out_without_a_trace(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    page = opened()
    page.show_run(friction[1])
    page.details.tabs.setCurrentWidget(page.details.figures)
    assert "Working out" in page.details.figure_hint.text()
    qtbot.waitUntil(lambda: bool(page.details.gallery.plots), timeout=LONGEST)
    assert len(read_analyses(friction[1])) == 1


@pytest.mark.usefixtures("in_process")
def test_what_cannot_be_fitted_says_why(
    opened: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot
) -> None:
    path = write_run(session.folder, 300)
    page = opened()
    page.show_run(path)
    page.details.bar.fit.click()
    qtbot.waitUntil(lambda: not page.details.is_busy, timeout=LONGEST)
    assert page.details.bar.says.property("part") == "bad"
    assert page.details.bar.says.text().startswith("This recording cannot be analysed")
    assert "too many cycles were missed" in page.details.bar.says.text()
    assert "Traceback" not in page.details.bar.says.text()


@pytest.mark.usefixtures("in_process")
def test_a_parameter_set_is_held_against_a_run(
    opened: Callable[..., ReviewPage], friction: list[Path], tmp_path: Path, qtbot: QtBot
) -> None:
    file = tmp_path / "set.toml"
    save_gear(shipped_gear(), file)
    page = opened(choose_file=lambda: file)
    page.show_run(friction[0])
    qtbot.mouseClick(page.details.bar.compare, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: not page.details.is_busy, timeout=LONGEST)
    assert page.details.tabs.currentWidget() is page.details.comparison
    assert "MSE (22)" in page.details.comparison.page.toPlainText()
    assert page.details.bar.parameters.currentText() == "set.toml"


def filled(page: ReviewPage, runs: list[Path]) -> ResultCache:
    """The results of the runs as if they had been fitted already."""
    cache = page.overlay.desk.cache
    for number, path in enumerate(runs):
        order = FitOrder(path, "friction" if number else "")
        cache[order.key()] = fit_files([path])[0].result
    return cache


def test_runs_are_overlaid_in_their_colours(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    page = opened()
    filled(page, friction)
    page.library.select(*friction)
    qtbot.mouseClick(page.library.buttons["overlay"], Qt.MouseButton.LeftButton)
    view = page.overlay
    assert page.right.currentWidget() is view
    qtbot.waitUntil(lambda: len(view.overlaid) == 2, timeout=LONGEST)
    view.figure.setCurrentIndex(view.figure.findData("friction-directions"))
    assert {c.group for c in view.plot.curves} == {0, 1}
    assert view.plot.mark == "SIMULATED"
    assert view.plot.curves[0].name.startswith("00001 SN-0815: measured")
    first = view.runs.item(0)
    assert first is not None
    first.setCheckState(Qt.CheckState.Unchecked)
    assert len(view.overlaid) == 1
    assert "no figure in common" in view.says.text()


def test_two_runs_differ_in_their_seed_and_not_in_their_gear(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    page = opened()
    page.library.select(*friction)
    qtbot.mouseClick(page.library.buttons["difference"], Qt.MouseButton.LeftButton)
    view = page.difference
    qtbot.waitUntil(lambda: view.difference is not None, timeout=LONGEST)
    assert "seed" in view.table.texts("what")
    assert "gear" not in view.table.texts("group")
    assert "The same in both: " in view.says.text()
    view.group.setCurrentIndex(view.group.findData("results"))
    assert view.table.texts("group") == ["results"]
    assert view.table.texts("first") == ["not analysed"]


@pytest.mark.usefixtures("in_process")
def test_a_report_is_written_and_opened(opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot) -> None:
    told: list[QUrl] = []
    page = opened(opener=told.append)
    page.library.select(friction[0])
    qtbot.mouseClick(page.library.buttons["report"], Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: bool(told), timeout=LONGEST)
    page_written = report_path([friction[0]])
    assert told == [QUrl.fromLocalFile(str(page_written))]
    assert "SIMULATED" in page_written.read_text(encoding="utf-8")


@pytest.mark.usefixtures("in_process")
def test_a_report_for_paper_is_a_pdf(opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot) -> None:
    told: list[QUrl] = []
    page = opened(opener=told.append)
    page.show_run(friction[0])
    qtbot.mouseClick(page.details.header.pdf, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: bool(told), timeout=LONGEST)
    assert report_path([friction[0]], ".pdf").read_bytes().startswith(b"%PDF-")


def test_a_report_of_several_runs_lies_beside_the_first() -> None:
    assert report_path([Path("r/1-a.h5"), Path("r/2-b.h5")]) == Path("r/1-a-and-1-more.html")


@pytest.mark.usefixtures("in_process")
def test_the_passport_of_a_gear_has_charts_after_its_runs_were_fitted(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    page = opened()
    page.library.select(friction[0])
    qtbot.mouseClick(page.library.buttons["passport"], Qt.MouseButton.LeftButton)
    view = page.passport
    qtbot.waitUntil(lambda: view.passport is not None, timeout=LONGEST)
    assert view.title.text() == "Passport of SN-0815 · CSF-25-120-2UH"
    assert view.mark.text() == "SIMULATED"
    assert set(view.state.texts("runs")) == {"1"}
    assert view.runs.rowCount() == 2
    assert any("friction" in text for text in view.missing.texts("what to do"))
    qtbot.mouseClick(view.analyse, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: not view.is_busy and view.passport is not None, timeout=LONGEST)
    assert set(view.state.texts("runs")) == {"2"}
    assert set(view.state.texts("state")) == {"no control limits yet"}
    row = view.state.texts("what").index(next(t for t in view.state.texts("what") if "500 r/min" in t))
    assert view.state.texts("catalogue limit")[row] in ("–", "100 (recalled)")
    assert view.charts.plot.mark == "SIMULATED"
    assert view.charts.plot.curves
    view.runs.activated.emit(view.runs.model().index(0, 0))
    assert page.right.currentWidget() is page.details


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
    writer = RunWriter(session.folder / "00001-friction-A1.h5", header(), compress=False, chunk_rows=64)
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
    qtbot.waitUntil(lambda: _drawn(details.signals.curves["torque"])[1] > 0.09, timeout=LONGEST)
    writer.append(block(100, 60))
    writer.flush()
    details.refresh()
    assert "160 rows" in details.header.file.text()
    writer.seal("PASS", "2025-11-21T04:41:00.000+00:00")
    qtbot.waitUntil(lambda: details.header.outcome.text() == "✓ PASS", timeout=LONGEST)
    qtbot.waitUntil(lambda: shown(page, "outcome") == ["✓ PASS"], timeout=LONGEST)
    assert details.bar.isEnabled()


def _drawn(curve: Curve) -> tuple[float, float]:
    """From when to when a curve is drawn [s]."""
    x, _ = curve.item.getOriginalDataset()
    return (0.0, 0.0) if x is None or not len(x) else (float(x[0]), float(x[-1]))


def test_signals_are_stacked_by_unit_zoomed_and_read(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    page = opened()
    page.show_run(friction[0])
    view = page.details.signals
    page.details.tabs.setCurrentWidget(view)
    view.choose("torque", "drive_torque", "housing_temperature")
    assert list(view.plots) == ["N m", "degC"]
    assert {plot.mark for plot in view.plots.values()} == {"SIMULATED"}
    torque = view.curves["torque"].item

    qtbot.waitUntil(lambda: _drawn(view.curves["torque"])[1] > 33.0, timeout=LONGEST)
    assert len(torque.getOriginalDataset()[0]) < 5000
    view.jump(10.0, width=1.0)
    qtbot.waitUntil(lambda: np.allclose(_drawn(view.curves["torque"]), (9.5, 10.5), atol=0.1), timeout=LONGEST)
    recording = page.details.recording
    assert recording is not None
    x, y = torque.getOriginalDataset()
    rows = np.round(x * 1000).astype(int)
    np.testing.assert_allclose(y, recording.si("torque")[rows], atol=1e-9)
    qtbot.waitUntil(lambda: bool(view._marks.segments), timeout=LONGEST)
    plot = view.plots["N m"]
    box = plot.item.getViewBox()
    view._point(plot, QPointF(box.mapViewToScene(QPointF(10.0, float(y.mean())))))
    assert view.readout.text().startswith(("10.000 s", "9.99"))
    assert "torque" in view.readout.text()
    assert "segment" in view.readout.text()


def test_thinned_signals_keep_every_peak(friction: list[Path]) -> None:
    from rig.runfile.read import open_run

    recording = open_run(friction[0])
    torque = recording.si("torque")
    (shape,) = shapes_of(recording, ["torque"], 0.0, 1e9, bins=64)
    assert len(shape.values) < 300
    assert (shape.values.min(), shape.values.max()) == (torque.min(), torque.max())


def test_events_are_filtered_and_lead_to_the_signals(opened: Callable[..., ReviewPage], session: WindowSession) -> None:
    path = write_run(session.folder, 2500)
    page = opened()
    page.show_run(path)
    events = page.details.events
    page.details.tabs.setCurrentWidget(events)
    assert events.table.texts("code") == ["NOTE", "DRIFT"]
    events.filter.setCurrentText("notes and answers")
    assert events.table.texts("what") == ["Öl nachgefüllt"]
    events.filter.setCurrentText("warnings and errors")
    assert events.table.texts("level") == ["warning"]
    events.table.activated.emit(events.table.model().index(0, 0))
    assert page.details.tabs.currentWidget() is page.details.signals
    assert page.details.signals.view[0] < 0.0 < page.details.signals.view[1]


def test_conditions_name_calibrations_with_their_certificates(
    opened: Callable[..., ReviewPage], session: WindowSession, qtbot: QtBot
) -> None:
    path = write_run(session.folder, 500)
    page = opened()
    page.show_run(path)
    page.details.tabs.setCurrentWidget(page.details.conditions)
    qtbot.waitUntil(lambda: "PTB-17" in page.details.conditions.toPlainText(), timeout=LONGEST)
    text = page.details.conditions.toPlainText()
    for word in ("2027-02-03", "EL3104 7", "Lubricant", "SK-1A", "1, 2.5 r/min"):
        assert word in text
    session.set_theme("dark")
    assert session.palette.muted in page.details.conditions.toHtml()


def test_files_are_checked_and_an_analysis_is_shown(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    told: list[QUrl] = []
    page = opened(opener=told.append)
    page.show_run(friction[1])
    files = page.details.files
    page.details.tabs.setCurrentWidget(files)
    files.verify.click()
    qtbot.waitUntil(lambda: "readable" in files.findings.text(), timeout=LONGEST)
    assert files.findings.text().startswith("ok   hash")
    files.folder.click()
    assert told == [QUrl.fromLocalFile(str(friction[1].parent))]
    files.table.activated.emit(files.table.model().index(0, 0))
    assert page.details.tabs.currentWidget() is page.details.results
    assert "Analysis 1" in page.details.bar.says.text()


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
            assert button.width() >= button.fontMetrics().horizontalAdvance(button.text().replace("&", "")) + 10
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

    def slowly(path: Path) -> ListedRun:
        read.append(path)
        source._stopped = True  # the window goes while the first file is being read
        return read_listed(path)

    monkeypatch.setattr("rig.library.index.read_listed", slowly)
    source.look()
    source.stop()
    assert source._thread is not None
    assert not source._thread.is_alive()
    assert len(read) <= 1 < len(friction)
