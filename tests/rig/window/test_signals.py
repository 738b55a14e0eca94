"""The signals of a run: the wheel zooms time, y refits, two cursors measure, and what is seen is taken along."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QImage, QWheelEvent
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from experiments.recording import Recording
from model.units import RPM
from rig.errors import RunFileError
from rig.runfile.read import close_recording, open_run
from rig.window.review.signals.cursors import COLUMNS, between_words, stretch_row
from rig.window.review.signals.data import LABORATORY, SI, Speed
from rig.window.review.signals.export import export_rows
from rig.window.review.signals.stretch import stretches_of
from rig.window.review.signals.view import SignalsView
from rig.window.shell.session import WindowSession
from tests.rig.runfile.making import write_run
from tests.rig.window.reviewing import LONGEST, destroy

ROWS = 2500


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """2.5 s of a synthetic run at 1 kHz; every 97th row is incomplete."""
    return write_run(tmp_path_factory.mktemp("signals"), ROWS)


@pytest.fixture
def recording(run: Path) -> Iterator[Recording]:
    opened = open_run(run)
    yield opened
    close_recording(opened)


@pytest.fixture
def view(session: WindowSession, recording: Recording, qtbot: QtBot) -> Iterator[SignalsView]:
    """The page over the run, its torque drawn."""
    made = SignalsView(session)
    made.resize(900, 500)
    made.show()
    made.show_recording(recording, "SIMULATED")
    made.choose("torque", "input_angle")
    qtbot.waitUntil(lambda: made.curves["torque"].item.xData is not None, timeout=LONGEST)
    yield made
    for task in (made._reading, made._between, made._writing, made._marker):
        task.wait()
    destroy(made)


def complete(recording: Recording, first: int, last: int) -> np.ndarray:
    rows = np.arange(first, last + 1)
    return rows[recording.flags(slice(first, last + 1)) & 1 == 0]


def test_statistics_between_two_times_are_those_of_the_complete_rows(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocks = type(recording).blocks
    # Several blocks: what joins them is tested too.
    monkeypatch.setattr(
        type(recording), "blocks", lambda self, where=None, size=0: blocks(self, where, 300)
    )
    torque, angle = stretches_of(recording, ["torque", "input_angle"], 0.2, 1.9, SI)
    rows = complete(recording, 200, 1900)
    time = recording.time()[rows]
    assert (torque.rows, torque.incomplete) == (len(rows), 1701 - len(rows))
    for one, name in ((torque, "torque"), (angle, "input_angle")):
        y = recording.si(name)[rows]
        expected = (y[0], y[-1], y.mean(), y.std(ddof=1), y.min(), y.max())
        found = (one.first, one.last, one.mean, one.std, one.smallest, one.largest)
        np.testing.assert_allclose(found, expected, rtol=1e-12)
        assert one.slope == pytest.approx(np.polyfit(time, y, 1)[0], rel=1e-9)
        assert one.change == pytest.approx(y[-1] - y[0])


def test_a_speed_is_measured_and_a_stretch_without_rows_says_nothing(recording: Recording) -> None:
    (speed,) = stretches_of(recording, ["input_speed"], 0.5, 1.5)
    assert speed.unit == "r/min"
    turned = np.diff(recording.si("input_angle")[[500, 1500]])[0]
    assert speed.mean == pytest.approx(turned / RPM, rel=1e-9)
    assert (speed.smallest, speed.largest) == pytest.approx((speed.mean, speed.mean))
    (nothing,) = stretches_of(recording, ["torque"], 7.0, 8.0)
    assert nothing.rows == 0
    assert np.isnan((nothing.mean, nothing.std, nothing.slope, nothing.change)).all()


def test_one_choice_draws_every_signal_in_its_units_and_is_remembered(
    view: SignalsView, recording: Recording, session: WindowSession, qtbot: QtBot
) -> None:
    view.choose("input_speed", "input_angle", "torque")
    view.show_all()
    assert list(view.plots) == ["r/min", "deg", "N m"]
    qtbot.waitUntil(lambda: view.curves["input_angle"].item.yData is not None)
    in_degrees = np.ptp(view.curves["input_angle"].item.yData)
    view.units.setCurrentText(SI)
    assert list(view.plots) == ["rad/s", "rad", "N m"]
    assert view.chosen == ["input_speed", "input_angle", "torque"]
    qtbot.waitUntil(lambda: view.curves["input_angle"].item.yData is not None)
    assert np.ptp(view.curves["input_angle"].item.yData) == pytest.approx(np.deg2rad(in_degrees))
    assert "[rad/s]" in view.channels.item(0).text()
    again = SignalsView(session)
    qtbot.addWidget(again)
    assert again.units.currentText() == SI
    again.units.setCurrentText(LABORATORY)


def test_a_speed_does_not_depend_on_where_its_stretch_begins(recording: Recording) -> None:
    whole = Speed(recording, "input_speed", 0).of(slice(0, ROWS))
    later = Speed(recording, "input_speed", 1000).of(slice(1000, 1500))
    np.testing.assert_allclose(later, whole[1000:1500])
    incomplete = recording.flags(slice(1000, 1500)) & 1 == 1
    assert np.isnan(later[incomplete]).all()
    assert np.isfinite(later[~incomplete]).all()


def test_the_wheel_zooms_time_and_the_height_fits_what_is_seen(
    view: SignalsView, recording: Recording, qtbot: QtBot
) -> None:
    plot = view.plots["deg"]
    box = plot.item.getViewBox()
    middle = box.mapToDevice(box.boundingRect().center()) or box.boundingRect().center()
    place = plot.canvas.mapFromScene(box.mapToScene(box.boundingRect().center()))
    before = box.viewRange()
    turn = QWheelEvent(
        QPointF(place),
        QPointF(plot.canvas.viewport().mapToGlobal(place)),
        QPoint(),
        QPoint(0, 1200),
        Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier,
        Qt.ScrollPhase.NoScrollPhase,
        False,
    )
    assert middle is not None
    QApplication.sendEvent(plot.canvas.viewport(), turn)
    begin, end = view.view
    assert before[0][0] < begin < end < before[0][1]
    qtbot.waitUntil(lambda: not view._reading.is_running, timeout=LONGEST)

    def fits() -> bool:
        plot.canvas.grab()
        low, high = box.viewRange()[1]
        seen = np.rad2deg(recording.si("input_angle"))[round(begin * 1000) : round(end * 1000)]
        return low <= seen.min() and seen.max() <= high and high - low < 1.3 * np.ptp(seen)

    qtbot.waitUntil(fits, timeout=LONGEST)
    # The other plot shows the same time.
    assert view.plots["N m"].item.getViewBox().viewRange()[0] == pytest.approx([begin, end])


def test_cursors_measure_what_lies_between_them(
    view: SignalsView, recording: Recording, qtbot: QtBot
) -> None:
    cursors = view.cursors
    assert not cursors.table.isVisible()
    cursors.switch.click()
    a, b = cursors.moments
    assert 0.0 < a < b < 2.5
    line_b = cursors._lines["B"][0]
    line_b.setValue(1.75)
    cursors.times["A"].setValue(0.75)
    assert cursors.moments == (0.75, 1.75)
    assert {line.value() for line in cursors._lines["A"]} == {0.75}
    assert len(cursors._lines["A"]) == len(view.plots) == 2
    qtbot.waitUntil(lambda: cursors.says.text().startswith("B − A 1.0000 s"), timeout=LONGEST)
    assert "1/(B − A) 1 Hz" in cursors.says.text()
    rows = complete(recording, 750, 1750)
    torque = recording.si("torque")[rows]
    place = cursors.table.texts("channel").index("torque")
    assert float(cursors.table.texts("mean")[place].replace("−", "-")) == pytest.approx(
        torque.mean(), rel=1e-5
    )
    assert float(cursors.table.texts("B − A")[place].replace("−", "-")) == pytest.approx(
        torque[-1] - torque[0], rel=1e-5
    )
    assert f"{1001 - len(rows)} incomplete left out" in cursors.says.text()
    # Another choice of channels keeps the cursors where they are.
    view.choose("torque")
    assert {line.value() for line in cursors._lines["B"]} == {1.75}
    qtbot.waitUntil(lambda: cursors.table.texts("channel") == ["torque"], timeout=LONGEST)


def test_crossed_cursors_turn_the_difference_round(recording: Recording) -> None:
    (one,) = stretches_of(recording, ["input_angle"], 0.5, 1.0)
    straight, crossed = (
        dict(zip([at.heading for at in COLUMNS], stretch_row(one, crossed=c), strict=True))
        for c in (False, True)
    )
    assert crossed["at A"] == straight["at B"]
    assert crossed["B − A"].startswith("−")
    assert crossed["slope [/s]"] == straight["slope [/s]"]
    assert between_words(1.0, 0.5, [one]).startswith("B − A −0.5000 s   ·   1/(B − A) −2 Hz")


def read_back(path: Path) -> tuple[list[str], dict[str, np.ndarray]]:
    lines = path.read_text(encoding="utf-8").splitlines()
    notes = [line for line in lines if line.startswith("#")]
    heading, *rows = csv.reader(lines[len(notes) :])
    columns = np.array([[float(cell or "nan") for cell in row] for row in rows]).T
    return notes, dict(zip(heading, columns, strict=True))


def test_every_row_between_the_cursors_is_taken_along_in_si(
    view: SignalsView, recording: Recording, qtbot: QtBot, tmp_path: Path
) -> None:
    target = tmp_path / "rows.csv"
    view.choose("torque", "input_speed")
    view.cursors.switch.click()
    view.cursors.place(0.4, 0.9)
    view.choose_target = lambda _: target
    view.export.click()
    qtbot.waitUntil(lambda: not view._writing.is_running and target.exists(), timeout=LONGEST)
    notes, table = read_back(target)
    assert any("SIMULATED" in line for line in notes)
    rows = slice(400, 901)
    np.testing.assert_allclose(table["time [s]"], recording.time(rows))
    np.testing.assert_allclose(table["torque [N m]"], recording.si("torque", rows), atol=3.1e-6)
    np.testing.assert_allclose(
        table["input_angle [rad]"], recording.si("input_angle", rows), atol=2e-5
    )
    expected = Speed(recording, "input_speed", 400).of(rows)
    np.testing.assert_allclose(table["input_speed [rad/s]"], expected, rtol=1e-8)
    np.testing.assert_array_equal(table["flags"], recording.flags(rows))
    assert [path.name for path in tmp_path.iterdir() if path.name != "runs"] == ["rows.csv"]


def test_what_is_in_view_is_taken_along_where_there_are_no_cursors(
    view: SignalsView, tmp_path: Path, qtbot: QtBot
) -> None:
    target = tmp_path / "rows.csv"
    view.choose_target = lambda _: target
    view._look_at(1.0, 1.5)
    begin, end = view.view
    view.export.click()
    qtbot.waitUntil(lambda: not view._writing.is_running and target.exists(), timeout=LONGEST)
    _, table = read_back(target)
    assert begin <= table["time [s]"][0] < begin + 0.001
    assert end - 0.001 < table["time [s]"][-1] <= end


def test_a_stretch_without_rows_and_a_folder_that_is_not_there_are_refused(
    view: SignalsView, recording: Recording, tmp_path: Path, qtbot: QtBot
) -> None:
    with pytest.raises(RunFileError, match="no row lies in this stretch"):
        export_rows(recording, ["torque"], 8.0, 9.0, tmp_path / "rows.csv")
    for suffix in (".csv", ".png", ".svg"):
        view.choose_target = lambda _, suffix=suffix: tmp_path / "nowhere" / f"seen{suffix}"
        said: list[str] = []
        view._session.message.connect(said.append)
        view.export.click()
        qtbot.waitUntil(
            lambda said=said: any("cannot be written" in s for s in said), timeout=LONGEST
        )


def test_the_plots_are_taken_along_as_picture_and_as_drawing(
    view: SignalsView, tmp_path: Path
) -> None:
    for suffix in (".png", ".svg"):
        view.choose_target = lambda _, suffix=suffix: tmp_path / f"seen{suffix}"
        view.export.click()
    picture = QImage(str(tmp_path / "seen.png"))
    assert picture.width() == 2 * view._stack.width()
    colours = {picture.pixel(x, y) for x in range(0, picture.width(), 5) for y in range(0, 300, 5)}
    assert len(colours) > 5
    drawing = (tmp_path / "seen.svg").read_text(encoding="utf-8")
    # Letters and lines, no pixels.
    assert "<image" not in drawing
    assert drawing.count("<polyline") + drawing.count("<path") > 20
    assert "SIMULATED" in drawing
    assert "time since the first row [s]" in drawing
