"""The page Fleet: reads a lot beside the window, filters it, draws it, and leads from a gear to its run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel
from pytestqt.qtbot import QtBot

pytest.importorskip("pyarrow")
pytest.importorskip("duckdb")

from rig.window.fleet import page as fleet
from rig.window.fleet.page import NOTHING, FleetPage
from rig.window.shell.session import WindowSession
from tests.extras.lots import FAILING, MARGINAL, NOT_ANALYSED, UNLIKE, shares, write_lot
from tests.rig.window.conftest import LONGEST
from tests.rig.window.reviewing import destroy


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_lot(tmp_path_factory.mktemp("made") / "fleet-results")


@pytest.fixture
def read(session: WindowSession, qtbot: QtBot, results: Path) -> Iterator[FleetPage]:
    """The page over the made-up lot, read."""
    page = FleetPage(session)
    page.folder = results
    page.resize(1000, 600)
    page.show()
    qtbot.waitUntil(lambda: page.lot is not None, timeout=LONGEST)
    yield page
    destroy(page)


def test_the_page_shows_the_gears_of_the_lot(read: FleetPage) -> None:
    assert len(read.shown) == read.gears.rowCount() == 60
    assert read.gears.texts("verdict")[FAILING] == "FAIL"
    assert read.count.text() == "60 gears: 57 PASS, 1 MARGINAL, 1 FAIL, 1 NOT JUDGED"
    assert read.quantity.itemText(0).startswith("running torque")
    assert read.plots.distribution.mark == read.plots.scatter.mark == "SIMULATED"
    assert "Cpk" in read.says.text()


def test_the_filter_leaves_the_gears_that_are_asked_for(read: FleetPage) -> None:
    read.verdict.setCurrentText("FAIL")
    assert [one.gear for one in read.shown] == [f"G{FAILING:03d}"]
    assert list(read.plots.places) == [f"G{FAILING:03d}"]
    read.verdict.setCurrentIndex(0)
    read.bench.setCurrentText("B")
    assert {one.bench for one in read.shown} == {"B"}
    read.text.setText("g03 no friction")
    assert [one.gear for one in read.shown] == [f"G{NOT_ANALYSED:03d}"]
    assert read.plots.places == {}
    read.text.setText("nothing is called so")
    assert read.shown == ()
    assert "0 of 60 gears" in read.count.text()


def test_a_point_lies_where_its_values_are_and_chooses_its_gear(read: FleetPage) -> None:
    # The first limit of the file is the kinematic error forward, the third the running torque.
    read.quantity.setCurrentText("running torque 2000 r/min at 20 °C")
    read.beside.setCurrentText("transmission accuracy forward")
    x, y = read.plots.places[f"G{MARGINAL:03d}"]
    made = shares()[MARGINAL]
    quantities = {one.title: one for one in read.lot.quantities} if read.lot else {}
    torque = quantities["running torque 2000 r/min at 20 °C"]
    assert torque.shown_in[1] == "mN m"
    assert (x, y) == (pytest.approx(119.0 * made[2]), pytest.approx(1.3 * made[0]))
    assert len(read.plots.places) == 59
    read.plots.gear_clicked.emit(f"G{MARGINAL:03d}")
    assert read.chosen is not None
    assert read.chosen.gear == f"G{MARGINAL:03d}"
    assert read.open_run.isEnabled()


def test_a_click_on_a_point_is_one_on_its_gear(read: FleetPage, qtbot: QtBot) -> None:
    plot = read.plots.scatter
    x, y = read.plots.places[f"G{FAILING:03d}"]
    (curve,) = (one for one in plot.curves if one.name == "bench B")
    points = curve.item.scatter.pointsAt(curve.item.scatter.mapToView(_point(x, y)))
    with qtbot.waitSignal(read.plots.gear_clicked) as clicked:
        curve.item.sigPointsClicked.emit(curve.item, points, None)
    assert clicked.args == [f"G{FAILING:03d}"]


def _point(x: float, y: float) -> object:
    from PySide6.QtCore import QPointF

    return QPointF(x, y)


def test_from_a_gear_to_its_run_or_a_word_that_it_is_elsewhere(
    read: FleetPage, session: WindowSession, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    read.choose_gear("G003")
    with qtbot.waitSignal(session.message) as said:
        qtbot.mouseClick(read.open_run, Qt.MouseButton.LeftButton)
    assert said.args == ["The run is not at this computer: /runs/00003-friction-G003.h5"]
    monkeypatch.setattr(Path, "is_file", lambda _: True)
    with qtbot.waitSignal(read.run_chosen) as chosen:
        read.open_run.click()
    assert chosen.args == [Path("/runs/00003-friction-G003.h5")]


def test_without_results_and_without_the_extra_a_sentence_says_so(
    session: WindowSession, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, results: Path
) -> None:
    page = FleetPage(session, choose_folder=lambda _: str(results))
    page.show()
    qtbot.waitUntil(lambda: not page.is_reading, timeout=LONGEST)
    assert (page.empty.isVisible(), page.both.isVisible()) == (True, False)
    assert NOTHING in [one.text() for one in page.empty.findChildren(QLabel)]
    monkeypatch.setattr("rig.extras.find_spec", lambda _: None)
    page.read()
    qtbot.waitUntil(
        lambda: "pip install 'harmonic-rig[fleet]'" in page.count.text(), timeout=LONGEST
    )
    monkeypatch.undo()
    session.run_exists = True
    page._open_folder()
    assert page.folder == session.folder
    session.run_exists = False
    page._open_folder()
    qtbot.waitUntil(lambda: page.lot is not None, timeout=LONGEST)
    assert (page.empty.isVisible(), page.both.isVisible()) == (False, True)
    destroy(page)


class Command:
    """A command that ends when it is told to."""

    begun: ClassVar[list[Command]] = []

    def __init__(self, arguments: list[str], _: object, done: Callable[[int, str, str], None]):
        self.arguments, self.done = arguments, done

    def start(self) -> None:
        self.begun.append(self)


def test_a_folder_is_fitted_and_shown_and_one_at_a_time(
    session: WindowSession, qtbot: QtBot, results: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet, "BackgroundCommand", Command)
    page = FleetPage(session, choose_folder=lambda _: "/runs")
    page.show()
    qtbot.waitUntil(lambda: not page.is_reading, timeout=LONGEST)
    assert [button.isEnabled() for button in page.papers] == [False, False]
    session.run_exists = True
    page._fit()
    assert Command.begun == [], "nothing may stand before STOP, nor fit beside a run"
    session.run_exists = False
    page._fit()
    page._fit()
    (command,) = Command.begun
    assert command.arguments == ["fleet", "fit", "/runs", "--json"]
    assert page.count.text() == "Fitting the runs of /runs …"
    assert not any(button.isEnabled() for button in page.makers)
    command.done(0, json.dumps({"output": str(results)}), "")
    qtbot.waitUntil(lambda: page.lot is not None, timeout=LONGEST)
    assert all(button.isEnabled() for button in page.makers)
    page._fit()
    Command.begun[-1].done(6, "", "Error: /runs: there is no run here.")
    assert page.count.text() == "Error: /runs: there is no run here."
    Command.begun.clear()
    destroy(page)


def test_the_reports_are_written_beside_the_results_and_opened(
    read: FleetPage, session: WindowSession, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet, "BackgroundCommand", Command)
    opened: list[Path] = []
    read.open_paper = lambda path: bool(opened.append(path)) or True
    for button, word, file in zip(
        read.papers, ("report", "rr"), ("lot.html", "gauge.html"), strict=True
    ):
        qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
        command = Command.begun.pop()
        target = read.folder / file
        asked = ["fleet", word, str(read.folder), "--output", str(target), "--json"]
        assert command.arguments == asked
        with qtbot.waitSignal(session.message) as said:
            command.done(0, "{}", "")
        assert said.args == [f"Opened: {target}"]
        assert opened.pop() == target


@pytest.mark.parametrize("size", [(1366, 768), (1120, 640)])
def test_nothing_is_cut_off(read: FleetPage, size: tuple[int, int], qtbot: QtBot) -> None:
    # The navigation and the line at the foot take 70 pixels of the window.
    read.resize(size[0], size[1] - 70)
    assert read.minimumSizeHint().width() <= size[0]
    assert read.minimumSizeHint().height() <= size[1] - 70
    # Words that wrap would make the page as high as the plots like to be, and scroll it.
    assert not read.hasHeightForWidth()
    for box in (read.quantity, read.beside, read.bench, read.verdict):
        words = max((box.itemText(i) for i in range(box.count())), key=len)
        assert box.fontMetrics().horizontalAdvance(words) <= box.width() - 36, words
    labels = [
        one
        for one in read.findChildren(QLabel)
        if one.isVisible() and one.text() and not one.wordWrap() and one is not read.where
    ]
    assert len(labels) > 5
    for label in labels:
        assert label.width() >= label.sizeHint().width(), label.text()


def test_the_rules_of_the_report_are_those_of_the_page(read: FleetPage) -> None:
    assert read.lot is not None
    assert fleet.lot_of(read.folder).verdicts == read.lot.verdicts


def test_bars_count_gears_and_one_far_off_is_named_and_flattens_nothing(read: FleetPage) -> None:
    """The lot has a gear whose starting torque is a third of the others'."""
    torque = read.plots.distribution
    read.quantity.setCurrentText("starting torque")
    read.beside.setCurrentText("transmission accuracy reverse")
    bars = next(curve for curve in torque.curves if curve.style == "bars")
    assert sum(bars.item.opts["height"]) == 59
    assert f"beyond: G{UNLIKE:03d} at 21 mN m" in torque._title.text()
    assert f"G{UNLIKE:03d}" in read.plots.scatter._title.text()
    (low, high), _ = read.plots.scatter.item.viewRange()
    x, _ = read.plots.places[f"G{UNLIKE:03d}"]
    assert x < low
    others = [place[0] for gear, place in read.plots.places.items() if gear != f"G{UNLIKE:03d}"]
    assert max(others) - min(others) > 0.8 * (high - low)
