"""One run on the Review page: opened, fitted, held against a parameter set; its signals, events,
conditions and files.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPointF, Qt, QUrl
from pytestqt.qtbot import QtBot

from model.gear_file import save_gear, shipped_gear
from rig.analysis.store import read_analyses
from rig.window.review.page import ReviewPage
from rig.window.review.signals import data
from rig.window.review.signals.data import rows_between, shapes_of
from rig.window.review.words import POINTS, plot_of
from rig.window.shell.session import WindowSession
from tests.rig.runfile.making import write_run
from tests.rig.window.reviewing import LONGEST, drawn


def test_an_opened_run_says_what_when_who_on_which_gear(
    opened: Callable[..., ReviewPage], friction: list[Path]
) -> None:
    page = opened()
    page.show_run(friction[0])
    head = page.details.header
    assert head.title.text() == friction[0].name.removesuffix(".h5")
    assert (head.mark.text(), head.outcome.text()) == ("SIMULATED", "✓ COMPLETED")
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
    catalogue = dict(
        zip(results.table.texts("quantity"), results.table.texts("limit or catalogue"), strict=True)
    )
    assert catalogue["running torque 500 r/min"].startswith("catalogue 100 mN m (recalled: ")
    assert "20 degC" in catalogue["running torque 500 r/min"]
    assert catalogue["Coulomb friction"] == ""
    assert "Without a valid tare" in results.page.toPlainText()


@pytest.mark.usefixtures("in_process")
def test_a_number_that_is_chosen_shows_its_budget_and_leads_to_its_points(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    page = opened()
    page.show_run(friction[1])
    details, results = page.details, page.details.results
    assert "Uncertainty budget" not in results.page.toPlainText().partition("To beware of")[0]
    row = results.table.texts("quantity").index("running torque 500 r/min")
    results.table.selectRow(row)
    shown = results.page.toPlainText().partition("To beware of")[0]
    assert shown.startswith("Running torque 500 r/min")
    assert "Uncertainty budget" in shown
    assert "U (95 %)" in shown
    results.page.anchorClicked.emit(QUrl(POINTS))
    assert details.tabs.currentWidget() is details.figures
    qtbot.waitUntil(lambda: not details.is_busy and bool(details.gallery.plots), timeout=LONGEST)
    chosen = details.gallery.plots[details.gallery.titles.currentRow()]
    assert chosen.name == plot_of(details.gallery.plots, results.chosen)
    assert "torque" in chosen.title.lower()
    details.gallery.choose(next(p.name for p in details.gallery.plots if p.name != chosen.name))
    results.page.anchorClicked.emit(QUrl(POINTS))
    assert details.gallery.plots[details.gallery.titles.currentRow()] is chosen


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
    # Five parameters and the running torques, each at the temperature of the run and at 20 degC.
    assert details.results.table.rowCount() == 14
    details.tabs.setCurrentWidget(details.figures)
    assert [plot.name for plot in details.gallery.plots][:2] == [
        "friction-curve",
        "friction-curve-low",
    ]
    for row in range(len(details.gallery.plots)):
        details.gallery.titles.setCurrentRow(row)
        assert details.gallery.plot.mark == "SIMULATED"
        assert "[" in details.gallery.plot.item.getAxis("left").labelText


def test_a_fit_is_given_up(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
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

    qtbot.waitUntil(lambda: drawn(view.curves["torque"])[1] > 33.0, timeout=LONGEST)
    assert len(torque.getOriginalDataset()[0]) < 5000
    view.jump(10.0, width=1.0)
    qtbot.waitUntil(
        lambda: np.allclose(drawn(view.curves["torque"]), (9.5, 10.5), atol=0.1), timeout=LONGEST
    )
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
    (shape,) = shapes_of(recording, ["torque"], rows_between(recording, 0.0, 1e9), bins=64)
    assert len(shape.values) < 300
    assert (shape.values.min(), shape.values.max()) == (torque.min(), torque.max())


def test_a_long_stretch_is_looked_at_first_and_then_read_whole(
    opened: Callable[..., ReviewPage],
    session: WindowSession,
    qtbot: QtBot,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(data, "FIRST_LOOK", 400)
    monkeypatch.setattr(data, "_PIECE", 100)
    path = write_run(session.folder, 2500)
    page = opened()
    view = page.details.signals
    seen: list[tuple[int, str]] = []
    draw = view._draw

    def watched(shapes: list[data.Shape]) -> None:
        draw(shapes)
        seen.append((len(shapes[0].time), view.readout.text()))

    view._reading.done.disconnect(view._draw)
    view._reading.done.connect(watched)
    page.details.tabs.setCurrentWidget(view)
    page.show_run(path)
    qtbot.waitUntil(lambda: bool(seen) and not view._reading.is_running, timeout=LONGEST)
    assert len(seen) == 2
    (first, says), (whole, says_then) = seen
    assert 0 < first < 0.4 * whole
    assert "first look" in says
    assert "first look" not in says_then


def test_events_are_filtered_and_lead_to_the_signals(
    opened: Callable[..., ReviewPage], session: WindowSession
) -> None:
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
