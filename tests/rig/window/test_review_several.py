"""Several runs on the Review page: overlaid, their difference, a gear's passport, and reports."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from PySide6.QtCore import Qt, QUrl
from pytestqt.qtbot import QtBot

from model.gear_file import load_gear, save_gear, shipped_gear
from rig.analysis.fit.run import fit_run
from rig.analysis.in_force import in_force
from rig.analysis.store import json_text, read_analyses
from rig.analysis.tare import FoundTare
from rig.gears.card import now_text, save_card, with_changes
from rig.window.review.fit import FitOrder, ResultCache
from rig.window.review.page import ReviewPage, report_path
from rig.window.review.passport import missing_fits
from rig.window.shell.session import WindowSession
from rig.window.work.background import BackgroundCommand
from tests.rig.runfile.making import reseal
from tests.rig.window.reviewing import LONGEST, indexed


def filled(page: ReviewPage, runs: list[Path]) -> ResultCache:
    """The results of the runs as if they had been fitted already."""
    cache = page.overlay.desk.cache
    for number, path in enumerate(runs):
        order = FitOrder(path, "friction" if number else "")
        cache[order.key()] = fit_run(path).result
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


def test_models_are_judged_by_runs_that_they_have_not_seen(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    page = opened()
    models = page.library.buttons["models"]
    page.library.select(friction[0])
    assert not models.isEnabled()
    page.library.select(*friction)
    qtbot.mouseClick(models, Qt.MouseButton.LeftButton)
    view = page.models
    assert page.right.currentWidget() is view
    qtbot.waitUntil(lambda: view.validation is not None, timeout=LONGEST)
    assert view.validation is not None
    assert "each of 2 runs predicted by a fit of the others" in view.says.text()
    assert view.validation.best.name in view.says.text()
    assert view.plot.mark == "SIMULATED"
    assert view.table.rowCount() == len(view.validation.rungs)
    first = view.table.item(0, 0)
    assert first is not None
    assert first.text() == "1  mean torque (null)"


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
def test_a_report_is_written_and_opened(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    told: list[QUrl] = []
    page = opened(opener=told.append)
    page.library.select(friction[0])
    qtbot.mouseClick(page.library.buttons["report"], Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: bool(told), timeout=LONGEST)
    page_written = report_path([friction[0]])
    assert told == [QUrl.fromLocalFile(str(page_written))]
    assert "SIMULATED" in page_written.read_text(encoding="utf-8")


@pytest.mark.usefixtures("in_process")
def test_a_report_for_paper_is_a_pdf(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
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
    assert set(view.state.texts("state")) == {"learning", "not watched"}
    row = view.state.texts("quantity").index(
        next(t for t in view.state.texts("quantity") if "500 r/min" in t)
    )
    assert view.state.texts("catalogue limit")[row] in ("–", "100 (recalled)")
    assert view.charts.plot.mark == "SIMULATED"
    assert view.charts.plot.curves
    view.runs.activated.emit(view.runs.model().index(0, 0))
    assert page.right.currentWidget() is page.details


@pytest.mark.usefixtures("in_process")
def test_the_report_of_the_gear_is_written_from_its_passport(
    opened: Callable[..., ReviewPage], friction: list[Path], qtbot: QtBot
) -> None:
    told: list[QUrl] = []
    page = opened(opener=told.append)
    page.library.select(friction[0])
    qtbot.mouseClick(page.library.buttons["passport"], Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: page.passport.passport is not None, timeout=LONGEST)
    qtbot.mouseClick(page.passport.report, Qt.MouseButton.LeftButton)
    assert not page.passport.pdf.isEnabled()
    qtbot.waitUntil(lambda: bool(told), timeout=LONGEST)
    written = friction[0].with_name("gear-SN-0815.html")
    assert told == [QUrl.fromLocalFile(str(written))]
    assert "SIMULATED" in written.read_text(encoding="utf-8")
    assert page.passport.pdf.isEnabled()


def test_a_report_chooses_no_tare_of_its_own_and_leaves_that_to_the_analysis_in_force(
    opened: Callable[..., ReviewPage], friction: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[str]] = []
    monkeypatch.setattr(BackgroundCommand, "start", lambda self: asked.append(self._arguments[2:]))
    analysis = read_analyses(friction[1])[0]
    with_tare = {**analysis.content, "tare": {"run": friction[0].name.removesuffix(".h5")}}
    analysis.path.write_text(json_text(with_tare), encoding="utf-8")
    reseal(analysis.path)
    found = in_force(friction[1]).analysis
    assert found is not None
    assert found.content == json.loads(json_text(with_tare))
    page = opened()
    page.make_report([friction[1]])
    # With --tare the report would be made anew, by hand; without, it reads what is in force.
    assert asked == [
        ["report", str(friction[1]), "--output", str(report_path([friction[1]]))],
    ]


@pytest.mark.usefixtures("in_process")
def test_what_was_identified_is_saved_as_a_parameter_set(
    opened: Callable[..., ReviewPage], friction: list[Path], tmp_path: Path, qtbot: QtBot
) -> None:
    target = tmp_path / "found.toml"
    page = opened()
    page.show_run(friction[0])
    page.details.bar.choose_target = lambda: target
    qtbot.mouseClick(page.details.bar.save, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: not page.details.is_busy, timeout=LONGEST)
    assert load_gear(target) == shipped_gear()
    assert page.details.bar.says.text().endswith(
        "(friction of motor and gear together stays out: choose a tare)."
    )
    save_gear(shipped_gear().with_values({"inertia.output": 0.2}), target)
    page.details.parameters._take_saved(target, 0, "")
    assert "found.toml, with 1 identified value." in page.details.bar.says.text()
    assert read_analyses(friction[0]) == ()


def test_friction_without_a_tare_waits_for_a_fit_once_there_is_one(
    friction: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = [
        indexed(number, path=path, gear_serial="SN-0815", protocol="friction")
        for number, path in enumerate(friction, 1)
    ]
    assert [order.run for order in missing_fits(runs, "SN-0815")] == [friction[0]]
    broken_off = indexed(3, path=friction[0], gear_serial="SN-0815", outcome="ABORTED")
    assert [order.run for order in missing_fits([broken_off, *runs[1:]], "SN-0815")] == []
    monkeypatch.setattr(
        "rig.window.review.passport.find_tare", lambda *_: FoundTare(Path("tare.h5"))
    )
    found = missing_fits(runs, "SN-0815")
    # Which tare it is the analysis finds by itself: the page names none.
    assert [(order.run, order.tare) for order in found] == [(path, None) for path in friction]


def test_a_stale_analysis_waits_for_a_fit(friction: list[Path], session: WindowSession) -> None:
    run = indexed(2, path=friction[1], gear_serial="SN-0815", protocol="friction")
    assert missing_fits([run], "SN-0815") == []
    facts = {"serial": "SN-0815", "load_inertia_kg_m2": 0.05}
    save_card(session.folder, with_changes(None, facts, "A. Example", now_text()))
    (order,) = missing_fits([run], "SN-0815")
    assert (order.run, order.keep) == (friction[1], True)
